//! The smallest file, written by hand and read again: `cargo run -p chpm-format --example smallest_file -- [FILE.chpm]`.
//!
//! A square of two triangles, one vertex of which may collapse: one cluster in one group on one level. With a file name, the bytes go
//! there, and `chpm info`, `verify` and `dump` understand them.

use chpm_format::{Chpm, ChpmWriter, ClusterRecord, GroupRecord, LevelRecord, PageParts, Tables, verify};
use chpm_mesh::{GroupId, Level, VertexSlices};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    // The page: vertices in the order in which they come, the last one first to go. It goes to vertex 1, at an error of 0.5.
    let parts = PageParts {
        vertices: VertexSlices::new(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]),
        triangles: &[[0, 1, 2], [1, 3, 2]],
        targets: &[1],
        errors: &[0.5],
        ..PageParts::default()
    };
    let mut page = Vec::new();
    parts.encode(&mut page)?;

    // The tables: the cluster has no parent, so it is a root; its group holds it, with a sphere and the largest error.
    let cluster = ClusterRecord::of_page(&page, Level(0), GroupId(0), GroupId::NONE)?;
    let (center, radius) = (cluster.center, cluster.radius);
    let group = GroupRecord { coarse_count: 1, max_error: 0.5, center, radius, ..GroupRecord::default() };
    let mut tables = Tables {
        clusters: vec![cluster],
        groups: vec![group],
        members: vec![0],
        levels: vec![LevelRecord::default()],
        ..Tables::default()
    };
    tables.header.source_vertex_count = 4;

    // Tables first, then the pages: one pass forward.
    let mut writer = ChpmWriter::begin(Vec::new(), &mut tables)?;
    writer.page(&page)?;
    let bytes = writer.finish()?;
    if let Some(path) = std::env::args().nth(1) {
        std::fs::write(path, &bytes)?;
    }

    // Reading: nothing is trusted before it was checked. The arrays of a page are slices of the bytes themselves.
    let file = Chpm::open(bytes)?;
    assert!(verify(&file, |_, _| ()).is_ok());
    for root in file.roots() {
        let page = file.page(root)?;
        let page = page.view();
        println!("cluster {}: {} vertices, {} triangles", root.0, page.vertex_count(), page.triangles.len());
        for bound in [0.0, 0.4, 0.5] {
            println!("  within {bound}: {} vertices", page.vertices_for(bound));
        }
    }
    Ok(())
}
