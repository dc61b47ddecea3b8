//! A cluster as the GPU has it: its vertices, written once, and behind them room for the triangles of any position of its progressive
//! mesh; and behind those, if it has a sheet, where that is and the chart of each triangle ([`super::sheets`]).
//!
//! A unit is a vertex: position, which way it faces, and colour if the file has colours. So a block can start wherever a vertex could, and its first
//! unit is the number that is added to its corners. The corners are those of one position, in the order of the file; they are written
//! whenever the position is another one ([`super::Arena::move_to`]), and are all that is written again.

use crate::tint::Tint;
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, Page};
use chpm_mesh::ClusterId;
use chpm_mesh::facing::{Facing, facings};

/// Words of a vertex.
pub fn words_of_unit(colors: bool) -> u32 {
    if colors { 5 } else { 4 }
}

/// The parts of a block.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Layout {
    /// Vertices of the finest mesh: units, from its start.
    pub vertices: u32,
    /// Triangles of the finest mesh, for the corners of which there is room behind the vertices.
    pub triangles: u32,
    /// Units of all.
    pub units: u32,
    /// Bytes of a unit.
    pub unit: u32,
    /// Charts of its sheet, which come behind the corners with the chart of each triangle; 0 for no sheet.
    pub charts: u32,
}

/// Words in front of the charts of a sheet, and words of each.
pub const CHARTS_HEAD: u32 = 8;
pub const CHART: u32 = 8;

impl Layout {
    /// The layout of a cluster with these counts, and so many charts of a sheet.
    pub fn new(vertices: u32, triangles: u32, colors: bool, charts: u32) -> Self {
        let unit = 4 * words_of_unit(colors);
        let mut layout = Layout { vertices, triangles, units: 0, unit, charts };
        layout.units = vertices + (4 * (layout.corner_words() + layout.sheet_words())).div_ceil(unit);
        layout
    }

    /// The layout of a cluster of a file.
    pub fn of(file: &Chpm<MappedFile>, cluster: ClusterId, tint: &Tint) -> Self {
        let record = &file.clusters()[cluster.index()];
        let charts = tint.charts(file, cluster);
        Layout::new(record.vertex_count, record.triangle_count, tint.is_there(), charts)
    }

    fn corner_words(&self) -> u32 {
        (3 * self.triangles).div_ceil(2)
    }

    fn sheet_words(&self) -> u32 {
        match self.charts {
            0 => 0,
            charts => CHARTS_HEAD + CHART * charts + self.triangles.div_ceil(2),
        }
    }

    /// Where what is told of its sheet begins: words from the start of the block.
    pub fn sheet_at(&self) -> u32 {
        self.vertices * (self.unit / 4) + self.corner_words()
    }

    /// Where the charts of its triangles begin: words from the start of the block.
    pub fn chart_numbers_at(&self) -> u32 {
        self.sheet_at() + CHARTS_HEAD + CHART * self.charts
    }

    /// Bytes of the block.
    pub fn bytes(&self) -> u64 {
        u64::from(self.units) * u64::from(self.unit)
    }

    /// Bytes of its vertices.
    pub fn vertex_bytes(&self) -> u64 {
        u64::from(self.vertices) * u64::from(self.unit)
    }
}

/// Part of a cluster's block that is written once.
#[derive(Clone, Debug, Default)]
pub struct Block {
    layout: Layout,
    words: Vec<u32>,
}

impl Block {
    /// Makes the block of a page that was checked, in its own colours.
    pub fn of_page(page: &Page<'_>) -> Self {
        Self::tinted(page, &Tint::own(page), 0)
    }

    /// The same in other colours, and with room for so many charts.
    pub fn tinted(page: &Page<'_>, tint: &Tint, charts: u32) -> Self {
        let (vertices, triangles) = (page.positions.len() as u32, page.triangles.len() as u32);
        let layout = Layout::new(vertices, triangles, tint.is_there(), charts);
        let own = if page.attributes().has_normals() {
            Vec::new()
        } else {
            facings(page.positions, page.triangles)
        };
        let mut words = Vec::with_capacity((layout.vertex_bytes() / 4) as usize);
        for (vertex, [x, y, z]) in page.positions.iter().enumerate() {
            let facing = page.normal(vertex).map_or_else(|| own[vertex], Facing::of_normal);
            words.extend([x.to_bits(), y.to_bits(), z.to_bits(), facing.code()]);
            words.extend(tint.color(page, vertex).map(bytemuck::cast::<[u8; 4], u32>));
        }
        debug_assert_eq!(4 * words.len() as u64, layout.vertex_bytes());
        Block { layout, words }
    }

    /// Which way one of its vertices faces.
    pub fn turn(&mut self, vertex: u16, code: u32) {
        let words = self.layout.unit as usize / 4;
        self.words[usize::from(vertex) * words + 3] = code;
    }

    /// Where its parts are.
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// The bytes of its vertices.
    pub fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(&self.words)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_format::PageParts;
    use chpm_mesh::VertexSlices;

    #[test]
    fn a_unit_is_a_vertex() {
        for (colors, words) in [(&[][..], 4), (&[[1, 2, 3, 255], [4, 5, 6, 255], [7, 8, 9, 255]], 5)] {
            let parts = PageParts {
                vertices: VertexSlices {
                    colors,
                    ..VertexSlices::new(&[[0.0, 0.0, 0.5], [2.0, 0.0, 0.5], [2.0, 2.0, 0.5]])
                },
                triangles: &[[0, 1, 2]],
                ..PageParts::default()
            };
            let mut page = Vec::new();
            parts.encode(&mut page).unwrap();
            let block = Block::of_page(&Page::parse(&page).unwrap());
            assert_eq!(block.layout(), Layout::new(3, 1, words == 5, 0));
            // Six bytes of corners are less than a unit.
            assert_eq!(block.layout().bytes(), 4 * 4 * words);
            assert_eq!(block.bytes().len() as u64, block.layout().vertex_bytes());
            for (vertex, bytes) in block.bytes().chunks_exact(4 * words as usize).enumerate() {
                let words: &[u32] = bytemuck::cast_slice(bytes);
                let expected = parts.vertices.positions[vertex].map(f32::to_bits);
                assert_eq!((&words[..3], words[3]), (&expected[..], Facing::Toward([0.0, 0.0, 1.0]).code()));
                assert_eq!(bytes.get(16..), colors.get(vertex).map(|color| &color[..]).or(Some(&[])));
            }
        }
    }

    /// Corners are written by whole words: an odd one takes two bytes more.
    #[test]
    fn there_is_room_for_all_corners() {
        for triangles in 0..100 {
            for colors in [false, true] {
                for charts in [0, 1, 5] {
                    let layout = Layout::new(7, triangles, colors, charts);
                    let room = layout.bytes() - layout.vertex_bytes();
                    let sheet = if charts > 0 { 32 + 32 * charts + 4 * triangles.div_ceil(2) } else { 0 };
                    let needed = u64::from((6 * triangles).next_multiple_of(4) + sheet);
                    assert!((needed..needed + u64::from(layout.unit)).contains(&room), "{layout:?}");
                }
            }
        }
    }
}
