//! Parts of a build in steps that were damaged: who reads one says so, or makes what it would have made.

use chpm_build::config::{Resources, Settings};
use chpm_build::stage::{self, Division, Step};
use chpm_build::{BuildError, Cancel, Silent};
use chpm_import::ply::{Encoding, write_mesh};
use chpm_mesh::Bytes;
use chpm_synth::{Shape, Synth};
use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

const DIVISION: Division = Division { parts: 2, levels: Some(1) };
const CASES: u64 = 300;

struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % limit.max(1) as u64) as usize
    }

    /// Changes some bytes: one bit, or a number that is out of all bounds, or a range of zeros.
    fn change(&mut self, bytes: &mut [u8]) {
        if bytes.is_empty() {
            return;
        }
        let at = self.below(bytes.len());
        let rest = &mut bytes[at..];
        match self.below(4) {
            0 => rest[0] ^= 1 << self.below(8),
            1 => rest.iter_mut().take(1 + self.below(9)).for_each(|byte| *byte = 0xff),
            2 => rest.iter_mut().take(1 + self.below(99)).for_each(|byte| *byte = 0),
            _ => rest[0] = self.below(256) as u8,
        }
    }
}

/// A folder in which all steps were done.
struct Done {
    dir: tempfile::TempDir,
    steps: Vec<Step>,
    /// What they have left.
    whole: BTreeMap<Step, Vec<u8>>,
}

fn resources() -> Resources {
    Resources { threads: 2, memory: Bytes::mib(128), checkpoint: None, ..Resources::default() }
}

impl Done {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let source = dir.path().join("mesh.ply");
        let mesh = Synth::new(Shape::Isosurface, 6000, 3).to_mesh();
        write_mesh(fs::File::create(&source).unwrap(), &mesh, Encoding::BinaryLittleEndian).unwrap();
        let settings = Settings { cluster_triangles: 16, cell_vertices: 4, ..Settings::default() };
        let folder = dir.path().join("mesh.stages");
        stage::plan(&source, &folder, &settings, DIVISION, &resources(), &Silent, &Cancel::default())
            .unwrap();
        let steps = Step::all(DIVISION.parts, 1);
        let mut done = Done { dir, steps, whole: BTreeMap::new() };
        for step in done.steps.clone() {
            done.run(step).unwrap();
            done.whole.insert(step, fs::read(done.path(step)).unwrap());
        }
        done
    }

    fn folder(&self) -> PathBuf {
        self.dir.path().join("mesh.stages")
    }

    fn path(&self, step: Step) -> PathBuf {
        self.folder().join(step.file())
    }

    fn run(&self, step: Step) -> Result<(), BuildError> {
        if step == Step::Plan {
            return Ok(());
        }
        let output = self.dir.path().join("mesh.chpm");
        let of = Some((output.as_path(), true));
        stage::run(step, &self.folder(), of, &resources(), &Silent, &Cancel::default()).map(|_| ())
    }

    /// Does each step again that reads what `step` has left, and then puts all back.
    fn readers(&self, step: Step, mut told: impl FnMut(Step, Result<(), BuildError>, bool)) {
        for reader in &self.steps {
            if !reader.inputs(DIVISION.parts, 1).contains(&step) {
                continue;
            }
            fs::remove_file(self.path(*reader)).unwrap();
            let result = self.run(*reader);
            let is_same = fs::read(self.path(*reader)).is_ok_and(|bytes| bytes == self.whole[reader]);
            told(*reader, result, is_same);
            fs::write(self.path(*reader), &self.whole[reader]).unwrap();
        }
        fs::write(self.path(step), &self.whole[&step]).unwrap();
    }
}

#[test]
fn damaged_parts_are_refused_or_do_not_matter() {
    let (done, mut random) = (Done::new(), Random(1));
    let mut refused = 0;
    for case in 0..CASES {
        let step = done.steps[random.below(done.steps.len())];
        let mut bytes = done.whole[&step].clone();
        match random.below(4) {
            0 => bytes.truncate(random.below(bytes.len())),
            1 => bytes.extend_from_within(..random.below(bytes.len().min(100))),
            2 => {
                let end = bytes.len();
                random.change(&mut bytes[end.saturating_sub(200)..]);
            }
            _ => random.change(&mut bytes),
        }
        fs::write(done.path(step), &bytes).unwrap();
        done.readers(step, |reader, result, is_same| {
            refused += u32::from(result.is_err());
            assert!(result.is_err() || is_same, "case {case}: {reader:?} of {step:?}");
        });
    }
    assert!(refused > 100, "{refused}");
}
