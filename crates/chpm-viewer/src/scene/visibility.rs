//! What is known to be hidden, by cluster and by group, from frame to frame.
//!
//! Clusters of the cut are visible, hidden, or outside the image. What a split or a collapse brings inherits the answer of what it replaces: it is
//! visible if any of it was. Groups that the view wants split, and that none of their visible clusters vouches for, are asked by
//! the box around all that is below. No clock, no GPU: who calls it does the asking.

use chpm_format::Chpm;
use chpm_mesh::{ClusterId, GroupId};
use chpm_refine::Entered;

/// A cluster of the cut.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Sight {
    /// Not in the image, or not in the cut.
    #[default]
    Outside,
    /// In the image and hidden.
    Hidden,
    /// To be drawn.
    Visible,
}

/// What a test is about.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Subject {
    /// A cluster of the cut.
    Cluster(ClusterId),
    /// All that is below a group, and the group.
    Group(GroupId),
}

/// The state of all clusters and groups.
#[derive(Clone, Debug)]
pub struct Visibility {
    clusters: Vec<Sight>,
    /// Whether the last answer was "visible".
    groups: Vec<bool>,
}

impl Visibility {
    /// Nothing is known: the roots are drawn.
    pub fn new<D: AsRef<[u8]>>(file: &Chpm<D>) -> Self {
        let sight = |root| if root { Sight::Visible } else { Sight::Outside };
        Visibility {
            clusters: file.clusters().iter().map(|cluster| sight(cluster.is_root())).collect(),
            groups: vec![false; file.groups().len()],
        }
    }

    /// What is known of a cluster of the cut.
    pub fn of(&self, cluster: ClusterId) -> Sight {
        self.clusters[cluster.index()]
    }

    /// Notes what is known without a test.
    pub fn set(&mut self, cluster: ClusterId, sight: Sight) {
        self.clusters[cluster.index()] = sight;
    }

    /// Whether a group may be split for what is seen of it: one of its clusters is, or something below.
    pub fn sees<D: AsRef<[u8]>>(&self, file: &Chpm<D>, group: GroupId) -> bool {
        let seen = |cluster: &u32| self.clusters[*cluster as usize] == Sight::Visible;
        self.groups[group.index()] || file.coarse(group).iter().any(seen)
    }

    /// Forgets the answer about a group: it has just come to the front, and what was true when it was there before may not be.
    pub fn forget(&mut self, group: GroupId) {
        self.groups[group.index()] = false;
    }

    /// Goes on to the next cut: what has entered inherits, what has left is forgotten. What was outside on all sides stays so until
    /// somebody looks where it is.
    pub fn follow<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        entered: &[Entered],
        left: &[ClusterId],
        is_active: impl Fn(ClusterId) -> bool,
    ) {
        for Entered { cluster, finest } in entered {
            let record = &file.clusters()[cluster.index()];
            let replaced =
                if *finest { file.fine(record.group()) } else { file.coarse(record.parent_group()) };
            // Hidden, if nothing of it is seen and something is hidden.
            let inherited =
                replaced.iter().map(|id| self.clusters[*id as usize]).max_by_key(|sight| *sight as u8);
            self.clusters[cluster.index()] = inherited.unwrap_or(Sight::Visible);
        }
        let gone = entered.iter().map(|entered| entered.cluster).chain(left.iter().copied());
        for cluster in gone.filter(|cluster| !is_active(*cluster)) {
            self.clusters[cluster.index()] = Sight::Outside;
        }
    }

    /// Takes in the answer of a test; answers whether something came into sight. An answer about a cluster that has left the cut, or
    /// the image, comes too late.
    pub fn answer(&mut self, subject: Subject, visible: bool) -> bool {
        match subject {
            Subject::Cluster(cluster) => {
                let sight = &mut self.clusters[cluster.index()];
                let before = *sight;
                if before != Sight::Outside {
                    *sight = if visible { Sight::Visible } else { Sight::Hidden };
                }
                visible && before == Sight::Hidden
            }
            Subject::Group(group) => {
                let before = std::mem::replace(&mut self.groups[group.index()], visible);
                visible && !before
            }
        }
    }
}
