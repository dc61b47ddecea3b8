//! A certification as a table and as JSON.

use crate::json::judged::{Errors, OfCut, OfDistance, OfLevel, Proven, ProvenSide};
use crate::number::Units;
use crate::report::{count, table};
use chpm_verify::certify::{Certified, Row, Side, TOLERANCE, Which};
use std::io::{self, Write};

/// A row for each level and cut.
pub(crate) fn print(certified: &Certified, out: &mut impl Write) -> io::Result<()> {
    fn interval(side: &Side) -> String {
        format!("{} to {}", Units(side.lower), Units(side.upper))
    }
    fn cells(row: &Row) -> Vec<String> {
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
    }

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
    let rows = certified.rows().map(cells);
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

/// All of it, for programs.
pub(crate) fn as_json(certified: &Certified, origin: [f64; 3]) -> Errors {
    let levels = certified.levels.iter().filter_map(|row| match row.which {
        Which::Level { level, collapsed } => Some(OfLevel { level, collapsed, found: proven(row, origin) }),
        _ => None,
    });
    let cuts = certified.cuts.iter().filter_map(|row| match row.which {
        Which::Cut { seed } => Some(OfCut { seed, found: proven(row, origin) }),
        _ => None,
    });
    let within = certified.within.iter().filter_map(|row| match row.which {
        Which::Within { distance } => Some(OfDistance { within: distance, found: proven(row, origin) }),
        _ => None,
    });
    Errors {
        slack: certified.slack,
        rounding: certified.rounding,
        violations: certified.rows().map(Row::violations).sum(),
        undecided: certified.rows().map(Row::undecided).sum(),
        levels: levels.collect(),
        cuts: cuts.collect(),
        within: within.collect(),
    }
}

fn proven(row: &Row, origin: [f64; 3]) -> Proven {
    Proven {
        clusters: row.clusters,
        triangles: row.triangles,
        stored_error: row.error,
        stored_distance: row.distance,
        of_mesh: proven_side(&row.of_mesh, origin),
        of_source: proven_side(&row.of_source, origin),
    }
}

fn proven_side(side: &Side, origin: [f64; 3]) -> ProvenSide {
    ProvenSide {
        least: side.lower,
        at: side.at.map(|at| absolute(at, origin)),
        most: side.upper,
        violations: side.violations,
        worst: side.worst.map(|worst| worst.distance),
        worst_stored: side.worst.map(|worst| worst.stored),
        worst_at: side.worst.map(|worst| absolute(worst.at, origin)),
        undecided: side.undecided,
        pieces: side.pieces,
    }
}

fn absolute(at: [f64; 3], origin: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| at[axis] + origin[axis])
}
