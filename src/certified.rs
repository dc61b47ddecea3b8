//! A certification as a table and as JSON.

use crate::number::Units;
use crate::report::{count, table};
use chpm_verify::certify::{Certified, Row, Side, TOLERANCE, Which};
use serde_json::{Value, json};
use std::io::{self, Write};

/// A row for each level and cut.
pub(crate) fn print(certified: &Certified, out: &mut impl Write) -> io::Result<()> {
    fn interval(side: &Side) -> String {
        format!("{} to {}", Units(side.least), Units(side.most))
    }
    let cells = |row: &Row| {
        vec![
            row.name(),
            count(row.clusters),
            count(row.triangles),
            Units(row.error.into()).to_string(),
            interval(&row.of_mesh),
            Units(row.distance.into()).to_string(),
            interval(&row.of_source),
            count(row.violations()),
            count(row.undecided()),
        ]
    };
    let header = [
        "",
        "clusters",
        "triangles",
        "error",
        "mesh to source",
        "distance",
        "source to mesh",
        "violations",
        "undecided",
    ];
    let rows = certified.levels.iter().chain(&certified.cuts).map(cells);
    writeln!(out, "{}\n", table(&header, rows))?;
    writeln!(
        out,
        "error and distance: the largest that is stored; each is followed by what is proven of the largest true distance, to {:.0} % where it \
         is not rounding; violations and undecided: triangles. What holds may be {} units beyond what is stored, by rounding of the proof",
        100.0 * TOLERANCE,
        Units(certified.slack)
    )?;
    if certified.rounding > 0.0 {
        writeln!(
            out,
            "the coordinates of the source are not singles: it is {} units from the triangles that were held against the meshes, at most; the \
             intervals allow for that",
            Units(certified.rounding)
        )?;
    }
    Ok(())
}

/// All of it.
pub(crate) fn as_json(certified: &Certified, origin: [f64; 3]) -> Value {
    let row = |row: &Row| {
        let fields = json!({
            "clusters": row.clusters,
            "triangles": row.triangles,
            "stored_error": row.error,
            "stored_distance": row.distance,
            "of_mesh": side_json(&row.of_mesh, origin),
            "of_source": side_json(&row.of_source, origin),
        });
        let mut value = match row.which {
            Which::Level { level, collapsed } => json!({ "level": level, "collapsed": collapsed }),
            Which::Cut { seed } => json!({ "seed": seed }),
        };
        if let (Value::Object(all), Value::Object(fields)) = (&mut value, fields) {
            all.extend(fields);
        }
        value
    };
    let all = || certified.levels.iter().chain(&certified.cuts);
    json!({
        "slack": certified.slack,
        "rounding": certified.rounding,
        "violations": all().map(Row::violations).sum::<u64>(),
        "undecided": all().map(Row::undecided).sum::<u64>(),
        "levels": certified.levels.iter().map(row).collect::<Vec<_>>(),
        "cuts": certified.cuts.iter().map(row).collect::<Vec<_>>(),
    })
}

fn side_json(side: &Side, origin: [f64; 3]) -> Value {
    json!({
        "least": side.least,
        "at": side.at.map(|at| absolute(at, origin)),
        "most": side.most,
        "violations": side.violations,
        "worst": side.worst.map(|worst| worst.distance),
        "worst_stored": side.worst.map(|worst| worst.stored),
        "worst_at": side.worst.map(|worst| absolute(worst.at, origin)),
        "undecided": side.undecided,
        "pieces": side.pieces,
    })
}

fn absolute(at: [f64; 3], origin: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| at[axis] + origin[axis])
}
