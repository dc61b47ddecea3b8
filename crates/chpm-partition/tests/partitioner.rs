//! Both partitioners through the public door: what every partition must be, whatever the graph.

use chpm_partition::{CsrGraph, Partition, PartitionError, Partitioner, Quality};
use proptest::prelude::*;

const BOTH: [Partitioner; 2] = [Partitioner::Metis, Partitioner::Greedy];

/// A grid with one diagonal per square: the neighbourhoods of a triangulated surface.
fn surface(width: u32, height: u32) -> CsrGraph {
    let mut edges = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let node = y * width + x;
            if x + 1 < width {
                edges.push((node, node + 1, 3));
            }
            if y + 1 < height {
                edges.push((node, node + width, 3));
            }
            if x + 1 < width && y + 1 < height {
                edges.push((node, node + width + 1, 1));
            }
        }
    }
    CsrGraph::from_edges(vec![1; (width * height) as usize], &edges).unwrap()
}

fn quality(graph: &CsrGraph, partition: &Partition) -> Quality {
    Quality::measure(graph, &partition.parts, partition.part_count).unwrap()
}

#[test]
fn names_are_read_and_written() {
    for partitioner in BOTH {
        assert_eq!(partitioner.to_string().parse(), Ok(partitioner));
    }
    let error = "scotch".parse::<Partitioner>().unwrap_err();
    assert_eq!(error, PartitionError::UnknownPartitioner { got: "scotch".to_owned() });
}

#[test]
fn a_surface_falls_into_balanced_connected_parts() {
    let graph = surface(60, 50);
    let cuts = BOTH.map(|partitioner| {
        let partition = partitioner.kway(&graph, 40, 11).unwrap();
        let quality = quality(&graph, &partition);
        assert_eq!((partition.used, partition.part_count), (partitioner, 40));
        assert!(quality.all_connected(), "{partitioner}: {quality:?}");
        assert!(quality.imbalance < 1.12, "{partitioner}: {quality:?}");
        quality.edge_cut as f64
    });
    assert!(cuts[0] <= 1.3 * cuts[1], "METIS {} against greedy {}", cuts[0], cuts[1]);
    assert!(cuts[1] <= 1.5 * cuts[0], "greedy {} against METIS {}", cuts[1], cuts[0]);
}

#[test]
fn a_surface_falls_into_two() {
    let graph = surface(64, 32);
    for partitioner in BOTH {
        let partition = partitioner.bisect(&graph, [0.5, 0.5], 4).unwrap();
        let quality = quality(&graph, &partition);
        assert!(quality.all_connected() && quality.imbalance <= 1.035, "{partitioner}: {quality:?}");
        // Straight across: 32 edges of weight 3 and 31 of weight 1.
        assert!(quality.edge_cut <= 160, "{partitioner}: {quality:?}");
        let third = partitioner.bisect(&graph, [2.0, 1.0], 4).unwrap();
        let on_zero = third.parts.iter().filter(|&&part| part == 0).count() as f64 / 2048.0;
        assert!((0.63..0.70).contains(&on_zero), "{partitioner}: {on_zero}");
    }
}

#[test]
fn few_nodes_are_each_a_part() {
    let empty = CsrGraph::from_edges(vec![], &[]).unwrap();
    let three = CsrGraph::from_edges(vec![1; 3], &[(0, 1, 1)]).unwrap();
    for partitioner in BOTH {
        assert_eq!(partitioner.kway(&empty, 7, 0).unwrap().part_count, 0);
        assert_eq!(partitioner.bisect(&empty, [1.0, 1.0], 0).unwrap().part_count, 0);
        let partition = partitioner.kway(&three, 7, 0).unwrap();
        assert_eq!((partition.parts, partition.part_count), (vec![0, 1, 2], 3));
        assert_eq!(partitioner.kway(&three, 0, 0), Err(PartitionError::NoParts));
        assert_eq!(partitioner.kway(&three, 1, 0).unwrap().parts, [0, 0, 0]);
    }
}

#[test]
fn a_graph_without_edges_is_shared_out() {
    let graph = CsrGraph::from_edges(vec![1; 100], &[]).unwrap();
    for partitioner in BOTH {
        let partition = partitioner.kway(&graph, 10, 1).unwrap();
        let quality = quality(&graph, &partition);
        assert_eq!((quality.edge_cut, quality.empty_parts), (0, 0));
        assert!(quality.imbalance <= 2.0, "{partitioner}: {quality:?}");
    }
}

#[test]
fn a_star_is_one_part_and_leaves() {
    let edges: Vec<_> = (1..200).map(|leaf| (0, leaf, 1)).collect();
    let graph = CsrGraph::from_edges(vec![1; 200], &edges).unwrap();
    for partitioner in BOTH {
        let partition = partitioner.kway(&graph, 5, 1).unwrap();
        let quality = quality(&graph, &partition);
        assert!(quality.all_connected(), "{partitioner}: {quality:?}");
        assert_eq!(quality.edge_cut, 4, "the hub's part and four leaves: all else is in pieces");
    }
}

#[test]
fn components_apart_are_not_glued_without_need() {
    // Eight squares of 5 x 5, no edge between them, in eight parts.
    let mut edges = Vec::new();
    for square in 0..8 {
        for y in 0..5 {
            for x in 0..5 {
                let node = square * 25 + y * 5 + x;
                if x < 4 {
                    edges.push((node, node + 1, 1));
                }
                if y < 4 {
                    edges.push((node, node + 5, 1));
                }
            }
        }
    }
    let graph = CsrGraph::from_edges(vec![1; 200], &edges).unwrap();
    for partitioner in BOTH {
        let partition = partitioner.kway(&graph, 8, 2).unwrap();
        let quality = quality(&graph, &partition);
        assert_eq!(quality.empty_parts, 0);
        assert!(quality.edge_cut <= 30 && quality.imbalance < 1.6, "{partitioner}: {quality:?}");
    }
}

#[test]
fn weights_are_balanced_not_counts() {
    let unweighted = surface(40, 40);
    let edges: Vec<_> = (0..1600)
        .flat_map(|node| {
            unweighted
                .neighbors_of(node)
                .filter(move |&(other, _)| other > node)
                .map(move |(other, w)| (node, other, w))
        })
        .collect();
    // The upper half weighs four times as much.
    let weights = (0..1600).map(|node| if node < 800 { 4 } else { 1 }).collect();
    let graph = CsrGraph::from_edges(weights, &edges).unwrap();
    for partitioner in BOTH {
        let partition = partitioner.kway(&graph, 10, 3).unwrap();
        let quality = quality(&graph, &partition);
        assert!(quality.imbalance < 1.12 && quality.all_connected(), "{partitioner}: {quality:?}");
    }
}

#[test]
fn threads_get_the_answers_of_one() {
    let graph = surface(40, 30);
    for partitioner in BOTH {
        let answer = |seed| partitioner.kway(&graph, 20, seed).unwrap();
        let alone: Vec<_> = (0..6).map(answer).collect();
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    let together: Vec<_> = (0..6).map(answer).collect();
                    assert!(together == alone, "{partitioner} differs among threads");
                });
            }
        });
        assert!(alone.iter().any(|other| other.parts != alone[0].parts), "{partitioner} ignores its seed");
    }
}

fn any_graph() -> impl Strategy<Value = CsrGraph> {
    (1u32..80).prop_flat_map(|nodes| {
        let edges = prop::collection::vec((0..nodes, 0..nodes, 0u32..9), 0..200);
        let weights = prop::collection::vec(0u32..6, nodes as usize);
        (weights, edges).prop_map(|(weights, edges)| CsrGraph::from_edges(weights, &edges).unwrap())
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn every_part_has_a_node_and_hangs_together(graph in any_graph(), parts in 1u32..90, seed in any::<u64>()) {
        for partitioner in BOTH {
            let partition = partitioner.kway(&graph, parts, seed).unwrap();
            let quality = quality(&graph, &partition);
            prop_assert_eq!(partition.part_count as usize, graph.node_count().min(parts as usize));
            prop_assert_eq!(partition.used, partitioner);
            prop_assert_eq!(quality.empty_parts, 0);
            prop_assert!(!graph.is_connected() || quality.all_connected());
            prop_assert_eq!(partitioner.kway(&graph, parts, seed).unwrap(), partition);
        }
    }

    #[test]
    fn two_sides_have_nodes_and_hang_together(graph in any_graph(), left in 0.2f64..0.8, seed in any::<u64>()) {
        for partitioner in BOTH {
            let partition = partitioner.bisect(&graph, [left, 1.0 - left], seed).unwrap();
            let quality = quality(&graph, &partition);
            prop_assert_eq!(partition.part_count as usize, graph.node_count().min(2));
            prop_assert_eq!(quality.empty_parts, 0);
            prop_assert!(!graph.is_connected() || quality.all_connected());
        }
    }
}
