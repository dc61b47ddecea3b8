//! Repair of what partitioners leave behind: empty parts, and parts in pieces.

use crate::{CsrGraph, PartitionError};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

/// Findings and changes of [`repair`].
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct RepairReport {
    /// Pieces that were given to a neighbouring part.
    pub fragments_moved: u32,
    /// Nodes in those pieces.
    pub nodes_moved: u32,
    /// Empty parts that got half of another.
    pub empty_filled: u32,
    /// Parts that are still empty: there are fewer nodes than parts.
    pub empty_left: u32,
    /// Pieces beyond the first of their part that stayed, having no neighbour to go to.
    pub extra_fragments: u32,
    /// Parts heavier than the weight that was to be kept.
    pub overweight: u32,
}

/// A connected piece of one part.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fragment {
    /// The part it belongs to.
    pub(crate) part: u32,
    weight: u64,
    /// Its lowest node.
    first: u32,
}

/// The connected pieces of all parts, in the order of their lowest nodes.
pub(crate) struct Fragments {
    pub(crate) list: Vec<Fragment>,
    /// The piece of every node.
    of_node: Vec<u32>,
}

impl Fragments {
    pub(crate) fn of(graph: &CsrGraph, parts: &[u32]) -> Self {
        let mut of_node = vec![u32::MAX; parts.len()];
        let mut list = Vec::new();
        let mut stack = Vec::new();

        for (first, &part) in parts.iter().enumerate() {
            if of_node[first] != u32::MAX {
                continue;
            }

            let id = list.len() as u32;
            let mut weight = 0;
            of_node[first] = id;
            stack.push(first as u32);
            while let Some(node) = stack.pop() {
                weight += u64::from(graph.node_weight(node));
                for (neighbor, _) in graph.neighbors_of(node) {
                    if parts[neighbor as usize] == part && of_node[neighbor as usize] == u32::MAX {
                        of_node[neighbor as usize] = id;
                        stack.push(neighbor);
                    }
                }
            }

            list.push(Fragment { part, weight, first: first as u32 });
        }
        Fragments { list, of_node }
    }
}

/// Makes every part one connected piece and no part empty, as far as the graph has edges and nodes for it.
///
/// The heaviest piece of a part stays. Every other piece goes to the neighbouring part it is most strongly connected
/// to, among those that stay within `max_part_weight` if there are any: connection counts more than balance. A
/// piece without neighbours stays, and so does the heaviest of several that have only one another. An empty part
/// gets about half of the heaviest part, cut along a spanning tree so that both halves are connected.
///
/// O((nodes + edges) log nodes) if no part is empty.
///
/// # Errors
/// [`PartitionError::AssignmentLength`] or [`PartitionError::PartOutOfRange`]; `parts` is then unchanged.
///
/// # Examples
/// ```
/// use chpm_partition::{CsrGraph, repair};
///
/// // Each part is in two pieces.
/// let path = CsrGraph::from_edges(vec![1; 5], &[(0, 1, 1), (1, 2, 1), (2, 3, 1), (3, 4, 1)])?;
/// let mut parts = [1, 0, 1, 0, 0];
/// repair(&path, &mut parts, 2, 4)?;
/// assert_eq!(parts, [1, 1, 0, 0, 0]);
/// # Ok::<(), chpm_partition::PartitionError>(())
/// ```
pub fn repair(
    graph: &CsrGraph,
    parts: &mut [u32],
    part_count: u32,
    max_part_weight: u64,
) -> Result<RepairReport, PartitionError> {
    graph.check_assignment(parts, part_count)?;
    let mut report = RepairReport::default();
    reconnect(graph, parts, part_count, max_part_weight, &mut report);
    fill_empty(graph, parts, part_count, &mut report);

    let mut weights = vec![0; part_count as usize];
    let mut pieces = vec![0u32; part_count as usize];
    for fragment in &Fragments::of(graph, parts).list {
        weights[fragment.part as usize] += fragment.weight;
        pieces[fragment.part as usize] += 1;
    }
    report.empty_left = pieces.iter().filter(|&&pieces| pieces == 0).count() as u32;
    report.extra_fragments = pieces.iter().map(|&pieces| pieces.saturating_sub(1)).sum();
    report.overweight = weights.iter().filter(|&&weight| weight > max_part_weight).count() as u32;
    Ok(report)
}

/// Gives every piece that is not its part's main piece to a neighbouring part.
fn reconnect(
    graph: &CsrGraph,
    parts: &mut [u32],
    part_count: u32,
    max_part_weight: u64,
    report: &mut RepairReport,
) {
    let Fragments { mut list, of_node } = Fragments::of(graph, parts);
    let mut settled = main_fragments(graph, &list, part_count);
    if settled.iter().all(|&settled| settled) {
        return;
    }
    let mut weights = vec![0; part_count as usize];
    for fragment in &list {
        weights[fragment.part as usize] += fragment.weight;
    }

    // Pieces settle from the settled ones outwards, so that each joins a piece that will not move any more.
    let mut queued = settled.clone();
    let mut queue = VecDeque::new();
    for node in 0..graph.node_count() as u32 {
        let id = of_node[node as usize] as usize;
        let touches = |(neighbor, _): (u32, u32)| settled[of_node[neighbor as usize] as usize];
        if !queued[id] && graph.neighbors_of(node).any(touches) {
            queued[id] = true;
            queue.push_back(id);
        }
    }

    let mut seen = vec![false; graph.node_count()];
    let mut connection = vec![0u64; part_count as usize];
    let mut touched = Vec::new();
    let mut nodes = Vec::new();
    while let Some(id) = queue.pop_front() {
        // The nodes of this piece, and how it is joined to pieces that are settled.
        let Fragment { part: from, weight, first } = list[id];
        nodes.clear();
        nodes.push(first);
        seen[first as usize] = true;
        let mut next = 0;
        while let Some(&node) = nodes.get(next) {
            next += 1;
            for (neighbor, edge_weight) in graph.neighbors_of(node) {
                let other = of_node[neighbor as usize] as usize;
                if other == id {
                    if !std::mem::replace(&mut seen[neighbor as usize], true) {
                        nodes.push(neighbor);
                    }
                } else if settled[other] {
                    let part = list[other].part;
                    if connection[part as usize] == 0 {
                        touched.push(part);
                    }
                    connection[part as usize] += u64::from(edge_weight);
                } else if !std::mem::replace(&mut queued[other], true) {
                    queue.push_back(other);
                }
            }
        }

        // It goes where it has most weight of edges, to parts that have room first.
        weights[from as usize] -= weight;
        let to = touched
            .iter()
            .copied()
            .max_by_key(|&part| {
                let has_room = weights[part as usize] + weight <= max_part_weight;
                (has_room, connection[part as usize], Reverse(part))
            })
            .unwrap_or(from);
        weights[to as usize] += weight;
        list[id].part = to;
        settled[id] = true;
        for part in touched.drain(..) {
            connection[part as usize] = 0;
        }
        if to != from {
            report.fragments_moved += 1;
            report.nodes_moved += nodes.len() as u32;
            for &node in &nodes {
                parts[node as usize] = to;
            }
        }
    }
}

/// Which pieces stay: the heaviest of every part, and the heaviest of every component of the graph that has none
/// of those.
fn main_fragments(graph: &CsrGraph, list: &[Fragment], part_count: u32) -> Vec<bool> {
    let components = Fragments::of(graph, &vec![0; graph.node_count()]);
    let mut stays = vec![false; list.len()];
    let mut anchored = vec![false; components.list.len()];

    let mut heaviest = vec![None; part_count as usize];
    choose_heaviest(list, &mut heaviest, |fragment| Some(fragment.part));
    for id in heaviest.into_iter().flatten() {
        stays[id] = true;
        anchored[components.of_node[list[id].first as usize] as usize] = true;
    }
    let mut heaviest = vec![None; components.list.len()];
    choose_heaviest(list, &mut heaviest, |fragment| {
        let component = components.of_node[fragment.first as usize];
        (!anchored[component as usize]).then_some(component)
    });
    for id in heaviest.into_iter().flatten() {
        stays[id] = true;
    }
    stays
}

/// Per group, the index of its heaviest piece; the first of equals.
fn choose_heaviest(
    list: &[Fragment],
    heaviest: &mut [Option<usize>],
    group: impl Fn(&Fragment) -> Option<u32>,
) {
    for (id, fragment) in list.iter().enumerate() {
        if let Some(group) = group(fragment) {
            let best = &mut heaviest[group as usize];
            if best.is_none_or(|best: usize| list[best].weight < fragment.weight) {
                *best = Some(id);
            }
        }
    }
}

/// Gives every empty part about half of the part that is then the heaviest.
fn fill_empty(graph: &CsrGraph, parts: &mut [u32], part_count: u32, report: &mut RepairReport) {
    let mut members = vec![Vec::new(); part_count as usize];
    for (node, &part) in parts.iter().enumerate() {
        members[part as usize].push(node as u32);
    }

    let empty: Vec<u32> = (0..part_count).filter(|&part| members[part as usize].is_empty()).collect();
    if empty.is_empty() {
        return;
    }

    let mut divisible: BinaryHeap<_> =
        (0..part_count).filter_map(|part| weigh(part, &members[part as usize], graph)).collect();

    for new in empty {
        let Some((_, Reverse(old))) = divisible.pop() else {
            break;
        };
        let moved = half_of(graph, &members[old as usize], parts);
        for &node in &moved {
            parts[node as usize] = new;
        }
        members[old as usize].retain(|&node| parts[node as usize] == old);
        members[new as usize] = moved;
        report.empty_filled += 1;
        divisible
            .extend([old, new].into_iter().filter_map(|part| weigh(part, &members[part as usize], graph)));
    }
}

fn weigh(part: u32, nodes: &[u32], graph: &CsrGraph) -> Option<(u64, Reverse<u32>)> {
    let weight: u64 = nodes.iter().map(|&node| u64::from(graph.node_weight(node))).sum();
    (nodes.len() > 1).then_some((weight, Reverse(part)))
}

/// The subtree of a part's spanning forest whose weight comes closest to half the part's; never all of it. The part
/// has at least two nodes, and removing a subtree leaves the rest as connected as it was.
fn half_of(graph: &CsrGraph, members: &[u32], parts: &[u32]) -> Vec<u32> {
    const ROOT: usize = usize::MAX;
    fn position(node: u32, members: &[u32]) -> Option<usize> {
        members.binary_search(&node).ok()
    }
    let mut order: Vec<(usize, usize)> = Vec::with_capacity(members.len()); // (member, place of the parent in order)
    let mut seen = vec![false; members.len()];
    for root in 0..members.len() {
        if std::mem::replace(&mut seen[root], true) {
            continue;
        }
        let mut next = order.len();
        order.push((root, ROOT));
        while let Some(&(member, _)) = order.get(next) {
            let node = members[member];
            for (neighbor, _) in graph.neighbors_of(node) {
                if parts[neighbor as usize] == parts[node as usize]
                    && let Some(other) = position(neighbor, members)
                    && !std::mem::replace(&mut seen[other], true)
                {
                    order.push((other, next));
                }
            }
            next += 1;
        }
    }

    let mut weights: Vec<u64> =
        order.iter().map(|&(member, _)| u64::from(graph.node_weight(members[member]))).collect();
    let total: u64 = weights.iter().sum();

    // The weight of a subtree is that of all below it; the one nearest to half of all is cut off.
    for place in (0..order.len()).rev() {
        if order[place].1 != ROOT {
            weights[order[place].1] += weights[place];
        }
    }
    let chosen = (0..order.len())
        .filter(|&place| weights[place] < total)
        .min_by_key(|&place| (weights[place] * 2).abs_diff(total));

    let mut taken = vec![false; order.len()];
    for (place, &(_, parent)) in order.iter().enumerate() {
        taken[place] = Some(place) == chosen || (parent != ROOT && taken[parent]);
    }
    let mut half: Vec<u32> = order
        .iter()
        .zip(taken)
        .filter(|(_, taken)| *taken)
        .map(|(&(member, _), _)| members[member])
        .collect();
    half.sort_unstable();
    half
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quality;
    use crate::graph::tests::{any_connected_graph, any_graph, grid};
    use proptest::prelude::*;

    const NO_LIMIT: u64 = u64::MAX;

    fn path(nodes: u32) -> CsrGraph {
        grid(nodes, 1)
    }

    #[test]
    fn a_good_partition_is_left_alone() {
        let mut parts = [0, 0, 0, 1, 1, 1];
        let report = repair(&path(6), &mut parts, 2, 3).unwrap();
        assert_eq!((parts, report), ([0, 0, 0, 1, 1, 1], RepairReport::default()));
    }

    #[test]
    fn a_piece_goes_to_the_stronger_neighbour() {
        let graph =
            CsrGraph::from_edges(vec![1; 6], &[(0, 1, 1), (1, 2, 1), (2, 3, 5), (3, 4, 1), (4, 5, 1)]);
        let mut parts = [0, 0, 1, 2, 1, 1];
        let report = repair(&graph.unwrap(), &mut parts, 3, NO_LIMIT).unwrap();
        assert_eq!(parts, [0, 0, 2, 2, 1, 1]);
        assert_eq!((report.fragments_moved, report.nodes_moved), (1, 1));
    }

    #[test]
    fn a_piece_goes_where_there_is_room_if_anywhere() {
        let graph =
            CsrGraph::from_edges(vec![1; 6], &[(0, 1, 1), (1, 2, 1), (2, 3, 5), (3, 4, 1), (4, 5, 1)]);
        let graph = graph.unwrap();
        let mut parts = [0, 1, 2, 1, 1, 1];
        // Node 1 may join part 0 or part 2, which have one node each; the weights are equal, so the lower number.
        repair(&graph, &mut parts, 3, 2).unwrap();
        assert_eq!(parts, [0, 0, 2, 1, 1, 1]);
        let mut parts = [0, 0, 1, 2, 1, 1];
        let report = repair(&graph, &mut parts, 3, 1).unwrap();
        assert_eq!(parts, [0, 0, 2, 2, 1, 1], "no room anywhere: the strongest");
        assert_eq!(report.overweight, 3);
        let mut parts = [0, 0, 1, 2, 2, 1];
        repair(&path(6), &mut parts, 3, 2).unwrap();
        assert_eq!(parts, [0, 0, 1, 2, 2, 2]);
    }

    #[test]
    fn pieces_behind_pieces_follow_one_another() {
        // Nodes 6, 7 and 8 are three pieces; 7 can only follow the others, and comes home with 8.
        let mut parts = [0, 0, 0, 2, 2, 2, 0, 1, 0, 1, 1, 1];
        let report = repair(&path(12), &mut parts, 3, NO_LIMIT).unwrap();
        assert_eq!(parts, [0, 0, 0, 2, 2, 2, 2, 1, 1, 1, 1, 1]);
        assert_eq!((report.fragments_moved, report.nodes_moved), (2, 2));
    }

    #[test]
    fn a_component_of_its_own_stays_and_is_made_one() {
        // Nodes 4..8 are a path apart, in pieces of parts at home in 0..4: the heaviest piece takes the others.
        let graph = CsrGraph::from_edges(
            vec![2, 2, 2, 2, 1, 1, 1, 1, 1],
            &[(0, 1, 1), (1, 2, 1), (2, 3, 1), (4, 5, 1), (5, 6, 1), (6, 7, 1)],
        );
        let mut parts = [0, 0, 1, 1, 0, 1, 1, 0, 1];
        let report = repair(&graph.unwrap(), &mut parts, 2, NO_LIMIT).unwrap();
        assert_eq!(parts, [0, 0, 1, 1, 1, 1, 1, 1, 1]);
        assert_eq!((report.fragments_moved, report.extra_fragments), (2, 2));
    }

    #[test]
    fn empty_parts_get_halves() {
        let graph = path(16);
        let mut parts = [0; 16];
        let report = repair(&graph, &mut parts, 4, NO_LIMIT).unwrap();
        let quality = Quality::measure(&graph, &parts, 4).unwrap();
        assert_eq!(report.empty_filled, 3);
        assert_eq!((quality.imbalance, quality.all_connected()), (1.0, true));
    }

    #[test]
    fn more_parts_than_nodes_leaves_some_empty() {
        let mut parts = [4, 4, 4];
        let report = repair(&path(3), &mut parts, 5, NO_LIMIT).unwrap();
        assert_eq!((report.empty_filled, report.empty_left), (2, 2));
    }

    #[test]
    fn a_star_gives_up_single_leaves() {
        let edges: Vec<_> = (1..10).map(|leaf| (0, leaf, 1)).collect();
        let graph = CsrGraph::from_edges(vec![1; 10], &edges).unwrap();
        let mut parts = [0; 10];
        repair(&graph, &mut parts, 3, NO_LIMIT).unwrap();
        let quality = Quality::measure(&graph, &parts, 3).unwrap();
        assert!(quality.all_connected());
        assert_eq!(quality.edge_cut, 2);
    }

    #[test]
    fn an_assignment_that_does_not_fit_is_refused() {
        assert!(repair(&path(5), &mut [0, 0, 2, 0, 0], 2, 9).is_err());
        assert!(repair(&path(5), &mut [0, 0, 1, 0], 2, 9).is_err());
    }

    fn any_parts() -> impl Strategy<Value = (Vec<u32>, u32)> {
        (1u32..12).prop_flat_map(|count| (prop::collection::vec(0..count, 60), Just(count)))
    }

    proptest! {
        #[test]
        fn a_connected_graph_gets_connected_parts(graph in any_connected_graph(), (parts, count) in any_parts(), max in 1u64..40) {
            let mut parts = parts[..graph.node_count()].to_vec();
            let report = repair(&graph, &mut parts, count, max).unwrap();
            let quality = Quality::measure(&graph, &parts, count).unwrap();
            prop_assert_eq!(quality.empty_parts as usize, (count as usize).saturating_sub(graph.node_count()));
            prop_assert_eq!(quality.empty_parts, report.empty_left);
            prop_assert!(quality.fragments.iter().all(|&pieces| pieces <= 1));
            let again = repair(&graph, &mut parts.clone(), count, max).unwrap();
            prop_assert_eq!((again.fragments_moved, again.empty_filled), (0, 0));
        }

        /// In any graph, a component holds at most one piece of every part, and none beyond need.
        #[test]
        fn extra_pieces_are_in_components_of_their_own(graph in any_graph(), (parts, count) in any_parts()) {
            let mut parts = parts[..graph.node_count()].to_vec();
            let report = repair(&graph, &mut parts, count, NO_LIMIT).unwrap();
            let components = Fragments::of(&graph, &vec![0; graph.node_count()]).list.len();
            let filled = count - report.empty_left;
            let pieces = Fragments::of(&graph, &parts).list.len();
            prop_assert_eq!(pieces, (filled + report.extra_fragments) as usize);
            prop_assert!(pieces <= components + filled as usize);
            if count == 1 {
                prop_assert_eq!(pieces, components);
            }
        }
    }
}
