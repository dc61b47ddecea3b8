//! Why a graph could not be partitioned.

/// Everything that this crate can fail with.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PartitionError {
    /// An edge names a node that the graph does not have.
    #[error("edge {edge} joins node {node}, but the graph has {nodes} nodes")]
    NodeOutOfRange {
        /// Index of the edge.
        edge: usize,
        /// The node it names.
        node: u32,
        /// Nodes of the graph.
        nodes: usize,
    },

    /// The graph is larger than METIS's 32-bit indices.
    #[error("the graph has {got} {what}, at most {limit} can be partitioned; partition a coarser graph")]
    TooLarge {
        /// "nodes" or "edge ends".
        what: &'static str,
        /// How many there are.
        got: usize,
        /// How many there may be.
        limit: usize,
    },

    /// Zero parts were asked for.
    #[error("a graph cannot be partitioned into 0 parts; ask for at least 1")]
    NoParts,

    /// The two target fractions are no weights.
    #[error("fractions {got:?} do not divide a graph; both must be positive and finite")]
    Fractions {
        /// As given.
        got: [f64; 2],
    },

    /// An assignment that does not fit its graph.
    #[error("the assignment has {got} entries, the graph {nodes} nodes")]
    AssignmentLength {
        /// Entries given.
        got: usize,
        /// Nodes of the graph.
        nodes: usize,
    },

    /// An assignment to a part that does not exist.
    #[error("node {node} is in part {part}, but there are {part_count} parts")]
    PartOutOfRange {
        /// The node.
        node: usize,
        /// Its part.
        part: u32,
        /// The number of parts.
        part_count: u32,
    },

    /// Two sides that cannot take all nodes together.
    #[error("{nodes} nodes do not fit two sides of at most {max_nodes:?}; allow more on a side")]
    Capacity {
        /// Nodes of the graph.
        nodes: usize,
        /// Most nodes per side.
        max_nodes: [usize; 2],
    },

    /// METIS does not take this graph, and would not another time.
    #[error("METIS cannot divide this graph ({reason}); the greedy partitioner can")]
    Metis {
        /// Why not.
        reason: String,
    },

    /// METIS ended early for what is not in the graph: the system had no memory for it, or a signal came. It does not always say which.
    #[error(
        "METIS ended early ({reason}) with a graph of {nodes} nodes and {edges} edges; run again with more memory free, or with the partitioner greedy, whose parts are others"
    )]
    EndedEarly {
        /// METIS's own words.
        reason: String,
        /// Nodes of the graph.
        nodes: usize,
        /// Its edges.
        edges: usize,
    },

    /// No partitioner has this name.
    #[error("'{got}' is no partitioner; choose metis or greedy")]
    UnknownPartitioner {
        /// The name given.
        got: String,
    },
}
