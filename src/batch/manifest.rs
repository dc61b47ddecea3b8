//! Lists of models in TOML or JSON, with settings for all and for each.

use anyhow::{Context, Result};
use chpm_mesh::Bytes;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// More than a list of a million models takes.
const MOST: Bytes = Bytes::mib(256);

/// The file. Settings have the names of the command line's options.
#[derive(Deserialize, Debug)]
#[serde(deny_unknown_fields)]
struct Manifest {
    #[serde(default)]
    settings: Settings,
    #[serde(alias = "models")]
    model: Vec<Entry>,
}

#[derive(Deserialize, Debug)]
#[serde(deny_unknown_fields)]
struct Entry {
    source: PathBuf,
    name: Option<String>,
    #[serde(default)]
    settings: Settings,
}

/// Names of options and their values.
pub(crate) type Settings = BTreeMap<String, Value>;

#[derive(Deserialize, Clone, Debug)]
#[serde(untagged)]
pub(crate) enum Value {
    Switch(bool),
    Whole(i64),
    /// Beyond those.
    Large(u64),
    Number(f64),
    Text(String),
    /// Of an option that can be given several times.
    List(Vec<Value>),
}

/// A model of the list; its source is relative to where the list's is, its settings are arguments of the command line.
#[derive(Debug, PartialEq)]
pub(super) struct Listed {
    pub(super) source: PathBuf,
    pub(super) name: Option<String>,
    pub(super) settings: Vec<String>,
}

/// Whether the name of a file says that it is a list.
pub(super) fn is_manifest(path: &Path) -> bool {
    is_json(path) || path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"))
}

fn is_json(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
}

/// Reads the list.
pub(super) fn read(path: &Path) -> Result<Vec<Listed>> {
    let text = crate::config::text(path, MOST)?;
    let told = || format!("'{}' is no valid list of models", path.display());
    let manifest: Manifest = if is_json(path) {
        serde_json::from_str(&text).with_context(told)?
    } else {
        toml::from_str(&text).with_context(told)?
    };
    let listed = manifest.model.into_iter().map(|entry| {
        let mut settings = manifest.settings.clone();
        settings.extend(entry.settings);
        Listed { source: path.with_file_name(entry.source), name: entry.name, settings: arguments(&settings) }
    });
    Ok(listed.collect())
}

/// `name = value` as it is typed; a switch that is off is not typed.
pub(crate) fn arguments(settings: &Settings) -> Vec<String> {
    settings.iter().flat_map(|(name, value)| typed(name, value)).collect()
}

fn typed(name: &str, value: &Value) -> Vec<String> {
    match value {
        Value::Switch(true) => vec![format!("--{name}")],
        Value::Switch(false) => Vec::new(),
        Value::Whole(n) => vec![format!("--{name}={n}")],
        Value::Large(n) => vec![format!("--{name}={n}")],
        Value::Number(x) => vec![format!("--{name}={x}")],
        Value::Text(text) => vec![format!("--{name}={text}")],
        Value::List(values) => values.iter().flat_map(|value| typed(name, value)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn listed(name: &str, text: &str) -> Result<Vec<Listed>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join(name);
        fs::write(&path, text)?;
        let mut all = read(&path)?;
        for model in &mut all {
            model.source = model.source.strip_prefix(folder.path())?.to_owned();
        }
        Ok(all)
    }

    #[test]
    fn a_seed_of_64_bits_is_kept() {
        for (name, text) in [
            ("m.toml", "[settings]\nseed = 9223372036854775809\n[[model]]\nsource = 'x.ply'\n"),
            ("m.json", r#"{"settings": {"seed": 9223372036854775809}, "models": [{"source": "x.ply"}]}"#),
        ] {
            let settings: Vec<_> =
                listed(name, text).unwrap().into_iter().flat_map(|model| model.settings).collect();
            assert_eq!(settings, ["--seed=9223372036854775809"], "{name}");
        }
    }

    #[test]
    fn toml_and_json_tell_the_same() {
        let toml = "[settings]\nseed = 3\nno-layout = true\n[[model]]\nsource = 'a/x.ply'\n[[model]]\nsource = 'y.ply'\nname = 'z'\n\
                    settings = { seed = 4, no-layout = false, boundary = 'lock' }\n";
        let json = r#"{"settings": {"seed": 3, "no-layout": true}, "models": [{"source": "a/x.ply"},
                       {"source": "y.ply", "name": "z", "settings": {"seed": 4, "no-layout": false, "boundary": "lock"}}]}"#;
        let expected = [
            (Path::new("a/x.ply"), None, vec!["--no-layout", "--seed=3"]),
            (Path::new("y.ply"), Some("z"), vec!["--boundary=lock", "--seed=4"]),
        ];
        for (name, text) in [("m.toml", toml), ("m.json", json)] {
            let all = listed(name, text).unwrap();
            assert_eq!(all.len(), 2);
            for (model, (source, name, settings)) in all.iter().zip(&expected) {
                assert_eq!((&*model.source, model.name.as_deref()), (*source, *name));
                assert_eq!(model.settings, *settings);
            }
        }
    }

    #[test]
    fn what_is_unknown_is_refused() {
        for text in ["[[model]]\nsourse = 'x.ply'\n", "[setings]\n[[model]]\nsource = 'x'\n", "model = 3", ""]
        {
            let error = format!("{:#}", listed("m.toml", text).unwrap_err());
            assert!(error.contains("m.toml"), "{text}: {error}");
        }
    }
}
