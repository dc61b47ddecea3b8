//! `chpm clearance`: proves that two models are apart by more than a distance, or shows where they are not.

use super::{Verdict, stdout};
use crate::number::Units;
use crate::proximity::{Asker, LimitArgs, Pair, PoseArgs, answer_json, read_path};
use crate::stop::Stop;
use anyhow::Result;
use chpm_build::config::Length;
use chpm_mesh::Bytes;
use chpm_proximity::{Answer, Question};
use serde_json::{Value, json};
use std::io::Write;
use std::path::PathBuf;

/// What `chpm clearance` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// A .chpm file; or a mesh (PLY, STL, OBJ, as it is or as .gz or .zst; a .conf set), which is built into a temporary one first
    first: PathBuf,
    /// Another, or the same
    second: PathBuf,
    /// The distance that the models must be farther apart than, in their units or, as in 1%, of the larger diagonal of their boxes
    #[arg(long, value_name = "D")]
    above: Length,
    #[command(flatten)]
    poses: PoseArgs,
    /// Ask for each pose of the second model in this file, one a line as for --pose
    #[arg(long, visible_alias = "poses", value_name = "FILE", conflicts_with = "pose")]
    path: Option<PathBuf>,
    /// The answers as JSON on stdout
    #[arg(long)]
    json: bool,
    /// No progress, no notes
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    limits: LimitArgs,
}

/// Asks for each pose; anything but a proof is a fault.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let [still, pose] = args.poses.poses();
    let path = args.path.as_deref().map(read_path).transpose()?.unwrap_or_else(|| vec![pose]);
    let pair = Pair::new([&args.first, &args.second], args.limits.memory, args.quiet, stop)?;
    let cancel = stop.heed();
    let above = args.above.of(pair.diagonal());
    let question = Question { error: 0.0, above: Some(above), most_pairs: pair.most_pairs };
    let answers = pair.reading(|| {
        let mut asker = Asker::new(&pair)?;
        let answers =
            path.iter().map(|pose| asker.ask(&[still, *pose], &question, &args.limits.start(&cancel)));
        answers.collect::<Result<Vec<Answer>>>()
    })?;
    let is_clear = |answer: &Answer| answer.least > above;
    let mut out = stdout();
    if args.json {
        let entry = |answer: &Answer| {
            let mut value = answer_json(answer);
            value["clear"] = Value::from(verdict(answer, above).0);
            value
        };
        let value = json!({
            "schema": "chpm-clearance/1",
            "first": pair.models[0].json(),
            "second": pair.models[1].json(),
            "above": above,
            "answers": answers.iter().map(entry).collect::<Vec<_>>(),
        });
        writeln!(out, "{value:#}")?;
    } else {
        for (step, answer) in answers.iter().enumerate() {
            let pages: u64 = answer.reads.iter().map(|read| read.pages).sum();
            let bytes = Bytes(answer.reads.iter().map(|read| read.bytes.0).sum());
            let lead = if answers.len() > 1 { format!("step {step}: ") } else { String::new() };
            writeln!(out, "{lead}{}; read {pages} pages, {bytes}", verdict(answer, above).1)?;
            if let (false, Some(witness)) = (is_clear(answer), answer.witness) {
                let [[x, y, z], [u, v, w]] = witness.points;
                let [e, f] = witness.errors.map(Units);
                writeln!(out, "  {x} {y} {z} and {u} {v} {w}, within {e} and {f} units of the sources")?;
            }
        }
    }
    out.flush()?;
    Ok(if answers.iter().all(is_clear) { Verdict::Good } else { Verdict::Faulty })
}

/// Whether it is clear, where that is known, for programs; and in words.
fn verdict(answer: &Answer, above: f64) -> (Option<bool>, String) {
    let (least, most, above_units) = (Units(answer.least), Units(answer.most), Units(above));
    if answer.least > above {
        (Some(true), format!("clear: {least} units or more apart, above {above_units}"))
    } else if answer.most <= above {
        (Some(false), format!("not clear: {most} units or less apart, not above {above_units}"))
    } else {
        (None, format!("undecided: from {least} to {most} units apart, and {above_units} asked for"))
    }
}
