//! The cost of refining a model fully from its base mesh: a vertex hierarchy with dependencies of every vertex split, in core,
//! beside a CHPM of the same model (Quick-VDR, table 4; Yoon's dissertation, table 4.4).
//!
//! `CHPM_VH_TRIANGLES` is the size of the generated isosurface, or several with commas between; `CHPM_RECORD=$(date +%F)` writes
//! `benches/records/DATE-vertex-hierarchy.csv`. Everything runs on one thread, the two in turn, five times; times are medians.
//!
//! The vertex hierarchy comes from half-edge collapses of the whole mesh, cheapest quadric first, until none is allowed; it keeps the topology,
//! so its base mesh is larger than that of a CHPM. A vertex can be split when up to four faces are there, the neighbours of the faces that the
//! split brings (Hoppe's fn0 to fn3); splits that it has to wait for are forced first. Before anything is timed, all of it is refined and has to be
//! the source's triangles.
//!
//! Counts, of the vertex hierarchy and of a CHPM: *questions to the view* are vertices, or groups, whose error was compared with what the view allows;
//! *dependency checks* are faces that were looked up because a split depends on them, or clusters that a split brought; *splits* are vertex splits, or
//! splits of groups. Both are asked for zero pixels of error from one camera. Columns, in milliseconds:
//!
//! - `vh_ms`: questions, checks and splits from the base mesh on, in memory that is ready; `vh_no_questions_ms`: every vertex split unasked
//! - `chpm_decisions_ms`: `Front::update`; `chpm_select_ms`: `ActiveList::update`, pages in memory checked
//! - `chpm_load_ms`: PM cursors from the pages of the cut, in new memory; `chpm_place_ms`: from there to the positions, played from scratch;
//!   `chpm_reload_and_place_ms`: both in the memory of cursors that are no longer used
//! - `chpm_half_ms`: from the finest meshes to halfway to the base meshes; `chpm_prepare_ms`, `chpm_pm_ms`: preparing steps, and vertex splits one by one
//! - `..._every_level_ms`: the same for all clusters
//! - `select_load_and_place_ratio`: a jump from the roots to full detail; `select_and_pm_ratio`: vertex splits with vertex splits, ready on both sides;
//!   `select_and_steps_ratio`: with the preparation included
#![forbid(unsafe_code)]

mod clusters;
mod fan;
mod hierarchy;
mod simplify;

use anyhow::{Context, ensure};
use chpm_mesh::{Aabb, TriMesh, geom};
use chpm_refine::Camera;
use chpm_synth::{Shape, Synth};
use clusters::Clusters;
use comfy_table::{CellAlignment, Table, presets};
use hierarchy::{Hierarchy, Tally, canonical};
use std::fs;
use std::hint::black_box;
use std::time::Instant;

/// Runs of each, in turn; times are medians.
const ROUNDS: usize = 5;
const DEFAULT_TRIANGLES: &str = "50000";

fn main() -> anyhow::Result<()> {
    let sizes = std::env::var("CHPM_VH_TRIANGLES").unwrap_or_else(|_| DEFAULT_TRIANGLES.to_owned());
    let mut rows = Vec::new();
    for size in sizes.split(',') {
        let size =
            size.trim().parse().with_context(|| format!("CHPM_VH_TRIANGLES: '{size}' is no number"))?;
        let row = compare(&Synth::new(Shape::Isosurface, size, 1).to_mesh())?;
        println!("{}", row.table());
        rows.push(row);
    }
    if let Ok(date) = std::env::var("CHPM_RECORD") {
        let path = format!("benches/records/{date}-vertex-hierarchy.csv");
        let names: Vec<_> = rows[0].columns().into_iter().map(|(name, _)| name).collect();
        let line =
            |row: &Row| row.columns().into_iter().map(|(_, value)| value).collect::<Vec<_>>().join(",");
        let lines: String = rows.iter().map(|row| format!("{date},{}\n", line(row))).collect();
        fs::create_dir_all("benches/records")?;
        fs::write(&path, format!("date,{}\n{lines}", names.join(","))).with_context(|| path.clone())?;
        println!("written: {path}");
    }
    Ok(())
}

/// What one model gave; times in milliseconds.
#[derive(Clone, Debug, Default)]
struct Row {
    triangles: u64,
    vh: Tally,
    vh_base: u64,
    vh_reached: u64,
    /// With the questions to the view, and with none.
    vh_ms: f64,
    vh_bare_ms: f64,
    chpm: clusters::Counts,
    chpm_ms: clusters::Times,
}

fn compare(mesh: &TriMesh) -> anyhow::Result<Row> {
    let hierarchy = Hierarchy::new(mesh).context("the vertex hierarchy")?;
    let camera = Camera::framing(&Aabb::of_points(&mesh.positions));
    let mut row = Row { triangles: mesh.triangles.len() as u64, ..Row::default() };
    row.vh_base = hierarchy.base().triangle_count();

    // The splits come in another order than the collapses went; the source comes out all the same.
    let mut full = hierarchy.base();
    hierarchy.refine(&mut full, |_, _, _| true);
    let same = hierarchy.triangles(&full) == canonical(mesh.triangles.iter().copied());
    ensure!(same, "the refined vertex hierarchy is not the source mesh");
    drop(full);

    let clusters = Clusters::build(mesh, &camera)?;
    let wants = no_pixel(&camera);
    let (mut asked, mut bare, mut times) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        let mut refined = hierarchy.base();
        let start = Instant::now();
        row.vh = hierarchy.refine(&mut refined, &wants);
        asked.push(milliseconds(start));
        row.vh_reached = black_box(&refined).triangle_count();

        let mut refined = hierarchy.base();
        let start = Instant::now();
        hierarchy.refine(&mut refined, |_, _, _| true);
        bare.push(milliseconds(start));
        black_box(&refined);

        let (counts, time) = clusters.refine()?;
        row.chpm = counts;
        times.push(time);
    }
    row.vh_ms = median(asked);
    row.vh_bare_ms = median(bare);
    row.chpm_ms = clusters::Times::medians(&times);
    Ok(row)
}

/// The view's question at zero pixels of error, for one vertex: any error asks for a split, but the view does not know.
fn no_pixel(camera: &Camera) -> impl Fn([f32; 3], f32, f32) -> bool {
    let eye = camera.position.map(|x| x as f32);
    let slope = black_box(0.0_f32);
    move |position, error, radius| error > slope * (geom::distance(position, eye) as f32 - radius).max(0.0)
}

fn milliseconds(start: Instant) -> f64 {
    1e3 * start.elapsed().as_secs_f64()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

impl Row {
    fn table(&self) -> Table {
        let mut table = Table::new();
        table.load_style(presets::NOTHING);
        table.set_header(["", "vertex hierarchy", "CHPM", "ratio"]);
        let (chpm, ms) = (&self.chpm, &self.chpm_ms);
        let counts = [
            ("source triangles", self.triangles, self.triangles),
            ("base mesh", self.vh_base, chpm.base),
            ("refined mesh", self.vh_reached, chpm.reached),
            ("questions to the view", self.vh.questions, chpm.questions),
            ("splits (vertices / groups)", self.vh.splits, chpm.splits),
            ("PM splits", self.vh.splits, chpm.pm_splits),
            ("PM splits through every level", self.vh.splits, chpm.pm_splits_every_level),
            ("forced splits", self.vh.forced, 0),
            ("dependency checks", self.vh.checks, chpm.checks),
        ];
        for (name, vh, chpm) in counts {
            table.add_row([name.to_owned(), vh.to_string(), chpm.to_string(), ratio(vh as f64, chpm as f64)]);
        }
        let times = [
            ("ms, group decisions", self.vh_ms, ms.decisions),
            ("ms, clusters and positions", self.vh_ms, ms.select),
            ("ms, loading PMs", self.vh_ms, ms.cut.load),
            ("ms, PMs to their positions from scratch", self.vh_ms, ms.cut.place),
            ("ms, selection, loading, positions", self.vh_ms, ms.select + ms.cut.first()),
            ("ms, the same in used memory", self.vh_ms, ms.select + ms.cut.again()),
            ("ms, the same through every level", self.vh_ms, ms.select + ms.all.first()),
            ("ms, PMs halfway to their base meshes, from scratch", self.vh_ms, ms.cut.half),
            ("ms, preparing steps of the PMs", self.vh_ms, ms.cut.prepare),
            ("ms, vertex splits of the PMs, step by step", self.vh_ms, ms.cut.play),
            ("ms, selection and PM splits", self.vh_ms, ms.select + ms.cut.play),
            ("ms, selection and every level's PM splits", self.vh_ms, ms.select + ms.all.play),
            (
                "ms, selection, loading, steps prepared and carried out",
                self.vh_ms,
                ms.select + ms.cut.stepped(),
            ),
            ("ms, the same through every level", self.vh_ms, ms.select + ms.all.stepped()),
            ("ms, no questions, selection and PM splits", self.vh_bare_ms, ms.select + ms.cut.play),
        ];
        for (name, vh, chpm) in times {
            table.add_row([name.to_owned(), format!("{vh:.1}"), format!("{chpm:.3}"), ratio(vh, chpm)]);
        }
        table.column_iter_mut().skip(1).for_each(|column| column.set_cell_alignment(CellAlignment::Right));
        table
    }

    fn columns(&self) -> Vec<(&'static str, String)> {
        let (chpm, ms) = (&self.chpm, &self.chpm_ms);
        let count = |name, value: u64| (name, value.to_string());
        let time = |name, value: f64| (name, format!("{value:.4}"));
        let quotient = |name, vh, chpm| (name, ratio(vh, chpm));
        vec![
            count("triangles", self.triangles),
            count("vh_base", self.vh_base),
            count("chpm_base", chpm.base),
            count("vh_reached", self.vh_reached),
            count("chpm_reached", chpm.reached),
            count("vh_questions", self.vh.questions),
            count("chpm_questions", chpm.questions),
            count("vh_splits", self.vh.splits),
            count("vh_forced", self.vh.forced),
            count("chpm_group_splits", chpm.splits),
            count("chpm_pm_splits", chpm.pm_splits),
            count("chpm_pm_splits_every_level", chpm.pm_splits_every_level),
            count("vh_checks", self.vh.checks),
            count("chpm_checks", chpm.checks),
            quotient("checks_ratio", self.vh.checks as f64, chpm.checks as f64),
            time("vh_ms", self.vh_ms),
            time("vh_no_questions_ms", self.vh_bare_ms),
            time("chpm_decisions_ms", ms.decisions),
            time("chpm_select_ms", ms.select),
            time("chpm_load_ms", ms.cut.load),
            time("chpm_place_ms", ms.cut.place),
            time("chpm_reload_and_place_ms", ms.cut.again()),
            time("chpm_half_ms", ms.cut.half),
            time("chpm_prepare_ms", ms.cut.prepare),
            time("chpm_pm_ms", ms.cut.play),
            time("chpm_load_and_place_every_level_ms", ms.all.first()),
            time("chpm_prepare_every_level_ms", ms.all.prepare),
            time("chpm_pm_every_level_ms", ms.all.play),
            quotient("decisions_ratio", self.vh_ms, ms.decisions),
            quotient("select_ratio", self.vh_ms, ms.select),
            quotient("select_load_and_place_ratio", self.vh_ms, ms.select + ms.cut.first()),
            quotient("select_load_and_place_in_used_memory_ratio", self.vh_ms, ms.select + ms.cut.again()),
            quotient("select_load_and_place_every_level_ratio", self.vh_ms, ms.select + ms.all.first()),
            quotient("select_and_pm_ratio", self.vh_ms, ms.select + ms.cut.play),
            quotient("select_and_every_level_pm_ratio", self.vh_ms, ms.select + ms.all.play),
            quotient("select_and_steps_ratio", self.vh_ms, ms.select + ms.cut.stepped()),
            quotient("select_and_steps_every_level_ratio", self.vh_ms, ms.select + ms.all.stepped()),
        ]
    }
}

fn ratio(vh: f64, chpm: f64) -> String {
    if chpm > 0.0 { format!("{:.2}", vh / chpm) } else { String::new() }
}
