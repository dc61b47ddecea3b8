//! How a model is shown, as somebody says or as its file tells: its title, how it stands, who is credited.

use crate::crs::Crs;
use chpm_format::shown;
use chpm_refine::{Side, Up};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// From where a whole model is looked at.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
#[command(next_help_heading = "Camera")]
pub(crate) struct StanceArgs {
    /// What is up: x, y, z, -x, -y or -z. If not given, the direction in which the model stands best, by what it touches the ground with; y or z in doubt
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    pub(crate) up: Option<Up>,
    /// The side that is shown. If not given, the front, unless another side is much wider or shows more; from a corner above what lies more than
    /// it stands
    #[arg(long = "view", value_name = "SIDE", value_parser = side())]
    pub(crate) side: Option<Side>,
}

/// Sides by their names.
fn side() -> impl TypedValueParser<Value = Side> {
    let names = Side::ALL.map(|(_, name)| PossibleValue::new(name));
    PossibleValuesParser::new(names).map(|name| Side::named(&name).unwrap_or(Side::Front))
}

/// How a model is shown; kept in the file.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Kept with the file, and shown")]
pub(crate) struct ShownArgs {
    /// The model's name, in words
    #[arg(long, value_name = "TEXT", hide_short_help = true, value_parser = text)]
    title: Option<String>,
    /// What is up: x, y, z, -x, -y or -z. If not given, it is found whenever the model is shown
    #[arg(long, value_name = "AXIS", hide_short_help = true, allow_hyphen_values = true)]
    up: Option<Up>,
    /// The side that is shown. If not given, it is found, too
    #[arg(long = "view", value_name = "SIDE", hide_short_help = true, value_parser = side())]
    side: Option<Side>,
    /// Whose it is, in words
    #[arg(long, value_name = "TEXT", hide_short_help = true, value_parser = text)]
    credit: Option<String>,
    /// The colour behind the model
    #[arg(long, value_name = "RRGGBB", hide_short_help = true, value_parser = color)]
    background: Option<String>,
    /// The system that its coordinates are of, as in EPSG:32633: what export and section take to place it
    #[arg(long, value_name = "EPSG:CODE", hide_short_help = true)]
    crs: Option<Crs>,
}

/// Longest of these texts, bytes.
const MOST: usize = 1000;

fn text(text: &str) -> Result<String, String> {
    match text {
        _ if text.len() > MOST => Err(format!("longer than {MOST} bytes")),
        _ if text.chars().any(char::is_control) => Err("it has control characters".to_owned()),
        _ => Ok(text.to_owned()),
    }
}

/// `ff8000`, with or without a `#`.
fn color(text: &str) -> Result<String, String> {
    let digits = text.strip_prefix('#').unwrap_or(text);
    let is_hex = digits.len() == 6 && digits.bytes().all(|digit| digit.is_ascii_hexdigit());
    if !is_hex {
        return Err(format!("'{text}' is no colour: write RRGGBB, as in ffffff"));
    }
    Ok(digits.to_ascii_lowercase())
}

impl ShownArgs {
    /// The settings that a file keeps of it.
    pub(crate) fn settings(&self) -> Vec<(String, String)> {
        let told = [
            (shown::TITLE, self.title.clone()),
            (shown::UP, self.up.map(|up| up.to_string())),
            (shown::VIEW, self.side.map(|side| side.name().to_owned())),
            (shown::CREDIT, self.credit.clone()),
            (shown::BACKGROUND, self.background.clone()),
            (shown::CRS, self.crs.as_ref().map(Crs::to_string)),
        ];
        told.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_and_texts_are_checked() {
        assert_eq!(color("#FF8000"), Ok("ff8000".to_owned()));
        for bad in ["", "fff", "gggggg", "ff8000;x"] {
            assert!(color(bad).is_err(), "{bad}");
        }
        assert!(text("Bust, 1765 – \"found\" <here>").is_ok());
        assert!(text("a\u{1b}[2J").is_err() && text(&"x".repeat(MOST + 1)).is_err());
    }
}
