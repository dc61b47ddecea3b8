//! Orders of all pages of a file.

use chpm_build::page_order::{self, Run};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{Aabb, ClusterId, GroupId};
use std::cmp::Reverse;
use std::collections::VecDeque;

/// Pages that come together: a root, or what a split brings; and the runs that splits of these bring.
struct Node {
    pages: Vec<ClusterId>,
    below: Vec<usize>,
    height: usize,
}

/// Names and orders.
pub(super) fn all(file: &Chpm<MappedFile>) -> Vec<(&'static str, Vec<ClusterId>)> {
    let clusters = (0..file.header().cluster_count).map(ClusterId);
    let splits: Vec<ClusterId> = page_order::order(runs(file)).into_iter().map(ClusterId).collect();
    let mut levels = splits.clone();
    levels.sort_by_key(|id| Reverse(file.clusters()[id.index()].level));
    let (tree, tops) = tree(file);
    let pages = |order: Vec<usize>| order.into_iter().flat_map(|node| tree[node].pages.clone()).collect();
    let mut veb = Vec::new();
    let height = tops.iter().map(|top| tree[*top].height).max().unwrap_or(0);
    emde_boas(&tree, &tops, height, &mut veb);
    vec![
        ("as stored", clusters.collect()),
        ("error", splits),
        ("level", levels),
        ("breadth-first", pages(breadth_first(&tree, &tops))),
        ("depth-first", pages(depth_first(&tree, &tops))),
        ("van Emde Boas", pages(veb)),
    ]
}

fn fine(file: &Chpm<MappedFile>, group: GroupId) -> Vec<ClusterId> {
    file.fine(group).iter().copied().map(ClusterId).collect()
}

fn runs(file: &Chpm<MappedFile>) -> Vec<Run> {
    let run = |error: f32, clusters: Vec<ClusterId>| {
        let mut bounds = Aabb::EMPTY;
        clusters.iter().for_each(|id| bounds.merge(&file.clusters()[id.index()].aabb()));
        let center = bounds.center().coords.map(|x| x as f32).into();
        Run { error, center, clusters: clusters.into_iter().map(|id| id.0).collect() }
    };
    let roots = file.roots().map(|root| run(f32::INFINITY, vec![root]));
    let groups = (0..file.groups().len() as u32).map(|group| fine(file, GroupId(group)));
    let splits = groups.filter(|fine| !fine.is_empty()).map(|fine| {
        let own = |id: &ClusterId| file.groups()[file.clusters()[id.index()].group().index()].max_error;
        run(fine.iter().map(own).fold(0.0, f32::max), fine)
    });
    roots.chain(splits).collect()
}

/// Groups as a tree: each hangs below the run that has the first of its coarse clusters.
fn tree(file: &Chpm<MappedFile>) -> (Vec<Node>, Vec<usize>) {
    let node = |pages| Node { pages, below: Vec::new(), height: 1 };
    let mut tree: Vec<Node> = file.roots().map(|root| node(vec![root])).collect();
    let tops: Vec<usize> = (0..tree.len()).collect();
    let mut groups: Vec<GroupId> = (0..file.groups().len() as u32).map(GroupId).collect();
    groups.retain(|group| !file.fine(*group).is_empty());
    groups.sort_by_key(|group| Reverse(file.groups()[group.index()].level));
    let mut run_of = vec![0; file.clusters().len()];
    tops.iter().for_each(|top| run_of[tree[*top].pages[0].index()] = *top);
    for group in groups {
        let above = run_of[file.coarse(group)[0] as usize];
        let here = tree.len();
        tree[above].below.push(here);
        tree.push(node(fine(file, group)));
        tree[here].pages.iter().for_each(|id| run_of[id.index()] = here);
    }
    for here in (0..tree.len()).rev() {
        tree[here].height = 1 + tree[here].below.iter().map(|below| tree[*below].height).max().unwrap_or(0);
    }
    (tree, tops)
}

fn breadth_first(tree: &[Node], tops: &[usize]) -> Vec<usize> {
    let mut queue: VecDeque<usize> = tops.iter().copied().collect();
    let mut order = Vec::new();
    while let Some(node) = queue.pop_front() {
        order.push(node);
        queue.extend(&tree[node].below);
    }
    order
}

fn depth_first(tree: &[Node], tops: &[usize]) -> Vec<usize> {
    let mut stack: Vec<usize> = tops.iter().rev().copied().collect();
    let mut order = Vec::new();
    while let Some(node) = stack.pop() {
        order.push(node);
        stack.extend(tree[node].below.iter().rev());
    }
    order
}

/// The upper half of the levels below `tops`, then each tree that hangs below it; answers what is below `height` levels.
fn emde_boas(tree: &[Node], tops: &[usize], height: usize, order: &mut Vec<usize>) -> Vec<usize> {
    let mut below = Vec::new();
    for top in tops {
        if height <= 1 {
            order.push(*top);
            below.extend(&tree[*top].below);
        } else {
            for lower in emde_boas(tree, &[*top], height / 2, order) {
                below.extend(emde_boas(tree, &[lower], height - height / 2, order));
            }
        }
    }
    below
}
