//! A comparison as one page of HTML that needs nothing else: whether it passes, a picture in the colours of distances, a histogram, numbers.

use super::{PERCENTS, Parts, Pass, Summary, plot, signed};
use crate::number::Units;
use crate::report::count;
use anyhow::Result;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_refine::Portrait;
use chpm_report::colors::Colors;
use chpm_report::page::{Canvas, Compared, Lens, Spot};

/// Pixels of the picture.
const PICTURE: [usize; 2] = [960, 640];

/// Facts beside the picture.
pub(crate) struct Told<'a> {
    pub(crate) title: &'a str,
    pub(crate) note: &'a str,
    pub(crate) summary: &'a Summary,
    pub(crate) pass: Option<&'a Pass>,
    /// The verdict in words, and whether it is good, where there is a tolerance.
    pub(crate) verdict: Option<(String, bool)>,
    pub(crate) signed: bool,
}

/// The page of a scan.
pub(crate) fn page(file: &Chpm<MappedFile>, parts: &Parts, told: &Told<'_>) -> Result<String> {
    let Summary { range, .. } = told.summary;
    let colors = Colors::new(*range, told.signed);
    let portrait = Portrait::of_file(file)?;
    let tolerance = told.pass.map(|pass| pass.tolerance);
    let [low, high] = *range;
    let page = Compared {
        title: told.title,
        note: told.note,
        verdict: told.verdict.as_ref().map(|(words, good)| (words.as_str(), *good)),
        picture: (picture(file, parts, &portrait, &colors)?, PICTURE),
        gradient: colors.gradient(),
        ends: [low, 0.5 * (low + high), high].map(signed),
        plot: plot(
            told.summary,
            &colors,
            tolerance,
            "distance, units",
            ["How many vertices are how far away", told.note],
        )?,
        numbers: numbers(told),
        why: portrait.why(),
    };
    Ok(page.html()?)
}

/// All leaves, each point in the colour of its distance.
fn picture(file: &Chpm<MappedFile>, parts: &Parts, portrait: &Portrait, colors: &Colors) -> Result<String> {
    let camera = portrait.camera(PICTURE[0] as f64 / PICTURE[1] as f64);
    let lens = Lens::new(&camera, PICTURE, portrait.stretch());
    let mut canvas = Canvas::new(PICTURE);
    parts.pages(file, |page, values| {
        for corners in page.triangles {
            let corners = corners.map(usize::from);
            let distances = corners.map(|corner| [values[corner] as f32, 0.0, 0.0]);
            let positions = corners.map(|corner| page.positions[corner]);
            canvas.draw(&lens, positions, 0, |spot: Spot| Some(spot.mix(&distances)));
        }
        Ok(())
    })?;
    let picture = canvas.picture(|_, [distance, ..]| {
        let [r, g, b, _] = colors.of(distance.into());
        [r, g, b]
    });
    Ok(picture?)
}

fn numbers(told: &Told<'_>) -> Vec<(String, String)> {
    let Summary { count: all, min, max, mean, rms, percentiles, outside: [below, above], .. } = told.summary;
    let mut rows = vec![
        ("vertices".to_owned(), count(*all)),
        ("least".to_owned(), signed(*min)),
        ("most".to_owned(), signed(*max)),
        ("mean".to_owned(), signed(*mean)),
        ("root mean square".to_owned(), Units(*rms).to_string()),
    ];
    fn named((percent, size): (&f64, &f64)) -> (String, String) {
        (format!("{percent} % are no farther than"), Units(*size).to_string())
    }
    rows.extend(PERCENTS.iter().zip(percentiles).map(named));
    if let Some(pass) = told.pass {
        rows.push((format!("within {}", Units(pass.tolerance)), count(pass.within)));
        rows.push((format!("beyond {}", Units(pass.tolerance)), count(pass.beyond)));
        rows.push(("undecided for rounding".to_owned(), count(pass.undecided)));
    }
    rows.push(("below the first colour".to_owned(), count(*below)));
    rows.push(("above the last colour".to_owned(), count(*above)));
    rows
}
