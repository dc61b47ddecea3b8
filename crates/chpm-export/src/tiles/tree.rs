//! Which coarse cluster a fine cluster is a part of, and the error that each group is given. A file tells groups only; a group's coarse clusters at their finest are, triangle for
//! triangle, its fine clusters at their base meshes (I4), so triangles tell the rest.

use crate::error::ExportError;
use chpm_format::{Chpm, FormatError, Page};
use chpm_mesh::{ClusterId, GroupId, Places};
use std::collections::HashMap;

/// The binary tree of a file's clusters.
pub struct Tree {
    /// By cluster; the roots have themselves.
    parents: Vec<u32>,
    /// By group: at least its largest error, and more than any group below has.
    errors: Vec<f32>,
}

/// Corner positions by their bits, beginning with the least.
type Key = [[u32; 3]; 3];

impl Tree {
    /// Reads the pages of groups with several coarse clusters, group by group; `begun` is told each group and may end it.
    ///
    /// # Errors
    /// [`ExportError::Orphan`] for a file that does not keep I4; [`ExportError::Format`] for a damaged page; what `begun` answers.
    pub fn find<D: AsRef<[u8]>, E: From<ExportError>>(
        file: &Chpm<D>,
        mut begun: impl FnMut(GroupId) -> Result<(), E>,
    ) -> Result<Self, E> {
        let mut parents: Vec<u32> = (0..file.clusters().len() as u32).collect();
        let mut family = Family::default();
        for group in (0..file.groups().len() as u32).map(GroupId) {
            begun(group)?;
            let (coarse, fine) = (file.coarse(group), file.fine(group));
            if let [only] = coarse {
                fine.iter().for_each(|cluster| parents[*cluster as usize] = *only);
                continue;
            }
            for (cluster, parent) in fine.iter().zip(family.of(file, group, coarse, fine)?) {
                parents[*cluster as usize] = parent;
            }
        }
        Ok(Tree { parents, errors: falling(file) })
    }

    /// The error that a viewer decides by. It falls from tile to tile, by a last bit at least: viewers take a tile whose error is no less than its
    /// parent's for one that is never to be drawn itself.
    pub fn error(&self, group: GroupId) -> f32 {
        self.errors[group.index()]
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

/// Errors of groups that fall strictly, down to the 0 of the finest meshes.
fn falling<D: AsRef<[u8]>>(file: &Chpm<D>) -> Vec<f32> {
    let mut errors: Vec<f32> = file.groups().iter().map(|group| group.max_error).collect();
    let mut upward: Vec<GroupId> = (0..errors.len() as u32).map(GroupId).collect();
    upward.sort_by_key(|group| file.groups()[group.index()].level);
    for group in upward {
        let below =
            file.fine(group).iter().map(|fine| errors[file.clusters()[*fine as usize].group().index()]);
        let below = below.fold(0.0, f32::max);
        errors[group.index()] = errors[group.index()].max(below.next_up());
    }
    errors
}

/// What finds the parents within a group.
#[derive(Default)]
struct Family {
    /// The fine cluster, by its number in the group, that has a triangle.
    owners: HashMap<Key, usize>,
    places: Places,
}

impl Family {
    /// The parents of the fine clusters: of each the coarse cluster with most of its triangles. Triangles in the same place may go astray, but not
    /// most of them.
    fn of<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        group: GroupId,
        coarse: &[u32],
        fine: &[u32],
    ) -> Result<Vec<u32>, ExportError> {
        self.owners.clear();
        for (number, cluster) in fine.iter().enumerate() {
            self.visit(
                file,
                *cluster,
                |page| page.base_vertex_count,
                |owners, key| {
                    owners.insert(key, number);
                },
            )?;
        }
        let mut votes = vec![vec![0_u32; coarse.len()]; fine.len()];
        for (number, cluster) in coarse.iter().enumerate() {
            self.visit(
                file,
                *cluster,
                |page| page.vertex_count(),
                |owners, key| {
                    if let Some(owner) = owners.get(&key) {
                        votes[*owner][number] += 1;
                    }
                },
            )?;
        }
        let parent = |(votes, cluster): (&Vec<u32>, &u32)| {
            let most = votes.iter().copied().max().unwrap_or(0);
            let first = votes.iter().position(|votes| *votes == most && most > 0);
            let empty = file.clusters()[*cluster as usize].base_triangle_count == 0;
            let orphan = ExportError::Orphan { cluster: ClusterId(*cluster), group };
            first.or(empty.then_some(0)).and_then(|number| coarse.get(number)).copied().ok_or(orphan)
        };
        votes.iter().zip(fine).map(parent).collect()
    }

    /// Hands out the triangles of a cluster at a position.
    fn visit<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        cluster: u32,
        position: impl Fn(&Page<'_>) -> usize,
        mut sink: impl FnMut(&mut HashMap<Key, usize>, Key),
    ) -> Result<(), FormatError> {
        let page = file.page(ClusterId(cluster))?;
        let page = page.view();
        self.places.go_to(&page.progressive_mesh(), position(&page));
        for corners in self.places.triangles(page.triangles) {
            let [a, b, c] = corners.map(|v| page.vertices.positions[usize::from(v)].map(f32::to_bits));
            sink(&mut self.owners, [a, b, c].min([b, c, a]).min([c, a, b]));
        }
        Ok(())
    }
}
