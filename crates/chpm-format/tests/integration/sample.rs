use chpm_format::{
    BoundaryMode, ChpmWriter, ClusterRecord, ErrorKind, Gaps, GroupRecord, Header, HeaderFields, LevelRecord,
    Metadata, PageParts, SectionEntry, SheetRecord, Source, Tables, checksum,
};
use chpm_mesh::{
    Aabb, Attributes, GroupId, Level, Octahedral, Scalar, ScalarKind, ScalarRange, Sphere, VertexSlices,
};
use std::collections::BTreeMap;

/// A page of these parts.
pub(crate) fn page(parts: &PageParts<'_>) -> Vec<u8> {
    let mut page = Vec::new();
    parts.encode(&mut page).unwrap();
    page
}

/// A cluster with the global number of each vertex, which also is its position and look.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cluster {
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) normals: Vec<[f32; 3]>,
    pub(crate) octahedral: Vec<Octahedral>,
    pub(crate) colors: Vec<[u8; 4]>,
    pub(crate) scalars: Vec<u32>,
    pub(crate) triangles: Vec<[u16; 3]>,
    pub(crate) targets: Vec<u16>,
    pub(crate) errors: Vec<f32>,
    pub(crate) shared: Vec<(u16, u32)>,
    pub(crate) min_error: f32,
    pub(crate) level: u32,
    pub(crate) group: u32,
    pub(crate) parent: Option<u32>,
}

impl Cluster {
    pub(crate) fn payload(&self) -> Vec<u8> {
        let parts = PageParts {
            vertices: VertexSlices {
                positions: &self.positions,
                normals: &self.normals,
                octahedral: &self.octahedral,
                colors: &self.colors,
                scalars: &self.scalars,
            },
            triangles: &self.triangles,
            targets: &self.targets,
            errors: &self.errors,
            shared: &self.shared,
            min_error: self.min_error,
            scale_error: 0.0,
        };
        let mut payload = Vec::new();
        let max_error = parts.encode(&mut payload).unwrap();
        assert_eq!(self.record(&payload).max_error, max_error);
        payload
    }

    fn record(&self, payload: &[u8]) -> ClusterRecord {
        let parent = self.parent.map_or(GroupId::NONE, GroupId);
        ClusterRecord::of_page(payload, Level(self.level), GroupId(self.group), parent).unwrap()
    }
}

/// A whole file before it is written. Groups come bottom-up.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sample {
    pub(crate) header: HeaderFields,
    pub(crate) clusters: Vec<Cluster>,
    pub(crate) groups: Vec<(Vec<u32>, Vec<u32>)>,
}

impl Sample {
    pub(crate) fn tables(&self) -> (Tables, Vec<Vec<u8>>) {
        let pages: Vec<_> = self.clusters.iter().map(Cluster::payload).collect();
        let clusters: Vec<_> = self.clusters.iter().zip(&pages).map(|(c, page)| c.record(page)).collect();
        let mut members = Vec::new();
        let mut groups: Vec<GroupRecord> = Vec::new();
        for (coarse, fine) in &self.groups {
            let of = |ids: &[u32]| ids.iter().map(|id| clusters[*id as usize]).collect::<Vec<_>>();
            let (coarse_records, fine_records) = (of(coarse), of(fine));
            let mut bounds = Aabb::EMPTY;
            coarse_records.iter().chain(&fine_records).for_each(|c| bounds.merge(&c.aabb()));
            let below = fine_records.iter().map(|c| groups[c.group as usize].sphere());
            let sphere = Sphere::around(&bounds, coarse_records.iter().map(|c| c.sphere()).chain(below));
            let first = members.len() as u32;
            members.extend(coarse.iter().chain(fine));
            groups.push(GroupRecord {
                coarse_first: first,
                coarse_count: coarse.len() as u32,
                fine_first: first + coarse.len() as u32,
                fine_count: fine.len() as u32,
                level: coarse_records[0].level,
                flags: 0,
                min_error: coarse_records.iter().map(|c| c.min_error).fold(0.0, f32::max),
                max_error: coarse_records.iter().map(|c| c.max_error).fold(0.0, f32::max),
                center: sphere.center,
                radius: sphere.radius,
                gaps: Gaps::default(),
                rest: 0.0,
            });
        }
        let top = self.clusters.iter().map(|c| c.level).max().unwrap();
        let levels =
            (0..=top).map(|level| LevelRecord { level, refusals: [7; 8], ..Default::default() }).collect();
        let scalars = scalars(self.header.attributes.scalar_words);
        (
            Tables {
                header: self.header,
                clusters,
                groups,
                members,
                levels,
                metadata: metadata(),
                scalars,
                remnants: Vec::new(),
                sheets: Vec::new(),
            },
            pages,
        )
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        let (mut tables, pages) = self.tables();
        write(&mut tables, &pages)
    }
}

pub(crate) fn write(tables: &mut Tables, pages: &[Vec<u8>]) -> Vec<u8> {
    let mut writer = ChpmWriter::begin(Vec::new(), tables).unwrap();
    pages.iter().for_each(|page| writer.page(page).unwrap());
    writer.finish().unwrap()
}

/// One of two words, as far as they go, and others of one.
fn scalars(words: u8) -> Vec<Scalar> {
    let wide = (words > 1).then(|| Scalar::new("wide \u{1b}", ScalarKind::Float64));
    let single = |at: u8| Scalar::new(format!("number {at}"), ScalarKind::Float32);
    let mut scalars: Vec<Scalar> = wide.into_iter().chain((2.min(words & !1)..words).map(single)).collect();
    let range = ScalarRange { low: f64::NEG_INFINITY, high: f64::INFINITY, count: 1 };
    scalars.iter_mut().for_each(|scalar| scalar.range = range);
    scalars
}

pub(crate) fn metadata() -> Metadata {
    Metadata {
        generator: "hand-made".to_owned(),
        source: Source { name: "four.ply".to_owned(), vertex_count: 4, face_count: 4, ..Source::default() },
        settings: vec![("boundary".to_owned(), "lock".to_owned())],
        repairs: vec![("degenerate faces".to_owned(), 0)],
        warnings: vec![],
    }
}

/// One cluster, one group, one level: four vertices, of which the last collapses to the first.
pub(crate) fn tetrahedron() -> Sample {
    let cluster = Cluster {
        positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
        targets: vec![0],
        errors: vec![0.75],
        ..Cluster::default()
    };
    Sample {
        header: HeaderFields {
            source_vertex_count: 4,
            boundary_mode: BoundaryMode::Lock,
            error_kind: ErrorKind::Certified,
            origin: [100.0, 0.0, -0.5],
            ..HeaderFields::default()
        },
        clusters: vec![cluster],
        groups: vec![(vec![0], vec![])],
    }
}

/// A bumpy sheet of `columns` x `rows` quads, cut into `strips` leaves (a power of two) that merge two by two. Odd
/// vertices that no other cluster has collapse, in every level. Clusters come top-down in the file.
pub(crate) fn sheet(columns: usize, rows: usize, strips: usize, attributes: Attributes) -> Sample {
    assert!(strips.is_power_of_two() && columns.is_multiple_of(strips) && columns / strips >= 2);
    let sheet = Sheet { rows, width: columns / strips, strips, attributes };
    // Bottom-up first, renumbered at the end.
    let mut clusters: Vec<Cluster> = Vec::new();
    let mut groups = Vec::new();
    let mut below: Vec<(usize, Vec<usize>)> = Vec::new();
    let mut level = 0;
    let mut span = 1;
    while span <= strips {
        let mut here = Vec::new();
        for first in (0..strips).step_by(span) {
            let children = &below[if level == 0 { 0..0 } else { first / span * 2..first / span * 2 + 2 }];
            let triangles = match children {
                [] => sheet.leaf_triangles(first),
                _ => {
                    children.iter().flat_map(|(c, globals)| base_triangles(&clusters[*c], globals)).collect()
                }
            };
            let mut all: Vec<usize> = triangles.iter().flatten().copied().collect();
            for (child, globals) in children {
                all.extend(&globals[..clusters[*child].positions.len() - clusters[*child].targets.len()]);
            }
            let of_child = |(child, _): &(usize, Vec<usize>)| {
                let c = &clusters[*child];
                c.record(&c.payload()).max_error
            };
            let min_error = children.iter().map(of_child).fold(0.0, f32::max);
            let (mut cluster, globals) = sheet.cluster(all, &triangles, first..first + span, min_error);
            (cluster.level, cluster.group) = (level, clusters.len() as u32);
            for (child, _) in children {
                clusters[*child].parent = Some(clusters.len() as u32);
            }
            groups.push((vec![clusters.len()], children.iter().map(|(c, _)| *c).collect::<Vec<_>>()));
            here.push((clusters.len(), globals));
            clusters.push(cluster);
        }
        below = here;
        level += 1;
        span *= 2;
    }
    clusters.reverse();
    let last = clusters.len() - 1;
    let renumber = |ids: Vec<usize>| ids.into_iter().map(|id| (last - id) as u32).collect();
    Sample {
        header: HeaderFields {
            attributes,
            source_vertex_count: ((columns + 1) * (rows + 1)) as u64,
            boundary_mode: BoundaryMode::Lock,
            shared_vertex_count: ((strips - 1) * (rows + 1)) as u32,
            ..HeaderFields::default()
        },
        clusters,
        groups: groups.into_iter().map(|(coarse, fine)| (renumber(coarse), renumber(fine))).collect(),
    }
}

/// Two levels, three clusters: one group of one coarse and two fine clusters.
pub(crate) fn two_level() -> Sample {
    sheet(4, 2, 2, Attributes::NONE)
}

struct Sheet {
    rows: usize,
    width: usize,
    strips: usize,
    attributes: Attributes,
}

impl Sheet {
    fn leaf_triangles(&self, strip: usize) -> Vec<[usize; 3]> {
        let at = |column: usize, row: usize| column * (self.rows + 1) + row;
        let quads =
            (strip * self.width..(strip + 1) * self.width).flat_map(|c| (0..self.rows).map(move |r| (c, r)));
        quads
            .flat_map(|(c, r)| {
                [[at(c, r), at(c + 1, r), at(c + 1, r + 1)], [at(c, r), at(c + 1, r + 1), at(c, r + 1)]]
            })
            .collect()
    }

    fn shared_id(&self, global: usize, strips: &std::ops::Range<usize>) -> Option<u32> {
        let (column, row) = (global / (self.rows + 1), global % (self.rows + 1));
        let border = column / self.width;
        let inner = column.is_multiple_of(self.width) && border > 0 && border < self.strips;
        let ours = border == strips.start || border == strips.end;
        (inner && ours).then(|| ((border - 1) * (self.rows + 1) + row) as u32)
    }

    fn cluster(
        &self,
        mut globals: Vec<usize>,
        triangles: &[[usize; 3]],
        strips: std::ops::Range<usize>,
        min_error: f32,
    ) -> (Cluster, Vec<usize>) {
        let shared = |global: usize| self.shared_id(global, &strips);
        globals.sort_unstable();
        globals.dedup();
        // What collapses: every second of the vertices that are ours alone.
        let order = |global: usize| (global / strips.len().max(1)) % 2 == 1 && shared(global).is_none();
        globals.sort_by_key(|g| order(*g));
        let base = globals.partition_point(|g| !order(*g)).max(1);
        let local: BTreeMap<usize, u16> = globals.iter().enumerate().map(|(i, g)| (*g, i as u16)).collect();
        let triangles: Vec<[u16; 3]> = triangles.iter().map(|t| t.map(|g| local[&g])).collect();
        let mut targets = vec![0; globals.len() - base];
        for corners in &triangles {
            for corner in corners {
                let smallest = *corners.iter().min().unwrap();
                if usize::from(*corner) >= base && smallest < *corner {
                    targets[usize::from(*corner) - base] = smallest;
                }
            }
        }
        let collapses = targets.len();
        let cluster = Cluster {
            positions: globals.iter().map(|g| self.position(*g)).collect(),
            normals: globals.iter().filter(|_| self.attributes.normals).map(|g| self.position(*g)).collect(),
            octahedral: globals
                .iter()
                .filter(|_| self.attributes.octahedral)
                .map(|g| Octahedral::of(self.position(*g).map(f64::from)))
                .collect(),
            colors: globals
                .iter()
                .filter(|_| self.attributes.colors)
                .map(|g| (*g as u32).to_le_bytes())
                .collect(),
            scalars: globals.iter().flat_map(|g| self.words(*g)).collect(),
            triangles,
            targets,
            errors: (0..collapses).map(|j| min_error + 0.01 * (collapses - j) as f32).collect(),
            shared: globals.iter().enumerate().filter_map(|(i, g)| Some((i as u16, shared(*g)?))).collect(),
            min_error,
            ..Cluster::default()
        };
        (cluster, globals)
    }

    /// Two words of a double, a number on a lattice and one of any bits.
    fn words(&self, global: usize) -> impl Iterator<Item = u32> {
        let double = (global as f64).sqrt().to_bits();
        let words =
            [double as u32, (double >> 32) as u32, (global as f32).to_bits(), (global as u32) << 9 | 3];
        words.into_iter().take(self.attributes.scalar_words.into())
    }

    fn position(&self, global: usize) -> [f32; 3] {
        let (column, row) = (global / (self.rows + 1), global % (self.rows + 1));
        [column as f32, row as f32, (global * global % 17) as f32 / 16.0]
    }
}

fn base_triangles(cluster: &Cluster, globals: &[usize]) -> Vec<[usize; 3]> {
    let mesh = chpm_mesh::ProgressiveMesh {
        vertex_count: cluster.positions.len(),
        base_vertex_count: cluster.positions.len() - cluster.targets.len(),
        triangles: &cluster.triangles,
        targets: &cluster.targets,
    };
    let mut base = Vec::new();
    mesh.triangles_at(mesh.base_vertex_count, &mut base);
    base.into_iter().map(|t| t.map(|v| globals[usize::from(v)])).collect()
}

/// Where the sections are: `[offset, end)` by position in the section table.
pub(crate) fn section_ranges(bytes: &[u8]) -> Vec<std::ops::Range<usize>> {
    entries(bytes).iter().map(|e| e.offset as usize..(e.offset + e.len) as usize).collect()
}

pub(crate) fn entries(bytes: &[u8]) -> Vec<SectionEntry> {
    let header: Header = bytemuck::pod_read_unaligned(&bytes[..256]);
    let table = &bytes[256..][..header.section_count.min(64) as usize * 40];
    table.chunks_exact(40).map(bytemuck::pod_read_unaligned).collect()
}

/// Makes every checksum right again, pages' included, as far as offsets still lead into the file.
pub(crate) fn reseal(bytes: &mut [u8]) {
    let mut entries = entries(bytes);
    if let Some(clusters) = entries.iter().find(|entry| entry.kind == 1)
        && let Some(table) =
            bytes.get(clusters.offset as usize..clusters.offset.saturating_add(clusters.len) as usize)
    {
        let mut records: Vec<ClusterRecord> =
            table.chunks_exact(128).map(bytemuck::pod_read_unaligned).collect();
        for record in &mut records {
            let start = record.page_offset as usize;
            if let Some(page) = bytes.get(start..start.saturating_add(record.page_len as usize)) {
                record.page_checksum = checksum(page);
            }
        }
        let start = clusters.offset as usize;
        bytes[start..start + records.len() * 128].copy_from_slice(bytemuck::cast_slice(&records));
    }
    reseal_sheets(bytes, &entries);
    reseal_chunks(bytes, &entries);
    for entry in &mut entries {
        let end = entry.offset.saturating_add(entry.len) as usize;
        if let Some(section) = bytes.get(entry.offset as usize..end)
            && ![6, 9].contains(&entry.kind)
        {
            entry.checksum = checksum(section);
        }
    }
    let table: &[u8] = bytemuck::cast_slice(&entries);
    bytes[256..256 + table.len()].copy_from_slice(table);
    let sum = checksum(&bytes[256..256 + table.len()]).to_le_bytes();
    bytes[240..248].copy_from_slice(&sum);
    let sum = checksum(&bytes[..248]).to_le_bytes();
    bytes[248..256].copy_from_slice(&sum);
}

/// Makes the checksums of the tables' chunks right again.
fn reseal_sheets(bytes: &mut [u8], entries: &[SectionEntry]) {
    let of_kind = |kind: u32| entries.iter().find(|entry| entry.kind == kind);
    let (Some(records), Some(texels)) = (of_kind(8), of_kind(9)) else { return };
    let range = records.offset as usize..records.offset.saturating_add(records.len) as usize;
    let Some(table) = bytes.get(range.clone()) else { return };
    let mut sheets: Vec<SheetRecord> = table.chunks_exact(64).map(bytemuck::pod_read_unaligned).collect();
    for sheet in &mut sheets {
        let start = texels.offset.saturating_add(sheet.offset);
        let end = start.saturating_add(sheet.len());
        if let Some(stored) = bytes.get(start as usize..end as usize) {
            sheet.checksum = checksum(stored);
        }
    }
    bytes[range.start..][..64 * sheets.len()].copy_from_slice(bytemuck::cast_slice(&sheets));
}

fn reseal_chunks(bytes: &mut [u8], entries: &[SectionEntry]) {
    let range = |kind: u32| {
        let entry = entries.iter().find(|entry| entry.kind == kind)?;
        let range = entry.offset as usize..entry.offset.saturating_add(entry.len) as usize;
        bytes.get(range.clone()).map(|_| range)
    };
    let Some(list) = range(0x8000_0001).filter(|list| list.len() >= 8) else { return };
    let chunk_len: u64 = bytemuck::pod_read_unaligned(&bytes[list.start..list.start + 8]);
    let tables: Vec<_> =
        (1..=3).filter_map(range).flat_map(|table| bytes[table].chunks(chunk_len.max(1) as usize)).collect();
    let sums: Vec<u64> = tables.into_iter().take(list.len() / 8 - 1).map(checksum).collect();
    bytes[list.start + 8..][..8 * sums.len()].copy_from_slice(bytemuck::cast_slice(&sums));
}

/// A copy of a file with the bytes at `offset` changed and all checksums right.
pub(crate) fn with(bytes: &[u8], offset: usize, new: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    bytes[offset..offset + new.len()].copy_from_slice(new);
    reseal(&mut bytes);
    bytes
}
