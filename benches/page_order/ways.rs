//! Traversals, and the pages that each reads in each of its frames.

use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{Aabb, Bytes, ClusterId, GroupId};
use chpm_refine::{Camera, CameraPath, Hierarchy, Pager, View};
use std::collections::BTreeSet;
use std::error::Error;

const FRAMES: usize = 300;
const VIEWPORT: [u32; 2] = [1280, 720];
/// Of the height above ground of a low flight, by the widest side of the box.
const LOW: f64 = 0.01;
/// Groups of a smaller error than this share of the diagonal are not split for a collision.
const TOUCH: f32 = 1e-5;

type Frames = Vec<Vec<ClusterId>>;

fn fine(file: &Chpm<MappedFile>, group: GroupId) -> impl Iterator<Item = ClusterId> {
    file.fine(group).iter().copied().map(ClusterId)
}

/// Every group that can be split, by itself.
pub(super) fn splits(file: &Chpm<MappedFile>) -> Frames {
    let groups = (0..file.groups().len() as u32).map(GroupId);
    groups.map(|group| fine(file, group).collect::<Vec<_>>()).filter(|pages| !pages.is_empty()).collect()
}

/// What a viewer reads on its way, at a pixel of error.
pub(super) fn cameras(
    file: &Chpm<MappedFile>,
    memory: Bytes,
) -> Result<Vec<(&'static str, Frames)>, Box<dyn Error>> {
    let bounds = file.header().aabb();
    let front = vertices(file, file.levels().len() - 1)?;
    let front = front.into_iter().max_by(|a, b| a[2].total_cmp(&b[2])).unwrap_or_default();
    let hierarchy = Hierarchy::new(file);
    let mut ways = Vec::new();
    for (name, path) in [
        ("orbit", CameraPath::orbit(&bounds, FRAMES)),
        ("dive", CameraPath::dive(&bounds, front.map(f64::from), FRAMES)),
        ("random", CameraPath::random(&bounds, 1, FRAMES)),
        ("low flight", low_flight(file)?),
    ] {
        let mut pager = Pager::new(file, memory);
        let mut frames = Vec::new();
        for camera in &path.cameras {
            let requests = pager.want(file, &hierarchy, &View::new(camera, VIEWPORT, 1.0)?).requests;
            for page in &requests {
                pager.arrive(file, *page);
            }
            frames.push(requests);
        }
        ways.push((name, frames));
    }
    Ok(ways)
}

/// Vertices of a level's base meshes.
fn vertices(file: &Chpm<MappedFile>, level: usize) -> Result<Vec<[f32; 3]>, Box<dyn Error>> {
    let mut vertices = Vec::new();
    for (id, record) in (0..).map(ClusterId).zip(file.clusters()) {
        if record.level as usize == level {
            let page = file.page(id)?;
            let page = page.view();
            vertices.extend_from_slice(&page.positions[..page.base_vertex_count]);
        }
    }
    Ok(vertices)
}

/// From one end of the longest side to the other and back on another line, close above what is below; up is along the shortest side.
fn low_flight(file: &Chpm<MappedFile>) -> Result<CameraPath, Box<dyn Error>> {
    let Aabb { min, max } = file.header().aabb();
    let side = |axis: usize| f64::from(max[axis]) - f64::from(min[axis]);
    let mut axes = [0, 1, 2];
    axes.sort_by(|a, b| side(*b).total_cmp(&side(*a)));
    let [along, across, up] = axes;
    let ground = vertices(file, file.levels().len() / 3)?;
    let near = 0.03 * side(along);
    let place = |frame: usize| {
        let t = frame as f64 / (FRAMES - 1) as f64;
        let (there, line) = if t < 0.5 { (2.0 * t, 0.3) } else { (2.0 - 2.0 * t, 0.6) };
        let mut place = [0.0; 3];
        place[along] = f64::from(min[along]) + side(along) * (0.05 + 0.9 * there);
        place[across] = f64::from(min[across]) + side(across) * (line + 0.1 * (9.0 * there).sin());
        let beside = |p: &&[f32; 3]| {
            [along, across].iter().all(|axis| (f64::from(p[*axis]) - place[*axis]).abs() < near)
        };
        let top = ground.iter().filter(beside).map(|p| f64::from(p[up])).fold(f64::from(min[up]), f64::max);
        place[up] = top + LOW * side(along);
        place
    };
    let places: Vec<_> = (0..=FRAMES).map(place).collect();
    let cameras = places.windows(2).map(|pair| {
        let mut camera = Camera::looking(pair[0], pair[1]);
        camera.up = [0.0; 3];
        camera.up[up] = 1.0;
        camera
    });
    Ok(CameraPath { cameras: cameras.collect() })
}

/// The model comes up against itself from the side, a twentieth of its width in a hundred frames: what has to be split to know the pairs of clusters whose boxes touch.
pub(super) fn collision(file: &Chpm<MappedFile>) -> Frames {
    let Aabb { min, max } = file.header().aabb();
    let width = max[0] - min[0];
    let least = TOUCH * file.header().aabb().diagonal() as f32;
    let mut here: BTreeSet<GroupId> = BTreeSet::new();
    let mut frames = Vec::new();
    for frame in 0..100 {
        let shift = width * (1.0 - 0.0005 * frame as f32);
        let mut pages = Vec::new();
        let mut met = BTreeSet::new();
        let mut pairs: Vec<_> = file.roots().flat_map(|a| file.roots().map(move |b| (a, b))).collect();
        while let Some((a, b)) = pairs.pop() {
            let boxes = [a, b].map(|id| file.clusters()[id.index()].aabb());
            let apart = |axis: usize, shift: f32| {
                boxes[0].max[axis] < boxes[1].min[axis] + shift
                    || boxes[1].max[axis] + shift < boxes[0].min[axis]
            };
            if apart(0, shift) || apart(1, 0.0) || apart(2, 0.0) || !met.insert((a, b)) {
                continue;
            }
            let group = |id: ClusterId| file.clusters()[id.index()].group();
            let error = |id: ClusterId| file.groups()[group(id).index()].min_error;
            let largest = if error(a) >= error(b) { a } else { b };
            let split = group(largest);
            if file.fine(split).is_empty() || error(largest) < least {
                continue;
            }
            if here.insert(split) {
                pages.extend(fine(file, split));
            }
            pairs.extend(fine(file, split).map(|below| if largest == a { (below, b) } else { (a, below) }));
        }
        frames.push(pages);
    }
    frames
}
