//! Draws a view with an engine of one's own: `cargo run -p chpm-refine --example draw_a_view -- FILE.chpm [PIXELS [MIB]]`.
//!
//! A camera comes nearer, frame by frame. Each frame selects what it needs at so many pixels of error, reads pages within so many MiB,
//! and hands triangles to the "engine", which here only counts them. What is not there yet is drawn coarser, without cracks.

use chpm_format::Chpm;
use chpm_mesh::{Bytes, ClusterId};
use chpm_refine::{ActiveList, Camera, Hierarchy, Pager, PmCursor, View};
use std::collections::BTreeMap;
use std::error::Error;

const VIEWPORT: [u32; 2] = [1280, 720];
const FRAMES: u32 = 8;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let path = args.next().ok_or("a .chpm file expected")?;
    let pixels: f64 = args.next().map_or(Ok(1.0), |text| text.parse())?;
    let budget = Bytes::mib(args.next().map_or(Ok(64), |text| text.parse())?);

    // Any bytes will do: a vector as here, or a memory map, from which the system reads what is touched.
    let file = Chpm::open(std::fs::read(path)?)?;
    let hierarchy = Hierarchy::new(&file);
    // Which pages are there, and which the view wants; what is drawn.
    let mut pager = Pager::new(&file, budget);
    let mut list = ActiveList::new(&file);
    // By cluster: its progressive mesh at the position that was drawn last.
    let mut engine: BTreeMap<ClusterId, PmCursor> = BTreeMap::new();

    let whole = Camera::framing(&file.header().aabb());
    let center = file.header().aabb().center();
    for frame in 0..FRAMES {
        let near = f64::from(frame) / f64::from(FRAMES);
        let from = whole.position;
        let position = std::array::from_fn(|i| from[i] + near * (center[i] - from[i]));
        let view = View::new(&Camera::looking(position, center.into()), VIEWPORT, pixels)?;

        // Ask for pages, most urgent first. A real engine reads them on other threads, and tells when they are there.
        let traffic = pager.want(&file, &hierarchy, &view);
        for page in &traffic.requests {
            pager.arrive(&file, *page);
        }

        // Select among what is there.
        let changes = list.update(&file, &hierarchy, &view, |group| pager.is_ready(group))?;
        for left in list.left() {
            engine.remove(left);
        }

        // Draw: a cursor plays each cluster to its position, from where it was.
        let mut triangles = 0;
        for member in list.members() {
            let page = file.page(member.cluster)?;
            let page = page.view();
            let cursor =
                engine.entry(member.cluster).or_insert_with(|| PmCursor::new(&page.progressive_mesh()));
            cursor.move_to(member.vertices as usize);
            triangles += cursor.triangles().len();
        }
        println!(
            "frame {frame}: {} clusters, {triangles} triangles; {} pages read, {} let go; {} groups split, {} collapsed",
            list.len(),
            traffic.requests.len(),
            traffic.evictions.len(),
            changes.splits,
            changes.collapses
        );
    }
    Ok(())
}
