//! The page of a file: pictures, plots, a map of the hierarchy, settings, findings.

use super::seen::{self, Seen, Shows};
use super::{STYLE, plots, tree};
use crate::Short;
use crate::chart::in_xml;
use crate::colors::Colors;
use crate::digest;
use crate::error::ReportError;
use crate::level::{levels_of, per_triangle};
use crate::stats::{self, Row, Stats, worst};
use askama::Template;
use chpm_extmem::{Cancel, MappedFile};
use chpm_format::{Chpm, Metadata};
use chpm_mesh::{Bytes, Thousands, Units};
use chpm_refine::Portrait;
use serde_json::Value;

/// Pixels of a picture, and of the first.
const PICTURE: [usize; 2] = [640, 480];
const FIRST: [usize; 2] = [960, 640];

const SCRIPT: &str = include_str!("../../templates/treemap.js");

/// A file that is shown, or compared with.
#[derive(Debug)]
pub struct Shown<'a> {
    /// Its name on the page.
    pub name: String,
    /// The file.
    pub file: &'a Chpm<MappedFile>,
    /// Its clusters.
    pub rows: Vec<Row<'a>>,
    /// All of it in numbers.
    pub stats: Stats,
}

impl<'a> Shown<'a> {
    /// Reads every page.
    ///
    /// # Errors
    /// Damage of the file, and [`ReportError::Cancelled`].
    pub fn new(name: String, file: &'a Chpm<MappedFile>, cancel: &Cancel) -> Result<Self, ReportError> {
        let (rows, borders) = stats::rows(file, cancel)?;
        let stats = Stats::new(name.clone(), file, &rows, &borders);
        Ok(Shown { name, file, rows, stats })
    }
}

/// A picture and what it shows.
struct Picture {
    data: String,
    size: [usize; 2],
    caption: &'static str,
    /// Values of the first and the last of its colours, if they are of a range.
    ends: Option<[String; 2]>,
}

struct Finding {
    words: &'static str,
    clusters: Vec<(u32, String)>,
}

#[derive(Template)]
#[template(path = "report.html")]
struct Page<'a> {
    style: &'a str,
    script: &'a str,
    title: &'a str,
    facts: Vec<(&'static str, String)>,
    remarks: Vec<String>,
    praise: Option<String>,
    first: Picture,
    pictures: Vec<Picture>,
    gradient: String,
    note: String,
    plots: Vec<String>,
    tree: String,
    drawables: Vec<[String; 5]>,
    worst: Vec<Finding>,
    compared: Vec<(String, String, String)>,
    other: Option<&'a str>,
    settings: Vec<(String, String)>,
    source: Vec<(&'static str, String)>,
    repairs: Vec<(String, String)>,
    warnings: Vec<String>,
}

/// The page of a file, beside another one or not; `built` is what `chpm build --json` printed.
///
/// # Errors
/// Damage of the file.
pub fn html(
    shown: &Shown<'_>,
    other: Option<&Shown<'_>>,
    built: Option<&Value>,
) -> Result<String, ReportError> {
    let file = shown.file;
    let metadata = file.metadata().unwrap_or_default();
    let levels = levels_of(file);
    let portrait = Portrait::of_file(file)?;
    let first = Picture {
        data: seen::look(file, &portrait, FIRST, false)?.picture(Shows::Surface)?,
        size: FIRST,
        caption: "The model as it is",
        ends: None,
    };
    let even = seen::look(file, &portrait, PICTURE, false)?;
    let beside = seen::look(file, &portrait, PICTURE, true)?;

    let files = std::iter::once(shown).chain(other).map(|shown| {
        let all = digest::drawables(shown.file).into_iter();
        let drawn = all.map(|row| [row.triangles as f64, row.distance]).collect::<Vec<_>>();
        (shown.name.clone(), &shown.stats, drawn)
    });
    let files: Vec<_> = files.collect();

    let remarks = digest::remarks(file, Some(&metadata), &levels);
    let page = Page {
        style: STYLE,
        script: SCRIPT,
        title: &shown.name,
        facts: facts(file, &metadata),
        praise: remarks.is_empty().then(|| digest::praise(file, &levels)),
        remarks,
        first,
        pictures: pictures(&even, &beside)?,
        gradient: Colors::new([0.0, 1.0], false).gradient(),
        note: format!(
            "Model and clusters: {}, an error of {} units. Drawn on the processor; {}.",
            Short(even.triangles).of("triangle"),
            Units(even.error.into()),
            portrait.why()
        ),
        plots: plots::all(&files, built)?,
        tree: tree::json(file, &shown.rows)?.to_string(),
        drawables: drawables(file),
        worst: shown.stats.worst.iter().map(finding).collect(),
        compared: other.map_or_else(Vec::new, |other| compared(&shown.stats, &other.stats)),
        other: other.map(|other| other.name.as_str()),
        source: source(&metadata),
        repairs: occurred(&metadata),
        settings: metadata.settings,
        warnings: metadata.warnings,
    };
    Ok(in_xml(&page.render()?))
}

/// Clusters of a model that is as fine everywhere, levels and errors of one that is seen from the right.
fn pictures(even: &Seen, beside: &Seen) -> Result<Vec<Picture>, ReportError> {
    let levels = ["level 0, the source".to_owned(), format!("level {}, the top", beside.top())];
    let errors = beside.errors().map(|error| format!("{} units", Units(error)));
    let rows = [
        (even, Shows::Cluster, "Clusters: each is stored, loaded and refined on its own", None),
        (beside, Shows::Level, "Levels, as an eye at the right needs them", Some(levels)),
        (beside, Shows::Error, "Errors of the same", Some(errors)),
    ];
    let drawn = rows.into_iter().map(|(seen, shows, caption, ends)| {
        Ok(Picture { data: seen.picture(shows)?, size: PICTURE, caption, ends })
    });
    drawn.collect()
}

fn facts(file: &Chpm<MappedFile>, metadata: &Metadata) -> Vec<(&'static str, String)> {
    let h = file.header();
    vec![
        ("Source", metadata.source.name.clone()),
        ("Triangles", Short(h.source_triangle_count).to_string()),
        ("Vertices", Short(h.source_vertex_count).to_string()),
        ("Clusters", Short(h.cluster_count.into()).to_string()),
        ("Levels", h.level_count.to_string()),
        ("Size", Bytes(file.stored_len()).to_string()),
        ("Bytes a triangle", format!("{:.1}", per_triangle(file.stored_len(), h.source_triangle_count))),
        ("Largest error", format!("{} units", Units(h.max_error.into()))),
        ("Built by", metadata.generator.clone()),
    ]
}

fn drawables(file: &Chpm<MappedFile>) -> Vec<[String; 5]> {
    let diagonal = file.header().aabb().diagonal();
    let rows = digest::drawables(file).into_iter().map(|row| {
        [
            row.level.map_or_else(|| "the coarsest".to_owned(), |level| format!("level {level}")),
            Short(row.clusters).to_string(),
            Short(row.triangles).to_string(),
            Units(row.distance).to_string(),
            format!("{} %", Units(if diagonal > 0.0 { 100.0 * row.distance / diagonal } else { 0.0 })),
        ]
    });
    rows.collect()
}

fn finding(worst: &worst::Worst) -> Finding {
    fn named(named: &worst::Named) -> (u32, String) {
        (named.cluster, format!("{} (level {})", Units(named.value), named.level))
    }
    Finding { words: worst::words(worst.measure), clusters: worst.clusters.iter().map(named).collect() }
}

fn compared(own: &Stats, other: &Stats) -> Vec<(String, String, String)> {
    let names = own.measures.keys();
    names
        .map(|name| {
            (name.replace('_', " "), text_of(own.measures.get(name)), text_of(other.measures.get(name)))
        })
        .collect()
}

fn text_of(value: Option<&Value>) -> String {
    match value.and_then(Value::as_f64) {
        Some(value) if value.fract() == 0.0 && value >= 0.0 => Short(value as u64).to_string(),
        Some(value) => Units(value).to_string(),
        None => "-".to_owned(),
    }
}

fn source(metadata: &Metadata) -> Vec<(&'static str, String)> {
    let source = &metadata.source;
    let mut rows = vec![
        ("Name", source.name.clone()),
        ("Size", Bytes(source.byte_len).to_string()),
        ("Format", source.encoding.clone()),
        ("Vertices", Thousands(source.vertex_count).to_string()),
        ("Faces", Thousands(source.face_count).to_string()),
        ("XXH3", format!("{:016x}", source.hash)),
    ];
    rows.extend(source.comments.iter().map(|comment| ("Comment", comment.clone())));
    rows
}

fn occurred(metadata: &Metadata) -> Vec<(String, String)> {
    let occurred = metadata.repairs.iter().filter(|(_, n)| *n > 0);
    occurred.map(|(name, n)| (name.replace('-', " "), Thousands(*n).to_string())).collect()
}
