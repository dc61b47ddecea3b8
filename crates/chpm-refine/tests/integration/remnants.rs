use chpm_format::{
    Chpm, ChpmWriter, ClusterRecord, Gaps, GroupRecord, HeaderFields, LevelRecord, PageParts, Remnant, Tables,
};
use chpm_mesh::{GroupId, Level, TriMesh, VertexSlices};
use chpm_refine::{Cut, Extraction, RefineError, extract};
use proptest::prelude::*;

/// Error from which a speck is missing.
const GONE: f32 = 0.5;
const SIZE: f32 = 0.125;

/// A square of two triangles, of side 100, and specks at these places, which vanish one after the other.
fn file(specks: &[[f32; 3]]) -> Chpm<Vec<u8>> {
    file_with(specks, specks.len(), 0.0)
}

/// The same where only the first `kept` have a remnant, and the others are within `rest` of what is drawn.
fn file_with(specks: &[[f32; 3]], kept: usize, rest: f32) -> Chpm<Vec<u8>> {
    let count = specks.len();
    let mut positions = vec![[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [100.0, 100.0, 0.0], [0.0, 100.0, 0.0]];
    let mut triangles = vec![[0, 1, 2], [0, 2, 3]];
    // Two corners of each stay, the third goes to the first of them.
    for [x, y, z] in specks {
        positions.extend([[*x, *y, *z], [x + SIZE, *y, *z]]);
    }
    let base = positions.len();
    positions.extend(specks.iter().map(|[x, y, z]| [*x, y + SIZE, *z]));
    let corners = |speck: usize| [(base + speck) as u16, (4 + 2 * speck) as u16, (5 + 2 * speck) as u16];
    triangles.extend((0..count).map(corners));
    let targets: Vec<u16> = (0..count).map(|speck| corners(speck)[1]).collect();
    let errors: Vec<f32> = (0..count).map(|speck| GONE * (1.0 + (count - speck) as f32 / 1024.0)).collect();
    let parts = PageParts {
        vertices: VertexSlices::new(&positions),
        triangles: &triangles,
        targets: &targets,
        errors: &errors,
        ..PageParts::default()
    };
    let mut page = Vec::new();
    parts.encode(&mut page).unwrap();
    let record = ClusterRecord::of_page(&page, Level(0), GroupId(0), GroupId::NONE).unwrap();
    let group = GroupRecord {
        coarse_count: 1,
        max_error: record.max_error,
        center: record.center,
        radius: record.radius,
        gaps: Gaps { fine: 0.0, base: 1000.0, from: GONE },
        rest,
        ..GroupRecord::default()
    };
    let remnant = |(speck, [x, y, z]): (usize, &[f32; 3])| Remnant {
        center: [*x, *y, *z],
        radius: 1.5 * SIZE,
        corners: corners(speck),
        bound: 0.0,
        ..Remnant::default()
    };
    let mut tables = Tables {
        header: HeaderFields { source_vertex_count: positions.len() as u64, ..HeaderFields::default() },
        clusters: vec![record],
        groups: vec![group],
        members: vec![0],
        levels: vec![LevelRecord::default()],
        remnants: specks.iter().enumerate().take(kept).map(remnant).collect(),
        ..Tables::default()
    };
    let mut writer = ChpmWriter::begin(Vec::new(), &mut tables).unwrap();
    writer.page(&page).unwrap();
    Chpm::open(writer.finish().unwrap()).unwrap()
}

/// Checks what every cut within a distance has to be; answers how many remnants it draws.
fn within(file: &Chpm<Vec<u8>>, specks: &[[f32; 3]], distance: f32) -> usize {
    let cut = Cut::at_distance(file, distance).unwrap();
    cut.check(file).unwrap();
    assert!(cut.distance(file).unwrap() <= distance && cut.error(file).unwrap() <= distance);
    let mesh = extract(file, &cut).unwrap();
    let triangles = cut.triangle_count(file).unwrap();
    assert_eq!(triangles, mesh.triangles.len() as u64);
    let extraction = Extraction::new(file, &cut).unwrap();
    assert_eq!(extraction.triangle_count(), triangles);
    assert_eq!(extraction.vertex_count() as usize, mesh.positions.len());
    assert_eq!(extraction.distance(), cut.distance(file).unwrap());
    assert_eq!(extraction.error(), cut.error(file).unwrap());
    // Every way to have it gives the same mesh.
    let (mut apart, mut pieces) = (TriMesh::default(), TriMesh::default());
    extraction
        .vertices(|vertices| {
            apart.extend_from_slices(vertices);
            Ok::<_, RefineError>(())
        })
        .unwrap();
    extraction
        .triangles(|all| {
            apart.triangles.extend_from_slice(all);
            Ok::<_, RefineError>(())
        })
        .unwrap();
    assert_eq!(apart, mesh);
    extraction
        .pieces(5, |vertices, all| {
            let first = pieces.positions.len() as u32;
            pieces.extend_from_slices(vertices);
            pieces.triangles.extend(all.iter().map(|t| t.map(|v| v + first)));
            Ok::<_, RefineError>(())
        })
        .unwrap();
    assert_eq!(pieces.triangles.len(), mesh.triangles.len());
    // No corner of a speck is farther from what is drawn: from the square, or from a corner of what is drawn of specks.
    for [x, y, z] in specks {
        for corner in [[*x, *y, *z], [x + SIZE, *y, *z], [*x, y + SIZE, *z]] {
            let drawn = mesh.positions[4..].iter().map(|p| chpm_mesh::geom::distance(*p, corner));
            let aside = |x: f32| f64::from((-x).max(x - 100.0).max(0.0));
            let square =
                (aside(corner[0]).powi(2) + aside(corner[1]).powi(2) + f64::from(corner[2]).powi(2)).sqrt();
            let nearest = drawn.fold(square, f64::min);
            assert!(nearest <= f64::from(distance) + 1e-6, "{corner:?} is {nearest} away, not {distance}");
        }
    }
    let count = cut.remnants().len();
    assert!(count == 0 || cut.members()[0].vertices < file.clusters()[0].vertex_count);
    count
}

/// Specks above the middle of a large triangle: their distance is their height, not that of the nearest vertex, and each costs one triangle.
#[test]
fn a_speck_costs_a_triangle_where_it_is_too_far() {
    let heights = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0];
    let specks: Vec<_> = heights.iter().zip(1..).map(|(z, i)| [15.0 * i as f32, 40.0, *z]).collect();
    let file = file(&specks);
    for (distance, drawn) in [(0.9, 6), (1.3, 5), (3.0, 4), (10.0, 2), (31.9, 1), (33.0, 0), (f32::MAX, 0)] {
        assert_eq!(within(&file, &specks, distance), drawn, "{distance}");
    }
    // Finer meshes have the specks themselves.
    for distance in [0.0, 0.4] {
        assert_eq!(within(&file, &specks, distance), 0);
        assert_eq!(Cut::at_distance(&file, distance).unwrap().triangle_count(&file).unwrap(), 8);
    }
    // Of what is left of the surface by one distance, specks keep to another.
    let cut = Cut::at_distances(&file, 100.0, 3.0).unwrap();
    assert_eq!(cut.remnants().len(), 4);
    // Whoever chooses by errors draws none, and has the gap.
    let cut = Cut::at_error(&file, 1.0).unwrap();
    assert_eq!((cut.remnants(), cut.distance(&file).unwrap()), (&[][..], 1000.0));
}

/// Leaves have nothing below them to be split into: where a speck without a remnant would be too far, they are as fine as it takes to have it.
#[test]
fn a_speck_without_a_remnant_is_there_where_it_would_be_too_far() {
    let specks = [[15.0, 40.0, 1.0], [60.0, 40.0, 30.0]];
    let file = file_with(&specks, 1, 120.0);
    for distance in [0.0, 0.4, 2.0, 20.0, 119.0, 121.0, 1001.0] {
        assert_eq!(within(&file, &specks, distance), 0);
        let triangles = Cut::at_distance(&file, distance).unwrap().triangle_count(&file).unwrap();
        assert_eq!(triangles, if distance < 120.0 { 4 } else { 2 }, "{distance}");
    }
    // What nothing is missing from is near all of it.
    assert_eq!(Cut::at_level(&file, Level(0)).distance(&file).unwrap(), 0.0);
    assert_eq!(Cut::at_distances(&file, 0.0, 0.0).unwrap().distance(&file).unwrap(), 0.0);
}

/// One of a swarm stands for those about it.
#[test]
fn what_is_drawn_of_a_swarm_covers_its_neighbours() {
    let swarm: Vec<_> = (0..64).map(|i| [50.0 + (i % 8) as f32, 50.0 + (i / 8) as f32, 60.0]).collect();
    let file = file(&swarm);
    assert_eq!(within(&file, &swarm, 0.75), 64);
    let drawn = within(&file, &swarm, 3.0);
    assert!((2..16).contains(&drawn), "{drawn}");
    assert_eq!(within(&file, &swarm, 20.0), 1);
}

#[test]
fn a_cut_of_another_file_is_refused() {
    let specks: Vec<_> = (1..4).map(|i| [20.0 * i as f32, 50.0, 60.0]).collect();
    let cut = Cut::at_distance(&file(&specks), 1.0).unwrap();
    assert_eq!(cut.remnants(), [0, 1, 2]);
    let other = file(&specks[..1]);
    assert!(matches!(cut.check(&other), Err(RefineError::Remnant { number: 2, count: 1 })));
}

proptest! {
    #[test]
    fn specks_anywhere_keep_to_the_distance(
        specks in prop::collection::vec((-30.0f32..130.0, -30.0f32..130.0, -40.0f32..40.0), 1..40),
        distance in 0.6f32..50.0,
    ) {
        let specks: Vec<_> = specks.into_iter().map(|(x, y, z)| [x, y, z]).collect();
        within(&file(&specks), &specks, distance);
    }
}
