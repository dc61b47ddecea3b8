//! `chpm distance`: how near two models are, as an interval that is proven.

use super::Verdict;
use crate::json::{self, near};
use crate::number::{AtLeast, AtMost, Units};
use crate::output;
use crate::proximity::{AskArgs, Pair, SecondArgs, answer_json, ask_all, ended, read, write_csv};
use crate::report::{count, table};
use crate::stop::Stop;
use anyhow::Result;
use chpm_build::config::Length;
use chpm_proximity::{Answer, End, Question, Reads};
use std::io::Write;

/// Arguments of `chpm distance`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    #[command(flatten)]
    ask: AskArgs,
    #[command(flatten)]
    second: SecondArgs,
    /// How wide the interval may be, in the models' units or, as in 0.1%, of the larger diagonal of their boxes. 0 goes to the triangles of the
    /// sources where need be, and is exact but for rounding
    #[arg(long, value_name = "E", default_value = "0.1%")]
    error: Length,
}

/// Asks for each pose.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let AskArgs { first, poses, limits, threads, tell } = &args.ask;
    let (mut csv, mut out) = tell.open(output::DISTANCE_CSV, &[first, &args.second.second])?;
    let ([still, _], path) = (poses.poses(), args.second.path.poses(poses)?);
    let pair = args.ask.pair(&args.second.second, stop)?;
    let cancel = stop.heed();
    let error = args.error.of(pair.diagonal());
    let question = Question { error, above: None, most_pairs: pair.most_pairs };
    let pool = threads.pool()?;
    let answers =
        pair.reading(|| pool.install(|| ask_all(&pair, &still, &path, &question, limits, &cancel)))?;
    if let Some(csv) = &mut csv {
        write_csv(&answers, csv)?;
    }
    if tell.json {
        json::print(&to_json(&pair, error, &answers), &mut out)?;
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

fn to_json(pair: &Pair, error: f64, answers: &[Answer]) -> near::Distance {
    near::Distance {
        schema: "chpm-distance/1",
        first: pair.models[0].json(),
        second: pair.models[1].json(),
        error,
        answers: answers.iter().map(answer_json).collect(),
    }
}

fn print(args: &Args, pair: &Pair, answers: &[Answer], out: &mut impl Write) -> Result<()> {
    let diagonal = pair.diagonal();
    let all: u64 = pair.models.iter().map(|model| model.file.stored_len()).sum();
    if let [answer] = answers {
        let [a, b] = &pair.models;
        writeln!(
            out,
            "{} and {}: from {} to {} units apart, of a diagonal of {} units",
            a.path.display(),
            b.path.display(),
            answer.lower,
            answer.upper,
            Units(diagonal)
        )?;
        if let Some(closest) = answer.closest_points {
            for (model, i) in pair.models.iter().zip(0..2) {
                let [x, y, z] = closest.points[i];
                let (level, name) = (closest.levels[i], model.path.display());
                let error = AtMost(closest.errors[i]);
                writeln!(
                    out,
                    "  nearest found on {name}: {x} {y} {z}, at level {level}, within {error} units of the source"
                )?;
            }
        }
        let Reads { pages, bytes } = read(answer);
        let share = 100.0 * bytes.0 as f64 / all as f64;
        writeln!(out, "  {}; read {} pages, {bytes}, {share:.2} % of the files", why(answer), count(pages))?;
    } else {
        let rows = answers.iter().enumerate().map(|(step, answer)| {
            let Reads { pages, bytes } = read(answer);
            let (least, most) = (AtLeast(answer.lower).to_string(), AtMost(answer.upper).to_string());
            vec![step.to_string(), least, most, ended(answer.end).to_owned(), count(pages), bytes.to_string()]
        });
        writeln!(out, "{}", table(&["step", "least", "most", "ended", "pages", "bytes"], rows))?;
    }
    if answers.iter().any(|answer| matches!(answer.end, End::Stopped | End::Crowded)) {
        writeln!(
            out,
            "undecided to {} within what may be spent; the interval holds as it is",
            args.error.describe(diagonal)
        )?;
    }
    Ok(())
}

/// Why an answer is not narrower, in words.
fn why(answer: &Answer) -> String {
    match answer.end {
        End::Decided => "as narrow as was asked for".to_owned(),
        End::Exact => {
            let rounding = AtMost(answer.rounding);
            format!("exact: triangles of the sources, but for rounding, {rounding} units at either end")
        }
        End::Stopped => "stopped at the limit".to_owned(),
        End::Crowded => "stopped where more pairs would wait than fit into the memory".to_owned(),
    }
}
