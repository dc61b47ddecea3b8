//! METIS where the system gives it no memory, in a process of its own.
#![cfg(target_os = "linux")]

use chpm_partition::{CsrGraph, PartitionError, Partitioner};
use std::process::Command;

const CHILD: &str = "CHPM_TEST_PARTITION";
const NAME: &str = "metis_without_memory_is_an_error_and_not_another_partition";

/// A grid of so many columns and rows.
fn grid(columns: u32, rows: u32) -> CsrGraph {
    let right = (0..columns * rows).filter(|node| (node + 1) % columns != 0).map(|node| (node, node + 1, 1));
    let down = (0..columns * (rows - 1)).map(|node| (node, node + columns, 1));
    let edges: Vec<_> = right.chain(down).collect();
    CsrGraph::from_edges(vec![1; (columns * rows) as usize], &edges).expect("a graph")
}

/// Lets this process map so many bytes more.
fn allow_further(bytes: u64) {
    let pages = std::fs::read_to_string("/proc/self/statm").expect("statm");
    let mapped = 4096 * pages.split(' ').next().expect("pages").parse::<u64>().expect("a number");
    let limit = format!("--as={}:", mapped + bytes);
    let pid = std::process::id().to_string();
    let status = Command::new("prlimit").args(["--pid", &pid, &limit]).status();
    assert!(status.expect("prlimit of util-linux").success());
}

#[test]
fn metis_without_memory_is_an_error_and_not_another_partition() {
    if std::env::var_os(CHILD).is_some() {
        let graph = grid(1500, 1500);
        for further in [12 << 20, 40 << 20, 80 << 20] {
            allow_further(further);
            match Partitioner::Metis.kway(&graph, 8, 17) {
                Err(PartitionError::EndedEarly { nodes, .. }) => println!("told: {nodes}"),
                other => panic!("with {further} bytes: {:?}", other.map(|found| found.used)),
            }
        }
        return;
    }

    let program = std::env::current_exe().expect("this test");
    let run = Command::new(program).args([NAME, "--exact", "--nocapture"]).env(CHILD, "1").output();
    let told = String::from_utf8(run.expect("run").stdout).expect("text");
    assert_eq!(told.matches("told: 2250000").count(), 3, "{told}");
}
