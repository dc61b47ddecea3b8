//! Which coarse cluster a fine cluster is a part of, and the error that each group is given. A file tells groups only; a group's coarse clusters at their finest are, triangle for
//! triangle, its fine clusters at their base meshes (I4), so triangles tell the rest.

use super::Mesh;
use crate::error::ExportError;
use chpm_format::{Chpm, FormatError};
use chpm_mesh::{Aabb, ClusterId, GroupId, Places};
use rayon::prelude::*;
use xxhash_rust::xxh3::xxh3_64;

/// The binary tree of a file's clusters.
pub struct Tree {
    /// By cluster; the roots have themselves.
    parents: Vec<u32>,
    bounds: GroupBounds,
}

/// The numbers by which groups are refined, the same for all of a group.
pub(crate) struct GroupBounds {
    /// By group: at least its largest error, and more than any group below has.
    errors: Vec<f32>,
    /// By group: the box around its clusters and all that is below.
    boxes: Vec<Aabb>,
}

impl GroupBounds {
    /// Those of a file, from its tables.
    pub(crate) fn of<D: AsRef<[u8]>>(file: &Chpm<D>) -> Self {
        let upward = upward(file);
        GroupBounds { errors: falling(file, &upward), boxes: nested(file, &upward) }
    }

    /// The error that a viewer decides by. It falls from group to group, by a last bit at least: viewers take a tile whose error is no less than its
    /// parent's for one that is never to be drawn itself.
    pub(crate) fn error(&self, group: GroupId) -> f32 {
        self.errors[group.index()]
    }

    /// The box around a group and all that is below, the same for all of its coarse clusters.
    pub(crate) fn around(&self, group: GroupId) -> &Aabb {
        &self.boxes[group.index()]
    }
}

impl Tree {
    /// Reads the pages of groups with several coarse clusters, on all threads; `begun` is told each group and may end it.
    ///
    /// # Errors
    /// [`ExportError::Orphan`] for a file that does not keep I4; [`ExportError::Format`] for a damaged page; what `begun` answers.
    pub fn find<D: AsRef<[u8]> + Sync, E: From<ExportError> + Send>(
        file: &Chpm<D>,
        begun: impl Fn(GroupId) -> Result<(), E> + Sync,
    ) -> Result<Self, E> {
        let groups = (0..file.groups().len() as u32).into_par_iter().map(GroupId);
        let families = groups.map_init(Family::default, |family, group| {
            begun(group)?;
            Ok(family.of(file, group)?)
        });
        let families: Vec<Vec<u32>> = families.collect::<Result<_, E>>()?;
        let mut parents: Vec<u32> = (0..file.clusters().len() as u32).collect();
        for (group, family) in families.iter().enumerate() {
            for (cluster, parent) in file.fine(GroupId(group as u32)).iter().zip(family) {
                parents[*cluster as usize] = *parent;
            }
        }
        Ok(Tree { parents, bounds: GroupBounds::of(file) })
    }

    /// The error that a viewer decides by. It falls strictly from tile to tile.
    pub fn error(&self, group: GroupId) -> f32 {
        self.bounds.error(group)
    }

    /// The box around a group and all that is below, the same for all of its coarse clusters.
    pub fn bounds(&self, group: GroupId) -> &Aabb {
        self.bounds.around(group)
    }

    /// The parts of a coarse cluster, ascending.
    pub fn children<'a, D: AsRef<[u8]>>(
        &'a self,
        file: &'a Chpm<D>,
        cluster: ClusterId,
    ) -> impl Iterator<Item = ClusterId> + 'a {
        let fine = file.fine(file.clusters()[cluster.index()].group());
        fine.iter()
            .filter(move |fine| self.parents[**fine as usize] == cluster.0)
            .map(|fine| ClusterId(*fine))
    }
}

/// Groups, each after those below.
fn upward<D: AsRef<[u8]>>(file: &Chpm<D>) -> Vec<GroupId> {
    let mut upward: Vec<GroupId> = (0..file.groups().len() as u32).map(GroupId).collect();
    upward.sort_by_key(|group| file.groups()[group.index()].level);
    upward
}

/// The groups in which the fine clusters of a group are coarse.
fn below<D: AsRef<[u8]>>(file: &Chpm<D>, group: GroupId) -> impl Iterator<Item = usize> {
    file.fine(group).iter().map(|fine| file.clusters()[*fine as usize].group().index())
}

/// Errors of groups that fall strictly, down to the 0 of the finest meshes.
fn falling<D: AsRef<[u8]>>(file: &Chpm<D>, upward: &[GroupId]) -> Vec<f32> {
    let mut errors: Vec<f32> = file.groups().iter().map(|group| group.max_error).collect();
    for group in upward {
        let largest = below(file, *group).map(|group| errors[group]).fold(0.0, f32::max);
        errors[group.index()] = errors[group.index()].max(largest.next_up());
    }
    errors
}

/// Boxes of groups, each in those above.
fn nested<D: AsRef<[u8]>>(file: &Chpm<D>, upward: &[GroupId]) -> Vec<Aabb> {
    let mut boxes = vec![Aabb::EMPTY; upward.len()];
    for group in upward {
        let own = file.coarse(*group).iter().map(|coarse| {
            let record = &file.clusters()[*coarse as usize];
            Aabb { min: record.aabb_min, max: record.aabb_max }
        });
        let mut bounds = Aabb::EMPTY;
        own.chain(below(file, *group).map(|group| boxes[group])).for_each(|part| bounds.merge(&part));
        boxes[group.index()] = bounds;
    }
    boxes
}

/// Search for parents within a group.
#[derive(Default)]
struct Family {
    /// Triangles of the fine clusters, each with its cluster's number in the group; ascending, and each once.
    fine: Vec<(u64, u32)>,
    /// The same of the coarse ones.
    coarse: Vec<(u64, u32)>,
    /// By fine cluster, then by coarse cluster: triangles that they share.
    votes: Vec<u32>,
    places: Places,
}

impl Family {
    /// The parents of a group's fine clusters: of each the coarse cluster with most of its triangles, or of what is in the same place.
    fn of<D: AsRef<[u8]>>(&mut self, file: &Chpm<D>, group: GroupId) -> Result<Vec<u32>, ExportError> {
        let (coarse, fine) = (file.coarse(group), file.fine(group));
        if let [only] = coarse {
            return Ok(vec![*only; fine.len()]);
        }
        let Family { fine: base, coarse: finest, votes, places } = self;
        gather(file, fine, Mesh::Base, places, base)?;
        gather(file, coarse, Mesh::Finest, places, finest)?;
        votes.clear();
        votes.resize(fine.len() * coarse.len(), 0);
        let mut owners = &base[..];
        for (key, number) in &*finest {
            let passed = owners.iter().take_while(|owner| owner.0 < *key).count();
            owners = &owners[passed..];
            // Sheets in the same place have the same triangles: each counts for all.
            for (_, owner) in owners.iter().take_while(|owner| owner.0 == *key) {
                votes[*owner as usize * coarse.len() + *number as usize] += 1;
            }
        }
        votes
            .chunks(coarse.len().max(1))
            .zip(fine)
            .map(|(votes, cluster)| {
                let most = votes.iter().copied().max().unwrap_or(0);
                let first = votes.iter().position(|votes| *votes == most && most > 0);
                let empty = file.clusters()[*cluster as usize].base_triangle_count == 0;
                let orphan = ExportError::Orphan { cluster: ClusterId(*cluster), group };
                first.or(empty.then_some(0)).and_then(|number| coarse.get(number)).copied().ok_or(orphan)
            })
            .collect()
    }
}

/// The triangles of clusters, as hashes of their corners, which begin with the least; each with the number of its cluster.
fn gather<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    clusters: &[u32],
    mesh: Mesh,
    places: &mut Places,
    out: &mut Vec<(u64, u32)>,
) -> Result<(), FormatError> {
    out.clear();
    for (number, cluster) in (0..).zip(clusters) {
        let page = file.page(ClusterId(*cluster))?;
        let page = page.view();
        places.go_to(&page.progressive_mesh(), mesh.position(&page));
        out.extend(places.triangles(page.triangles).map(|corners| {
            let [a, b, c] = corners.map(|v| page.vertices.positions[usize::from(v)].map(f32::to_bits));
            let corners = [a, b, c].min([b, c, a]).min([c, a, b]);
            (xxh3_64(bytemuck::cast_slice(corners.as_flattened())), number)
        }));
    }
    out.sort_unstable();
    out.dedup();
    Ok(())
}
