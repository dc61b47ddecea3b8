//! METIS from many threads at once: the same answers, and the process's signals as they were. A file of its own, since signals are
//! the process's.

use chpm_partition::{CsrGraph, metis};
use std::sync::Barrier;
use std::thread;

fn grid(side: u32) -> CsrGraph {
    let right = (0..side * side).filter(|node| node % side + 1 < side).map(|node| (node, node + 1, 2));
    let down = (0..side * (side - 1)).map(|node| (node, node + side, 3));
    CsrGraph::from_edges(vec![1; (side * side) as usize], &right.chain(down).collect::<Vec<_>>()).unwrap()
}

/// Whether the process has handlers for SIGABRT and SIGTERM.
#[cfg(target_os = "linux")]
fn handled() -> [bool; 2] {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap();
    let mask = u64::from_str_radix(mask.trim(), 16).unwrap();
    [6, 15].map(|signal: u64| mask >> (signal - 1) & 1 == 1)
}

/// Held by each test, since both look at what is the process's.
static ALONE: std::sync::Mutex<()> = std::sync::Mutex::new(());

#[test]
fn calls_side_by_side_answer_as_alone_and_leave_signals_alone() {
    const THREADS: usize = 6;
    let _alone = ALONE.lock();
    let graphs: Vec<CsrGraph> = (0..THREADS as u32).map(|thread| grid(12 + 5 * thread)).collect();
    let calls = |thread: usize| -> Vec<Vec<u32>> {
        let graph = &graphs[thread];
        let seeds = 0..25;
        seeds
            .flat_map(|seed| {
                [metis::kway(graph, 7, seed).unwrap(), metis::bisect(graph, [1.0, 2.0], seed).unwrap()]
            })
            .collect()
    };
    let alone: Vec<_> = (0..THREADS).map(calls).collect();

    for _ in 0..8 {
        let start = Barrier::new(THREADS);
        let run = |thread| {
            start.wait();
            calls(thread)
        };
        let together: Vec<_> = thread::scope(|scope| {
            let run = &run;
            let threads: Vec<_> = (0..THREADS).map(|thread| scope.spawn(move || run(thread))).collect();
            threads.into_iter().map(|thread| thread.join().unwrap()).collect()
        });
        assert!(together == alone, "answers depend on what other threads do");
        #[cfg(target_os = "linux")]
        assert_eq!(handled(), [false, false], "a handler was left");
    }
}

/// Between the first and the last of overlapping calls METIS's own errors find their handler, whichever call ends first.
#[test]
#[cfg(target_os = "linux")]
fn a_call_that_ends_leaves_the_handlers_of_others() {
    use chpm_extmem::metis::Traps;
    let _alone = ALONE.lock();
    let outer = Traps::set().unwrap();
    assert_eq!(handled(), [true, true]);
    metis::kway(&grid(20), 4, 1).unwrap();
    drop(Traps::set().unwrap());
    assert_eq!(handled(), [true, true]);
    drop(outer);
    assert_eq!(handled(), [false, false]);
}
