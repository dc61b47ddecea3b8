//! `JSON.md`, made of the schemas of all documents. `CHPM_GOLDEN=write` writes it anew.

use super::{file, judged, made, near, seen};
use crate::batch::summary::Summary;
use schemars::schema_for;
use serde_json::Value;
use std::fmt::Write;
use std::path::PathBuf;
use std::{env, fs};

const INTRODUCTION: &str = "# What `--json` prints

For programs that read the results. Every document says in `schema` what it is and the version of its keys, as in `chpm-info/1`. Within a version
keys are never renamed, removed or given another meaning or unit; new ones may come, so ignore what you do not know.

Lengths, distances and errors are in the model's units; sizes in bytes, times in seconds where the key does not say otherwise; `null` where there is
nothing to tell. `[]` stands for each entry of a list, `*` for each name in an object whose names depend on the model. Documents go to stdout, warnings and
errors to stderr. Nothing is printed where the exit code is 2.

This page is generated from the types in `src/json/`: a test compares it, and `CHPM_GOLDEN=write cargo test -p chpm json::page` writes it anew. Another test
runs every verb and holds its output against it.
";

/// Every document with its schema, in the order of the page.
fn documents() -> Vec<(&'static str, Value)> {
    let stats = fs::read_to_string(path("docs/chpm-stats-1.schema.json")).expect("the schema of stats");
    vec![
        ("chpm-build/1", schema_for!(file::Build).to_value()),
        ("chpm-info/1", schema_for!(file::Info).to_value()),
        ("chpm-stats/1", serde_json::from_str(&stats).expect("JSON")),
        ("chpm-config/1", schema_for!(file::Config).to_value()),
        ("chpm-verify/1", schema_for!(judged::Verify).to_value()),
        ("chpm-measure/2", schema_for!(judged::Measure).to_value()),
        ("chpm-measure-meshes/1", schema_for!(judged::MeasureMeshes).to_value()),
        ("chpm-measure-texture/1", schema_for!(judged::MeasureTexture).to_value()),
        ("chpm-extract/1", schema_for!(made::Extract).to_value()),
        ("chpm-extract-lods/1", schema_for!(made::ExtractLods).to_value()),
        ("chpm-section/1", schema_for!(made::Section).to_value()),
        ("chpm-rays/1", schema_for!(made::Rays).to_value()),
        ("chpm-simplify/1", schema_for!(made::Simplify).to_value()),
        ("chpm-origin/1", schema_for!(made::Origin).to_value()),
        ("chpm-export/1", schema_for!(made::Export).to_value()),
        ("chpm-export-meshlets/1", schema_for!(made::ExportMeshlets).to_value()),
        ("chpm-share/1", schema_for!(made::Share).to_value()),
        ("chpm-report/1", schema_for!(made::Report).to_value()),
        ("chpm-batch/1", schema_for!(Summary).to_value()),
        ("chpm-bench/1", schema_for!(made::Bench).to_value()),
        ("chpm-bench-threads/1", schema_for!(made::Scaling).to_value()),
        ("chpm-distance/1", schema_for!(near::Distance).to_value()),
        ("chpm-clearance/1", schema_for!(near::Clearance).to_value()),
        ("chpm-contacts/1", schema_for!(near::Contacts).to_value()),
        ("chpm-contacts-path/1", schema_for!(near::ContactsPath).to_value()),
        ("chpm-contacts-self/1", schema_for!(near::ContactsSelf).to_value()),
        ("chpm-thickness/1", schema_for!(near::Thickness).to_value()),
        ("chpm-visible/1", schema_for!(near::Visible).to_value()),
        ("chpm-compare/1", schema_for!(near::Compare).to_value()),
        ("chpm-render/1", schema_for!(seen::Render).to_value()),
        ("chpm-still/1", schema_for!(seen::Still).to_value()),
        ("chpm-walk/1", schema_for!(seen::Walk).to_value()),
        ("chpm-walk-render/1", schema_for!(seen::WalkRender).to_value()),
        ("chpm-walk-prove/1", schema_for!(seen::WalkProve).to_value()),
    ]
}

/// A schema whose rows are written.
struct Rows<'a> {
    root: &'a Value,
    page: String,
}

impl<'a> Rows<'a> {
    /// Target of a reference; of a choice between something and null, that; and whether it may be null.
    fn resolved(&self, schema: &'a Value) -> (&'a Value, bool) {
        if let Some(target) = schema["$ref"].as_str() {
            let pointer = target.trim_start_matches('#');
            return self.resolved(self.root.pointer(pointer).expect("a definition"));
        }
        let choices = schema["anyOf"].as_array().or(schema["oneOf"].as_array());
        let is_null = |choice: &&Value| choice["type"] == "null";
        match choices {
            Some(choices) if choices.iter().any(|choice| is_null(&choice)) => {
                let other = choices.iter().find(|choice| !is_null(choice)).expect("another");
                (self.resolved(other).0, true)
            }
            _ => (schema, schema["type"].as_array().is_some_and(|types| types.contains(&"null".into()))),
        }
    }

    fn row(&mut self, key: &str, text: &str) {
        // A pipe would end the cell.
        let text = text.replace('|', "\\|");
        let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        // Writing to a string does not fail.
        let _ = writeln!(self.page, "| `{key}` | {text} |");
    }

    /// Rows of a value and of all in it.
    fn value(&mut self, key: &str, schema: &'a Value) {
        let constant = schema["const"].as_str().map(|value| format!("`{value}`"));
        let text = schema["description"].as_str().map(str::to_owned).or(constant).unwrap_or_default();
        let text = text.as_str();
        if schema["$ref"].as_str().is_some_and(|name| name.ends_with("/spread")) {
            return self.row(&format!("{key}.*"), &format!("Spread: {text}"));
        }

        let (found, may_be_null) = self.resolved(schema);
        if found["properties"].is_object() {
            if may_be_null {
                self.row(key, text);
            }
            return self.object(key, found);
        }

        let types = &found["type"];
        let is_object =
            types == "object" || types.as_array().is_some_and(|types| types.contains(&"object".into()));
        let more = &found["additionalProperties"];
        if is_object && more.is_null() {
            return self.row(&format!("{key}.*"), text);
        }
        if more.is_object() || more == &Value::Bool(true) {
            let (inner, _) = self.resolved(more);
            if inner["properties"].is_object() {
                self.row(key, text);
                return self.object(&format!("{key}.*"), inner);
            }
            return self.row(&format!("{key}.*"), text);
        }

        if let Some(items) = found.get("items").filter(|_| !may_be_null) {
            let (inner, _) = self.resolved(items);
            let key = format!("{key}[]");
            match inner["properties"].is_object() {
                true => self.object(&key, inner),
                false if inner.get("items").is_some() => self.row(&format!("{key}[]"), text),
                false => self.row(&key, text),
            }
            return;
        }
        self.row(key, text);
    }

    fn object(&mut self, key: &str, schema: &'a Value) {
        for (name, value) in schema["properties"].as_object().expect("keys") {
            let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
            self.value(&key, value);
        }
    }
}

fn page() -> String {
    let mut page = INTRODUCTION.to_owned();
    for (name, schema) in documents() {
        let about = schema["description"].as_str().unwrap_or_default();
        let _ = write!(page, "\n## {name}\n\n{about}\n\n| key | is |\n|---|---|\n");
        let mut rows = Rows { root: &schema, page: String::new() };
        rows.object("", &schema);
        page += &rows.page;
    }
    page
}

fn path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(name)
}

#[test]
fn the_page_of_json_is_current() {
    let (path, page) = (path("JSON.md"), page());
    if env::var_os("CHPM_GOLDEN").is_some_and(|word| word == "write") {
        fs::write(&path, &page).expect("the page");
    }
    let found = fs::read_to_string(&path).expect("the page");
    assert!(found == page, "JSON.md is stale: run CHPM_GOLDEN=write cargo test -p chpm json::page");
}
