//! `chpm thickness`: how thick the wall is behind each vertex.

use super::Verdict;
use super::compare::range;
use crate::compare::Summary;
use crate::json::{self, near};
use crate::number::{Units, decimal};
use crate::output::{self, Writes};
use crate::rays::{Asked, InsideOut, Measured, ScalarArgs, Scalars};
use crate::report::{count, table};
use crate::stop::Stop;
use anyhow::{Result, ensure};
use chpm_mesh::Counted;
use chpm_rays::{Hit, Ray, Seek};
use clap::ValueEnum;
use std::f64::consts::TAU;
use std::io::Write;

/// Arguments of `chpm thickness`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    #[command(flatten)]
    scalars: ScalarArgs,
    /// From each vertex a ray goes inward, against the sum of its triangles' normals by area, and six more go around it at this angle, in degrees. Each tells its distance to the first triangle that it meets, times the
    /// cosine of its angle; triangles that have the vertex do not count. The thickness is the median of the seven. 0 is the first ray alone
    #[arg(long, value_name = "DEGREES", default_value = "10", value_parser = decimal)]
    cone: f64,
    /// Which parts' triangles are taken the other way around: those of a model that was stored inside out. auto: of closed components those of a negative signed volume, with what is within them; others all
    /// together where theirs is clearly negative
    #[arg(long, value_name = "WHICH", value_enum, default_value = "auto")]
    inside_out: InsideOut,
    /// Thicknesses that the first and the last colour stand for; 0 and the 99th percentile if not given
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true)]
    range: Option<[f64; 2]>,
}

/// Rays about the first one.
const AROUND: usize = 6;

/// Inward rays of a vertex.
struct Walls {
    sine: f64,
    cosine: f64,
    turn: InsideOut,
}

impl Asked for Walls {
    const BY: &'static str = "thickness";
    const SVG: Writes = output::THICKNESS_SVG;
    const ALONG: &'static str = "thickness, units";
    const SEEK: Seek = Seek::Nearest;
    const NORMALS: bool = true;

    fn turn(&self) -> InsideOut {
        self.turn
    }

    fn rays(&self, at: [f64; 3], normal: [f64; 3], out: &mut Vec<Ray>) {
        let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
        // A vertex without a normal has rays that end where they begin.
        let (axis, reach) = match length > 0.0 && length.is_finite() {
            true => (normal.map(|x| -x / length), f64::INFINITY),
            false => ([0.0, 0.0, 1.0], 0.0),
        };
        let ray = |direction| Ray { reach, is_from_vertex: true, ..Ray::new(at, direction) };
        out.push(ray(axis));
        if self.sine == 0.0 {
            return;
        }
        let [u, v] = across(axis);
        for number in 0..AROUND {
            let angle = number as f64 / AROUND as f64 * TAU;
            let (sin, cos) = (libm::sin(angle), libm::cos(angle));
            out.push(ray(std::array::from_fn(|i| {
                self.cosine * axis[i] + self.sine * (cos * u[i] + sin * v[i])
            })));
        }
    }

    fn value(&mut self, hits: &[Option<Hit>]) -> f64 {
        let mut all = [f64::INFINITY; 1 + AROUND];
        for (number, (slot, hit)) in all.iter_mut().zip(hits).enumerate() {
            let factor = if number == 0 { 1.0 } else { self.cosine };
            *slot = hit.map_or(f64::INFINITY, |hit| hit.distance * factor);
        }
        let all = &mut all[..hits.len()];
        all.sort_unstable_by(f64::total_cmp);
        let median = all.get(all.len() / 2).copied().unwrap_or(f64::INFINITY);
        if median.is_finite() { median } else { f64::NAN }
    }
}

/// Two directions that are upright on a third, of length 1, and on each other.
fn across(axis: [f64; 3]) -> [[f64; 3]; 2] {
    let least = (0..3).fold(0, |least, i| if axis[i].abs() < axis[least].abs() { i } else { least });
    let mut u: [f64; 3] = std::array::from_fn(|i| f64::from(u8::from(i == least)) - axis[least] * axis[i]);
    let length = u.iter().map(|x| x * x).sum::<f64>().sqrt();
    u = u.map(|x| x / length);
    let v =
        [axis[1] * u[2] - axis[2] * u[1], axis[2] * u[0] - axis[0] * u[2], axis[0] * u[1] - axis[1] * u[0]];
    [u, v]
}

/// Measures, and writes what is asked for.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    ensure!(
        args.cone < 90.0,
        "an angle of at least 0 and less than 90 degrees expected for --cone, got {}",
        args.cone
    );
    let angle = args.cone.to_radians();
    let mut walls = Walls { sine: libm::sin(angle), cosine: libm::cos(angle), turn: args.inside_out };
    let mut scalars = Scalars::open(&args.scalars, &walls, stop)?;
    let Measured { parts, pages, turned } = scalars.measure(&mut walls)?;
    let found: Vec<f64> = parts.values.iter().copied().filter(|value| !value.is_nan()).collect();
    let open = (parts.values.len() - found.len()) as u64;
    let summary = Summary::new(&found, false, args.range);
    let note = format!("{}, {} open", Counted(found.len() as u64, "vertex"), count(open));
    scalars.write::<Walls>(&parts, &summary, &note, stop)?;

    if args.scalars.json {
        let told = near::Thickness {
            schema: "chpm-thickness/1",
            file: scalars.json(),
            cone: args.cone,
            rays: if args.cone > 0.0 { 1 + AROUND as u64 } else { 1 },
            inside_out: args.inside_out.to_possible_value().map(|value| value.get_name().to_owned()),
            components: turned.map(|[components, _]| components),
            components_turned: turned.map(|[_, turned]| turned),
            open,
            summary: summary.json(),
            pages,
        };
        json::print(&told, &mut scalars.out)?;
    } else {
        print(&summary, open, &mut scalars.out)?;
        told(args.inside_out, turned, open, &mut scalars.out)?;
    }
    scalars.out.flush()?;
    Ok(Verdict::Good)
}

fn print(summary: &Summary, open: u64, out: &mut impl Write) -> Result<()> {
    let [p50, p90, p95, p99, p999] = summary.percentiles;
    if summary.count > 0 {
        let row = [summary.min, summary.max, summary.mean, p50, p90, p95, p99, p999];
        let header = ["", "least", "most", "mean", "50 %", "90 %", "95 %", "99 %", "99.9 %"];
        let cells = std::iter::once("units".to_owned()).chain(row.map(|x| Units(x).to_string()));
        writeln!(out, "{}", table(&header, [cells.collect::<Vec<String>>()]))?;
    }
    writeln!(out, "{} with a wall behind", Counted(summary.count, "vertex"))?;
    if open > 0 {
        writeln!(
            out,
            "{} without: most of their rays meet nothing, so the surface is open there",
            count(open)
        )?;
    }
    Ok(())
}

/// Which side was taken for the inside.
fn told(asked: InsideOut, turned: Option<[u64; 2]>, open: u64, out: &mut impl Write) -> Result<()> {
    match (asked, turned) {
        (InsideOut::Yes, _) => writeln!(out, "taken inside out, as asked")?,
        (_, Some([components, turned])) if turned > 0 => {
            let which = if components == 1 {
                "the model is".to_owned()
            } else {
                format!("{} of {} components are", count(turned), count(components))
            };
            writeln!(
                out,
                "{which} stored inside out (a negative volume), and taken the other way around; --inside-out no takes them as they are"
            )?;
        }
        (InsideOut::No, _) if open > 0 => {
            writeln!(out, "taken as stored, as asked; --inside-out auto finds what is turned inside out")?;
        }
        _ => {}
    }
    Ok(())
}
