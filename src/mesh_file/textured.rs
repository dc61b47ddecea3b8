//! The mesh of a cut with its sheets, in a GLB: as many atlases as there have to be, each with the part of the mesh that it shows.

use super::{Ready, facts};
use crate::progress::Meter;
use crate::stop;
use crate::whole::{Order, Whole};
use anyhow::{Context, Result, ensure};
use chpm_build::Cancel;
use chpm_export::{TexturedPart, write_textured};
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, Page, Sheet, SheetRecord};
use chpm_image::ImageRows;
use chpm_mesh::{ClusterId, Places, pm};
use chpm_refine::Cut;
use chpm_texture::sheet::{halved, pack};
use std::collections::BTreeMap;
use std::io::Cursor;

/// Bytes of a texel of an atlas and of the sheet that goes into it, and of a triangle and its vertices.
const TEXEL: u64 = 12;
const TRIANGLE: u64 = 120;

/// Triangles that one sheet shows.
struct Item {
    cluster: ClusterId,
    /// How often its image is halved, so that it fits.
    halvings: u32,
    size: [u32; 2],
    /// The vertices that are left; or the corners of one triangle of any position.
    what: What,
}

#[derive(Clone, Copy)]
enum What {
    Position(u32),
    One([u16; 3]),
}

/// Bytes that writing takes for a mesh of so many triangles.
pub(crate) fn memory(side: u32, triangles: u64) -> u64 {
    TEXEL * u64::from(side).pow(2) + TRIANGLE * triangles
}

impl Ready<'_, '_> {
    /// Writes the mesh with images of at most `side` texels a side; answers how many.
    pub(crate) fn write_textured(
        self,
        file: &Chpm<MappedFile>,
        cut: &Cut,
        side: u32,
        meter: &Meter,
        cancel: &Cancel,
    ) -> Result<usize> {
        let offset = self.offset();
        let Ready { target, mesh, frame, turn, bounds, .. } = self;
        let whole = Whole::new(mesh, frame, Order::File, cancel)?;
        let mut facts = facts(file, &whole, target.by, bounds, offset, turn);
        facts.scalars.clear();
        let items = items(file, cut, side);
        meter.start("write", items.len() as u64);
        let mut parts = Vec::new();
        for (some, places, height) in atlases(&items, side) {
            let atlas = Atlas::new([side, height.next_multiple_of(16)]);
            parts.push(atlas.fill(file, &items, &some, &places, !target.args.no_normals, (meter, cancel))?);
        }
        let count = parts.len();
        let output = write_textured(target.output, &facts, &parts)?;
        file.get_ref().check_unchanged()?;
        output.publish()?;
        meter.finish();
        Ok(count)
    }
}

/// Triangles of a cut, sheet by sheet.
fn items(file: &Chpm<MappedFile>, cut: &Cut, side: u32) -> Vec<Item> {
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
    members.chain(remnants).map(item).collect()
}

/// Items by atlas, with their places in it and the rows that they take.
fn atlases(items: &[Item], side: u32) -> Vec<(Vec<usize>, Vec<[u32; 2]>, u32)> {
    let mut left: Vec<usize> = (0..items.len()).collect();
    left.sort_by_key(|at| std::cmp::Reverse(items[*at].size[1]));
    let packed = |some: &[usize]| {
        let sizes: Vec<[u32; 2]> = some.iter().map(|at| items[*at].size).collect();
        pack(&sizes, side)
    };
    let mut atlases = Vec::new();
    while !left.is_empty() {
        // As many as fit, by halves; one always does.
        let (mut fits, mut too_many) = (1, left.len() + 1);
        while too_many - fits > 1 {
            let count =
                if too_many > left.len() && fits * 2 < left.len() { fits * 2 } else { (fits + too_many) / 2 };
            if packed(&left[..count]).1 <= side { fits = count } else { too_many = count }
        }
        let some: Vec<usize> = left.drain(..fits).collect();
        let (places, rows) = packed(&some);
        atlases.push((some, places, rows));
    }
    atlases
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

    fn fill(
        mut self,
        file: &Chpm<MappedFile>,
        items: &[Item],
        some: &[usize],
        places: &[[u32; 2]],
        with_normals: bool,
        (meter, cancel): (&Meter, &Cancel),
    ) -> Result<TexturedPart> {
        for (item, place) in some.iter().map(|at| &items[*at]).zip(places) {
            stop::check(cancel)?;
            let sheet = file.sheet(item.cluster)?.context("a cluster lacks its sheet")?;
            self.put_image(&sheet, item, *place)?;
            let page = file.page(item.cluster)?;
            self.put_triangles(&page.view(), &sheet, item, *place, with_normals);
            meter.add(1);
        }
        let Atlas { size, texels, mut part } = self;
        let image = chpm_image::encode(&texels, size.map(|side| side as u16))?;
        (part.image, part.is_png) = (image.bytes, image.is_png);
        Ok(part)
    }

    fn put_image(&mut self, sheet: &Sheet<'_>, item: &Item, [x, y]: [u32; 2]) -> Result<()> {
        let mut size = sheet.record.size.map(u32::from);
        let bytes = Cursor::new(sheet.image.to_vec());
        let mut rows =
            ImageRows::open(bytes, u64::MAX).with_context(|| format!("sheet of {}", item.cluster))?;
        let is_right = rows.size() == size;
        ensure!(
            is_right,
            "sheet of {}: an image of {:?}, not of {size:?}; chpm verify tells more",
            item.cluster,
            rows.size()
        );
        let mut pixels = Vec::new();
        rows.read_rows(size[1] as usize, &mut pixels)
            .with_context(|| format!("sheet of {}", item.cluster))?;
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
        let mut known: BTreeMap<(u16, u16), u32> = BTreeMap::new();
        for (corners, chart) in triangles(page, sheet, item.what) {
            let corners = corners.map(|corner| {
                *known.entry((corner, chart)).or_insert_with(|| {
                    let vertex = usize::from(corner);
                    let position = page.positions[vertex];
                    let scale = f64::from(1 << item.halvings);
                    let in_sheet =
                        sheet.layout.charts[usize::from(chart)].place(sheet.layout.origin, position);
                    self.part.positions.push(position);
                    self.part.places.push(std::array::from_fn(|axis| {
                        let texel = f64::from(place[axis]) + in_sheet[axis] / scale;
                        (texel / f64::from(self.size[axis])) as f32
                    }));
                    if let Some(normal) = page.normal(vertex).filter(|_| with_normals) {
                        self.part.normals.push(normal);
                    }
                    self.part.positions.len() as u32 - 1
                })
            });
            self.part.triangles.push(corners);
        }
    }
}

/// Triangles that are drawn, and their charts.
fn triangles(page: &Page<'_>, sheet: &Sheet<'_>, what: What) -> Vec<([u16; 3], u16)> {
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
