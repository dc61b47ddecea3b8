//! Sections beside a brute-force cut of all triangles of the source's finest mesh.

use chpm_build::config::Layout;
use chpm_build::{BuildConfig, Cancel, Resources, Settings, Silent, build};
use chpm_format::Chpm;
use chpm_import::ply::{Encoding, write_mesh};
use chpm_mesh::{Bytes, Level, TriMesh};
use chpm_refine::{Cut, extract};
use chpm_section::{Line, Pages, Planes, Section, SectionError, Slicer};
use chpm_synth::hard::{CASES, Case};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fs;

type File = Chpm<Vec<u8>>;
/// Ends of segments by their bits, the smaller first; ordered.
type Segments = Vec<[[u64; 3]; 2]>;

fn built(mesh: &TriMesh, layout: Layout) -> File {
    let folder = tempfile::tempdir().unwrap();
    let (source, output) = (folder.path().join("in.ply"), folder.path().join("in.chpm"));
    write_mesh(fs::File::create(&source).unwrap(), mesh, Encoding::BinaryLittleEndian).unwrap();
    let config = BuildConfig {
        settings: Settings { cluster_triangles: 64, cell_vertices: 4, layout, ..Settings::default() },
        resources: Resources { threads: 1, memory: Bytes::mib(256), ..Resources::default() },
        overwrite: false,
    };
    build(&source, &output, &config, &Silent, &Cancel::default()).unwrap();
    Chpm::open(fs::read(output).unwrap()).unwrap()
}

fn cut_with(
    file: &File,
    cut: &Cut,
    planes: &Planes,
    room: u64,
) -> Result<(Vec<Section>, Pages), SectionError> {
    let mut slicer = Slicer::new(file, cut, planes);
    let mut sections = Vec::new();
    loop {
        let more = slicer.next_sections(Bytes(room), || true)?;
        if more.is_empty() {
            return Ok((sections, slicer.pages()));
        }
        sections.extend(more);
    }
}

fn cut(file: &File, planes: &Planes) -> Vec<Section> {
    cut_with(file, &Cut::at_level(file, Level(0)), planes, u64::MAX).unwrap().0
}

fn canonical([a, b]: [[f64; 3]; 2]) -> [[u64; 3]; 2] {
    // A zero with a sign is the same place.
    let [a, b] = [a, b].map(|point| point.map(|x| (x + 0.0).to_bits()));
    [a.min(b), a.max(b)]
}

/// Segments of all lines but for those without a length.
fn segments(lines: &[Line]) -> Segments {
    let mut all: Segments = lines.iter().flat_map(Line::segments).map(canonical).collect();
    all.sort_unstable();
    all
}

/// The same by looking at every triangle: an edge is cut where one of its ends is above and the other one is not.
fn brute(mesh: &TriMesh, normal: [f64; 3], offset: f64) -> Segments {
    let height = |p: [f32; 3]| {
        let [x, y, z] = p.map(f64::from);
        normal[0] * x + normal[1] * y + normal[2] * z
    };
    let mut all = Segments::new();
    for corners in &mesh.triangles {
        let corners = mesh.corners(*corners);
        let mut ends = Vec::new();
        for [a, b] in [[0, 1], [1, 2], [2, 0]].map(|edge: [usize; 2]| edge.map(|i| corners[i])) {
            let [above, below] = if height(a) >= offset { [a, b] } else { [b, a] };
            if height(above) >= offset && height(below) < offset {
                let t = (height(above) - offset) / (height(above) - height(below));
                let [a, b] = [above, below].map(|p| p.map(f64::from));
                ends.push([0, 1, 2].map(|axis| a[axis] + t * (b[axis] - a[axis])));
            }
        }
        if let [a, b] = *ends
            && a != b
        {
            all.push(canonical([a, b]));
        }
    }
    all.sort_unstable();
    all
}

/// Planes along axes and askew, through the middle, vertices, edges and faces, and beside the mesh.
fn planes(mesh: &TriMesh) -> Vec<Planes> {
    let mut found = Vec::new();
    for normal in [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [1.0, 1.0, 1.0], [0.3, -0.7, 0.2]] {
        let n = Planes::new(normal, vec![]).unwrap().normal();
        let height = |p: &[f32; 3]| {
            let [x, y, z] = p.map(f64::from);
            n[0] * x + n[1] * y + n[2] * z
        };
        let heights: Vec<f64> = mesh.positions.iter().map(height).collect();
        let low = heights.iter().copied().fold(f64::INFINITY, f64::min);
        let high = heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let count = heights.len();
        let mut offsets = vec![low, high, low.midpoint(high), low - 1.0, low + 0.3 * (high - low)];
        // Heights of vertices: exactly through them, and where faces are level through whole faces.
        offsets.extend([0, count / 3, count / 2, count - 1].map(|v| heights[v]));
        found.push(Planes::new(n, offsets).unwrap());
    }
    found
}

/// How many segments end at each vertex or edge of the brute-force cut says nothing of keys; the mesh's own edges do.
fn is_closed(mesh: &TriMesh) -> bool {
    let mut uses = BTreeMap::new();
    for [a, b, c] in &mesh.triangles {
        for [a, b] in [[a, b], [b, c], [c, a]] {
            *uses.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
        }
    }
    uses.values().all(|count| count % 2 == 0)
}

fn for_each_case(check: impl Fn(&Case, &File, &TriMesh) + Sync) {
    CASES.par_iter().for_each(|case| {
        let file = built(&case.mesh(1500), Layout::VertexCache);
        let mesh = extract(&file, &Cut::at_level(&file, Level(0))).unwrap();
        check(case, &file, &mesh);
    });
}

#[test]
fn sections_have_the_segments_of_a_brute_force_cut() {
    for_each_case(|case, file, mesh| {
        let origin = file.header().origin;
        for local in planes(mesh) {
            let n = local.normal();
            let away = n[0] * origin[0] + n[1] * origin[1] + n[2] * origin[2];
            let world = Planes::new(n, local.offsets().iter().map(|offset| offset + away).collect()).unwrap();
            for section in cut(file, &world) {
                let offset = section.offset - away;
                let expected = brute(mesh, world.normal(), offset);
                assert!(segments(&section.lines) == expected, "{case:?} {world:?} at {offset}");
            }
        }
    });
}

#[test]
fn closed_surfaces_have_closed_lines() {
    let closed = std::sync::atomic::AtomicUsize::new(0);
    for_each_case(|case, file, mesh| {
        if !is_closed(mesh) {
            return;
        }
        closed.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        for planes in planes(mesh) {
            for section in cut(file, &planes) {
                assert_eq!(section.open_ends(), 0, "{case:?} {planes:?} at {}", section.offset);
            }
        }
    });
    assert!(closed.into_inner() >= 8);
}

/// Area that all triangles together go around, as each is turned: of a surface that nowhere crosses itself, that of its inside.
fn turned_area(mesh: &TriMesh, planes: &Planes, offset: f64) -> f64 {
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let mut sum = 0.0;
    for corners in &mesh.triangles {
        let corners = mesh.corners(*corners).map(|corner| corner.map(f64::from));
        let height = |i: usize| dot(planes.normal(), corners[i % 3]);
        let end = |goes: &dyn Fn(usize) -> bool| {
            let i = (0..3).find(|i| goes(*i))?;
            let t = (offset - height(i)) / (height(i + 1) - height(i));
            let [a, b] = [corners[i], corners[(i + 1) % 3]];
            let point: [f64; 3] = [0, 1, 2].map(|axis| a[axis] + t * (b[axis] - a[axis]));
            Some(planes.axes().map(|axis| dot(axis, point)))
        };
        let from = end(&|i| height(i) >= offset && height(i + 1) < offset);
        let to = end(&|i| height(i) < offset && height(i + 1) >= offset);
        if let (Some([a, b]), Some([c, d])) = (from, to) {
            sum += (a * d - b * c) / 2.0;
        }
    }
    sum
}

#[test]
fn where_lines_touch_each_encloses_its_own() {
    let case = CASES.iter().find(|case| case.name == "voxels").unwrap();
    let file = built(&case.mesh(20_000), Layout::VertexCache);
    let mesh = extract(&file, &Cut::at_level(&file, Level(0))).unwrap();
    let mut touch = 0;
    // Between the layers of cubes, across all three axes.
    for axis in 0..3 {
        let normal = std::array::from_fn(|a| if a == axis { 1.0 } else { 0.0 });
        let heights = || mesh.positions.iter().map(|position| f64::from(position[axis]));
        let [low, high] =
            [heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max)];
        let offsets = (0..(high - low) as u32).map(|layer| low + f64::from(layer) + 0.581).collect();
        let planes = Planes::new(normal, offsets).unwrap();
        for section in cut(&file, &planes) {
            let expected = turned_area(&mesh, &planes, section.offset).abs();
            let area = section.area().unwrap();
            assert!(
                (area - expected).abs() < 1e-6 * expected,
                "{normal:?} at {}: {area}, {expected}",
                section.offset
            );
            let mut points: Vec<_> = section.lines.iter().flat_map(|line| &line.points).collect();
            points.sort_by(|a, b| a.partial_cmp(b).unwrap());
            touch += points.windows(2).filter(|pair| pair[0] == pair[1]).count();
        }
    }
    assert!(touch > 10, "{touch}");
}

#[test]
fn orders_of_pages_and_triangles_do_not_show() {
    CASES.par_iter().for_each(|case| {
        let mesh = case.mesh(1500);
        let files = [Layout::VertexCache, Layout::CacheOblivious, Layout::Simplification]
            .map(|layout| built(&mesh, layout));
        for planes in planes(&mesh) {
            let [a, b, c] = files.each_ref().map(|file| cut(file, &planes));
            assert!(a == b && b == c, "{case:?} {planes:?}");
        }
    });
}

#[test]
fn neither_threads_nor_memory_show() {
    let mesh = Case::find("spikes").unwrap().mesh(3000);
    let file = built(&mesh, Layout::VertexCache);
    let bounds = file.header().aabb();
    let step = f64::from(bounds.max[2] - bounds.min[2]) / 40.0;
    let planes = Planes::new(
        [0.0, 0.0, 1.0],
        (0..40).map(|i| f64::from(bounds.min[2]) + step * f64::from(i)).collect(),
    )
    .unwrap();
    let leaves = Cut::at_level(&file, Level(0));
    let (expected, pages) = cut_with(&file, &leaves, &planes, u64::MAX).unwrap();
    assert_eq!(expected.len(), 40);
    assert!(pages.read >= pages.crossed && pages.crossed > 0, "{pages:?}");
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let least = (1..40).map(|i| 1 << i).find(|room| {
            pool.install(|| match cut_with(&file, &leaves, &planes, *room) {
                Ok(found) => {
                    assert!(found == (expected.clone(), pages));
                    true
                }
                Err(SectionError::TooLarge { .. }) => false,
                Err(error) => panic!("{error}"),
            })
        });
        // Some room is too little for one plane, and less than for all is enough.
        let all =
            cut_with(&file, &leaves, &planes, u64::MAX).unwrap().0.iter().map(Section::points).sum::<u64>();
        assert!(least.is_some_and(|least| least > 1 && least < 144 * all), "{least:?} {all}");
    }
    let stopped = Slicer::new(&file, &leaves, &planes).next_sections(Bytes(u64::MAX), || false);
    assert!(matches!(stopped, Err(SectionError::Stopped)));
}

fn cube(low: [f32; 3], side: f32) -> TriMesh {
    let at = |i: u32| [0, 1, 2].map(|axis| low[axis] + side * (i >> axis & 1) as f32);
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    TriMesh::new((0..8).map(at).collect(), triangles)
}

/// The number of crossing lines of a plane through two cubes, and their area.
fn of_two(second: TriMesh, normal: [f64; 3], offset: f64) -> (u64, Option<f64>) {
    let mut mesh = cube([0.0; 3], 1.0);
    mesh.triangles.extend(second.triangles.iter().map(|corners| corners.map(|corner| corner + 8)));
    mesh.positions.extend(second.positions.iter());
    let file = built(&mesh, Layout::VertexCache);
    let sections = cut(&file, &Planes::new(normal, vec![offset]).unwrap());
    assert_eq!(sections[0].lines.len(), 2);
    (sections[0].crossing(), sections[0].area())
}

#[test]
fn lines_of_solids_that_overlap_cross_and_have_no_area() {
    for x in [0.3, 0.5, 0.7, 0.9] {
        for normal in [[0.0, 0.0, 1.0], [0.1, 0.2, 1.0]] {
            assert_eq!(of_two(cube([x, 0.11, 0.13], 0.9), normal, 0.55), (2, None), "{x} {normal:?}");
        }
    }
    // Half of each in the other, and faces on faces.
    assert_eq!(of_two(cube([0.5, 0.0, 0.0], 1.0), [0.0, 0.0, 1.0], 0.5), (2, None));
}

#[test]
fn solids_that_touch_or_lie_in_each_other_have_an_area() {
    for (low, side, expected) in [
        ([1.25, 0.0, 0.0], 1.0, 2.0),
        ([0.25, 0.25, 0.25], 0.5, 0.75),
        ([1.0, 0.25, 0.25], 0.5, 1.25),
        ([-0.5, 0.25, 0.25], 0.5, 1.25),
        ([0.25, 1.0, 0.25], 0.5, 1.25),
        ([0.25, -0.5, 0.25], 0.5, 1.25),
        ([0.5, 0.25, 0.25], 0.5, 0.75),
        ([0.0, 0.25, 0.25], 0.5, 0.75),
        ([0.25, 0.0, 0.25], 0.5, 0.75),
        ([0.25, 0.5, 0.25], 0.5, 0.75),
        ([1.0, 0.0, 0.0], 1.0, 2.0),
        ([0.0, -1.0, 0.0], 1.0, 2.0),
    ] {
        assert_eq!(of_two(cube(low, side), [0.0, 0.0, 1.0], 0.5), (0, Some(expected)), "{low:?}");
    }
    // Askew, with the same corners on both sides of the wall.
    for low in [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]] {
        let (crossing, area) = of_two(cube(low, 1.0), [0.2, 0.2, 1.0], 0.6);
        let expected = 2.0 * 1.08_f64.sqrt();
        assert!(crossing == 0 && (area.unwrap() - expected).abs() < 1e-12, "{low:?} {area:?}");
    }
}

/// A cube: planes through its faces, edges and corners.
#[test]
fn a_cube_has_the_areas_that_it_has() {
    let file = built(&cube([0.0; 3], 1.0), Layout::VertexCache);
    let area = |normal: [f64; 3], offset: f64| {
        let sections = cut(&file, &Planes::new(normal, vec![offset]).unwrap());
        assert_eq!(sections[0].open_ends(), 0);
        (sections[0].lines.len(), sections[0].area().unwrap(), sections[0].length())
    };
    assert_eq!(area([0.0, 0.0, 1.0], 0.5), (1, 1.0, 4.0));
    // A face counts as above: the upper one is the rim of what is below it, below the lower one nothing is.
    assert_eq!(area([0.0, 0.0, 1.0], 1.0), (1, 1.0, 4.0));
    assert_eq!(area([0.0, 0.0, 1.0], 0.0).0, 0);
    let (lines, hexagon, _) = area([1.0, 1.0, 1.0], 3.0f64.sqrt() / 2.0);
    assert!(lines == 1 && (hexagon - 1.299_038_105_676_658).abs() < 1e-12);
    // Through four corners, and along an edge.
    let (lines, diagonal, _) = area([1.0, -1.0, 0.0], 0.0);
    assert!(lines == 1 && (diagonal - 2.0f64.sqrt()).abs() < 1e-12);
    assert_eq!(area([1.0, 1.0, 0.0], 2.0f64.sqrt()).1, 0.0);
}
