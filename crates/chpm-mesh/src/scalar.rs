//! Named numbers of vertices, such as a scanner's confidence: what they are called, and how the words of a vertex hold them.
//!
//! A word is 32 bits. A vertex has the words of all its scalars in a row, those of the first scalar first; whoever moves vertices moves rows, and
//! only who reads or shows a value asks which scalar it is.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Most words that the scalars of a vertex may take.
pub const MOST_SCALAR_WORDS: usize = 255;

/// The type that a source gives to a scalar.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[repr(u8)]
pub enum ScalarKind {
    /// 8 bits with a sign.
    Int8 = 1,
    /// 8 bits.
    Uint8 = 2,
    /// 16 bits with a sign.
    Int16 = 3,
    /// 16 bits.
    Uint16 = 4,
    /// 32 bits with a sign.
    Int32 = 5,
    /// 32 bits.
    Uint32 = 6,
    /// Single precision.
    Float32 = 7,
    /// Double precision.
    Float64 = 8,
}

impl ScalarKind {
    /// All of them, by code.
    pub const ALL: [ScalarKind; 8] = [
        ScalarKind::Int8,
        ScalarKind::Uint8,
        ScalarKind::Int16,
        ScalarKind::Uint16,
        ScalarKind::Int32,
        ScalarKind::Uint32,
        ScalarKind::Float32,
        ScalarKind::Float64,
    ];

    /// The kind of a code, if there is one.
    pub fn of_code(code: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| *kind as u16 == code)
    }

    /// Words of a value: one for what single precision holds exactly, two in double precision for all else.
    pub fn words(self) -> usize {
        match self {
            ScalarKind::Int32 | ScalarKind::Uint32 | ScalarKind::Float64 => 2,
            _ => 1,
        }
    }

    /// Appends the words of a value of this kind, which single precision must hold where it takes one word. For a float in single precision
    /// that is no number, give the bits themselves.
    pub fn put(self, value: f64, words: &mut Vec<u32>) {
        let mut own = [0; 2];
        let own = &mut own[..self.words()];
        self.fill(value, own);
        words.extend_from_slice(own);
    }

    /// As [`ScalarKind::put`], into the words of this value.
    pub fn fill(self, value: f64, words: &mut [u32]) {
        match words {
            [single] => *single = (value as f32).to_bits(),
            [low, high] => (*low, *high) = (value.to_bits() as u32, (value.to_bits() >> 32) as u32),
            _ => {}
        }
    }

    /// The value that words hold.
    pub fn value(self, words: &[u32]) -> f64 {
        match *words {
            [single] => f32::from_bits(single).into(),
            [low, high] => f64::from_bits(u64::from(high) << 32 | u64::from(low)),
            _ => f64::NAN,
        }
    }
}

impl fmt::Display for ScalarKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ScalarKind::Int8 => "int8",
            ScalarKind::Uint8 => "uint8",
            ScalarKind::Int16 => "int16",
            ScalarKind::Uint16 => "uint16",
            ScalarKind::Int32 => "int32",
            ScalarKind::Uint32 => "uint32",
            ScalarKind::Float32 => "float32",
            ScalarKind::Float64 => "float64",
        })
    }
}

/// A named scalar that vertices have.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Scalar {
    /// As the source has it.
    pub name: String,
    /// As the source has it.
    pub kind: ScalarKind,
    /// Values and their range.
    pub range: ScalarRange,
}

impl Scalar {
    /// A scalar of which no value is known yet.
    pub fn new(name: impl Into<String>, kind: ScalarKind) -> Self {
        Scalar { name: name.into(), kind, range: ScalarRange::default() }
    }
}

/// The range of a scalar's values. What is no number is left aside.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct ScalarRange {
    /// Lowest value; 0 where there is none.
    pub low: f64,
    /// Highest value; 0 where there is none.
    pub high: f64,
    /// Vertices with a value.
    pub count: u64,
}

impl ScalarRange {
    /// Takes a value in.
    pub fn add(&mut self, value: f64) {
        if value.is_nan() {
            return;
        }
        if self.count == 0 {
            (self.low, self.high) = (value, value);
        }
        (self.low, self.high) = (self.low.min(value), self.high.max(value));
        self.count += 1;
    }

    /// Whether a value is no number or lies in the range.
    pub fn holds(&self, value: f64) -> bool {
        value.is_nan() || self.count > 0 && (self.low..=self.high).contains(&value)
    }

    /// Where a value lies between the lowest, 0, and the highest, 1; none for what is no number.
    pub fn fraction(&self, value: f64) -> Option<f64> {
        // Halves, so that the width of the whole range of doubles is no infinity.
        let width = self.high / 2.0 - self.low / 2.0;
        let at = if width > 0.0 && width.is_finite() { (value / 2.0 - self.low / 2.0) / width } else { 0.5 };
        (!value.is_nan()).then(|| at.clamp(0.0, 1.0))
    }
}

/// The scalars, each with the place of its words among those of a vertex.
pub fn scalar_places(scalars: &[Scalar]) -> impl Iterator<Item = (std::ops::Range<usize>, &Scalar)> + Clone {
    scalars.iter().scan(0, |end, scalar| {
        let start = *end;
        *end += scalar.kind.words();
        Some((start..*end, scalar))
    })
}

/// A name for each scalar in a format that knows fewer: `fit` makes a name of the format of one, and those that are taken get a number.
pub fn scalar_names(scalars: &[Scalar], taken: &[&str], fit: impl Fn(&str) -> String) -> Vec<String> {
    let mut names: Vec<String> = Vec::with_capacity(scalars.len());
    for scalar in scalars {
        let fitting = fit(&scalar.name);
        let is_free = |name: &str| !names.iter().any(|other| other == name) && !taken.contains(&name);
        let numbered = (2..).map(|number| format!("{fitting}_{number}"));
        names.extend([fitting.clone()].into_iter().chain(numbered).find(|name| is_free(name)));
    }
    names
}

/// Words of a vertex.
pub fn scalar_words(scalars: &[Scalar]) -> usize {
    scalars.iter().map(|scalar| scalar.kind.words()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_gives_its_values_back() {
        let cases = [
            (ScalarKind::Int8, -128.0),
            (ScalarKind::Uint16, 65535.0),
            (ScalarKind::Int32, f64::from(i32::MIN)),
            (ScalarKind::Uint32, f64::from(u32::MAX)),
            (ScalarKind::Float32, f64::from(0.1f32)),
            (ScalarKind::Float64, 0.1),
        ];
        for (kind, value) in cases {
            let mut words = Vec::new();
            kind.put(value, &mut words);
            assert_eq!((words.len(), kind.value(&words)), (kind.words(), value), "{kind}");
            assert_eq!(ScalarKind::of_code(kind as u16), Some(kind));
        }
        assert_eq!([0, 9].map(ScalarKind::of_code), [None, None]);
    }

    #[test]
    fn ranges_leave_out_what_is_no_number() {
        let mut range = ScalarRange::default();
        assert_eq!((range.holds(0.0), range.holds(f64::NAN)), (false, true));
        [f64::NAN, 3.0, -1.0, f64::NAN].into_iter().for_each(|value| range.add(value));
        assert_eq!(range, ScalarRange { low: -1.0, high: 3.0, count: 2 });
        assert_eq!([-1.0, 1.0, 3.0].map(|value| range.fraction(value)), [Some(0.0), Some(0.5), Some(1.0)]);
        assert_eq!(range.fraction(f64::NAN), None);
        let whole = ScalarRange { low: -f64::MAX, high: f64::MAX, count: 2 };
        assert_eq!(whole.fraction(0.0), Some(0.5));
    }

    #[test]
    fn fitting_names_are_not_given_twice() {
        let scalars = ["a b", "a_b", "x", "a_b_2"].map(|name| Scalar::new(name, ScalarKind::Int8));
        let names = scalar_names(&scalars, &["x"], |name| name.replace(' ', "_"));
        assert_eq!(names, ["a_b", "a_b_2", "x_2", "a_b_2_2"]);
    }

    #[test]
    fn words_follow_one_another() {
        let scalars = [
            Scalar::new("quality", ScalarKind::Float32),
            Scalar::new("time", ScalarKind::Float64),
            Scalar::new("class", ScalarKind::Uint8),
        ];
        let places: Vec<_> = scalar_places(&scalars).map(|(place, _)| place).collect();
        assert_eq!((places, scalar_words(&scalars)), (vec![0..1, 1..3, 3..4], 4));
    }
}
