//! `chpm distance`: how near two models are, as an interval that is proven.

use super::Verdict;
use crate::number::Units;
use crate::output;
use crate::proximity::{Asker, LimitArgs, Pair, PoseArgs, answer_json, ended, read_path};
use crate::report::{count, table};
use crate::stop::Stop;
use anyhow::Result;
use chpm_build::config::Length;
use chpm_mesh::Bytes;
use chpm_proximity::{Answer, End, Pose, Question};
use serde_json::{Value, json};
use std::io::Write;
use std::path::PathBuf;

/// What `chpm distance` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// A .chpm file; or a mesh (PLY, STL, OBJ, as it is or as .gz or .zst; a .conf set), which is built into a temporary one first
    first: PathBuf,
    /// Another, or the same
    second: PathBuf,
    #[command(flatten)]
    poses: PoseArgs,
    /// Ask for each pose of the second model in this file, one a line as for --pose, in this order. Each answer begins with what the one before has
    /// read and found, so that small motions cost little
    #[arg(long, visible_alias = "poses", value_name = "FILE", conflicts_with = "pose")]
    path: Option<PathBuf>,
    /// How wide the interval may be, in the models' units or, as in 0.1%, of the larger diagonal of their boxes. 0 goes to the triangles of the
    /// sources where need be, and is exact but for rounding
    #[arg(long, value_name = "E", default_value = "0.1%")]
    error: Length,
    /// Write a line of numbers for every pose; - for standard output
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Replace the CSV if it exists
    #[arg(short, long)]
    force: bool,
    /// The answers as JSON on stdout
    #[arg(long)]
    json: bool,
    /// No progress, no notes
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    limits: LimitArgs,
}

/// Asks for each pose.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let inputs = [args.first.as_path(), args.second.as_path()];
    let mut csv = match &args.csv {
        Some(path) => Some(output::DISTANCE_CSV.create(path, args.force, &inputs)?),
        None => None,
    };
    let mut out = output::messages(&csv, args.json, args.quiet)?;
    let [still, pose] = args.poses.poses();
    let path = args.path.as_deref().map(read_path).transpose()?.unwrap_or_else(|| vec![pose]);
    let pair = Pair::new(inputs, args.limits.memory, args.quiet, stop)?;
    let cancel = stop.heed();
    let error = args.error.of(pair.diagonal());
    let question = Question { error, above: None, most_pairs: pair.most_pairs };
    let answers: Vec<Answer> = pair.reading(|| {
        let mut asker = Asker::new(&pair)?;
        let ask = |pose: &Pose| asker.ask(&[still, *pose], &question, &args.limits.start(&cancel));
        path.iter().map(ask).collect()
    })?;
    if let Some(csv) = &mut csv {
        write_csv(&answers, csv)?;
    }
    if args.json {
        writeln!(out, "{:#}", to_json(&pair, error, &answers))?;
    } else {
        print(args, &pair, &answers, &mut out)?;
    }
    out.flush()?;
    drop(out);
    if let Some(csv) = csv {
        csv.publish()?;
    }
    Ok(Verdict::Good)
}

fn to_json(pair: &Pair, error: f64, answers: &[Answer]) -> Value {
    json!({
        "schema": "chpm-distance/1",
        "first": pair.models[0].json(),
        "second": pair.models[1].json(),
        "error": error,
        "answers": answers.iter().map(answer_json).collect::<Vec<_>>(),
    })
}

fn write_csv(answers: &[Answer], out: &mut impl Write) -> Result<()> {
    writeln!(out, "step,least,most,ended,ax,ay,az,bx,by,bz,pages,page_bytes")?;
    for (step, answer) in answers.iter().enumerate() {
        let points = answer.witness.map_or([[f64::NAN; 3]; 2], |witness| witness.points);
        let points: Vec<String> = points.as_flattened().iter().map(f64::to_string).collect();
        let (pages, bytes) = read(answer);
        let Answer { least, most, end, .. } = answer;
        writeln!(out, "{step},{least},{most},{},{},{pages},{}", ended(*end), points.join(","), bytes.0)?;
    }
    Ok(())
}

fn read(answer: &Answer) -> (u64, Bytes) {
    let [a, b] = answer.reads;
    (a.pages + b.pages, Bytes(a.bytes.0 + b.bytes.0))
}

fn print(args: &Args, pair: &Pair, answers: &[Answer], out: &mut impl Write) -> Result<()> {
    let diagonal = pair.diagonal();
    let all: u64 = pair.models.iter().map(|model| model.file.header().file_len).sum();
    if let [answer] = answers {
        let [a, b] = &pair.models;
        writeln!(
            out,
            "{} and {}: from {} to {} units apart, of a diagonal of {} units",
            a.path.display(),
            b.path.display(),
            answer.least,
            answer.most,
            Units(diagonal)
        )?;
        if let Some(witness) = answer.witness {
            for (model, i) in pair.models.iter().zip(0..2) {
                let [x, y, z] = witness.points[i];
                let (level, name) = (witness.levels[i], model.path.display());
                let error = Units(witness.errors[i]);
                writeln!(
                    out,
                    "  nearest found on {name}: {x} {y} {z}, at level {level}, within {error} units of the source"
                )?;
            }
        }
        let (pages, bytes) = read(answer);
        let share = 100.0 * bytes.0 as f64 / all as f64;
        writeln!(
            out,
            "  {}; read {} pages, {bytes}, {share:.2} % of the files",
            why(answer.end),
            count(pages)
        )?;
    } else {
        let rows = answers.iter().enumerate().map(|(step, answer)| {
            let (pages, bytes) = read(answer);
            let [least, most] = [answer.least, answer.most].map(|x| Units(x).to_string());
            vec![step.to_string(), least, most, ended(answer.end).to_owned(), count(pages), bytes.to_string()]
        });
        writeln!(out, "{}", table(&["step", "least", "most", "ended", "pages", "bytes"], rows))?;
    }
    if answers.iter().any(|answer| matches!(answer.end, End::Stopped | End::Crowded)) {
        writeln!(
            out,
            "undecided to {} within what may be spent; the interval holds as it is",
            args.error.told(diagonal)
        )?;
    }
    Ok(())
}

/// Why an answer is not narrower, in words.
fn why(end: End) -> &'static str {
    match end {
        End::Decided => "as narrow as was asked for",
        End::Exact => "exact: triangles of the sources, but for rounding",
        End::Stopped => "stopped at the limit",
        End::Crowded => "stopped where more pairs would wait than fit into the memory",
    }
}
