//! The scene of a glTF: a node with the mesh, or one for each level of detail, of which readers that know no levels show the finest.

use crate::gltf::Facts;
use serde_json::{Map, Value, json};

/// Name of the extension `MSFT_lod`.
const LEVELS: &str = "MSFT_lod";
/// Name of the extension `KHR_mesh_quantization`.
const QUANTIZED: &str = "KHR_mesh_quantization";
/// Lines of the image in which a level's error is a pixel where it begins.
const LINES: f64 = 1080.0;

/// A mesh of a glTF. Several are levels of detail, the finest first.
#[derive(Clone, Debug, Default)]
pub struct Level {
    /// Further numbers and words about it, by name.
    pub extras: Map<String, Value>,
    /// The share of an image's height that the sphere around the model takes at least where this level is to be drawn.
    pub coverage: f64,
}

/// The shares of an image's height down to which levels are to be drawn, by their errors and the diagonal of the model. The next
/// level is drawn where its error is a pixel of an image of 1080 lines at most; the last one always.
pub fn coverage(errors: &[f32], diagonal: f64) -> Vec<f64> {
    let mut shares: Vec<f64> = Vec::with_capacity(errors.len());
    for next in errors.iter().skip(1) {
        let share = diagonal / (LINES * f64::from(*next));
        // Nothing is larger than an image, nor is a finer level drawn where a coarser one is.
        let most = shares.last().copied().unwrap_or(1.0);
        shares.push(if share < most { share } else { most });
    }
    shares.resize(errors.len(), 0.0);
    shares
}

/// The document but for its tables: nodes, and meshes of these primitives, by level.
pub(crate) fn document(facts: &Facts, primitives: Vec<Vec<Value>>) -> Value {
    let (mut nodes, mut meshes) = (Vec::new(), Vec::new());
    let is_alone = facts.levels.len() == 1;
    for (number, (level, primitives)) in facts.levels.iter().zip(primitives).enumerate() {
        let mut node = facts.placement.node(facts.grid.as_ref());
        if !is_alone {
            node["name"] = format!("LOD{number}").into();
        }
        if primitives.is_empty() {
            // glTF has no empty meshes.
            node["extras"] = level.extras.clone().into();
        } else {
            node["mesh"] = meshes.len().into();
            meshes.push(json!({ "primitives": primitives, "extras": level.extras }));
        }
        nodes.push(node);
    }

    let asset = json!({ "version": "2.0", "generator": facts.generator });
    let mut root = json!({ "asset": asset, "scene": 0, "scenes": [{ "nodes": [0] }] });
    if !is_alone && let Some(finest) = nodes.first_mut() {
        let coarser: Vec<usize> = (1..facts.levels.len()).collect();
        let coverage: Vec<f64> = facts.levels.iter().map(|level| level.coverage).collect();
        finest["extensions"] = json!({ LEVELS: { "ids": coarser } });
        finest["extras"]["MSFT_screencoverage"] = coverage.into();
        use_extension(&mut root, LEVELS, false);
    }
    root["nodes"] = nodes.into();
    if !meshes.is_empty() {
        if facts.grid.is_some() {
            use_extension(&mut root, QUANTIZED, true);
        }
        root["meshes"] = meshes.into();
    }
    root
}

/// Names an extension, and whether readers have to know it.
pub(crate) fn use_extension(root: &mut Value, name: &str, is_required: bool) {
    let lists = if is_required { &["extensionsUsed", "extensionsRequired"][..] } else { &["extensionsUsed"] };
    for list in lists {
        match root[*list].as_array_mut() {
            Some(names) => names.push(name.into()),
            None => root[*list] = json!([name]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Placement;

    #[test]
    fn a_level_is_drawn_where_the_next_one_would_be_a_pixel_off() {
        // A model of 1080 units that fills the height has a unit in a pixel.
        assert_eq!(coverage(&[0.0, 2.0, 8.0], 1080.0), [0.5, 0.125, 0.0]);
        // However near it is, a share is at most the whole, and shares fall.
        assert_eq!(coverage(&[0.0, 0.0, 4.0, 2.0], 1080.0), [1.0, 0.25, 0.25, 0.0]);
        assert_eq!(coverage(&[3.0], 1.0), [0.0]);
        assert_eq!(coverage(&[0.0, 0.0], 0.0), [1.0, 0.0]);
        assert!(coverage(&[], 1.0).is_empty());
    }

    #[test]
    fn readers_without_levels_find_the_finest_alone() {
        let level = |error: f64, coverage| Level {
            extras: Map::from_iter([("error".to_owned(), error.into())]),
            coverage,
        };
        let mut facts = Facts {
            generator: "test".to_owned(),
            placement: Placement { origin: [1.0, 2.0, 3.0], ..Placement::HERE },
            levels: vec![level(0.5, 0.25), level(1.5, 0.125), level(2.5, 0.0)],
            scalars: Vec::new(),
            grid: None,
        };
        let root = document(&facts, vec![vec![json!({})], vec![], vec![json!({})]]);
        assert_eq!(
            (&root["scenes"], &root["extensionsUsed"]),
            (&json!([{ "nodes": [0] }]), &json!([LEVELS]))
        );
        assert_eq!(root.get("extensionsRequired"), None);
        let nodes = root["nodes"].as_array().unwrap();
        assert_eq!(nodes[0]["extensions"][LEVELS]["ids"], json!([1, 2]));
        assert_eq!(nodes[0]["extras"]["MSFT_screencoverage"], json!([0.25, 0.125, 0.0]));
        assert!(nodes.iter().all(|node| node["translation"] == json!([1.0, 2.0, 3.0])));
        let meshes: Vec<_> = nodes.iter().map(|node| node.get("mesh").cloned()).collect();
        assert_eq!(meshes, [Some(0.into()), None, Some(1.into())]);
        assert_eq!(
            (&root["meshes"][1]["extras"]["error"], &nodes[1]["extras"]["error"]),
            (&2.5.into(), &1.5.into())
        );

        facts.levels.truncate(1);
        let alone = document(&facts, vec![vec![json!({})]]);
        assert_eq!(alone["nodes"], json!([{ "mesh": 0, "translation": [1.0, 2.0, 3.0] }]));
        assert_eq!(alone.get("extensionsUsed"), None);
    }
}
