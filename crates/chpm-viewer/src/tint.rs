//! Colours of a surface: those that the file has, of vertices and in sheets, or those of a named scalar by its range.

use chpm_extmem::MappedFile;
use chpm_format::{Chpm, Page};
use chpm_mesh::{ClusterId, Scalar, scalar_places, viridis};
use std::ops::Range;

/// The colour of what is no number.
const NONE: [u8; 3] = [128; 3];

/// A scalar that colours show, and the place of its words.
#[derive(Clone, Debug)]
struct Shown {
    words: Range<usize>,
    scalar: Scalar,
}

/// Where the colours of vertices come from.
#[derive(Clone, Debug, Default)]
pub struct Tint {
    has_own: bool,
    scalar: Option<Shown>,
    /// Longest side of a sheet that is drawn, texels; none where no sheets are.
    longest_sheet: Option<u32>,
}

impl Tint {
    /// The colours of a file: by the scalar of a name if it has that, else its own.
    pub fn of(file: &Chpm<MappedFile>, color_by: Option<&str>) -> Self {
        let named = scalar_places(file.scalars()).find(|(_, scalar)| Some(&*scalar.name) == color_by);
        let scalar = named.map(|(words, scalar)| Shown { words, scalar: scalar.clone() });
        let has_sheets = scalar.is_none() && file.header().has_sheets();
        let longest_sheet = has_sheets.then_some(u32::from(chpm_format::MAX_SIDE));
        Tint { has_own: file.header().attributes().colors, scalar, longest_sheet }
    }

    /// The same with no sheets larger than this, and without any for none.
    pub fn with_sheets_to(self, longest: Option<u32>) -> Self {
        Tint { longest_sheet: self.longest_sheet.and(longest), ..self }
    }

    /// Longest side of a sheet that is drawn, texels; none where no sheets are.
    pub fn longest_sheet(&self) -> Option<u32> {
        self.longest_sheet
    }

    /// Charts of the sheet that a cluster is drawn with; 0 for none.
    pub fn charts(&self, file: &Chpm<MappedFile>, cluster: ClusterId) -> u32 {
        self.longest_sheet.map_or(0, |_| file.sheets()[cluster.index()].chart_count)
    }

    /// The file's own colours, where a page has some.
    pub fn own(page: &Page<'_>) -> Self {
        Tint { has_own: !page.colors.is_empty(), ..Tint::default() }
    }

    /// Whether vertices have colours of their own.
    pub fn is_there(&self) -> bool {
        self.has_own || self.scalar.is_some()
    }

    /// The scalar that colours show.
    pub fn scalar(&self) -> Option<&Scalar> {
        self.scalar.as_ref().map(|shown| &shown.scalar)
    }

    /// The colour of a vertex, if vertices have colours.
    pub fn color(&self, page: &Page<'_>, vertex: usize) -> Option<[u8; 4]> {
        let Some(Shown { words, scalar }) = &self.scalar else { return page.colors.get(vertex).copied() };
        let value = scalar.kind.value(&page.scalars_of(vertex)[words.clone()]);
        let [red, green, blue] = scalar.range.fraction(value).map_or(NONE, viridis);
        Some([red, green, blue, 255])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_format::PageParts;
    use chpm_mesh::{ScalarKind, ScalarRange, VertexSlices};

    #[test]
    fn a_vertex_has_the_colour_of_its_value() {
        let mut scalar = Scalar::new("quality", ScalarKind::Float64);
        scalar.range = ScalarRange { low: -1.0, high: 3.0, count: 2 };
        let mut words = Vec::new();
        for value in [-1.0, f64::NAN, 3.0] {
            words.push(7);
            scalar.kind.put(value, &mut words);
        }
        let vertices = VertexSlices {
            scalars: &words,
            ..VertexSlices::new(&[[0.0, 0.0, 0.5], [2.0, 0.0, 0.5], [2.0, 2.0, 0.5]])
        };
        let parts = PageParts { vertices, triangles: &[[0, 1, 2]], ..PageParts::default() };
        let mut page = Vec::new();
        parts.encode(&mut page).unwrap();
        let page = Page::parse(&page).unwrap();
        let tint = Tint { scalar: Some(Shown { words: 1..3, scalar }), ..Tint::default() };
        let opaque = |[r, g, b]: [u8; 3]| Some([r, g, b, 255]);
        let colors = [0, 1, 2].map(|vertex| tint.color(&page, vertex));
        assert_eq!(colors, [opaque(viridis(0.0)), opaque(NONE), opaque(viridis(1.0))]);
        assert_eq!((Tint::own(&page).is_there(), Tint::own(&page).color(&page, 0)), (false, None));
    }
}
