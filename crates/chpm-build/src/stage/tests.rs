//! Builds of one source by ids of every kind: those of 64 bits, and those that count from 2^33 on, must not show.

use super::*;
use crate::config::{BuildConfig, Length, Normals, Positions};
use crate::ids::Ids;

use chpm_extmem::{Cancel, Silent};
use chpm_import::ply::{Encoding, write_mesh};
use chpm_mesh::Bytes;
use chpm_synth::{Shape, Synth};
use std::fs::{self, File};

const KINDS: [Ids; 2] = [Ids::Narrow, Ids::Wide];
const DIVISION: Division = Division { parts: 2, levels: Some(1) };

fn resources(ids: Ids, memory: Bytes) -> Resources {
    Resources { threads: 2, memory, checkpoint: None, ids, ..Resources::default() }
}

/// A mesh that lies in many places, with copies of triangles and with pieces of all sizes.
fn write(path: &Path) {
    let mut mesh = Synth::new(Shape::Plates, 6000, 3).to_mesh();
    let copies: Vec<[u32; 3]> = mesh.triangles.iter().step_by(7).map(|[a, b, c]| [*b, *c, *a]).collect();
    mesh.triangles.extend(copies);
    write_mesh(File::create(path).unwrap(), &mesh, Encoding::BinaryLittleEndian).unwrap();
}

fn settings() -> [Settings; 3] {
    let small = Settings { cluster_triangles: 16, cell_vertices: 4, ..Settings::default() };
    [
        Settings { positions: Positions::Auto, ..small.clone() },
        Settings { min_component: Some(Length::Units(0.2)), ..small.clone() },
        Settings { normals: Normals::Computed, ..small },
    ]
}

#[test]
fn ids_of_any_kind_give_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let source = dir.path().join("plates.ply");
    write(&source);
    for (case, settings) in settings().into_iter().enumerate() {
        let mut all = Vec::new();
        for ids in KINDS {
            let output = dir.path().join(format!("{case}-{ids:?}.chpm"));
            let resources = resources(ids, Bytes::mib(128));
            let config = BuildConfig { settings: settings.clone(), resources, overwrite: false };
            let report = crate::build(&source, &output, &config, &Silent, &Cancel::default()).unwrap();
            assert!(report.repairs.merged_copies > 500, "{}", report.repairs.merged_copies);
            all.push((report.repairs, fs::read(&output).unwrap()));
        }
        assert!(all.iter().all(|one| *one == all[0]), "case {case}");
    }
}

#[test]
fn steps_hand_over_ids_of_any_kind() {
    let dir = tempfile::tempdir().unwrap();
    let source = dir.path().join("plates.ply");
    write(&source);
    let [settings, ..] = settings();
    let mut all = Vec::new();
    for ids in KINDS {
        let folder = dir.path().join(format!("{ids:?}.stages"));
        let output = output_of(&folder);
        let cancel = Cancel::default();
        let resources = resources(ids, Bytes::mib(128));
        plan(&source, &folder, &settings, DIVISION, &resources, &Silent, &cancel).unwrap();
        // What the plan says counts, and not what later steps are told.
        let resources = Resources { ids: Ids::Narrow, ..resources };
        for step in Step::all(DIVISION.parts, 1) {
            if step != Step::Plan {
                run(step, &folder, Some((&output, false)), &resources, &Silent, &cancel).unwrap();
            }
        }
        let len = |step: Step| folder.join(step.file()).metadata().unwrap().len();
        let scattered = len(Step::Scatter(Share { index: 1, of: 2 }));
        all.push((fs::read(&output).unwrap(), scattered));
    }
    let [(narrow, less), (wide, more)] = all.try_into().unwrap();
    assert!(narrow == wide);
    assert!(2 * less > more && more > less, "{less} and {more} bytes");
}
