//! Results of every model: a table for people, JSON and CSV for programs, and the merging of several machines' results.

use super::shard::Shard;
use crate::escape::in_line;
use crate::json;
use crate::report::{self, count, per_triangle};
use anyhow::{Context, Result, ensure};
use chpm_extmem::AtomicFile;
use chpm_mesh::{Bytes, Counted};
use serde::{Deserialize, Serialize, Serializer};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A path that may be no text, as JSON can have it.
fn shown<S: Serializer>(path: &Path, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(&json::named(path))
}

const SCHEMA: &str = "chpm-batch/1";
/// First line of the CSV.
const CSV: &str = "name,status,reason,seconds,triangles,source_bytes,output_bytes,bytes_per_triangle,error,warnings,source,output\n";

/// `chpm batch --json`, and `summary.json` in the folder of the results
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Summary {
    /// Meaning of the keys; summaries of earlier programs have none.
    #[serde(default)]
    pub(crate) schema: String,
    /// The program's version.
    pub(crate) version: String,
    /// The part that this machine had; none for all of it.
    pub(crate) shard: Option<Shard>,
    /// By name.
    pub(crate) models: Vec<Row>,
}

/// Result of one model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Row {
    /// Name of the model, which its output has
    pub(crate) name: String,
    /// `built`, `current`, `failed`, `stopped` or `planned`
    #[cfg_attr(test, schemars(with = "String"))]
    pub(crate) status: Status,
    /// Why it was built, or would be.
    pub(crate) reason: String,
    /// Wall-clock seconds of the build.
    pub(crate) seconds: f64,
    /// Triangles of the finest meshes
    pub(crate) triangles: u64,
    /// Length of the source
    pub(crate) source_bytes: u64,
    /// Length of the file
    pub(crate) output_bytes: u64,
    /// Why it failed
    pub(crate) error: Option<String>,
    /// As in `chpm-build/1`
    pub(crate) warnings: Vec<String>,
    /// The source
    #[serde(serialize_with = "shown")]
    #[cfg_attr(test, schemars(with = "PathBuf"))]
    pub(crate) source: PathBuf,
    /// The file
    #[serde(serialize_with = "shown")]
    #[cfg_attr(test, schemars(with = "PathBuf"))]
    pub(crate) output: PathBuf,
    /// Hash of the source that the output was built from.
    pub(crate) hash: String,
    /// Sizes and times of the source's files.
    #[serde(rename = "stamp")]
    pub(crate) fingerprint: String,
}

/// The fate of a model.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Status {
    /// Built in this run.
    Built,
    /// Built before, from the same source and settings.
    Current,
    /// Not built for an error; an older output is still there.
    Failed,
    /// Not built since the run was stopped.
    Stopped,
    /// To be built.
    Planned,
}

impl Status {
    pub(crate) fn word(self) -> &'static str {
        match self {
            Status::Built => "built",
            Status::Current => "current",
            Status::Failed => "failed",
            Status::Stopped => "stopped",
            Status::Planned => "planned",
        }
    }
}

impl Summary {
    pub(crate) fn new(shard: Option<Shard>, models: Vec<Row>) -> Self {
        Summary { schema: SCHEMA.to_owned(), version: env!("CARGO_PKG_VERSION").to_owned(), shard, models }
    }

    /// The name of the summary's file in the output folder, without its extension.
    pub(crate) fn path(folder: &Path, shard: Option<Shard>) -> PathBuf {
        folder.join(match shard {
            Some(Shard { index, count }) => format!("summary-{index}-of-{count}.json"),
            None => "summary.json".to_owned(),
        })
    }

    /// An error if JSON or CSV could not be written to the folder for what is there by now: folders, one of the `inputs`, or, without `force`, what no batch wrote.
    pub(crate) fn check(folder: &Path, shard: Option<Shard>, force: bool, inputs: &[PathBuf]) -> Result<()> {
        let json = Summary::path(folder, shard);
        for path in [&json.with_extension("csv"), &json] {
            chpm_extmem::target(path, true)?;
            let is_ours = path != &json || !inputs.iter().any(|input| chpm_extmem::same_file(input, path));
            ensure!(
                is_ours,
                "the batch writes '{}', which is the list that it was given: call that otherwise",
                path.display()
            );
        }
        if !force {
            replaces(&json, |text| serde_json::from_slice::<Summary>(text).is_ok())?;
            replaces(&json.with_extension("csv"), |text| text.starts_with(CSV.as_bytes()))?;
        }
        Ok(())
    }

    /// Reads one.
    pub(crate) fn read(path: &Path) -> Result<Summary> {
        let text = json::read(path)?;
        serde_json::from_slice(&text)
            .with_context(|| format!("'{}' is no summary of a batch", path.display()))
    }

    /// Writes JSON and CSV to the folder.
    pub(crate) fn write(&self, folder: &Path) -> Result<()> {
        let json = Summary::path(folder, self.shard);
        let text = serde_json::to_string_pretty(self)? + "\n";
        for (path, text) in [(json.with_extension("csv"), self.csv()), (json, text)] {
            let mut file = AtomicFile::create(&path, true)?;
            file.write_all(text.as_bytes()).map_err(|error| file.error(error))?;
            file.publish()?;
        }
        Ok(())
    }

    /// How many models ended so.
    pub(crate) fn count(&self, status: Status) -> usize {
        self.models.iter().filter(|row| row.status == status).count()
    }

    /// All of it as one line.
    pub(crate) fn line(&self) -> String {
        let all = [Status::Built, Status::Current, Status::Failed, Status::Stopped, Status::Planned];
        let parts = all.iter().map(|status| (self.count(*status), status.word())).filter(|(n, _)| *n > 0);
        let parts: Vec<String> = parts.map(|(n, word)| format!("{n} {word}")).collect();
        let bytes = self.models.iter().map(|row| row.output_bytes).sum();
        let triangles = self.models.iter().map(|row| row.triangles).sum();
        let (models, parts) = (Counted(self.models.len() as u64, "model"), parts.join(", "));
        format!("{models}: {parts}; {} in {}", Counted(triangles, "triangle"), Bytes(bytes))
    }

    /// Errors of models that failed, one a line.
    pub(crate) fn errors(&self) -> impl Iterator<Item = String> {
        let told = |row: &Row| {
            row.error.as_ref().map(|error| in_line(&format!("{}: {error}", row.name)).into_owned())
        };
        self.models.iter().filter_map(told)
    }

    /// A row for each model.
    pub(crate) fn table(&self) -> String {
        fn known(n: u64, text: String) -> String {
            if n == 0 { "-".to_owned() } else { text }
        }
        let rows = self.models.iter().map(|row| {
            let triangles = known(row.triangles, count(row.triangles));
            let bytes = known(row.output_bytes, Bytes(row.output_bytes).to_string());
            let warned = row.warnings.len();
            let note = match &row.error {
                Some(_) => "see below".to_owned(),
                None if warned > 0 => format!("{} ({})", row.reason, Counted(warned as u64, "warning")),
                None => row.reason.clone(),
            };
            vec![
                in_line(&row.name).into_owned(),
                row.status.word().to_owned(),
                format!("{:.2}", row.seconds),
                triangles,
                bytes,
                note,
            ]
        });
        report::table(&["model", "status", "seconds", "triangles", "size", "note"], rows)
    }

    fn csv(&self) -> String {
        let mut text = CSV.to_owned();
        for row in &self.models {
            let fields = [
                row.name.clone(),
                row.status.word().to_owned(),
                row.reason.clone(),
                format!("{:.3}", row.seconds),
                row.triangles.to_string(),
                row.source_bytes.to_string(),
                row.output_bytes.to_string(),
                format!("{:.2}", per_triangle(row.output_bytes, row.triangles)),
                row.error.clone().unwrap_or_default(),
                row.warnings.join("; "),
                row.source.display().to_string(),
                row.output.display().to_string(),
            ];
            text += &fields.map(|field| quoted(&field)).join(",");
            text.push('\n');
        }
        text
    }
}

/// An error if a file is there that the batch would replace, and that is none of an earlier one.
pub(crate) fn replaces(path: &Path, is_ours: impl Fn(&[u8]) -> bool) -> Result<()> {
    if !path.is_file() {
        return Ok(());
    }
    let text = std::fs::read(path).with_context(|| format!("cannot read '{}'", path.display()))?;
    ensure!(
        is_ours(&text),
        "the batch writes '{}', which is there and which no batch wrote: choose another folder, or pass --force",
        path.display()
    );
    Ok(())
}

/// One summary of several machines' parts. None may be missing, and no model may be in two.
pub(crate) fn merge(parts: Vec<(PathBuf, Summary)>) -> Result<Summary> {
    let mut shards: BTreeMap<u32, PathBuf> = BTreeMap::new();
    let mut shard_count = None;
    let mut models: BTreeMap<String, (Row, PathBuf)> = BTreeMap::new();
    for (path, part) in parts {
        if let Some(Shard { index, count }) = part.shard {
            let expected = *shard_count.get_or_insert(count);
            let told = path.display();
            ensure!(
                count == expected,
                "'{told}' is one of {count} parts, others are of {expected}: they do not belong together"
            );
            if let Some(other) = shards.insert(index, path.clone()) {
                anyhow::bail!("'{}' and '{told}' are both part {index} of {count}", other.display());
            }
        }
        for row in part.models {
            if let Some((_, other)) = models.get(&row.name) {
                anyhow::bail!("model '{}' is in '{}' and in '{}'", row.name, other.display(), path.display());
            }
            models.insert(row.name.clone(), (row, path.clone()));
        }
    }
    if let Some(count) = shard_count {
        let missing: Vec<String> =
            (1..=count).filter(|i| !shards.contains_key(i)).map(|i| i.to_string()).collect();
        ensure!(missing.is_empty(), "of {count} parts these are missing: {}", missing.join(", "));
    }
    Ok(Summary::new(None, models.into_values().map(|(row, _)| row).collect()))
}

/// A field of a CSV file as RFC 4180 has it.
fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: &str, status: Status) -> Row {
        Row {
            name: name.to_owned(),
            status,
            reason: "new".to_owned(),
            seconds: 1.5,
            triangles: 4,
            source_bytes: 10,
            output_bytes: 100,
            error: None,
            warnings: vec!["a, \"b\"".to_owned()],
            source: "x.ply".into(),
            output: "x.chpm".into(),
            hash: String::new(),
            fingerprint: String::new(),
        }
    }

    fn part(index: u32, count: u32, names: &[&str]) -> (PathBuf, Summary) {
        let models = names.iter().map(|name| row(name, Status::Built)).collect();
        (format!("{index}.json").into(), Summary::new(Some(Shard { index, count }), models))
    }

    #[test]
    fn parts_that_make_a_whole_are_merged_by_name() {
        let whole = merge(vec![part(2, 2, &["b"]), part(1, 2, &["c", "a"])]).unwrap();
        let names: Vec<&str> = whole.models.iter().map(|row| row.name.as_str()).collect();
        assert_eq!((names, whole.shard), (vec!["a", "b", "c"], None));
        for (parts, words) in [
            (vec![part(1, 3, &["a"])], "missing: 2, 3"),
            (vec![part(1, 2, &["a"]), part(1, 2, &["b"])], "both part 1"),
            (vec![part(1, 2, &["a"]), part(2, 3, &["b"])], "do not belong together"),
            (vec![part(1, 2, &["a"]), part(2, 2, &["a"])], "model 'a' is in"),
        ] {
            let error = merge(parts).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn csv_fields_are_quoted_where_they_must_be() {
        let summary = Summary::new(None, vec![row("a", Status::Failed)]);
        let text = summary.csv();
        assert_eq!(
            text.lines().nth(1),
            Some("a,failed,new,1.500,4,10,100,25.00,,\"a, \"\"b\"\"\",x.ply,x.chpm")
        );
        assert_eq!(text.lines().next().map(|line| line.split(',').count()), Some(12));
        assert_eq!(summary.line(), "1 model: 1 failed; 4 triangles in 100 B");
    }
}
