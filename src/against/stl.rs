//! STL: facets, each with its own corners.

use super::mesh::{Corners, Mesh};
use super::stream::{Stream, real, words};
use anyhow::{Result, bail, ensure};
use chpm_import::Triangulator;

/// Reads binary facets: a header of 80 bytes, a count, and records of 50 bytes.
pub(super) fn read_binary(mut stream: Stream, mesh: &mut Mesh<'_>) -> Result<()> {
    let count = if stream.skip(80)? { stream.take()?.map(u32::from_le_bytes) } else { None };
    let Some(count) = count else { bail!(stream.wrong("expected a header of 84 bytes")) };
    for read in 0..count {
        let Some(record) = stream.take::<50>()? else {
            ensure!(
                mesh.drops,
                stream.wrong(format!("the file ends here, and {} facets are missing", count - read))
            );
            mesh.counts.missing_faces += u64::from(count - read);
            break;
        };
        // Behind the normal.
        let number =
            |at: usize| f32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]);
        let corner = |k: usize| [0, 4, 8].map(|axis| f64::from(number(12 + 12 * k + axis)));
        facet([corner(0), corner(1), corner(2)], &stream, mesh)?;
    }
    Ok(())
}

/// Reads facets as text: `facet`, any number of `vertex` lines, `endfacet`.
pub(super) fn read_ascii(mut stream: Stream, mesh: &mut Mesh<'_>) -> Result<()> {
    let (mut line, mut corners, mut is_inside, mut solids) = (Vec::new(), Vec::new(), false, 0);
    while stream.line(&mut line)? {
        let mut words = words(&line);
        while let Some(word) = words.next() {
            match (word.to_ascii_lowercase().as_str(), is_inside) {
                ("solid", false) => {
                    solids += 1;
                    break;
                }
                ("endsolid", false) => {
                    solids -= 1;
                    break;
                }
                ("facet", false) => {
                    is_inside = true;
                    corners.clear();
                    break;
                }
                ("outer" | "loop" | "endloop", true) => {}
                ("vertex", true) => {
                    let mut corner = [0.0; 3];
                    for x in &mut corner {
                        let word = words.next().unwrap_or("the end of the line");
                        let told = || format!("expected a number, got '{}'", word.escape_default());
                        *x = real(word, f64::NAN).ok_or_else(|| stream.wrong(told()))?;
                    }
                    corners.push(corner);
                }
                ("endfacet", true) => {
                    is_inside = false;
                    polygon(&corners, &stream, mesh)?;
                }
                (word, _) => bail!(stream.wrong(format!("not understood: '{}'", word.escape_default()))),
            }
        }
    }
    if is_inside || solids > 0 {
        ensure!(mesh.drops, stream.wrong("the file ends in the middle of a solid"));
        mesh.counts.missing_faces += u64::from(is_inside);
    }
    Ok(())
}

/// A facet of any number of corners.
fn polygon(corners: &[[f64; 3]], stream: &Stream, mesh: &mut Mesh<'_>) -> Result<()> {
    if !corners.as_flattened().iter().all(|x| x.is_finite()) {
        ensure!(mesh.drops, stream.wrong("a coordinate that is not finite"));
        mesh.counts.dropped_faces += 1;
        return Ok(());
    }
    mesh.counts.degenerate_faces += u64::from(corners.len() < 3);
    mesh.counts.polygons_triangulated += u64::from(corners.len() > 3);
    if let &[a, b, c] = corners {
        return facet([a, b, c], stream, mesh);
    }
    let numbers: Vec<u32> = (0..corners.len() as u32).collect();
    let mut triangles = Vec::new();
    mesh.counts.degenerate_faces += Triangulator::default().cut(&numbers, corners, &mut triangles);
    triangles.into_iter().try_for_each(|t| facet(t.map(|corner| corners[corner as usize]), stream, mesh))
}

fn facet(corners: Corners, stream: &Stream, mesh: &mut Mesh<'_>) -> Result<()> {
    if corners.as_flattened().iter().all(|x| x.is_finite()) {
        // Corners are joined by position, and zero is one, whatever its sign.
        return mesh.facet(corners.map(|corner| corner.map(|x| x + 0.0)));
    }
    ensure!(mesh.drops, stream.wrong("a coordinate that is not finite"));
    mesh.counts.dropped_faces += 1;
    Ok(())
}
