//! Builds whose pages go to files of their own: nothing is there, or all of it, or an error that says so.

use crate::site::{Site, config};
use chpm_build::config::Volumes;
use chpm_build::{BuildConfig, BuildProgress, Cancel, FailPoints, Silent, Stage};
use chpm_extmem::Progress;
use chpm_format::{Chpm, FormatError, VolumeFault, verify, volume};
use chpm_synth::{Shape, Synth};
use std::fs;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

fn in_volumes(size: &str) -> BuildConfig {
    let mut config = config(64);
    config.settings.volumes = size.parse().unwrap();
    config.overwrite = true;
    config
}

fn open(site: &Site) -> Result<Chpm<Vec<u8>>, FormatError> {
    Chpm::open_at(fs::read(site.output()).unwrap(), &site.output(), |path| fs::read(path))
}

fn build(site: &Site, config: &BuildConfig) -> Result<u64, chpm_build::BuildError> {
    site.try_build(config, &Silent, &Cancel::default()).map(|report| report.output_len)
}

/// Whether a stage has begun.
#[derive(Default)]
struct Started(AtomicBool);

impl Progress for Started {
    fn begin(&self, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}
    fn end(&self) {}
}

impl BuildProgress for Started {
    fn begin_stage(&self, _: Stage, _: u64) {
        self.0.store(true, Relaxed);
    }
}

/// Length of all files but the source.
fn stored(site: &Site) -> u64 {
    let files = site.files();
    let built = files.iter().filter(|name| *name != "mesh.ply");
    built.map(|name| fs::metadata(site.output().with_file_name(name)).unwrap().len()).sum()
}

#[test]
fn sets_replace_one_another_and_nothing_else() {
    let site = Site::of(&Synth::new(Shape::Sphere, 2_000, 0).to_mesh());
    let own = site.output().with_file_name("mesh.0999.pages");
    fs::write(&own, "mine").unwrap();
    for (size, packed) in
        [("24K", false), ("64K", true), ("one", false), ("40K", true), ("24K", true), ("1T", false)]
    {
        let mut config = in_volumes(size);
        config.settings.packed = packed;
        let len = build(&site, &config).unwrap();
        let file = open(&site).unwrap();
        assert_eq!(verify(&file, |_, _| ()).faults, []);
        assert_eq!((len, fs::read(&own).unwrap()), (stored(&site) - 4, b"mine".to_vec()));
        assert_eq!(file.stored_len(), len);
        assert_eq!(site.files().len(), 3 + file.volumes().len(), "{size}: {:?}", site.files());
        assert!((size == "one") == file.volumes().is_empty());
        if let Some(size) = config.settings.volumes.size() {
            assert!(file.volumes().iter().all(|volume| volume.len() as u64 <= size));
        }
    }
    // What is nobody's is not replaced.
    fs::write(volume::path(&site.output(), 1), "mine").unwrap();
    let told = build(&site, &in_volumes("24K")).unwrap_err().to_string();
    assert!(told.contains("mesh.0001.pages' has the name of a volume"), "{told}");
    assert_eq!(fs::read(volume::path(&site.output(), 1)).unwrap(), b"mine");
}

#[test]
fn a_later_volumes_name_is_refused_before_the_work() {
    let site = Site::of(&Synth::new(Shape::Sphere, 2_000, 0).to_mesh());
    let taken = volume::path(&site.output(), 3);
    fs::write(&taken, "mine").unwrap();
    let started = Started::default();
    let told = site.try_build(&in_volumes("24K"), &started, &Cancel::default()).unwrap_err().to_string();
    assert!(told.contains("mesh.0003.pages' has the name of a volume"), "{told}");
    assert!(!started.0.into_inner() && fs::read(&taken).unwrap() == b"mine");
}

#[test]
fn volumes_that_are_there_are_not_replaced_unasked() {
    let site = Site::of(&Synth::new(Shape::Sphere, 2_000, 0).to_mesh());
    let mut config = in_volumes("24K");
    build(&site, &config).unwrap();
    fs::remove_file(site.output()).unwrap();
    let (before, files) = (fs::read(volume::path(&site.output(), 1)).unwrap(), site.files());
    config.overwrite = false;
    let told = build(&site, &config).unwrap_err().to_string();
    assert!(told.contains("mesh.0001.pages' exists"), "{told}");
    assert_eq!((fs::read(volume::path(&site.output(), 1)).unwrap(), site.files()), (before, files));
}

#[test]
fn too_many_or_too_small_volumes_are_refused() {
    let site = Site::of(&Synth::new(Shape::Sphere, 60_000, 0).to_mesh());
    for (size, told) in
        [("4K", "size of a volume"), ("12K", "--volume-size 12288 would take more than 500 files")]
    {
        let got = build(&site, &in_volumes(size)).unwrap_err().to_string();
        assert!(got.contains(told), "{got}");
        assert_eq!(site.files(), ["mesh.ply"]);
    }
}

/// Whatever access fails, what was there is there still or, where names were changing, says what is wrong with it.
#[test]
fn a_fault_leaves_the_old_model_or_the_new_one_or_one_that_says_so() {
    let site = Site::of(&Synth::new(Shape::Sphere, 1_000, 0).to_mesh());
    let others = Site::of(&Synth::new(Shape::Torus, 1_000, 0).to_mesh());
    let config = in_volumes("40K");
    build(&site, &config).unwrap();
    build(&others, &config).unwrap();
    let kept: Vec<(String, Vec<u8>)> = (site.files().into_iter())
        .map(|name| (name.clone(), fs::read(site.output().with_file_name(name)).unwrap()))
        .collect();
    fs::copy(others.source(), site.source()).unwrap();
    let new = fs::read(others.output()).unwrap();
    let (mut kinds, mut at) = ([0; 3], 0);
    loop {
        for (name, bytes) in kept.iter().filter(|(name, _)| name != "mesh.ply") {
            fs::write(site.output().with_file_name(name), bytes).unwrap();
        }
        let mut faulty = config.clone();
        faulty.resources.fail_points = FailPoints::fail_at(at, true);
        let result = build(&site, &faulty);
        assert!(site.files().iter().all(|name| !name.contains("partial")), "{:?}", site.files());
        let is_new = fs::read(site.output()).unwrap() == new;
        match open(&site) {
            Ok(file) => {
                assert_eq!(verify(&file, |_, _| ()).faults, []);
                kinds[usize::from(is_new)] += 1;
            }
            Err(FormatError::Volume { fault: VolumeFault::Foreign, .. }) if result.is_err() => kinds[2] += 1,
            Err(error) => panic!("{at}: {error}"),
        }
        if result.is_ok() {
            break;
        }
        at += 1;
    }
    assert!(kinds.iter().all(|count| *count > 0), "{kinds:?} of {at}");
}

/// Without an older set, nothing stays of one whose names could not all be given.
#[test]
fn a_fault_leaves_nothing_new() {
    let site = Site::of(&Synth::new(Shape::Sphere, 1_000, 0).to_mesh());
    let mut config = in_volumes("40K");
    config.overwrite = false;
    for at in 0.. {
        config.resources.fail_points = FailPoints::fail_at(at, true);
        let result = build(&site, &config);
        if result.is_ok() {
            break;
        }
        let left = site.files();
        // The last of all accesses looks after the folder, when all names are given.
        assert!(left == ["mesh.ply"] || open(&site).is_ok(), "{at}: {left:?}");
        left.iter().filter(|name| *name != "mesh.ply").for_each(|name| {
            fs::remove_file(site.output().with_file_name(name)).unwrap();
        });
    }
    assert_eq!(config.settings.volumes, "40K".parse::<Volumes>().unwrap());
}
