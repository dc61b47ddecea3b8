//! The mesh of a cut with its sheets: as many images as there have to be, each with the part of the mesh that it shows.

use crate::error::ExportError;
use crate::textured::{Charted, PartImage, TexturedPart};
use chpm_format::{Chpm, Page, Sheet, SheetRecord};
use chpm_image::ImageRows;
use chpm_mesh::{ClusterId, Places, pm};
use chpm_refine::Cut;
use chpm_texture::sheet::{halved, pack};
use std::io::Cursor;

/// Bytes of a texel of an image and of the sheet that goes into it, and of a triangle and its vertices.
const TEXEL: u64 = 12;
const TRIANGLE: u64 = 120;

/// Triangles that one sheet shows.
struct Item {
    cluster: ClusterId,
    /// How often its image is halved, so that it fits.
    halvings: u32,
    size: [u32; 2],
    what: What,
}

/// The vertices that are left; or the corners of one triangle of any position.
#[derive(Clone, Copy)]
enum What {
    Position(u32),
    One([u16; 3]),
}

/// Packs the sheets of a cut into images of one longest side.
pub struct Atlases {
    items: Vec<Item>,
    side: u32,
    with_normals: bool,
}

impl Atlases {
    /// Images of at most `side` texels a side for a cut of a file that has sheets.
    pub fn new<D: AsRef<[u8]>>(file: &Chpm<D>, cut: &Cut, side: u32, with_normals: bool) -> Self {
        let members = cut.members().iter().map(|member| (member.cluster, What::Position(member.vertices)));
        let remnants = cut.remnants().iter().map(|number| {
            let remnant = &file.remnants()[*number as usize];
            (remnant.cluster(), What::One(remnant.corners))
        });
        let item = |(cluster, what): (ClusterId, What)| {
            let SheetRecord { size: sides, .. } = file.sheets()[cluster.index()];
            let (mut size, mut halvings) = (sides.map(u32::from), 0);
            while size.iter().any(|length| *length > side) {
                (size, halvings) = (size.map(|length| length.div_ceil(2)), halvings + 1);
            }
            Item { cluster, halvings, size, what }
        };
        Atlases { items: members.chain(remnants).map(item).collect(), side, with_normals }
    }

    /// Bytes that the parts of a mesh of so many triangles take, and one image.
    pub fn memory(side: u32, triangles: u64) -> u64 {
        TEXEL * u64::from(side).pow(2) + TRIANGLE * triangles
    }

    /// Clusters, and triangles by themselves.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Whether the cut has none.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// The parts of the mesh, each with its image. `begun` is told each item and may end it.
    ///
    /// # Errors
    /// [`ExportError::Format`] and [`ExportError::Sheet`] for damaged pages and sheets; what `begun` answers.
    pub fn parts<D: AsRef<[u8]>, E: From<ExportError>>(
        &self,
        file: &Chpm<D>,
        mut begun: impl FnMut() -> Result<(), E>,
    ) -> Result<Vec<TexturedPart>, E> {
        let mut parts = Vec::new();
        for (some, places, height) in self.divided() {
            let mut atlas = Atlas::new([self.side, height.next_multiple_of(16)]);
            for (item, place) in some.iter().map(|at| &self.items[*at]).zip(&places) {
                begun()?;
                atlas.put(file, item, *place, self.with_normals)?;
            }
            parts.push(atlas.finish()?);
        }
        Ok(parts)
    }

    /// Items by image, with their places in it and the rows that they take.
    fn divided(&self) -> Vec<(Vec<usize>, Vec<[u32; 2]>, u32)> {
        let mut left: Vec<usize> = (0..self.items.len()).collect();
        left.sort_by_key(|at| std::cmp::Reverse(self.items[*at].size[1]));
        let packed = |some: &[usize]| {
            let sizes: Vec<[u32; 2]> = some.iter().map(|at| self.items[*at].size).collect();
            pack(&sizes, self.side)
        };
        let mut images = Vec::new();
        while !left.is_empty() {
            // As many as fit, by halves; one always does.
            let (mut fits, mut too_many) = (1, left.len() + 1);
            while too_many - fits > 1 {
                let count = if too_many > left.len() && fits * 2 < left.len() {
                    fits * 2
                } else {
                    (fits + too_many) / 2
                };
                if packed(&left[..count]).1 <= self.side { fits = count } else { too_many = count }
            }
            let some: Vec<usize> = left.drain(..fits).collect();
            let (places, rows) = packed(&some);
            images.push((some, places, rows));
        }
        images
    }
}

/// An image while sheets are put into it.
struct Atlas {
    size: [u32; 2],
    texels: Vec<[u8; 4]>,
    part: TexturedPart,
}

impl Atlas {
    fn new(size: [u32; 2]) -> Self {
        let texels = vec![[0, 0, 0, 255]; size[0] as usize * size[1] as usize];
        Atlas { size, texels, part: TexturedPart::default() }
    }

    fn put<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        item: &Item,
        place: [u32; 2],
        with_normals: bool,
    ) -> Result<(), ExportError> {
        let failed = |reason: String| ExportError::Sheet { cluster: item.cluster, reason };
        let sheet = file.sheet(item.cluster)?.ok_or_else(|| failed("there is none".to_owned()))?;
        self.put_image(&sheet, item, place).map_err(failed)?;
        self.put_triangles(&file.page(item.cluster)?.view(), &sheet, item, place, with_normals);
        Ok(())
    }

    fn finish(self) -> Result<TexturedPart, ExportError> {
        let Atlas { size, texels, mut part } = self;
        let image = chpm_image::encode(&texels, size.map(|side| side as u16))?;
        (part.image, part.is_png) = (PartImage::Inside(image.bytes), image.is_png);
        Ok(part)
    }

    fn put_image(&mut self, sheet: &Sheet<'_>, item: &Item, [x, y]: [u32; 2]) -> Result<(), String> {
        let mut size = sheet.record.size.map(u32::from);
        let bytes = Cursor::new(sheet.image.to_vec());
        let mut rows = ImageRows::open(bytes, u64::MAX).map_err(|error| error.to_string())?;
        if rows.size() != size {
            return Err(format!("an image of {:?}, not of {size:?}", rows.size()));
        }
        let mut pixels = Vec::new();
        rows.read_rows(size[1] as usize, &mut pixels).map_err(|error| error.to_string())?;
        for _ in 0..item.halvings {
            (pixels, size) = halved(&pixels, size);
        }
        let (width, stride) = (size[0] as usize, self.size[0] as usize);
        for (row, texels) in pixels.chunks_exact(width).enumerate() {
            let begin = (y as usize + row) * stride + x as usize;
            self.texels[begin..begin + width].copy_from_slice(texels);
        }
        Ok(())
    }

    fn put_triangles(
        &mut self,
        page: &Page<'_>,
        sheet: &Sheet<'_>,
        item: &Item,
        place: [u32; 2],
        with_normals: bool,
    ) {
        let drawn = drawn(page, sheet, item.what).into_iter();
        let charted = Charted::new(drawn.map(|(corners, chart)| (corners.map(u32::from), chart)));
        let (first, scale) = (self.part.positions.len() as u32, f64::from(1 << item.halvings));
        for (vertex, chart) in charted.vertices {
            let vertex = vertex as usize;
            let position = page.positions[vertex];
            let in_sheet = sheet.layout.charts[usize::from(chart)].place(sheet.layout.origin, position);
            self.part.positions.push(position);
            self.part.places.push(std::array::from_fn(|axis| {
                let texel = f64::from(place[axis]) + in_sheet[axis] / scale;
                (texel / f64::from(self.size[axis])) as f32
            }));
            if let Some(normal) = page.normal(vertex).filter(|_| with_normals) {
                self.part.normals.push(normal);
            }
        }
        self.part.triangles.extend(charted.triangles.iter().map(|corners| corners.map(|v| first + v)));
    }
}

/// Triangles that are drawn, and their charts.
fn drawn(page: &Page<'_>, sheet: &Sheet<'_>, what: What) -> Vec<([u16; 3], u16)> {
    let (mesh, charts) = (page.progressive_mesh(), &sheet.layout.chart_of);
    let all = page.triangles.iter().zip(charts);
    match what {
        What::Position(vertices) => {
            let mut places = Places::default();
            places.go_to(&mesh, vertices as usize);
            let now = all.map(|(corners, chart)| (corners.map(|corner| places.of(corner)), *chart));
            now.filter(|(corners, _)| pm::is_alive(corners)).collect()
        }
        What::One(corners) => {
            let turned =
                |state: [u16; 3]| (0..3).any(|turn| [0, 1, 2].map(|at| state[(at + turn) % 3]) == corners);
            let mut with_it = all.filter(|(finest, _)| mesh.states(**finest).any(turned));
            with_it.next().map(|(_, chart)| (corners, *chart)).into_iter().collect()
        }
    }
}
