//! Numbers as they are typed on the command line, each kind read in one way wherever it is asked for.

use chpm_mesh::asked;
pub(crate) use chpm_mesh::{AtLeast, AtMost, Digits, Triangles, Units};
pub(crate) use chpm_report::Short;
use std::ops::RangeInclusive;

/// A parser of counts within `range`: `20000`, `20,000`, `20_000`, `20k`, `1.5M`, `2e4`.
pub(crate) fn count<T>(
    range: RangeInclusive<T>,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    T: TryFrom<u64> + Into<u64> + Copy + Send + Sync + 'static,
{
    move |text| {
        let (least, most) = ((*range.start()).into(), (*range.end()).into());
        match asked::whole(text).map_err(|error| error.to_string())? {
            count if count < least => Err(format!("'{text}' is too small: at least {least}")),
            count if count > most => Err(format!("'{text}' is too large: at most {most}")),
            count => T::try_from(count).map_err(|_| format!("'{text}' is too large: at most {most}")),
        }
    }
}

/// A number that is not negative, and finite.
pub(crate) fn decimal(text: &str) -> Result<f64, String> {
    asked::decimal(text).map_err(|error| error.to_string())
}

/// A finite number.
pub(crate) fn finite(text: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|x: &f64| x.is_finite());
    number.ok_or_else(|| format!("'{text}' is no number"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_read_as_people_type_them() {
        let of = |text| count(1_u32..=2_000_000)(text);
        for text in ["20000", "20,000", "20_000", "20k", "20K", "2e4", "0.02M"] {
            assert_eq!(of(text), Ok(20_000), "{text}");
        }
        for (text, told) in [
            ("1,5", "ambiguous"),
            ("0", "at least 1"),
            ("2.1M", "at most 2000000"),
            ("1e30", "too large"),
            ("1.5", "20,000, 20_000, 20k"),
            ("-3", "not a whole number"),
            ("nan", "not a whole number"),
            ("3%", "not a whole number"),
        ] {
            assert!(of(text).unwrap_err().contains(told), "{text}: {:?}", of(text));
        }
        assert!(count(0..=u32::MAX)("5G").unwrap_err().contains("at most 4294967295"));
    }
}
