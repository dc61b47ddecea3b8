//! `chpm visible`: which vertices can be seen from points.

use super::Verdict;
use crate::compare::Summary;
use crate::json::{self, near};
use crate::output::{self, Writes};
use crate::rays::{Asked, Measured, ScalarArgs, Scalars, point};
use crate::report::{count, table};
use crate::stop::Stop;
use anyhow::Result;
use chpm_rays::{Hit, Ray, Seek};
use std::io::Write;

/// Arguments of `chpm visible`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    #[command(flatten)]
    scalars: ScalarArgs,
    /// A point to see from, in the model's coordinates; may be given many times. A vertex is seen from it where the straight way between them meets no triangle but those
    /// that have the vertex; both sides of a triangle hide. Its number is that of the points that see it
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, required = true)]
    from: Vec<[f64; 3]>,
}

/// Ways from a vertex to each point.
struct Views {
    /// About the file's origin.
    from: Vec<[f64; 3]>,
}

impl Asked for Views {
    const BY: &'static str = "visible";
    const SVG: Writes = output::VISIBLE_SVG;
    const ALONG: &'static str = "points that see a vertex";
    const SEEK: Seek = Seek::Any;
    const NORMALS: bool = false;

    fn rays(&self, at: [f64; 3], _: [f64; 3], out: &mut Vec<Ray>) {
        for from in &self.from {
            let way = [from[0] - at[0], from[1] - at[1], from[2] - at[2]];
            let reach = way.iter().map(|x| x * x).sum::<f64>().sqrt();
            let direction = if reach > 0.0 { way } else { [0.0, 0.0, 1.0] };
            out.push(Ray { reach, is_from_vertex: true, ..Ray::new(at, direction) });
        }
    }

    fn value(&mut self, hits: &[Option<Hit>]) -> f64 {
        hits.iter().filter(|hit| hit.is_none()).count() as f64
    }
}

/// Looks, and writes what is asked for.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let mut views = Views { from: args.from.clone() };
    let mut scalars = Scalars::open(&args.scalars, &views, stop)?;
    let origin = scalars.file.header().origin;
    views.from.iter_mut().for_each(|at| *at = std::array::from_fn(|axis| at[axis] - origin[axis]));
    let Measured { parts, pages, .. } = scalars.measure(&mut views)?;
    let most = args.from.len();
    let summary = Summary::new(&parts.values, false, Some([0.0, most as f64]));
    let mut histogram = vec![0_u64; most + 1];
    parts.values.iter().for_each(|value| histogram[*value as usize] += 1);
    let all = parts.values.len() as u64;
    let note = format!("{} of {} vertices are seen", count(all - histogram[0]), count(all));
    scalars.write::<Views>(&parts, &summary, &note, stop)?;

    if args.scalars.json {
        let told = near::Visible {
            schema: "chpm-visible/1",
            file: scalars.json(),
            vertices: all,
            from: args.from.clone(),
            histogram,
            pages,
        };
        json::print(&told, &mut scalars.out)?;
    } else {
        let rows =
            histogram.iter().enumerate().map(|(points, vertices)| vec![points.to_string(), count(*vertices)]);
        writeln!(scalars.out, "{}", table(&["seen from points", "vertices"], rows))?;
        writeln!(scalars.out, "{note}")?;
    }
    scalars.out.flush()?;
    Ok(Verdict::Good)
}
