//! `chpm clearance`: proves that two models are apart by more than a distance, or shows where they are not.

use super::Verdict;
use crate::json::{self, near};
use crate::number::AtMost;
use crate::output;
use crate::proximity::{AskArgs, SecondArgs, answer_json, ask_all, read, write_csv};
use crate::stop::Stop;
use anyhow::Result;
use chpm_build::config::Length;
use chpm_proximity::{Answer, Question, Reads};
use std::io::Write;

/// Arguments of `chpm clearance`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    #[command(flatten)]
    ask: AskArgs,
    #[command(flatten)]
    second: SecondArgs,
    /// The distance that the models must be farther apart than, in their units or, as in 1%, of the larger diagonal of their boxes
    #[arg(long, value_name = "D")]
    above: Length,
}

/// Asks for each pose; anything but a proof is a fault.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let AskArgs { first, poses, limits, threads, tell } = &args.ask;
    let (mut csv, mut out) = tell.open(output::CLEARANCE_CSV, &[first, &args.second.second])?;
    let ([still, _], path) = (poses.poses(), args.second.path.poses(poses)?);
    let pair = args.ask.pair(&args.second.second, stop)?;

    let cancel = stop.heed();
    let above = args.above.of(pair.diagonal());
    let question = Question { error: 0.0, above: Some(above), most_pairs: pair.most_pairs };
    let pool = threads.pool()?;
    let answers =
        pair.reading(|| pool.install(|| ask_all(&pair, &still, &path, &question, limits, &cancel)))?;
    if let Some(csv) = &mut csv {
        write_csv(&answers, csv)?;
    }
    let is_clear = |answer: &Answer| answer.lower > above;

    if tell.json {
        let verdicts = answers
            .iter()
            .map(|answer| near::Verdict { clear: verdict(answer, above).0, answer: answer_json(answer) });
        let clearance = near::Clearance {
            schema: "chpm-clearance/1",
            first: pair.models[0].json(),
            second: pair.models[1].json(),
            above,
            answers: verdicts.collect(),
        };
        json::print(&clearance, &mut out)?;
    } else {
        for (step, answer) in answers.iter().enumerate() {
            let Reads { pages, bytes } = read(answer);
            let lead = if answers.len() > 1 { format!("step {step}: ") } else { String::new() };
            writeln!(out, "{lead}{}; read {pages} pages, {bytes}", verdict(answer, above).1)?;
            if let (false, Some(closest)) = (is_clear(answer), answer.closest_points) {
                let [[x, y, z], [u, v, w]] = closest.points;
                let [e, f] = closest.errors.map(AtMost);
                writeln!(out, "  {x} {y} {z} and {u} {v} {w}, within {e} and {f} units of the sources")?;
            }
        }
    }
    out.flush()?;
    drop(out);
    if let Some(csv) = csv {
        csv.publish()?;
    }
    Ok(if answers.iter().all(is_clear) { Verdict::Good } else { Verdict::Faulty })
}

/// Whether it is clear, where that is known, for programs; and in words.
fn verdict(answer: &Answer, above: f64) -> (Option<bool>, String) {
    let Answer { lower, upper, .. } = *answer;
    // With all digits: rounded, a bound may be told on the other side of what it is compared with.
    if lower > above {
        (Some(true), format!("clear: {lower} units or more apart, above {above}"))
    } else if upper <= above {
        (Some(false), format!("not clear: {upper} units or less apart, not above {above}"))
    } else {
        (None, format!("undecided: from {lower} to {upper} units apart, and {above} asked for"))
    }
}
