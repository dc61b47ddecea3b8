//! Visibility by cluster and by group, from frame to frame.
//!
//! Clusters of the cut are visible, hidden, or outside the image. Clusters that a split or a collapse brings inherit the answer of those that they replace: they are
//! visible if any of those was. Groups that the view wants split, and that none of their visible clusters vouches for, are tested by
//! the box around all that is below. No clock, no GPU: who calls it does the testing.

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

/// Subject of a test.
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
    groups: Vec<Told>,
    /// Number of the frame.
    now: u64,
}

/// The last answer about a group, and the frame that it came in; none came before the first.
#[derive(Clone, Copy, Debug, Default)]
struct Told {
    visible: bool,
    when: u64,
}

/// Frames after which an answer about a group that nobody asked for in between is an old one.
const FRESH: u64 = 8;

impl Visibility {
    /// Nothing is known: the roots are drawn.
    pub fn new<D: AsRef<[u8]>>(file: &Chpm<D>) -> Self {
        fn sight(root: bool) -> Sight {
            if root { Sight::Visible } else { Sight::Outside }
        }
        Visibility {
            clusters: file.clusters().iter().map(|cluster| sight(cluster.is_root())).collect(),
            groups: vec![Told::default(); file.groups().len()],
            now: FRESH,
        }
    }

    /// Visibility of a cluster of the cut.
    pub fn of(&self, cluster: ClusterId) -> Sight {
        self.clusters[cluster.index()]
    }

    /// Notes what is known without a test.
    pub fn set(&mut self, cluster: ClusterId, sight: Sight) {
        self.clusters[cluster.index()] = sight;
    }

    /// Whether a group may be split for what is seen of it: one of its clusters is, or something below.
    pub fn sees<D: AsRef<[u8]>>(&self, file: &Chpm<D>, group: GroupId) -> bool {
        self.groups[group.index()].visible
            || file.coarse(group).iter().any(|cluster| self.clusters[*cluster as usize] == Sight::Visible)
    }

    /// Begins a frame.
    pub fn turn(&mut self) {
        self.now += 1;
    }

    /// Forgets an old answer about a group: it has just come to the front, and what was true when it was there before may not be.
    pub fn forget(&mut self, group: GroupId) {
        if !self.is_told(group) {
            self.groups[group.index()] = Told::default();
        }
    }

    /// Whether an answer about a group came lately.
    fn is_told(&self, group: GroupId) -> bool {
        let Told { when, .. } = self.groups[group.index()];
        when > 0 && self.now < when + FRESH
    }

    /// Whether a group is known to be hidden, and with it all that is below.
    pub fn hides(&self, group: GroupId) -> bool {
        self.is_told(group) && !self.groups[group.index()].visible
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

    /// Takes in the answer of a test; answers whether its subject came into sight. An answer about a cluster that has left the cut, or
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
                let told = Told { visible, when: self.now };
                let before = std::mem::replace(&mut self.groups[group.index()], told);
                visible && !before.visible
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::plane;
    use chpm_refine::{Front, Hierarchy, View};

    /// A view so near that everything is split, and one so far that nothing is.
    fn views() -> [View; 2] {
        [1.0, 1e9].map(|z| {
            let camera = chpm_refine::Camera::looking([64.0, 64.0, z], [64.0, 64.0, 0.0]);
            View::new(&camera, [100, 100], 0.01).unwrap()
        })
    }

    #[test]
    fn what_a_split_brings_is_as_visible_as_what_it_replaces() {
        let file = plane::file().unwrap();
        let hierarchy = Hierarchy::new(&file);
        let [near, far] = views();
        let mut front = Front::new(&file);
        let mut visibility = Visibility::new(&file);
        let root = file.roots().next().unwrap();
        let top = file.clusters()[root.index()].group();
        let is_active = |front: &Front, id: ClusterId| front.is_active(&file.clusters()[id.index()]);
        let children: Vec<_> = file.fine(top).iter().copied().map(ClusterId).collect();

        front.update(&file, &hierarchy, &near, |group| group == top);
        visibility.follow(&file, front.entered(), &[root], |id| is_active(&front, id));
        assert!(children.iter().all(|child| visibility.of(*child) == Sight::Visible));
        assert_eq!(visibility.of(root), Sight::Outside, "it has left");

        // One of two is hidden, and nothing below it is seen, nor is it split for its own sake.
        assert!(!visibility.answer(Subject::Cluster(children[0]), false));
        let [hidden, seen] = [0, 1].map(|n| file.clusters()[children[n].index()].group());
        assert!(!visibility.sees(&file, hidden) && visibility.sees(&file, seen));
        front.update(&file, &hierarchy, &near, |group| [top, hidden, seen].contains(&group));
        visibility.follow(&file, front.entered(), &children, |id| is_active(&front, id));
        let below = |group| file.fine(group).iter().map(|id| visibility.of(ClusterId(*id)));
        assert!(below(hidden).all(|sight| sight == Sight::Hidden));
        assert!(below(seen).all(|sight| sight == Sight::Visible));

        // All of it collapses in one update: the root is visible, since something of it was.
        front.update(&file, &hierarchy, &far, |_| true);
        visibility.follow(&file, front.entered(), &[], |id| is_active(&front, id));
        assert_eq!(visibility.of(root), Sight::Visible);
        assert!(children.iter().all(|child| visibility.of(*child) == Sight::Outside));
    }

    #[test]
    fn late_answers_change_nothing() {
        let file = plane::file().unwrap();
        let mut visibility = Visibility::new(&file);
        let leaf = ClusterId(0);
        assert!(!visibility.answer(Subject::Cluster(leaf), true));
        assert_eq!(visibility.of(leaf), Sight::Outside);
        let group = file.clusters()[0].group();
        assert!(visibility.answer(Subject::Group(group), true) && visibility.sees(&file, group));
        assert!(!visibility.answer(Subject::Group(group), true), "nothing new");
        // It has just been asked; for some frames that is as good as an answer to come.
        visibility.forget(group);
        assert!(visibility.sees(&file, group) && !visibility.hides(group));
        (0..FRESH).for_each(|_| visibility.turn());
        visibility.forget(group);
        assert!(!visibility.sees(&file, group) && !visibility.hides(group));
        visibility.answer(Subject::Group(group), false);
        assert!(visibility.hides(group));
    }
}
