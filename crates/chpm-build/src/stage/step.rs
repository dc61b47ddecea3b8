//! Steps of a build in stages: their names, the commands that make them, and what each is made of.

use std::fmt;
use std::str::FromStr;

/// One of so many parts, counted from 1.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct Share {
    /// Which one.
    pub index: u32,
    /// Of how many.
    pub of: u32,
}

impl Share {
    /// All of so many.
    pub fn all(of: u32) -> impl Iterator<Item = Share> {
        (1..=of).map(move |index| Share { index, of })
    }

    /// The consecutive items of this part, of so many that weigh the same.
    pub(super) fn of_equal(self, count: u64) -> std::ops::Range<usize> {
        let end = |parts: u32| (u128::from(count) * u128::from(parts) / u128::from(self.of)) as usize;
        end(self.index - 1)..end(self.index)
    }

    /// The consecutive items of this part, where items weigh so much each: about as much in each part.
    pub(super) fn range(self, weights: impl Iterator<Item = u64> + Clone) -> std::ops::Range<usize> {
        let total: u128 = weights.clone().map(u128::from).sum();
        let (of, mut before) = (u128::from(self.of), 0);
        // An item belongs to the part that its middle lies in.
        let part = weights.map(|weight| {
            let middle = 2 * before + u128::from(weight);
            before += u128::from(weight);
            (middle * of / (2 * total).max(1)).min(of - 1) as u32 + 1
        });
        let (mut start, mut end) = (0, 0);
        for part in part {
            start += usize::from(part < self.index);
            end += usize::from(part <= self.index);
        }
        start..end
    }
}

impl fmt::Display for Share {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.of)
    }
}

impl FromStr for Share {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers =
            text.split_once('/').and_then(|(index, of)| Some((index.parse().ok()?, of.parse().ok()?)));
        match numbers {
            Some((index, of)) if index >= 1 && index <= of && of <= MOST_PARTS => Ok(Share { index, of }),
            _ => {
                Err(format!("'{text}' is no part: write 2/4 for the second of four, of {MOST_PARTS} at most"))
            }
        }
    }
}

/// Most parts of a plan.
pub const MOST_PARTS: u32 = 65_536;

/// A step, which leaves one file.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Step {
    /// The source is read, and its vertices are divided into regions.
    Plan,
    /// Some triangles are sent to their regions.
    Scatter(Share),
    /// Vertices that several regions have are numbered.
    Borders,
    /// Some regions become leaves.
    Regions(Share),
    /// A tree over all leaves.
    Hierarchy,
    /// The groups of a level.
    Group(u32),
    /// Some groups of a level are simplified.
    Simplify(u32, Share),
    /// All levels from one on are simplified.
    Top(u32),
    /// The order of pages in the file.
    Layout,
    /// Some pages as they are in the file.
    Emit(Share),
    /// The file.
    Finish,
}

impl Step {
    /// The file that it leaves.
    pub fn file(self) -> String {
        match self {
            Step::Plan => "plan.part".to_owned(),
            Step::Scatter(Share { index, of }) => format!("scatter-{index}-of-{of}.part"),
            Step::Borders => "borders.part".to_owned(),
            Step::Regions(Share { index, of }) => format!("regions-{index}-of-{of}.part"),
            Step::Hierarchy => "hierarchy.part".to_owned(),
            Step::Group(level) => format!("group-{level}.part"),
            Step::Simplify(level, Share { index, of }) => format!("simplify-{level}-{index}-of-{of}.part"),
            Step::Top(_) => "top.part".to_owned(),
            Step::Layout => "layout.part".to_owned(),
            Step::Emit(Share { index, of }) => format!("emit-{index}-of-{of}.part"),
            Step::Finish => "finish.part".to_owned(),
        }
    }

    /// The words of `chpm stage` that make it: what comes before the folder and behind it. Those of a plan name its source.
    pub fn words(self) -> (&'static str, String) {
        match self {
            Step::Plan => ("plan SOURCE -o", String::new()),
            Step::Scatter(share) => ("scatter", format!(" --part {share}")),
            Step::Borders => ("borders", String::new()),
            Step::Regions(share) => ("regions", format!(" --part {share}")),
            Step::Hierarchy => ("hierarchy", String::new()),
            Step::Group(level) => ("group", format!(" --level {level}")),
            Step::Simplify(level, share) => ("simplify", format!(" --level {level} --part {share}")),
            Step::Top(level) => ("simplify", format!(" --from-level {level}")),
            Step::Layout => ("layout", String::new()),
            Step::Emit(share) => ("emit", format!(" --part {share}")),
            Step::Finish => ("finish", String::new()),
        }
    }

    /// All steps of a plan, each behind those that it needs.
    pub fn all(parts: u32, levels: u32) -> Vec<Step> {
        let mut steps = vec![Step::Plan];
        steps.extend(Share::all(parts).map(Step::Scatter));
        steps.push(Step::Borders);
        steps.extend(Share::all(parts).map(Step::Regions));
        steps.push(Step::Hierarchy);
        for level in 0..levels {
            steps.push(Step::Group(level));
            steps.extend(Share::all(parts).map(|share| Step::Simplify(level, share)));
        }
        steps.extend([Step::Top(levels), Step::Layout]);
        steps.extend(Share::all(parts).map(Step::Emit));
        steps.push(Step::Finish);
        steps
    }

    /// The steps whose files it reads.
    pub fn inputs(self, parts: u32, levels: u32) -> Vec<Step> {
        let all = |step: fn(Share) -> Step| Share::all(parts).map(step);
        let of_level = |level: u32| {
            let simplified = Share::all(parts).map(move |share| Step::Simplify(level, share));
            [Step::Hierarchy, Step::Group(level)].into_iter().chain(simplified)
        };
        match self {
            Step::Plan => Vec::new(),
            Step::Scatter(_) => vec![Step::Plan],
            Step::Borders => [Step::Plan].into_iter().chain(all(Step::Scatter)).collect(),
            Step::Regions(_) => [Step::Plan, Step::Borders].into_iter().chain(all(Step::Scatter)).collect(),
            Step::Hierarchy => [Step::Plan, Step::Borders].into_iter().chain(all(Step::Regions)).collect(),
            Step::Group(0) => vec![Step::Plan, Step::Hierarchy],
            Step::Group(level) => [Step::Plan].into_iter().chain(of_level(level - 1)).collect(),
            Step::Simplify(level, _) => vec![Step::Plan, Step::Hierarchy, Step::Group(level)],
            Step::Top(0) => vec![Step::Plan, Step::Hierarchy],
            Step::Top(level) => [Step::Plan].into_iter().chain(of_level(level - 1)).collect(),
            Step::Layout => vec![Step::Plan, Step::Top(levels)],
            Step::Emit(_) => vec![Step::Plan, Step::Top(levels), Step::Layout],
            Step::Finish => {
                let first = [Step::Plan, Step::Hierarchy, Step::Top(levels), Step::Layout];
                first.into_iter().chain(all(Step::Emit)).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn parts_are_all_items_once_and_about_equal() {
        for weights in
            [vec![], vec![0, 0], vec![1], vec![5; 100], (0..77).collect::<Vec<u64>>(), vec![1000, 1, 1]]
        {
            for of in [1, 2, 5, 300] {
                let ranges: Vec<_> =
                    Share::all(of).map(|share| share.range(weights.iter().copied())).collect();
                assert_eq!((ranges[0].start, ranges[of as usize - 1].end), (0, weights.len()));
                assert!(ranges.windows(2).all(|pair| pair[0].end == pair[1].start), "{ranges:?}");
                let total: u64 = weights.iter().sum();
                let largest = weights.iter().copied().max().unwrap_or(0);
                for range in ranges {
                    let weight: u64 = weights[range].iter().sum();
                    assert!(weight <= total / u64::from(of) + 1 + largest, "{of}: {weight}");
                }
            }
        }
    }

    #[test]
    fn parts_of_equal_items_follow_one_another() {
        for (count, of) in [(0, 3), (1, 5), (7, 3), (10_000_000_001, 7)] {
            let ranges: Vec<_> = Share::all(of).map(|share| share.of_equal(count)).collect();
            assert_eq!((ranges[0].start, ranges[of as usize - 1].end), (0, count as usize));
            assert!(ranges.windows(2).all(|pair| pair[0].end == pair[1].start), "{ranges:?}");
            let most = count.div_ceil(u64::from(of)) as usize;
            assert!(ranges.iter().all(|range| range.len() + 1 >= most && range.len() <= most), "{ranges:?}");
        }
    }

    #[test]
    fn each_step_comes_behind_what_it_needs() {
        for (parts, levels) in [(1, 0), (1, 3), (4, 0), (5, 2)] {
            let mut seen = BTreeSet::new();
            for step in Step::all(parts, levels) {
                assert!(step.inputs(parts, levels).iter().all(|input| seen.contains(input)), "{step:?}");
                assert!(seen.insert(step));
            }
            let names: BTreeSet<String> = seen.iter().map(|step| step.file()).collect();
            assert_eq!(names.len(), seen.len());
        }
    }

    #[test]
    fn parts_are_read_as_they_are_told() {
        assert_eq!("2/4".parse(), Ok(Share { index: 2, of: 4 }));
        for bad in ["", "2", "0/4", "5/4", "1/0", "-1/2", "1/2/3", "1/99999999", "a/b"] {
            assert!(bad.parse::<Share>().is_err(), "{bad}");
        }
    }
}
