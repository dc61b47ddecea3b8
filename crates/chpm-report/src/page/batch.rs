//! The page of many models.

use super::STYLE;
use crate::chart::in_xml;
use crate::error::ReportError;
use askama::Template;

/// A model of a batch.
#[derive(Clone, Debug)]
pub struct Card<'a> {
    /// Its name.
    pub name: &'a str,
    /// Result, in a word.
    pub status: &'static str,
    /// Why it failed.
    pub error: Option<&'a str>,
    /// Warnings of its build.
    pub warnings: &'a [String],
    /// A [`thumbnail`](super::thumbnail), if there is one.
    pub picture: Option<String>,
    /// Its size, in words.
    pub facts: String,
    /// Where its file is, from the page.
    pub link: String,
}

#[derive(Template)]
#[template(path = "batch.html")]
struct Page<'a> {
    style: &'a str,
    title: &'a str,
    cards: Vec<Card<'a>>,
}

/// The page of a batch, failures first, below a title.
///
/// # Errors
/// [`ReportError::Page`].
pub fn index(title: &str, mut cards: Vec<Card<'_>>) -> Result<String, ReportError> {
    cards.sort_by_key(|card| (card.error.is_none(), card.picture.is_some(), card.name));
    Ok(in_xml(&Page { style: STYLE, title, cards }.render()?))
}
