//! Builds that do not end well leave nothing behind.

use crate::site::{Site, config};
use chpm_build::{BuildError, BuildProgress, Cancel, Progress, Silent, Stage};
use chpm_import::SourceError;
use chpm_synth::{Shape, Synth};
use std::fs;
use std::sync::Mutex;

/// Asks to stop when a stage begins, or as soon as it has advanced.
struct StopAt {
    stage: Stage,
    advanced: bool,
    running: Mutex<Option<Stage>>,
    cancel: Cancel,
}

impl BuildProgress for StopAt {
    fn begin_stage(&self, stage: Stage, _: u64) {
        *self.running.lock().unwrap() = Some(stage);
        if stage == self.stage && !self.advanced {
            self.cancel.cancel();
        }
    }
}

impl Progress for StopAt {
    fn begin(&self, _: &str, _: u64) {}

    fn advance(&self, _: u64) {
        if *self.running.lock().unwrap() == Some(self.stage) {
            self.cancel.cancel();
        }
    }

    fn end(&self) {}
}

#[test]
fn a_stopped_build_leaves_nothing_behind() {
    let site = Site::of(&Synth::new(Shape::Terrain, 20_000, 0).to_mesh());
    for memory in [1 << 16, 1 << 28] {
        let mut config = config(256);
        config.resources.memory = chpm_mesh::Bytes(memory);
        // The last stage writes the tables and publishes: once it runs, the file is there.
        for stage in Stage::ALL.into_iter().filter(|s| ![Stage::Sheets, Stage::Emit].contains(s)) {
            for advanced in [false, true] {
                let cancel = Cancel::default();
                let running = Mutex::new(None);
                let stop = StopAt { stage, advanced, running, cancel: cancel.clone() };
                let result = site.try_build(&config, &stop, &cancel);
                assert!(matches!(result, Err(BuildError::Cancelled)), "{stage}: {result:?}");
                assert_eq!(site.files(), ["mesh.ply"], "{stage}");
            }
        }
    }
    // And the site is good for a build afterwards.
    site.build(&config(256));
}

#[test]
fn an_existing_output_is_replaced_only_if_wanted() {
    let site = Site::of(&Synth::new(Shape::Sphere, 2_000, 0).to_mesh());
    fs::write(site.output(), b"precious").unwrap();
    let refused = site.try_build(&config(256), &Silent, &Cancel::default());
    assert!(matches!(refused, Err(BuildError::Extmem(_))), "{refused:?}");
    assert_eq!(fs::read(site.output()).unwrap(), b"precious");
    assert_eq!(site.files(), ["mesh.chpm", "mesh.ply"]);

    let mut config = config(256);
    config.overwrite = true;
    site.build(&config);
}

#[test]
fn a_stopped_build_keeps_what_it_was_to_replace() {
    let site = Site::of(&Synth::new(Shape::Sphere, 2_000, 0).to_mesh());
    fs::write(site.output(), b"precious").unwrap();
    let mut config = config(256);
    config.overwrite = true;
    let cancel = Cancel::default();
    cancel.cancel();
    let result = site.try_build(&config, &Silent, &cancel);
    assert!(matches!(result, Err(BuildError::Cancelled)));
    assert_eq!(fs::read(site.output()).unwrap(), b"precious");
    assert_eq!(site.files(), ["mesh.chpm", "mesh.ply"]);
}

#[test]
fn a_broken_source_is_an_error_with_its_place() {
    let site = Site::of(&Synth::new(Shape::Sphere, 2_000, 0).to_mesh());
    let bytes = fs::read(site.source()).unwrap();
    fs::write(site.source(), &bytes[..bytes.len() / 2]).unwrap();
    let result = site.try_build(&config(256), &Silent, &Cancel::default());
    assert!(
        matches!(&result, Err(BuildError::Source(error)) if matches!(**error, SourceError::Import { .. })),
        "{result:?}"
    );
    assert_eq!(site.files(), ["mesh.ply"]);

    fs::remove_file(site.source()).unwrap();
    let result = site.try_build(&config(256), &Silent, &Cancel::default());
    assert!(
        matches!(&result, Err(BuildError::Source(error)) if matches!(**error, SourceError::Read { .. })),
        "{result:?}"
    );
    assert!(site.files().is_empty());
}
