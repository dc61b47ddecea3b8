//! The mesh of a cut with its sheets: as many images as there have to be, each with the part of the mesh that it shows.

use crate::error::ExportError;
use crate::finer::{self, Coarseness, FineSheet};
use crate::textured::{Charted, PartImage, TexturedPart};
use chpm_format::{Chpm, Page, SheetLayout, SheetRecord};
use chpm_mesh::{ClusterId, Places, pm};
use chpm_refine::Cut;
use chpm_texture::sheet::{halved, pack};

/// Bytes of a texel of an image while it is written, of one of a sheet that waits for it, and of a triangle and its vertices.
const TEXEL: u64 = 12;
const WAITING: u64 = 4;
const TRIANGLE: u64 = 120;
/// Steps by which texels that fit are looked for, and how much larger they are taken where they did not.
const STEPS: u32 = 24;
const LARGER: f64 = 1.06;
/// How often that is tried, and from how much finer texels on it is worth it.
const TRIES: u32 = 3;
const WORTH: f64 = 1.05;

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

    /// Bytes that the parts of a mesh of so many triangles take, one image, and its sheets.
    pub fn memory<D: AsRef<[u8]>>(file: &Chpm<D>, side: u32, triangles: u64) -> u64 {
        let texels = u64::from(side).pow(2);
        let image = (TEXEL * texels).max(WAITING * texels + finer::memory(file, texels));
        image + TRIANGLE * triangles
    }

    /// Clusters, and triangles by themselves.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Whether the cut has none.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// The parts of the mesh, each with its image. Where one image has room for more than the sheets of the file, texels become finer, up to those of the source. `check` is called often and may end it; `put` is told each item.
    ///
    /// # Errors
    /// [`ExportError::Format`] and [`ExportError::Sheet`] for damaged pages and sheets; what `check` answers.
    pub fn parts<D: AsRef<[u8]>, E: From<ExportError>>(
        &self,
        file: &Chpm<D>,
        mut check: impl FnMut() -> Result<(), E>,
        mut put: impl FnMut(),
    ) -> Result<Vec<TexturedPart>, E> {
        let stored: Vec<[u32; 2]> = self.items.iter().map(|item| item.size).collect();
        let mut images = self.divided(&stored);
        let mut finer = match images.len() {
            1 => self.finer(file, &stored, &mut check)?,
            _ => None,
        };
        if let Some(sheets) = &finer {
            images = self.divided(&sizes_of(sheets, &stored));
        }
        let mut parts = Vec::new();
        for (some, places, height) in images {
            let mut atlas = Atlas::new([self.side, height.next_multiple_of(16)]);
            for (at, place) in some.iter().zip(&places) {
                check()?;
                put();
                let finer = finer.as_mut().and_then(|sheets| sheets[*at].take());
                atlas.put(file, &self.items[*at], finer, *place, self.with_normals)?;
            }
            parts.push(atlas.finish()?);
        }
        Ok(parts)
    }

    /// Sheets that fill one image as far as they can, by item; none for items that keep their own, and where nothing becomes finer. Given the sizes that are stored.
    fn finer<D: AsRef<[u8]>, E: From<ExportError>>(
        &self,
        file: &Chpm<D>,
        stored: &[[u32; 2]],
        check: &mut impl FnMut() -> Result<(), E>,
    ) -> Result<Option<Vec<Option<FineSheet>>>, E> {
        let coarseness = Coarseness::new(file);
        let own = |item: &Item| match item.what {
            What::Position(_) if item.halvings == 0 => coarseness.of(item.cluster),
            _ => 1.0,
        };
        // How many times longer sides of sheets are where texels are so many times coarser than the finest.
        let longer = |item: &Item, coarser: f64| (own(item) / coarser).max(1.0);
        let fits = |coarser: f64| {
            let scaled = |item: &Item| {
                item.size.map(|side| ((f64::from(side) * longer(item, coarser)) as u32).next_multiple_of(16))
            };
            let sizes: Vec<[u32; 2]> = self.items.iter().map(scaled).collect();
            sizes.iter().flatten().all(|side| *side <= self.side) && self.divided(&sizes).len() == 1
        };
        // As the finest, or else by halves of what is between.
        let (mut fine, mut coarse) = (1.0, self.items.iter().map(own).fold(1.0, f64::max));
        if fits(fine) {
            coarse = fine;
        }
        for _ in 0..STEPS {
            let between = (fine + coarse) / 2.0;
            *(if fits(between) { &mut coarse } else { &mut fine }) = between;
        }
        for _ in 0..TRIES {
            if self.items.iter().all(|item| longer(item, coarse) < WORTH) {
                return Ok(None);
            }
            let sheets = self.items.iter().map(|item| match longer(item, coarse) {
                longer if longer < WORTH => Ok(None),
                _ => coarseness.sheet(item.cluster, coarse, check).map(|(sheet, _)| Some(sheet)),
            });
            let sheets = sheets.collect::<Result<Vec<_>, E>>()?;
            let sizes = sizes_of(&sheets, stored);
            if sizes.iter().flatten().all(|side| *side <= self.side) && self.divided(&sizes).len() == 1 {
                return Ok(Some(sheets));
            }
            coarse *= LARGER;
        }
        Ok(None)
    }

    /// Items by image, with their places in it and the rows that they take, given their sizes.
    fn divided(&self, sizes: &[[u32; 2]]) -> Vec<(Vec<usize>, Vec<[u32; 2]>, u32)> {
        let mut left: Vec<usize> = (0..sizes.len()).collect();
        left.sort_by_key(|at| std::cmp::Reverse(sizes[*at][1]));
        let packed = |some: &[usize]| {
            let sizes: Vec<[u32; 2]> = some.iter().map(|at| sizes[*at]).collect();
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

/// Sizes of the sheets that are finer, and of the others as they are.
fn sizes_of(finer: &[Option<FineSheet>], stored: &[[u32; 2]]) -> Vec<[u32; 2]> {
    finer
        .iter()
        .zip(stored)
        .map(|(finer, stored)| finer.as_ref().map_or(*stored, |sheet| sheet.size))
        .collect()
}

/// Whether many of the texels that are not opaque are seen a little: glass, and not leaves whose borders are.
fn is_blended(texels: &[[u8; 4]]) -> bool {
    let count = |is: fn(u8) -> bool| texels.iter().filter(|texel| is(texel[3])).count();
    2 * count(|alpha| (26..=229).contains(&alpha)) > count(|alpha| alpha < 255)
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
        finer: Option<FineSheet>,
        place: [u32; 2],
        with_normals: bool,
    ) -> Result<(), ExportError> {
        let sheet = finer.map_or_else(|| FineSheet::stored(file, item.cluster), Ok)?;
        let layout = self.put_image(sheet, item.halvings, place);
        self.put_triangles(&file.page(item.cluster)?.view(), &layout, item, place, with_normals);
        Ok(())
    }

    fn finish(self) -> Result<TexturedPart, ExportError> {
        let Atlas { size, texels, mut part } = self;
        let image = chpm_image::encode(&texels, size.map(|side| side as u16))?;
        (part.image, part.is_png) = (PartImage::Inside(image.bytes), image.is_png);
        part.is_blended = is_blended(&texels);
        Ok(part)
    }

    fn put_image(&mut self, sheet: FineSheet, halvings: u32, [x, y]: [u32; 2]) -> SheetLayout {
        let FineSheet { layout, mut size, texels: mut pixels } = sheet;
        for _ in 0..halvings {
            (pixels, size) = halved(&pixels, size);
        }
        let (width, stride) = (size[0] as usize, self.size[0] as usize);
        for (row, texels) in pixels.chunks_exact(width).enumerate() {
            let begin = (y as usize + row) * stride + x as usize;
            self.texels[begin..begin + width].copy_from_slice(texels);
        }
        layout
    }

    fn put_triangles(
        &mut self,
        page: &Page<'_>,
        layout: &SheetLayout,
        item: &Item,
        place: [u32; 2],
        with_normals: bool,
    ) {
        let drawn = drawn(page, layout, item.what).into_iter();
        let charted = Charted::new(drawn.map(|(corners, chart)| (corners.map(u32::from), chart)));
        let (first, scale) = (self.part.positions.len() as u32, f64::from(1 << item.halvings));
        for (vertex, chart) in charted.vertices {
            let vertex = vertex as usize;
            let position = page.positions[vertex];
            let in_sheet = layout.charts[usize::from(chart)].place(layout.origin, position);
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
fn drawn(page: &Page<'_>, layout: &SheetLayout, what: What) -> Vec<([u16; 3], u16)> {
    let (mesh, charts) = (page.progressive_mesh(), &layout.chart_of);
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
