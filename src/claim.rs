//! Assertions of a pipeline about a file: `acmr24<0.8`.

use serde_json::{Map, Value};
use std::fmt;
use std::str::FromStr;

/// A measure, a relation and a number.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Claim {
    text: String,
    measure: String,
    relation: Relation,
    bound: f64,
}

/// A relation and its sign.
type Relation = (&'static str, fn(&f64, &f64) -> bool);

/// Longer signs before those that they begin with.
const RELATIONS: [Relation; 6] =
    [("<=", f64::le), (">=", f64::ge), ("==", f64::eq), ("!=", f64::ne), ("<", f64::lt), (">", f64::gt)];

impl FromStr for Claim {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Claim::parse(text).ok_or_else(|| {
            format!(
                "'{text}' is no assertion: write a measure, one of < <= > >= == != and a number, as in acmr24<0.8"
            )
        })
    }
}

impl Claim {
    fn parse(text: &str) -> Option<Self> {
        let (measure, rest) = text.split_at(text.find(['<', '>', '=', '!'])?);
        let relation = RELATIONS.into_iter().find(|(sign, _)| rest.starts_with(sign))?;
        let bound = rest[relation.0.len()..].trim().parse::<f64>().ok()?;
        let is_sound = !measure.trim().is_empty() && bound.is_finite();
        is_sound.then(|| Claim { text: text.to_owned(), measure: measure.trim().to_owned(), relation, bound })
    }

    /// Whether it holds; else what the measure is.
    ///
    /// # Errors
    /// A measure that there is not.
    pub(crate) fn check(&self, measures: &Map<String, Value>) -> Result<Option<String>, String> {
        let Some(value) = measures.get(&self.measure).and_then(Value::as_f64) else {
            let known: Vec<&str> = measures.keys().map(String::as_str).collect();
            let measured = if self.measure == "tightness" { "; tightness takes --measured" } else { "" };
            return Err(format!(
                "there is no measure '{}'{measured}; there are {}",
                self.measure,
                known.join(", ")
            ));
        };
        let holds = (self.relation.1)(&value, &self.bound);
        Ok((!holds).then(|| format!("{self} does not hold: {} is {value}", self.measure)))
    }
}

impl fmt::Display for Claim {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn assertions_hold_or_do_not() {
        let mut measures = Map::new();
        measures.insert("acmr24".to_owned(), 0.75.into());
        let check = |text: &str| text.parse::<Claim>().map(|claim| claim.check(&measures));
        for good in
            ["acmr24<0.8", "acmr24 <= 0.75", "acmr24>=0.75", "acmr24==.75", "acmr24 != 1", "acmr24>-1e3"]
        {
            assert_eq!(check(good), Ok(Ok(None)), "{good}");
        }
        for bad in ["acmr24<0.75", "acmr24>0.75", "acmr24==1", "acmr24!=0.75"] {
            assert!(check(bad).unwrap().unwrap().is_some_and(|told| told.contains("is 0.75")), "{bad}");
        }
        for wrong in ["", "acmr24", "<3", "acmr24<", "acmr24<much", "acmr24=1", "acmr24<nan", "acmr24<1<2"] {
            assert!(check(wrong).unwrap_err().contains("acmr24<0.8"), "{wrong}");
        }
        assert!(check("acmr<1").unwrap().unwrap_err().contains("there are acmr24"));
        assert!(check("tightness<1").unwrap().unwrap_err().contains("--measured"));
    }
}
