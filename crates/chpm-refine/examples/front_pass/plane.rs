//! A made-up file: a plane of 128 x 128 tiny leaf clusters with a binary tree above.

use chpm_format::{
    Chpm, ChpmWriter, ClusterRecord, FormatError, GroupRecord, HeaderFields, LevelRecord, PageParts, Tables,
};
use chpm_mesh::{GroupId, Level, Sphere, VertexSlices};

/// Levels above the leaves: halves across and along in turn.
const LEVELS: u32 = 14;

/// Columns and rows of a level.
fn size(level: u32) -> [u32; 2] {
    [1 << (LEVELS / 2 - level / 2), 1 << (LEVELS / 2 - level.div_ceil(2))]
}

/// The first cluster of a level; leaves come first.
fn first(level: u32) -> u32 {
    (0..level).map(|level| size(level).iter().product::<u32>()).sum()
}

/// Four vertices at the corners of a rectangle, two of which collapse.
fn page(level: u32, at: [u32; 2], out: &mut Vec<u8>) -> Result<(), FormatError> {
    let [columns, rows] = size(level).map(|n| 128.0 / n as f32);
    let [x, y] = [at[0] as f32 * columns, at[1] as f32 * rows];
    let least = if level == 0 { 0.0 } else { 0.001 * 1.5_f32.powi(level as i32) };
    out.clear();
    PageParts {
        vertices: VertexSlices::new(&[
            [x, y, 0.0],
            [x + columns, y, 0.0],
            [x, y + rows, 0.0],
            [x + columns, y + rows, 0.0],
        ]),
        triangles: &[[0, 1, 2], [1, 3, 2]],
        targets: &[1],
        errors: &[0.001 * 1.5_f32.powi(level as i32 + 1)],
        min_error: least,
        ..PageParts::default()
    }
    .encode(out)
    .map(drop)
}

/// Callback for a level, a place in it, and the page of the cluster there.
type Visit<'a> = dyn FnMut(u32, [u32; 2], &[u8]) -> Result<(), FormatError> + 'a;

/// The file.
pub(crate) fn file() -> Result<Chpm<Vec<u8>>, FormatError> {
    let mut tables = Tables {
        header: HeaderFields {
            boundary_mode: chpm_format::BoundaryMode::Lock,
            source_vertex_count: 4 << LEVELS,
            ..HeaderFields::default()
        },
        levels: (0..=LEVELS).map(|level| LevelRecord { level, ..LevelRecord::default() }).collect(),
        ..Tables::default()
    };
    let mut bytes = Vec::new();
    let mut each = |visit: &mut Visit<'_>| {
        for level in 0..=LEVELS {
            let [columns, rows] = size(level);
            for at in (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y])) {
                page(level, at, &mut bytes)?;
                visit(level, at, &bytes)?;
            }
        }
        Ok::<_, FormatError>(())
    };
    each(&mut |level, [x, y], page| {
        let id = tables.clusters.len() as u32;
        // One level up, pairs along one axis become one: a group is a cluster, and has its number.
        let parent = match level {
            LEVELS => GroupId::NONE,
            _ => {
                let [px, py] = if level % 2 == 0 { [x, y / 2] } else { [x / 2, y] };
                GroupId(first(level + 1) + py * size(level + 1)[0] + px)
            }
        };
        let cluster = ClusterRecord::of_page(page, Level(level), GroupId(id), parent)?;
        let children = match level {
            0 => vec![],
            _ => {
                let [columns, _] = size(level - 1);
                let at = |x, y| first(level - 1) + y * columns + x;
                if level % 2 == 1 {
                    vec![at(x, 2 * y), at(x, 2 * y + 1)]
                } else {
                    vec![at(2 * x, y), at(2 * x + 1, y)]
                }
            }
        };
        let below = children.iter().map(|child| tables.groups[*child as usize].sphere());
        let sphere = Sphere::around(&cluster.aabb(), [cluster.sphere()].into_iter().chain(below));
        tables.groups.push(GroupRecord {
            coarse_first: tables.members.len() as u32,
            coarse_count: 1,
            fine_first: tables.members.len() as u32 + 1,
            fine_count: children.len() as u32,
            level,
            min_error: cluster.min_error,
            max_error: cluster.max_error,
            center: sphere.center,
            radius: sphere.radius,
            ..GroupRecord::default()
        });
        tables.members.push(id);
        tables.members.extend(children);
        tables.clusters.push(cluster);
        Ok(())
    })?;
    let mut writer = ChpmWriter::begin(Vec::new(), &mut tables)?;
    each(&mut |_, _, page| writer.page(page))?;
    Chpm::open(writer.finish()?)
}
