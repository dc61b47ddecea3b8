use crate::strips::{self, ALL, DEPENDENT, File, MORE, PAIRS, Plan, TWINS, WOVEN};
use chpm_format::{
    Chpm, ChpmWriter, ClusterRecord, GroupRecord, HeaderFields, LevelRecord, PageParts, Tables,
};
use chpm_mesh::{GroupId, Level, TriMesh, VertexSlices};
use chpm_refine::{Cut, Extraction, Member, RefineError, extract, random_cut};
use std::collections::{BTreeMap, BTreeSet};

/// The grid's number of every vertex of the mesh, which must have that vertex's look.
fn known(mesh: &TriMesh, plan: &Plan) -> Vec<u32> {
    let all = (0..plan.strips).flat_map(strips::strip).flatten();
    let numbers: BTreeMap<_, _> = all.map(|v| (strips::position(v).map(f32::to_bits), v)).collect();
    let number = |(i, p): (usize, &[f32; 3])| {
        let v = numbers[&p.map(f32::to_bits)];
        assert_eq!((mesh.normals[i], mesh.colors[i]), (strips::normal(v), strips::color(v)));
        v
    };
    mesh.positions.iter().enumerate().map(number).collect()
}

/// Triangles over the grid's numbers, each from its least corner, sorted.
fn canonical(triangles: impl IntoIterator<Item = [u32; 3]>) -> Vec<[u32; 3]> {
    let rotated = |[a, b, c]: [u32; 3]| [a, b, c].min([b, c, a]).min([c, a, b]);
    let mut triangles: Vec<_> = triangles.into_iter().map(rotated).collect();
    triangles.sort_unstable();
    triangles
}

/// The cut's triangles, played cluster by cluster.
fn played(file: &File, cut: &Cut, plan: &Plan) -> Vec<[u32; 3]> {
    let mut all = Vec::new();
    for member in cut.members() {
        let page = file.page(member.cluster).unwrap();
        let page = page.view();
        let mut triangles = Vec::new();
        page.progressive_mesh().triangles_at(member.vertices as usize, &mut triangles);
        let mut vertices = TriMesh::default();
        vertices.extend_from_slices(page.vertices);
        let numbers = known(&vertices, plan);
        all.extend(triangles.iter().map(|t| t.map(|v| numbers[usize::from(v)])));
    }
    canonical(all)
}

/// The pieces of a cut are its mesh, each of them welded and no larger than it may be.
fn in_pieces(file: &File, cut: &Cut, plan: &Plan, limit: usize, mesh: &TriMesh) {
    let (mut all, mut pieces) = (Vec::new(), 0);
    let largest = cut.members().iter().map(|member| member.vertices as usize).max().unwrap_or(0);
    let taken = Extraction::new(file, cut).unwrap().pieces(limit, |vertices, triangles| {
        let mut piece = TriMesh { triangles: triangles.to_vec(), ..TriMesh::default() };
        piece.extend_from_slices(vertices);
        let numbers = known(&piece, plan);
        assert_eq!(numbers.iter().collect::<BTreeSet<_>>().len(), numbers.len(), "a vertex is there twice");
        assert!(numbers.len() <= limit.max(largest));
        all.extend(triangles.iter().map(|t| t.map(|v| numbers[v as usize])));
        pieces += 1;
        Ok::<_, RefineError>(())
    });
    taken.unwrap();
    assert_eq!(canonical(all), played(file, cut, plan));
    match limit {
        0 => assert_eq!(pieces, cut.members().len()),
        usize::MAX => assert_eq!(pieces, usize::from(!mesh.triangles.is_empty())),
        _ => {}
    }
}

/// Extracts and checks everything that must hold for any cut.
pub(crate) fn extracted(file: &File, cut: &Cut, plan: &Plan) -> TriMesh {
    let mesh = extract(file, cut).unwrap();
    let numbers = known(&mesh, plan);
    assert_eq!(numbers.iter().collect::<BTreeSet<_>>().len(), numbers.len(), "a vertex is there twice");
    let used: BTreeSet<u32> = mesh.triangles.iter().flatten().copied().collect();
    assert!(used.into_iter().eq(0..numbers.len() as u32), "a vertex has no triangle");

    let triangles: Vec<_> = mesh.triangles.iter().map(|t| t.map(|v| numbers[v as usize])).collect();
    assert_eq!(canonical(triangles.iter().copied()), played(file, cut, plan));
    assert_eq!(cut.triangle_count(file).unwrap(), mesh.triangles.len() as u64);
    for limit in [0, 12, 40, usize::MAX] {
        in_pieces(file, cut, plan, limit, &mesh);
    }
    // No cracks: every edge has its partner, but for the outline of the grid; no edge is there twice.
    let edges: BTreeSet<_> = triangles.iter().flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]).collect();
    assert_eq!(edges.len(), 3 * triangles.len());
    assert_eq!(strips::boundary(&triangles), strips::outline(plan), "a crack in {cut:?}");
    mesh
}

#[test]
fn level_0_is_the_source() {
    for plan in ALL {
        let file = plan.build();
        let mesh = extracted(&file, &Cut::at_level(&file, Level(0)), &plan);
        let numbers = known(&mesh, &plan);
        let source = canonical((0..plan.strips).flat_map(strips::strip));
        assert_eq!(canonical(mesh.triangles.iter().map(|t| t.map(|v| numbers[v as usize]))), source);
        assert_eq!(mesh.positions.len() as u64, file.header().source_vertex_count);
    }
}

#[test]
fn levels_and_error_bounds_have_no_cracks() {
    for plan in ALL {
        let file = plan.build();
        for level in 0..4 {
            extracted(&file, &Cut::at_level(&file, Level(level)), &plan);
        }
        for step in 0..60 {
            let bound = file.header().max_error * step as f32 / 59.0;
            extracted(&file, &Cut::at_error(&file, bound).unwrap(), &plan);
        }
    }
}

#[test]
fn random_cuts_have_no_cracks() {
    for plan in MORE {
        let file = plan.build();
        for seed in 0..500 {
            extracted(&file, &random_cut(&file, seed).unwrap(), &plan);
        }
    }
}

/// The oracle above can fail: positions that contradict each other on a simplified border leave a crack.
#[test]
#[should_panic(expected = "a crack in")]
fn a_border_that_moved_on_one_side_is_seen() {
    let file = DEPENDENT.build();
    let mut members = Cut::at_level(&file, Level(0)).members().to_vec();
    members[1].vertices = file.clusters()[1].base_vertex_count;
    extracted(&file, &Cut::new(members), &DEPENDENT);
}

#[test]
fn the_order_is_that_of_the_file() {
    let file = PAIRS.build();
    let mesh = extract(&file, &Cut::at_level(&file, Level(0))).unwrap();
    let page = file.page(chpm_mesh::ClusterId(0)).unwrap();
    let page = page.view();
    assert_eq!(&mesh.positions[..page.vertex_count()], page.positions);
    let first: Vec<_> = page.triangles.iter().map(|t| t.map(u32::from)).collect();
    assert_eq!(&mesh.triangles[..first.len()], first);
}

#[test]
fn batches_are_announced_and_an_error_of_the_sink_ends_them() {
    let file = TWINS.build();
    let cut = Cut::at_level(&file, Level(1));
    let extraction = Extraction::new(&file, &cut).unwrap();
    assert_eq!((extraction.attributes().normals, extraction.attributes().colors), (true, true));
    let (mut vertices, mut triangles, mut calls) = (0, 0, 0);
    let count = |batch: VertexSlices<'_>| {
        vertices += batch.positions.len();
        Ok::<_, RefineError>(())
    };
    extraction.vertices(count).unwrap();
    let result = extraction.triangles(|batch| {
        (triangles, calls) = (triangles + batch.len(), calls + 1);
        if calls == 2 { Err(RefineError::Bound { got: -1.0 }) } else { Ok(()) }
    });
    assert!(matches!(result, Err(RefineError::Bound { .. })));
    assert_eq!((vertices as u32, calls), (extraction.vertex_count(), 2));
    assert_eq!(triangles as u64, extraction.triangle_count());
}

#[test]
fn the_origin_is_told_if_it_matters() {
    let file = PAIRS.build();
    let cut = Cut::at_level(&file, Level(3));
    assert_eq!(Extraction::new(&file, &cut).unwrap().origin(), None);

    let far = [1e7 + 0.1, 0.0, -3.0];
    let file = Chpm::open(PAIRS.bytes(far)).unwrap();
    let extraction = Extraction::new(&file, &cut).unwrap();
    assert_eq!(extraction.origin(), Some(far));
    let check = |batch: VertexSlices<'_>| {
        for (absolute, p) in batch.absolute(far).zip(batch.positions) {
            assert_eq!(absolute, [far[0] + f64::from(p[0]), f64::from(p[1]), f64::from(p[2]) - 3.0]);
        }
        assert_eq!(batch.absolute(far).count(), batch.positions.len());
        Ok::<_, RefineError>(())
    };
    extraction.vertices(check).unwrap();
}

/// Two triangles apart, of which the second collapses and leaves two vertices behind.
#[test]
fn vertices_without_triangles_are_left_out() {
    let positions: Vec<[f32; 3]> = (0..6).map(|i| [i as f32, (i * i) as f32, 0.0]).collect();
    let parts = PageParts {
        vertices: VertexSlices::new(&positions),
        triangles: &[[3, 4, 5], [2, 0, 1]],
        targets: &[4],
        errors: &[1.0],
        ..PageParts::default()
    };
    let mut page = Vec::new();
    parts.encode(&mut page).unwrap();
    let record = ClusterRecord::of_page(&page, Level(0), GroupId(0), GroupId::NONE).unwrap();
    let group = GroupRecord {
        coarse_first: 0,
        coarse_count: 1,
        fine_first: 1,
        fine_count: 0,
        level: 0,
        flags: 0,
        min_error: 0.0,
        max_error: record.max_error,
        center: record.center,
        radius: record.radius,
        gaps: Default::default(),
        rest: 0.0,
    };
    let mut tables = Tables {
        header: HeaderFields { source_vertex_count: 6, ..HeaderFields::default() },
        clusters: vec![record],
        groups: vec![group],
        members: vec![0],
        levels: vec![LevelRecord::default()],
        ..Tables::default()
    };
    let mut writer = ChpmWriter::begin(Vec::new(), &mut tables).unwrap();
    writer.page(&page).unwrap();
    let file = Chpm::open(writer.finish().unwrap()).unwrap();

    let base = Cut::new(vec![Member { cluster: chpm_mesh::ClusterId(0), vertices: 5 }]);
    let expected = TriMesh::new(positions[..3].to_vec(), vec![[2, 0, 1]]);
    assert_eq!(extract(&file, &base).unwrap(), expected);
    assert_eq!(base.error(&file).unwrap(), 1.0);
    let finest = extract(&file, &Cut::at_error(&file, 0.5).unwrap()).unwrap();
    assert_eq!((finest.vertices.positions, finest.triangles), (positions, vec![[3, 4, 5], [2, 0, 1]]));
}

#[test]
fn an_illegal_cut_is_not_extracted() {
    let file = PAIRS.build();
    assert!(matches!(extract(&file, &Cut::default()), Err(RefineError::Illegal { .. })));
}

#[test]
fn pages_that_are_kept_show_in_nothing() {
    let raw = DEPENDENT.build();
    let mut tables = chpm_format::Tables::of(&raw).unwrap();
    tables.header.packed = true;
    let mut offset = tables.first_page_offset().unwrap();
    let mut pages = Vec::new();
    for (id, record) in (0..).map(chpm_mesh::ClusterId).zip(&mut tables.clusters) {
        let mut bytes = Vec::new();
        if chpm_format::packed::pack(raw.page_bytes(id), &mut bytes).unwrap() {
            record.flags |= ClusterRecord::PACKED;
        } else {
            bytes = raw.page_bytes(id).to_vec();
        }
        (record.page_offset, record.page_len) = (offset, bytes.len() as u32);
        record.page_checksum = chpm_format::checksum(&bytes);
        pages.push((offset, bytes.clone()));
        offset = (offset + bytes.len() as u64).next_multiple_of(chpm_format::PACKED_ALIGN);
    }
    let mut file = tables.encode().unwrap();
    file.resize(tables.file_len().unwrap() as usize, 0);
    for (offset, bytes) in pages {
        file[offset as usize..][..bytes.len()].copy_from_slice(&bytes);
    }
    let file = Chpm::open(file).unwrap();
    for level in 0..3 {
        let cut = Cut::at_level(&file, Level(level));
        let expected = extract(&raw, &cut).unwrap();
        for bytes in [0, 300, 3000, u64::MAX] {
            let taken = Extraction::keeping(&file, &cut, bytes, || Ok::<_, RefineError>(())).unwrap();
            let (mut mesh, mut apart) = (TriMesh::default(), TriMesh::default());
            taken
                .both(|vertices, triangles| {
                    mesh.extend_from_slices(vertices);
                    mesh.triangles.extend_from_slice(triangles);
                    Ok::<_, RefineError>(())
                })
                .unwrap();
            let done = taken.vertices(|batch| {
                apart.extend_from_slices(batch);
                Ok::<_, RefineError>(())
            });
            done.unwrap();
            let done = taken.triangles(|batch| {
                apart.triangles.extend_from_slice(batch);
                Ok::<_, RefineError>(())
            });
            done.unwrap();
            assert!(mesh == expected && apart == expected, "level {level}, {bytes} bytes");
            assert_eq!(
                (taken.error(), taken.distance()),
                (cut.error(&file).unwrap(), cut.distance(&file).unwrap())
            );
        }
    }
}

/// Error and distance of a mesh are the largest of its members, gaps and all.
#[test]
fn errors_and_distances_are_the_largest_of_the_members() {
    for plan in [PAIRS, DEPENDENT, WOVEN] {
        let file = plan.build_with_gaps();
        let mut differ = 0;
        for seed in 0..40 {
            let cut = random_cut(&file, seed).unwrap();
            let [mut error, mut distance] = [0.0_f32; 2];
            for member in cut.members() {
                let own = file.page(member.cluster).unwrap().view().error_at(member.vertices as usize);
                let gaps = &file.groups()[file.clusters()[member.cluster.index()].group as usize].gaps;
                // From the error on with which something has vanished the gap is that of the base mesh.
                let gap = if own >= gaps.from { gaps.base } else { gaps.fine };
                (error, distance) = (error.max(own), distance.max(own).max(gap));
            }
            let extraction = Extraction::new(&file, &cut).unwrap();
            assert_eq!((extraction.error(), extraction.distance()), (error, distance), "{plan:?}, {seed}");
            assert_eq!((cut.error(&file).unwrap(), cut.distance(&file).unwrap()), (error, distance));
            differ += u32::from(distance > error);
        }
        assert!(differ > 10, "{plan:?}: {differ}");
    }
}
