//! The best mesh of at most so many triangles for a view: refinement in the order of what is seen, until the triangles are used up.

use crate::cut::{Cut, Member};
use crate::error::RefineError;
use crate::front::Front;
use crate::hierarchy::Hierarchy;
use crate::view::View;
use chpm_format::{Chpm, Page};
use chpm_mesh::{ClusterId, GroupId};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// A refinement that can be stopped after any step: it starts with the coarsest cut, and every step takes away the error
/// that covers the most pixels, in all clusters of one dependency group at once. So what is left is the least largest error that this many
/// triangles can have in steps of whole groups, and every cut on the way is legal and without cracks.
#[derive(Debug)]
pub struct Budgeted<'a, D> {
    file: &'a Chpm<D>,
    hierarchy: &'a Hierarchy,
    view: View,
    front: Front,
    /// By cluster, those of the cut.
    members: Vec<Option<Counted>>,
    triangles: u64,
    heap: BinaryHeap<Step>,
}

/// A cluster of the cut.
#[derive(Clone, Debug)]
struct Counted {
    vertices: usize,
    base_vertex_count: usize,
    /// By position from the base mesh's: how many triangles it has.
    triangles: Vec<u32>,
}

/// The next thing to do in a group: to go below its largest error.
#[derive(Clone, Copy, Debug)]
struct Step {
    pixels: f64,
    /// Decides between equals.
    rank: Reverse<u32>,
    group: GroupId,
    error: f32,
}

impl<'a, D: AsRef<[u8]>> Budgeted<'a, D> {
    /// The coarsest cut.
    ///
    /// # Errors
    /// [`RefineError::Format`] for a damaged page.
    pub fn new(file: &'a Chpm<D>, hierarchy: &'a Hierarchy, view: &View) -> Result<Self, RefineError> {
        let mut budgeted = Budgeted {
            file,
            hierarchy,
            view: *view,
            front: Front::new(file),
            members: vec![None; file.clusters().len()],
            triangles: 0,
            heap: BinaryHeap::new(),
        };
        for root in file.roots() {
            let counted = Counted::of(file, root)?;
            budgeted.enter(root, counted);
        }
        for group in budgeted.front.open_groups().to_vec() {
            budgeted.plan(group)?;
        }
        Ok(budgeted)
    }

    /// Refines once more, unless that would make more than `limit` triangles or the view is content: then answers `false`.
    ///
    /// # Errors
    /// [`RefineError::Format`] for a damaged page, after which the cut is the one before, and no step follows in that group.
    pub fn step(&mut self, limit: u64) -> Result<bool, RefineError> {
        let Some(Step { group, error, .. }) = self.heap.peek().copied() else { return Ok(false) };
        let splits = self.hierarchy.split_error(group).is_some_and(|at| at >= error);
        let after = if splits { self.fine_triangles(group) } else { self.moved_triangles(group, error)? };
        let rest = self.triangles - self.coarse_triangles(group);
        if rest + after > limit {
            return Ok(false);
        }
        self.heap.pop();
        if splits {
            self.split(group)?;
        } else {
            self.refine(group, error)?;
            self.plan(group)?;
        }
        Ok(true)
    }

    /// Refines as long as the limit allows.
    ///
    /// # Errors
    /// As [`Budgeted::step`].
    pub fn run(&mut self, limit: u64) -> Result<(), RefineError> {
        while self.step(limit)? {}
        Ok(())
    }

    /// Triangles of the cut; more than a limit only where even the coarsest cut has more.
    pub fn triangles(&self) -> u64 {
        self.triangles
    }

    /// Pixels that the largest error which could still be refined covers, wherever it is; `None` where the view is content.
    pub fn pixels(&self) -> Option<f64> {
        self.heap.peek().map(|step| step.pixels)
    }

    /// The cut.
    pub fn cut(&self) -> Cut {
        let member = |(cluster, counted): (_, &Option<Counted>)| {
            counted.as_ref().map(|counted| Member { cluster, vertices: counted.vertices as u32 })
        };
        Cut::new((0..).map(ClusterId).zip(&self.members).filter_map(member).collect())
    }

    /// The clusters of a group and their pages.
    fn coarse(
        &self,
        group: GroupId,
    ) -> impl Iterator<Item = (ClusterId, Result<Page<'a>, RefineError>)> + use<'a, D> {
        let file = self.file;
        let page = |id| Ok(Page::view(file.page_bytes(id))?);
        file.coarse(group).iter().copied().map(ClusterId).map(move |id| (id, page(id)))
    }

    fn counted(&self, cluster: ClusterId) -> impl Iterator<Item = &Counted> {
        self.members[cluster.index()].iter()
    }

    fn coarse_triangles(&self, group: GroupId) -> u64 {
        let coarse = self.file.coarse(group).iter().copied().map(ClusterId);
        coarse.flat_map(|id| self.counted(id)).map(|counted| counted.at(counted.vertices)).sum()
    }

    fn fine_triangles(&self, group: GroupId) -> u64 {
        let fine = self.file.fine(group).iter().map(|id| &self.file.clusters()[*id as usize]);
        fine.map(|record| u64::from(record.base_triangle_count)).sum()
    }

    /// Triangles of the clusters of a group below an error.
    fn moved_triangles(&self, group: GroupId, error: f32) -> Result<u64, RefineError> {
        let mut sum = 0;
        for (id, page) in self.coarse(group) {
            let n = page?.vertices_for(error.next_down());
            sum += self.counted(id).map(|counted| counted.at(n)).sum::<u64>();
        }
        Ok(sum)
    }

    fn refine(&mut self, group: GroupId, error: f32) -> Result<(), RefineError> {
        for (id, page) in self.coarse(group) {
            let n = page?.vertices_for(error.next_down());
            if let Some(counted) = &mut self.members[id.index()] {
                self.triangles += counted.at(n);
                self.triangles -= counted.at(counted.vertices);
                counted.vertices = n;
            }
        }
        Ok(())
    }

    fn split(&mut self, group: GroupId) -> Result<(), RefineError> {
        // What may fail comes first.
        let fine = self.file.fine(group).iter().copied().map(ClusterId);
        let fine =
            fine.map(|id| Ok((id, Counted::of(self.file, id)?))).collect::<Result<Vec<_>, RefineError>>()?;
        fine.into_iter().for_each(|(id, counted)| self.enter(id, counted));
        for coarse in self.file.coarse(group) {
            if let Some(counted) = self.members[*coarse as usize].take() {
                self.triangles -= counted.at(counted.vertices);
            }
        }
        let known = self.front.open_groups().len();
        self.front.split(self.file, group);
        for place in known..self.front.open_groups().len() {
            self.plan(self.front.open_groups()[place])?;
        }
        Ok(())
    }

    fn enter(&mut self, cluster: ClusterId, counted: Counted) {
        self.triangles += counted.at(counted.vertices);
        self.members[cluster.index()] = Some(counted);
    }

    /// Queues the next step in a group, unless the view is content with it.
    fn plan(&mut self, group: GroupId) -> Result<(), RefineError> {
        let mut error = self.hierarchy.split_error(group).unwrap_or(0.0);
        for (id, page) in self.coarse(group) {
            let page = page?;
            let refinable = self.counted(id).filter(|counted| counted.vertices < page.vertex_count());
            error = refinable.map(|counted| page.error_at(counted.vertices)).fold(error, f32::max);
        }
        if error > self.hierarchy.bound(group, &self.view) {
            let pixels = self.view.pixels_of(error, self.hierarchy.region(group));
            self.heap.push(Step { pixels, rank: Reverse(self.hierarchy.rank(group)), group, error });
        }
        Ok(())
    }
}

impl Counted {
    /// A cluster at its base mesh.
    fn of<D: AsRef<[u8]>>(file: &Chpm<D>, cluster: ClusterId) -> Result<Self, RefineError> {
        let mesh = file.page(cluster)?.progressive_mesh();
        let base_vertex_count = mesh.base_vertex_count;
        let mut triangles = vec![0; mesh.vertex_count - base_vertex_count + 1];
        for corners in mesh.triangles {
            triangles[mesh.birth(*corners) - base_vertex_count] += 1;
        }
        let mut sum = 0;
        for count in &mut triangles {
            sum += *count;
            *count = sum;
        }
        Ok(Counted { vertices: base_vertex_count, base_vertex_count, triangles })
    }

    fn at(&self, vertices: usize) -> u64 {
        u64::from(self.triangles[vertices - self.base_vertex_count])
    }
}

impl Ord for Step {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let by_pixels = self.pixels.total_cmp(&other.pixels);
        by_pixels.then(self.rank.cmp(&other.rank))
    }
}

impl PartialOrd for Step {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Step {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Step {}
