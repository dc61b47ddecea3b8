//! A build that ended early goes on where it was, to the same bytes; what does not fit is not used.

use crate::site::{Site, config, with_attributes};
use chpm_build::config::{Length, Normals, Positions};
use chpm_build::{
    BuildConfig, BuildError, BuildProgress, Cancel, FailPoints, Progress, Reached, Silent, Stage,
};
use chpm_extmem::ExtmemError;
use chpm_mesh::Bytes;
use chpm_synth::{Shape, Synth, hand};
use std::fs::{self, File};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

/// Clusters of 256 triangles, everything on disk, and a checkpoint at every opportunity.
pub(crate) fn eager(threads: usize) -> BuildConfig {
    let mut config = config(256);
    let resources = &mut config.resources;
    (resources.threads, resources.memory, resources.checkpoint) = (threads, Bytes(0), Some(Duration::ZERO));
    config.overwrite = true;
    config
}

fn site() -> Site {
    let mut mesh = Synth::new(Shape::Isosurface, 8_000, 3).to_mesh();
    // A speck of dust.
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(hand::tetrahedron().positions.iter().map(|p| p.map(|x| 1e-3 * x)));
    mesh.triangles.extend(hand::tetrahedron().triangles.iter().map(|t| t.map(|v| first + v)));
    Site::of(&with_attributes(mesh))
}

impl Site {
    /// The work folders.
    fn work(&self) -> Vec<PathBuf> {
        let names = self.files().into_iter().filter(|name| name.ends_with(".work"));
        names.map(|name| self.source().with_file_name(name)).collect()
    }
}

/// Asks to stop after some advances, from a stage on.
struct StopAfter {
    advances: AtomicU64,
    from: Stage,
    has_begun: AtomicBool,
    cancel: Cancel,
}

impl BuildProgress for StopAfter {
    fn begin_stage(&self, stage: Stage, _: u64) {
        self.has_begun.fetch_or(stage >= self.from, Ordering::Relaxed);
    }
}

impl Progress for StopAfter {
    fn begin(&self, _: &str, _: u64) {}

    fn advance(&self, _: u64) {
        let counts = self.has_begun.load(Ordering::Relaxed);
        if counts && self.advances.fetch_sub(1, Ordering::Relaxed) == 1 {
            self.cancel.cancel();
        }
    }

    fn end(&self) {}
}

/// Stops after so many advances from a stage on; answers how far it was then, or none if it was done before.
fn stopped(site: &Site, config: &BuildConfig, from: Stage, advances: u64) -> Option<Option<Reached>> {
    let advances = AtomicU64::new(advances);
    let stop = StopAfter { advances, from, has_begun: AtomicBool::new(false), cancel: Cancel::default() };
    match site.try_build(config, &stop, &stop.cancel) {
        Ok(_) => None,
        Err(BuildError::Cancelled) => Some(None),
        Err(BuildError::Kept { error, reached, folder }) => {
            assert!(error.is_cancelled());
            assert_eq!(site.work(), [folder]);
            Some(Some(reached))
        }
        Err(other) => panic!("{other}"),
    }
}

/// Stops a build in simplify, again and again, until it is above the leaves.
fn left_in_simplify(site: &Site) {
    loop {
        let reached = stopped(site, &eager(1), Stage::Simplify, 4).expect("not done");
        if matches!(reached, Some(Reached::Groups { level: 1.., .. })) {
            return;
        }
    }
}

#[test]
fn a_stopped_build_goes_on_from_everywhere_with_any_resources() {
    let site = site();
    let mut settings = [eager(1), eager(1)];
    settings[1].settings.finest_error = Some(Length::OfDiagonal(0.05));
    settings[1].settings.target_error = Some(Length::OfDiagonal(2.0));
    settings[1].settings.min_component = Some(Length::OfDiagonal(0.5));
    settings[1].settings.positions = Positions::Lattice(12);
    for config in settings {
        let (report, whole) = site.bytes(&config);
        let left_out = report.repairs.small_components.map_or(0, |small| small.components);
        assert_eq!(left_out > 0, config.settings.min_component.is_some());
        let mut seen = Vec::new();
        for advances in (1..).step_by(5) {
            let Some(reached) = stopped(&site, &config, Stage::Ingest, advances) else { break };
            let mut other = config.clone();
            let resources = &mut other.resources;
            resources.threads = 1 + advances as usize % 3;
            resources.memory = [Bytes(1 << 16), Bytes::mib(256)][advances as usize % 2];
            let (report, bytes) = site.bytes(&other);
            assert!(bytes == whole, "stopped after {advances} advances, at {reached:?}");
            assert_eq!(report.resumed, reached);
            seen.extend(reached);
        }
        for stage in [Stage::Ingest, Stage::Decompose, Stage::Hierarchy, Stage::Simplify] {
            // A tree of so few leaves may have no place to stop at.
            let is_seen = seen.contains(&Reached::Stage(stage));
            assert!(is_seen || stage == Stage::Decompose, "{stage} in {seen:?}");
        }
        let within = |r: &&Reached| matches!(r, Reached::Groups { done, of, .. } if 0 < *done && done < of);
        assert!(seen.iter().filter(within).count() > 3, "{seen:?}");
    }
}

/// What the faces of several regions come to is in a checkpoint, too.
#[test]
fn computed_normals_are_kept() {
    let site = site();
    let mut config = eager(1);
    (config.settings.cluster_triangles, config.settings.normals) = (16, Normals::Computed);
    let (_, whole) = site.bytes(&config);
    assert!(matches!(stopped(&site, &config, Stage::Simplify, 4), Some(Some(_))), "stopped in simplify");
    let (report, bytes) = site.bytes(&config);
    assert!(bytes == whole && report.resumed.is_some(), "{:?}", report.resumed);
}

/// Every access to a file fails once: an error, nothing wrong, and the next run makes the same bytes.
#[test]
fn a_fault_of_any_access_is_an_error_and_nothing_is_lost() {
    let site = Site::of(&Synth::new(Shape::Terrain, 3_000, 1).to_mesh());
    let (_, whole) = site.bytes(&eager(1));
    let (mut failed, mut resumed) = (0, 0);
    for at in (0..200).chain((200..).step_by(17)) {
        let mut faulty = eager(1);
        faulty.resources.fail_points = FailPoints::fail_at(at, at % 2 == 0);
        let result = site.try_build(&faulty, &Silent, &Cancel::default());
        if faulty.resources.fail_points.seen() <= at {
            result.unwrap();
            break;
        }
        let Err(error) = result else { panic!("access {at} failed and nobody noticed") };
        let is_full = error.to_string().to_lowercase().contains("no space left");
        assert!(is_full || error.to_string().contains("Input/output error"), "{error}");
        if site.output().exists() {
            // Only the folder was not synced.
            assert!(fs::read(site.output()).unwrap() == whole, "{error}");
        }
        let (report, bytes) = site.bytes(&eager(1));
        assert!(bytes == whole, "after fault {at}: {error}");
        failed += 1;
        resumed += u32::from(report.resumed.is_some());
    }
    assert!(failed > 200 && resumed > 100, "{failed} failed, {resumed} of them resumed");
}

#[test]
fn damaged_work_is_named_and_not_used() {
    let site = site();
    let (_, whole) = site.bytes(&eager(1));
    left_in_simplify(&site);
    let folder = site.work().remove(0);
    let names: Vec<_> = fs::read_dir(&folder).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert!(names.len() > 3, "{names:?}");
    for name in names {
        for damage in ["flipped", "cut", "gone"] {
            left_in_simplify(&site);
            let path = folder.join(&name);
            // Not all levels leave the same files.
            let Ok(mut bytes) = fs::read(&path) else { continue };
            match damage {
                "flipped" => {
                    let middle = if name == "manifest" { bytes.len() / 2 } else { 100 };
                    bytes[middle] ^= 1;
                    fs::write(&path, &bytes).unwrap();
                }
                "cut" => fs::write(&path, &bytes[..50]).unwrap(),
                _ => fs::remove_file(&path).unwrap(),
            }
            let (report, bytes) = site.bytes(&eager(2));
            assert!(bytes == whole, "{name:?} {damage}");
            assert_eq!(report.resumed, None);
            // Without a manifest there is nothing to be named.
            let is_named = report.notes.iter().any(|note| note.contains("not used"));
            assert_eq!(
                is_named,
                name != "manifest" || damage != "gone",
                "{name:?} {damage}: {:?}",
                report.notes
            );
        }
    }
}

#[test]
fn work_of_other_settings_or_another_source_is_named_and_left() {
    let site = site();
    left_in_simplify(&site);
    let stale = site.work();
    let content = |folder: &PathBuf| fs::read(folder.join("manifest")).unwrap();
    let before = content(&stale[0]);

    let mut other = eager(1);
    other.settings.seed += 1;
    let report = site.try_build(&other, &Silent, &Cancel::default()).unwrap();
    assert!(report.resumed.is_none());
    assert!(report.notes[0].contains(&stale[0].display().to_string()), "{:?}", report.notes);

    let touched = SystemTime::now() + Duration::from_secs(5);
    File::options().write(true).open(site.source()).unwrap().set_modified(touched).unwrap();
    let report = site.try_build(&eager(1), &Silent, &Cancel::default()).unwrap();
    assert!(report.resumed.is_none() && report.notes.len() == 1);
    assert_eq!((site.work(), content(&stale[0])), (stale, before));
}

#[test]
fn work_that_is_kept_serves_the_next_build() {
    let site = site();
    let (_, whole) = site.bytes(&eager(1));
    let mut keeping = config(256);
    (keeping.overwrite, keeping.resources.keep_work) = (true, true);
    for expected in [None, Some(Reached::Stage(Stage::Simplify))] {
        let report = site.try_build(&keeping, &Silent, &Cancel::default()).unwrap();
        assert_eq!((report.resumed, site.work().len()), (expected, 1));
        assert!(fs::read(site.output()).unwrap() == whole);
    }
    let elsewhere = tempfile::tempdir().unwrap();
    keeping.resources.work_dir = Some(elsewhere.path().to_owned());
    site.try_build(&keeping, &Silent, &Cancel::default()).unwrap();
    assert_eq!(fs::read_dir(elsewhere.path()).unwrap().count(), 1);
    // Whoever does not want to go on neither uses nor removes it.
    keeping.resources.checkpoint = None;
    let report = site.try_build(&keeping, &Silent, &Cancel::default()).unwrap();
    assert_eq!((report.resumed, site.work().len()), (None, 1));
    // The same command without keeping it uses it up.
    assert_eq!(site.bytes(&eager(1)).0.resumed, Some(Reached::Stage(Stage::Simplify)));
}

/// Changes the source while it is read.
struct Meddler<'a>(&'a Site);

impl BuildProgress for Meddler<'_> {
    fn begin_stage(&self, stage: Stage, _: u64) {
        if stage == Stage::Ingest {
            let time = SystemTime::now() + Duration::from_secs(5);
            File::options().write(true).open(self.0.source()).unwrap().set_modified(time).unwrap();
        }
    }
}

impl Progress for Meddler<'_> {
    fn begin(&self, _: &str, _: u64) {}

    fn advance(&self, _: u64) {}

    fn end(&self) {}
}

#[test]
fn a_source_that_changes_while_it_is_read_is_refused() {
    let site = site();
    let result = site.try_build(&eager(1), &Meddler(&site), &Cancel::default());
    assert!(matches!(result, Err(BuildError::SourceChanged { .. })), "{result:?}");
    assert_eq!(site.files(), ["mesh.ply"]);
}

#[test]
fn a_full_disk_says_where_the_work_is_kept() {
    let site = site();
    let full = (0..).map(|n| {
        let mut faulty = eager(2);
        faulty.resources.fail_points = FailPoints::fail_at(300 + 50 * n, true);
        site.try_build(&faulty, &Silent, &Cancel::default()).unwrap_err()
    });
    let kept = full.take(20).find(|error| matches!(error, BuildError::Kept { .. })).expect("a checkpoint");
    let text = kept.to_string();
    assert!(text.contains("no space left") && text.contains("same command"), "{text}");
    assert!(text.contains(&site.work()[0].display().to_string()), "{text}");
    let BuildError::Kept { error, .. } = kept else { unreachable!() };
    assert!(matches!(*error, BuildError::Extmem(ExtmemError::DiskFull { .. })));
}
