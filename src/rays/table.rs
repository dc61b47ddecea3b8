//! Files of rays: text with a ray on each line, or an array of NumPy.

use super::npy::{self, Kind, Shape};
use anyhow::{Context, Result, bail, ensure};
use chpm_rays::Ray;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// A file of rays that is read from front to back.
pub(crate) struct RayFile {
    path: PathBuf,
    from: BufReader<File>,
    /// Of an array; text has none.
    shape: Option<Shape>,
    /// Lines or rows that were read.
    line: u64,
    /// Whether names of columns, or a ray, came before.
    is_begun: bool,
    text: Vec<u8>,
}

/// Bytes of a line, at most.
const LONGEST: u64 = 1 << 14;

impl RayFile {
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let unread = || format!("cannot read '{}'", path.display());
        let mut from = BufReader::with_capacity(1 << 18, File::open(path).with_context(unread)?);
        let mut magic = [0; npy::MAGIC.len()];
        let mut shape = None;
        let is_array = match from.read_exact(&mut magic) {
            Ok(()) => &magic == npy::MAGIC,
            Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => false,
            Err(error) => return Err(error).with_context(unread),
        };
        if is_array {
            shape = Some(npy::read(&mut from).with_context(unread)?);
        } else {
            from.seek(SeekFrom::Start(0)).with_context(unread)?;
        }
        Ok(RayFile { path: path.to_owned(), from, shape, line: 0, is_begun: false, text: Vec::new() })
    }

    /// Appends rays, as many as there are and `most` at most; none at the end. Positions are about `origin`.
    pub(crate) fn next(&mut self, most: usize, origin: [f64; 3], rays: &mut Vec<Ray>) -> Result<()> {
        while rays.len() < most {
            let read = if let Some(shape) = self.shape { self.row(shape) } else { self.text_line() };
            let kind = if self.shape.is_some() { "row" } else { "line" };
            let place = || format!("'{}', {kind} {}", self.path.display(), self.line);
            let Some((numbers, count)) = read.with_context(place)? else { break };
            rays.push(ray(&numbers[..count], origin).with_context(place)?);
        }
        Ok(())
    }

    fn row(&mut self, shape: Shape) -> Result<Option<([f64; 7], usize)>> {
        if self.line == shape.rows {
            let more = self.from.fill_buf()?.len();
            ensure!(more == 0, "the file goes on behind the array's last row; save it again with numpy.save");
            return Ok(None);
        }
        self.line += 1;
        let mut numbers = [0.0; 7];
        for number in &mut numbers[..shape.columns] {
            let mut bytes = [0; 8];
            let bytes = &mut bytes[..if shape.kind == Kind::F32 { 4 } else { 8 }];
            self.from
                .read_exact(bytes)
                .with_context(|| format!("the file ends here, and has {} rows by its header", shape.rows))?;
            *number = match *bytes {
                [a, b, c, d] => f32::from_le_bytes([a, b, c, d]).into(),
                [a, b, c, d, e, f, g, h] => f64::from_le_bytes([a, b, c, d, e, f, g, h]),
                _ => f64::NAN,
            };
        }
        Ok(Some((numbers, shape.columns)))
    }

    fn text_line(&mut self) -> Result<Option<([f64; 7], usize)>> {
        loop {
            self.text.clear();
            self.line += 1;
            let read = (&mut self.from).take(LONGEST).read_until(b'\n', &mut self.text)?;
            if read == 0 {
                return Ok(None);
            }
            ensure!(
                (read as u64) < LONGEST,
                "a line of a ray expected, got one of more than {LONGEST} bytes"
            );
            let text = std::str::from_utf8(&self.text).ok();
            // Of what is no text, lines may look like names of columns.
            let text = text.filter(|text| !text.trim_end().contains(|c: char| c.is_control() && c != '\t'));
            let text =
                text.context("text expected: a ray on each line, or an array that numpy.save wrote")?;
            let text = text.trim_start_matches('\u{feff}').trim();
            if text.is_empty() || text.starts_with('#') {
                continue;
            }
            let words = || text.split([',', ';', ' ', '\t']).filter(|word| !word.is_empty());
            if !std::mem::replace(&mut self.is_begun, true)
                && words().all(|word| word.parse::<f64>().is_err())
            {
                continue;
            }
            let mut numbers = [0.0; 7];
            let mut count = 0;
            for word in words() {
                let Ok(number) = word.parse() else { bail!("a number expected, got '{word}'") };
                ensure!(count < 7, "6 or 7 numbers expected, got more");
                numbers[count] = number;
                count += 1;
            }
            return Ok(Some((numbers, count)));
        }
    }
}

/// A ray of 6 numbers, or of 7 with its reach.
fn ray(numbers: &[f64], origin: [f64; 3]) -> Result<Ray> {
    let ([x, y, z, dx, dy, dz], reach) = match *numbers {
        [x, y, z, dx, dy, dz] => ([x, y, z, dx, dy, dz], f64::INFINITY),
        [x, y, z, dx, dy, dz, reach] => ([x, y, z, dx, dy, dz], reach),
        _ => bail!(
            "6 numbers expected (origin x, y, z, direction x, y, z), or 7 with how far the ray goes; got {}",
            numbers.len()
        ),
    };
    let from = [x - origin[0], y - origin[1], z - origin[2]];
    let ray = Ray { reach, ..Ray::new(from, [dx, dy, dz]) };
    if !ray.is_sound() {
        bail!(
            "finite numbers, a direction of some length and a reach of at least 0 expected, got {numbers:?}"
        );
    }
    Ok(ray)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8]) -> Result<Vec<Ray>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rays");
        std::fs::write(&path, bytes).unwrap();
        let mut file = RayFile::open(&path)?;
        let mut all = Vec::new();
        loop {
            let mut some = Vec::new();
            file.next(2, [1.0, 0.0, 0.0], &mut some)?;
            if some.is_empty() {
                return Ok(all);
            }
            all.extend(some);
        }
    }

    #[test]
    fn rays_are_read_from_text() {
        let text = "# rays\nox,oy,oz,dx,dy,dz\n1,2,3,0,0,1\n\n 1 2 3 0 0 -1 5\n1;2;3;1;0;0;inf\n";
        let rays = read(text.as_bytes()).unwrap();
        assert_eq!(rays.len(), 3);
        assert_eq!((rays[0].origin, rays[1].reach), ([0.0, 2.0, 3.0], 5.0));
        assert_eq!(read(b"").unwrap(), []);
    }

    #[test]
    fn what_is_no_ray_is_told_with_its_line() {
        for (text, told) in [
            ("1,2,3,0,0,1\n1,2,3\n", "line 2"),
            ("1,2,3,0,0,0\n", "a direction of some length"),
            ("1,2,3,0,0,nan\n", "finite numbers"),
            ("1,2,3,0,0,1,-1\n", "a reach of at least 0"),
            ("x,y\na,b\n", "line 2"),
            ("1,2,3,0,0,1\nx,y,z,u,v,w\n", "got 'x'"),
            ("1,2,3,4,5,6,7,8\n", "got more"),
            ("\u{1}\u{2}", "line 1"),
        ] {
            let error = format!("{:#}", read(text.as_bytes()).unwrap_err());
            assert!(error.contains(told), "{text}: {error}");
        }
        assert!(format!("{:#}", read(&[0xff, 0xfe, 0, 10]).unwrap_err()).contains("text expected"));
    }

    #[test]
    fn arrays_are_read_to_their_last_row() {
        let array = |rows: u64, has: usize| {
            let dict = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({rows}, 6), }}\n");
            let mut bytes =
                [&b"\x93NUMPY\x01\x00"[..], &(dict.len() as u16).to_le_bytes(), dict.as_bytes()].concat();
            (0..has).for_each(|_| {
                [1.0_f64, 2.0, 3.0, 0.0, 0.0, 1.0].iter().for_each(|x| bytes.extend(x.to_le_bytes()))
            });
            bytes
        };
        assert_eq!(read(&array(3, 3)).unwrap().len(), 3);
        assert!(format!("{:#}", read(&array(3, 2)).unwrap_err()).contains("row 3"));
        assert!(format!("{:#}", read(&array(3, 4)).unwrap_err()).contains("goes on"));
        assert!(read(&array(3, 3)[..20]).is_err());
    }

    /// Whatever happens to a file, it is rays, all of them sound, or an error that names a place.
    #[test]
    fn spoilt_files_are_rays_or_errors() {
        let text = b"# rays\nx,y,z,u,v,w\n1,2,3,0,0,1\n1e3;-2;3;0;0;1;9\n".to_vec();
        let dict = "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 7), }\n";
        let head = [&b"\x93NUMPY\x01\x00"[..], &(dict.len() as u16).to_le_bytes(), dict.as_bytes()].concat();
        let array = [head, [1.0_f32; 21].iter().flat_map(|x| x.to_le_bytes()).collect()].concat();
        let mut state = 5_u64;
        let mut draw = |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % below.max(1)
        };
        let (mut read_well, mut refused) = (0, 0);
        for number in 0..6000 {
            let mut bytes = if number % 2 == 0 { text.clone() } else { array.clone() };
            for _ in 0..=draw(3) {
                let at = draw(bytes.len());
                match draw(4) {
                    0 => bytes.truncate(at),
                    1 => bytes.insert(at, b"0,-e.\n\xff(')"[draw(10)]),
                    _ if bytes.is_empty() => {}
                    2 => bytes[at] ^= 1 << draw(8),
                    _ => bytes[at] = draw(256) as u8,
                }
            }
            match read(&bytes) {
                Ok(rays) => {
                    assert!(rays.iter().all(Ray::is_sound));
                    read_well += 1;
                }
                Err(error) => {
                    let error = format!("{error:#}");
                    assert!(error.contains("rays'"), "{error}");
                    refused += 1;
                }
            }
        }
        assert!(read_well > 500 && refused > 500, "{read_well} {refused}");
    }
}
