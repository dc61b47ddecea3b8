//! Meshes that are hard to simplify, each for a reason of its own and of any size.
//!
//! What every case must give: a build; the same bytes again; a file whose invariants hold; no number that is none; cuts without
//! cracks; stored errors that bound measured ones; and all that in at most [`Case::slowest`] times as long as a terrain of as many
//! triangles takes. [`Case::gives`] is what one case must give beyond that.

mod apart;
mod flat;
mod scale;
mod sheet;
mod touching;
mod twisted;

use chpm_mesh::TriMesh;
use std::fmt;

/// A hard mesh by name.
#[derive(Clone, Copy)]
pub struct Case {
    /// Name on the command line.
    pub name: &'static str,
    /// Description.
    pub is: &'static str,
    /// Expected result, beyond what all cases must give.
    pub gives: &'static str,
    /// Triangles at full size.
    pub full: u32,
    /// How many times as long as a terrain of as many triangles it may take.
    pub slowest: f64,
    /// Offset of every position, in double precision; zero unless the mesh needs it.
    pub offset: [f64; 3],
    make: fn(u32) -> TriMesh,
}

impl Case {
    /// The case at a size of about `triangles`, at most [`Case::MAX_TRIANGLES`]; relative to `Case::offset`. Those whose name says
    /// how many parts they have come in steps, and none has fewer than it takes to be what it is called.
    pub fn mesh(&self, triangles: u32) -> TriMesh {
        (self.make)(triangles.min(Self::MAX_TRIANGLES))
    }

    /// The most triangles that a case is made of: all are made in core, and whole numbers up to 2^24 are exact in f32.
    pub const MAX_TRIANGLES: u32 = 1 << 24;

    /// The case of that name.
    pub fn find(name: &str) -> Option<&'static Case> {
        CASES.iter().find(|case| case.name == name)
    }

    const fn new(
        name: &'static str,
        make: fn(u32) -> TriMesh,
        is: &'static str,
        gives: &'static str,
    ) -> Case {
        Case { name, is, gives, full: 1_000_000, slowest: 3.0, offset: [0.0; 3], make }
    }

    const fn full(self, full: u32) -> Case {
        Case { full, ..self }
    }

    /// Where every triangle is a component: each looks for its nearest neighbour.
    const fn in_pieces(self) -> Case {
        Case { slowest: 6.0, ..self }
    }

    const fn offset(self, offset: [f64; 3]) -> Case {
        Case { offset, ..self }
    }
}

impl fmt::Debug for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

/// Every case.
pub const CASES: [Case; 33] = [
    // Numbers.
    Case::new(
        "far",
        scale::far,
        "a ball of radius 1000, 1e7 units from the origin along each axis, where single precision has steps of 1",
        "every vertex bit by bit; nothing that depends on squares of coordinates",
    ),
    Case::new(
        "far-double",
        scale::unit,
        "a terrain over the unit square, 1e7 units from the origin, in double precision",
        "an origin, so that no vertex moves by more than 1e-7",
    )
    .offset([1e7, -1e7, 1e7]),
    Case::new(
        "tiny",
        scale::tiny,
        "an isosurface 1e-9 across",
        "errors in proportion: no absolute tolerance",
    ),
    Case::new("huge", scale::huge, "an isosurface 1e9 across", "errors in proportion: no absolute tolerance"),
    Case::new(
        "orders",
        scale::orders,
        "a horn from 1e-6 to 1e6: coordinates of 12 orders of magnitude",
        "errors that are lengths: the narrow end is gone first",
    ),
    Case::new(
        "denormals",
        scale::denormals,
        "a terrain 1e-40 across, all of whose coordinates are subnormal numbers",
        "errors that are finite and do not fall short where they are rounded",
    ),
    Case::new(
        "zeros",
        scale::zeros,
        "two halves of a sheet; where they meet one has 0.0 and the other -0.0",
        "both signs bit by bit",
    ),
    // Quadrics without a single minimum.
    Case::new(
        "plane",
        flat::plane,
        "a tilted plate that is exactly plane, its inner vertices off the grid",
        "its outline, with an error of 0",
    ),
    Case::new(
        "cylinder",
        flat::cylinder,
        "an open tube whose rulings are exactly straight",
        "rulings without inner vertices before any other loss",
    ),
    Case::new(
        "line",
        flat::line,
        "a sheet with all vertices on one line: no triangle has an area",
        "all triangles kept and counted; errors of what is dropped along the line",
    ),
    Case::new("point", flat::point, "a sheet with all vertices in one point", "an error of 0"),
    Case::new(
        "ties",
        flat::ties,
        "blocks on a grid of whole numbers, so that most collapses cost the same",
        "an order that follows from the input alone",
    ),
    Case::new("strip", flat::strip, "a zigzag strip, one triangle wide", "a boundary that keeps its ends"),
    Case::new(
        "folded",
        flat::folded,
        "a sheet folded to and fro, so that its layers lie exactly on each other",
        "layers that stay apart where indices are",
    ),
    Case::new(
        "needles",
        flat::needles,
        "a wavy sheet of triangles a million times as long as wide",
        "no triangle turned over",
    ),
    Case::new(
        "caps",
        flat::caps,
        "a plate with bumps of a millionth on every edge: triangles of an angle of almost 180 degrees",
        "the bumps first, at an error near 1e-6",
    ),
    // Pieces.
    Case::new("soup", apart::soup, "triangles in a cube that share no vertex", "a root of bounded size")
        .in_pieces(),
    Case::new(
        "components",
        apart::components,
        "tetrahedra that differ in size by a factor of 1000; 100,000 of them at full size",
        "small ones gone before large ones",
    )
    .full(400_000),
    Case::new(
        "unwelded",
        apart::unwelded,
        "a ball whose triangles have vertices of their own, 0, one step or 1e-6 apart",
        "triangles that are told apart by index, never by position",
    )
    .in_pieces(),
    Case::new(
        "giant",
        apart::giant,
        "a terrain over the unit square and, at its corner, one triangle of a million units",
        "clusters of equal size, whatever the box",
    ),
    // Surfaces upon surfaces.
    Case::new(
        "sheets",
        touching::sheets,
        "four copies of a terrain, 0, one step and 1e-6 apart; every second one looks down",
        "four sheets, welded nowhere",
    ),
    Case::new(
        "doubled",
        touching::doubled,
        "a terrain with every triangle there twice, the second time turned over",
        "edges of four faces everywhere, and no edge of an odd number",
    ),
    Case::new(
        "winding",
        touching::winding,
        "an isosurface with every triangle turned over or not, by chance",
        "a closed surface that stays closed",
    ),
    Case::new(
        "bow-ties",
        touching::bow_ties,
        "the black squares of a wavy chessboard, which touch in corners alone",
        "two fans about every inner vertex that do not grow together unseen",
    ),
    Case::new(
        "pages",
        touching::pages,
        "books of 3 to 50 pages: edges of 3 to 50 faces",
        "spines that keep whether their number of faces is odd",
    ),
    Case::new(
        "cubes",
        touching::cubes,
        "cubes side by side, each with triangles of its own: edges of up to eight faces, every inner face twice",
        "a root of bounded size, and no edge of an odd number",
    ),
    Case::new(
        "voxels",
        touching::voxels,
        "the hull of cells that are full by chance: edges of four faces, corners where parts touch",
        "a root of bounded size, and no edge of an odd number",
    ),
    Case::new(
        "fan",
        touching::fan,
        "a wavy disc of triangles about one vertex; 100,000 of them at full size",
        "time in proportion to the triangles, not to their square",
    )
    .full(100_000),
    Case::new(
        "poles",
        touching::poles,
        "a ball of meridians that all end in two vertices",
        "time in proportion to the triangles",
    ),
    // Surfaces without an inside.
    Case::new("moebius", twisted::moebius, "a wide Moebius band", "one boundary curve"),
    Case::new("klein", twisted::klein, "a Klein bottle, which passes through itself", "no boundary"),
    Case::new(
        "crossing",
        twisted::crossing,
        "two balls that pass through each other without a common vertex",
        "two balls that stay apart where indices are",
    ),
    Case::new(
        "spikes",
        twisted::spikes,
        "a ball with every hundredth vertex ten radii out",
        "spikes that are kept as long as their length asks for",
    ),
];

#[cfg(test)]
mod tests;
