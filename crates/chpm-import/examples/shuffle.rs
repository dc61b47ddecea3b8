//! Writes a PLY again with its vertices and its triangles in random order: the same surface, without any coherence.
//! Usage: shuffle IN.ply OUT.ply [SEED]. The mesh is held in memory.

use chpm_import::ply::{Batch, BatchKind, Encoding, Options, PlyReader, PlyWriter};
use chpm_mesh::{Attributes, VertexSlices};
use std::error::Error;
use std::fs::File;
use std::io::BufWriter;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [source, target, seed @ ..] = &arguments[..] else {
        return Err("usage: shuffle IN OUT [SEED]".into());
    };
    let mut state = seed.first().map_or(Ok(1), |seed| seed.parse::<u64>())?;
    // SplitMix64.
    let mut below = |bound: usize| {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = state;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((u128::from(x ^ (x >> 31)) * bound as u128) >> 64) as usize
    };

    let mut reader = PlyReader::new(File::open(source)?, Options::default())?;
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let mut batch = Batch::default();
    loop {
        match reader.next_batch(&mut batch)? {
            BatchKind::Vertices if batch.vertices.positions.is_empty() => {
                return Err("double coordinates".into());
            }
            BatchKind::Vertices => positions.extend_from_slice(&batch.vertices.positions),
            BatchKind::Triangles => triangles.extend_from_slice(&batch.triangles),
            BatchKind::End => break,
        }
    }
    // Fisher-Yates, for the new places of the vertices and for the triangles themselves.
    let mut places: Vec<u32> = (0..positions.len() as u32).collect();
    for last in (1..places.len()).rev() {
        places.swap(last, below(last + 1));
    }
    for last in (1..triangles.len()).rev() {
        triangles.swap(last, below(last + 1));
    }
    let mut shuffled = vec![[0.0f32; 3]; positions.len()];
    for (position, place) in positions.iter().zip(&places) {
        shuffled[*place as usize] = *position;
    }
    triangles.iter_mut().for_each(|t| *t = t.map(|v| places[v as usize]));

    let (vertex_count, triangle_count) = (shuffled.len() as u64, triangles.len() as u64);
    let out = BufWriter::new(File::create(target)?);
    let encoding = Encoding::BinaryLittleEndian;
    let mut ply =
        PlyWriter::new(out, encoding, vertex_count, triangle_count, Attributes::NONE, false, &["shuffled"])?;
    ply.vertices(VertexSlices::new(&shuffled))?;
    ply.triangles(&triangles)?;
    ply.finish()?.into_inner()?.sync_all()?;
    Ok(())
}
