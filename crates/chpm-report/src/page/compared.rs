//! The page of a comparison: whether it passes, a picture in the colours of distances, a histogram, numbers.

use super::STYLE;
use crate::chart::in_xml;
use crate::error::ReportError;
use askama::Template;

/// A comparison, as its page shows it.
#[derive(Clone, Debug)]
pub struct Compared<'a> {
    /// Above it.
    pub title: &'a str,
    /// Below the picture.
    pub note: &'a str,
    /// The verdict in words, and whether it is good, where there is a tolerance.
    pub verdict: Option<(&'a str, bool)>,
    /// A picture by [`Canvas`](super::Canvas), and its pixels.
    pub picture: (String, [usize; 2]),
    /// Stops of the gradient of its colours.
    pub gradient: String,
    /// Distances at the first colour, in the middle, at the last.
    pub ends: [String; 3],
    /// The histogram, as SVG.
    pub plot: String,
    /// Names and values.
    pub numbers: Vec<(String, String)>,
    /// Why the model is shown from this side.
    pub why: String,
}

#[derive(Template)]
#[template(path = "compare.html")]
struct Page<'a> {
    style: &'a str,
    title: &'a str,
    note: &'a str,
    verdict: Option<&'a str>,
    passed: bool,
    picture: &'a str,
    size: [usize; 2],
    gradient: &'a str,
    ends: &'a [String; 3],
    plot: &'a str,
    numbers: &'a [(String, String)],
    why: &'a str,
}

impl Compared<'_> {
    /// The page.
    ///
    /// # Errors
    /// [`ReportError::Page`].
    pub fn html(&self) -> Result<String, ReportError> {
        let page = Page {
            style: STYLE,
            title: self.title,
            note: self.note,
            verdict: self.verdict.map(|(words, _)| words),
            passed: self.verdict.is_none_or(|(_, good)| good),
            picture: &self.picture.0,
            size: self.picture.1,
            gradient: &self.gradient,
            ends: &self.ends,
            plot: &self.plot,
            numbers: &self.numbers,
            why: &self.why,
        };
        Ok(in_xml(&page.render()?))
    }
}
