//! The same model as a CHPM, refined from the base meshes of its roots to the finest meshes of its leaves.

use crate::{median, milliseconds};
use chpm_build::{BuildConfig, Cancel, Silent, build};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_import::ply::{self, Encoding};
use chpm_mesh::{ClusterId, GroupId, TriMesh};
use chpm_refine::{ActiveList, Camera, Front, Hierarchy, PmCursor, View};
use std::fs::File;
use std::hint::black_box;
use std::time::Instant;
use tempfile::TempDir;

pub(crate) struct Clusters {
    file: Chpm<MappedFile>,
    hierarchy: Hierarchy,
    view: View,
    /// Lives as long as the file.
    _folder: TempDir,
}

/// What a refinement counts.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Counts {
    /// Triangles before and after.
    pub(crate) base: u64,
    pub(crate) reached: u64,
    /// Groups whose error was held against the view.
    pub(crate) questions: u64,
    /// Groups that were split.
    pub(crate) splits: u64,
    /// Clusters that a split brought, each of which makes the front look whether its own group is there as a whole.
    pub(crate) checks: u64,
    /// Vertex splits of the clusters of the cut, from their base meshes; and of all clusters from the roots down.
    pub(crate) pm_splits: u64,
    pub(crate) pm_splits_every_level: u64,
}

/// Milliseconds.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Times {
    /// The groups alone.
    pub(crate) decisions: f64,
    /// The groups, the cut's clusters, and their positions; pages are checked as they enter.
    pub(crate) select: f64,
    /// The meshes of the cut's clusters.
    pub(crate) cut: Meshes,
    /// Those of all clusters, as a refinement through all levels passes them.
    pub(crate) all: Meshes,
}

/// Milliseconds for the meshes of some clusters.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Meshes {
    /// Making cursors in new memory.
    pub(crate) load: f64,
    /// From there to the positions, from scratch: what a frame does that brings the clusters.
    pub(crate) place: f64,
    /// The same two in the memory of cursors that are no longer used.
    pub(crate) reload: f64,
    pub(crate) replace: f64,
    /// From the finest meshes to halfway to the base meshes, from scratch.
    pub(crate) half: f64,
    /// Preparing the steps.
    pub(crate) prepare: f64,
    /// Vertex splits, step by step, from base meshes to positions.
    pub(crate) play: f64,
}

impl Meshes {
    /// To the positions, in new memory and without a step.
    pub(crate) fn first(&self) -> f64 {
        self.load + self.place
    }

    /// To the positions, in used memory and without a step.
    pub(crate) fn again(&self) -> f64 {
        self.reload + self.replace
    }

    /// To the positions with every step carried out.
    pub(crate) fn stepped(&self) -> f64 {
        self.load + self.prepare + self.play
    }
}

impl Times {
    pub(crate) fn medians(times: &[Times]) -> Self {
        let of = |field: fn(&Times) -> f64| median(times.iter().map(field).collect());
        let meshes = |pick: fn(&Times) -> Meshes| {
            let of = |field: fn(&Meshes) -> f64| median(times.iter().map(|t| field(&pick(t))).collect());
            Meshes {
                load: of(|m| m.load),
                place: of(|m| m.place),
                reload: of(|m| m.reload),
                replace: of(|m| m.replace),
                half: of(|m| m.half),
                prepare: of(|m| m.prepare),
                play: of(|m| m.play),
            }
        };
        Times {
            decisions: of(|t| t.decisions),
            select: of(|t| t.select),
            cut: meshes(|t| t.cut),
            all: meshes(|t| t.all),
        }
    }
}

impl Clusters {
    /// Builds a file with the default settings.
    pub(crate) fn build(mesh: &TriMesh, camera: &Camera) -> anyhow::Result<Self> {
        let folder = tempfile::tempdir()?;
        let [source, output] = ["source.ply", "out.chpm"].map(|name| folder.path().join(name));
        ply::write_mesh(File::create(&source)?, mesh, Encoding::BinaryLittleEndian)?;
        build(&source, &output, &BuildConfig::default(), &Silent, &Cancel::default())?;
        let file = Chpm::open(MappedFile::open(&output)?)?;
        let hierarchy = Hierarchy::new(&file);
        let view = View::new(&camera.relative_to(file.header().origin), [512, 512], 0.0)?;
        Ok(Clusters { file, hierarchy, view, _folder: folder })
    }

    /// Refines from nothing but the roots, at zero pixels of error.
    pub(crate) fn refine(&self) -> anyhow::Result<(Counts, Times)> {
        let Clusters { file, hierarchy, view, .. } = self;
        let (mut counts, mut times) = (Counts::default(), Times::default());

        let mut front = Front::new(file);
        let start = Instant::now();
        front.update(file, hierarchy, view, |_| true);
        times.decisions = milliseconds(start);
        black_box(&front);

        let mut list = ActiveList::new(file);
        let start = Instant::now();
        let changes = list.update(file, hierarchy, view, |_| true)?;
        times.select = milliseconds(start);

        let clusters = file.clusters();
        let record = |id: &u32| &clusters[*id as usize];
        let is_split = |group: GroupId| list.front().is_split(group);
        let is_asked = |group: &GroupId| {
            file.coarse(*group).iter().map(record).all(|c| c.is_root() || is_split(c.parent_group()))
        };
        counts.questions = (0..file.groups().len() as u32).map(GroupId).filter(is_asked).count() as u64;
        counts.splits = changes.splits;
        counts.checks = list.front().split_groups().iter().map(|group| file.fine(*group).len() as u64).sum();
        counts.base = file.roots().map(|root| u64::from(clusters[root.index()].base_triangle_count)).sum();
        counts.reached = list.cut().triangle_count(file)?;

        let members: Vec<_> = list.members().map(|m| (m.cluster, m.vertices as usize)).collect();
        (counts.pm_splits, times.cut) = self.play(&members)?;
        let all: Vec<_> =
            (0..).map(ClusterId).zip(clusters).map(|(id, c)| (id, c.vertex_count as usize)).collect();
        (counts.pm_splits_every_level, times.all) = self.play(&all)?;
        Ok((counts, times))
    }

    /// Brings cursors to these positions in every way: number of vertex splits from the base meshes, and times. Pages were
    /// checked when the selection met them.
    fn play(&self, members: &[(ClusterId, usize)]) -> anyhow::Result<(u64, Meshes)> {
        let mut times = Meshes::default();
        let page = |id: ClusterId| self.file.page_known(id);
        let start = Instant::now();
        let cursor = |(id, _): &(ClusterId, usize)| Ok(PmCursor::new(&page(*id)?.view().progressive_mesh()));
        let mut cursors = members.iter().map(cursor).collect::<anyhow::Result<Vec<_>>>()?;
        times.load = milliseconds(start);
        times.place = played(&mut cursors, members);

        let start = Instant::now();
        for (cursor, (id, _)) in cursors.iter_mut().zip(members) {
            cursor.load(&page(*id)?.view().progressive_mesh());
        }
        times.reload = milliseconds(start);
        times.replace = played(&mut cursors, members);

        let middle = |cursor: &PmCursor| (cursor.base_vertex_count() + cursor.vertex_count()) / 2;
        let middles: Vec<_> =
            cursors.iter().zip(members).map(|(cursor, (id, _))| (*id, middle(cursor))).collect();
        times.half = played(&mut cursors, &middles);

        let start = Instant::now();
        cursors.iter_mut().for_each(PmCursor::prepare_steps);
        times.prepare = milliseconds(start);
        let mut splits = 0;
        for (cursor, (_, n)) in cursors.iter_mut().zip(members) {
            cursor.move_to(0);
            splits += (n - cursor.position()) as u64;
        }
        times.play = played(&mut cursors, members);
        Ok((splits, times))
    }
}

/// Moves cursors to their positions; milliseconds.
fn played(cursors: &mut [PmCursor], members: &[(ClusterId, usize)]) -> f64 {
    let start = Instant::now();
    for (cursor, (_, n)) in cursors.iter_mut().zip(members) {
        cursor.move_to(*n);
    }
    let time = milliseconds(start);
    black_box(cursors);
    time
}
