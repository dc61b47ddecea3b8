//! Regions that an earlier build has cut into leaves: a result goes by a hash of the region's mesh and of the settings that decide it, in which border vertices are
//! numbered by the region alone.

use super::load::INNER;
use super::region::{self, Done, Mesh};
use crate::config::{Normals, Settings};
use crate::context::Context;
use crate::error::BuildError;
use crate::memo::{Key, Memo, Owner, hash_value, opened, sealed};
use bytemuck::cast_slice;
use chpm_extmem::Spool;
use xxhash_rust::xxh3::Xxh3;

/// Border numbers of a region, ascending: its own number of each is its place here.
struct Borders(Vec<u32>);

impl Borders {
    /// Takes the border numbers of a mesh, and leaves it the region's own.
    fn take(mesh: &mut Mesh) -> Self {
        let mut all: Vec<u32> = mesh.border.iter().copied().filter(|border| *border != INNER).collect();
        all.sort_unstable();
        let borders = Borders(all);
        for border in mesh.border.iter_mut().filter(|border| **border != INNER) {
            *border = borders.0.partition_point(|other| other < border) as u32;
        }
        borders
    }

    fn count(&self) -> u32 {
        self.0.len() as u32
    }

    /// The number in the whole source.
    fn global(&self, own: u32) -> u32 {
        self.0.get(own as usize).copied().unwrap_or(own)
    }
}

/// Result of a region, as the memo has it or made. `border_count` is that of the whole source.
pub(super) fn done(
    (memo, region): (&Memo, usize),
    mut mesh: Mesh,
    parts: u32,
    border_count: u32,
    settings: &Settings,
    spool: &Spool,
    context: &Context<'_>,
) -> Result<Done, BuildError> {
    let borders = Borders::take(&mut mesh);
    let key = key(&mesh, parts, settings)?;
    let owner = Owner::Region(region);
    if let Some(bytes) = memo.find(owner, key)? {
        context.progress.advance(mesh.triangles.len() as u64);
        return taken_over(&bytes, &borders, border_count, spool);
    }

    let scratch = Spool::new(&context.store, "leaves of a region");
    let mut done = region::done(mesh, parts, borders.count(), settings, &scratch, context)?;
    let (mut blobs, mut page) = (Vec::new(), Vec::new());
    for leaf in &mut done.leaves {
        leaf.move_to(&scratch, &mut page, |page| {
            blobs.extend_from_slice(page);
            Ok((blobs.len() - page.len()) as u64)
        })?;
    }
    let bytes = sealed(&done, &blobs)?;
    drop((scratch, blobs, done));
    memo.add(owner, key, &bytes)?;
    taken_over(&bytes, &borders, border_count, spool)
}

/// Hash of all that decides the leaves of a region.
fn key(mesh: &Mesh, parts: u32, settings: &Settings) -> Result<Key, BuildError> {
    let mut hash = Xxh3::new();
    let Settings { cell_vertices, cell_neighbors, partitioner, seed, normals, .. } = settings;
    let decides =
        (cell_vertices, cell_neighbors, partitioner.to_string(), seed, *normals == Normals::Computed);
    hash_value(&mut hash, &("region", parts, decides))?;
    hash_value(&mut hash, &(mesh.copies, mesh.referenced))?;
    let vertices = &mesh.vertices;
    let columns: [&[u8]; 7] = [
        cast_slice(&vertices.positions),
        cast_slice(&vertices.normals),
        cast_slice(&vertices.octahedral),
        cast_slice(&vertices.colors),
        cast_slice(&vertices.scalars),
        cast_slice(&mesh.border),
        cast_slice(&mesh.triangles),
    ];
    for column in columns {
        hash.update(&(column.len() as u64).to_le_bytes());
        hash.update(column);
    }
    Ok(hash.digest128())
}

/// A result in the numbers of this source, its leaves spooled.
fn taken_over(bytes: &[u8], borders: &Borders, border_count: u32, spool: &Spool) -> Result<Done, BuildError> {
    let (mut done, blobs) = opened::<Done>(bytes)?;
    let mut page = Vec::new();
    for leaf in &mut done.leaves {
        let blob = |offset, len| blobs.get(offset, len);
        leaf.spool_anew(blob, &mut page, |border| borders.global(border), spool)?;
    }
    for (border, _) in &mut done.border_uses {
        *border = borders.global(*border);
    }
    for sum in &mut done.normals {
        sum.border = borders.global(sum.border as u32).into();
    }
    let count = borders.count();
    done.topology = done.topology.renumbered(|number| match number.checked_sub(count) {
        Some(inner) => inner + border_count,
        None => borders.global(number),
    });
    Ok(done)
}
