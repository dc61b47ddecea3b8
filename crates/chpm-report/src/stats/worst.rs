//! The clusters that stand out.

use super::{Row, Spread};
use serde::Serialize;

/// So many are named.
const NAMED: usize = 5;

/// The worst clusters by one measure, the worst first.
#[derive(Serialize, Debug)]
pub struct Worst {
    /// The name of the measure.
    pub measure: &'static str,
    /// The clusters.
    pub clusters: Vec<Named>,
}

/// A cluster and its value.
#[derive(Clone, Copy, Serialize, Debug)]
pub struct Named {
    /// Its number.
    pub cluster: u32,
    /// Its level.
    pub level: u32,
    /// Its value.
    pub value: f64,
}

/// Value of a cluster; of more than one cluster the larger is the worse.
type Measure = fn(&Row<'_>, &[Option<Spread>]) -> Option<f64>;

/// Names and measures. The second argument has the errors of each level.
const MEASURES: [(&str, &str, Measure); 10] = [
    ("error", "error by the median of its level", |row, errors| {
        let median = errors.get(row.record.level as usize)?.as_ref()?.median;
        (median > 0.0).then(|| f64::from(row.record.max_error) / median)
    }),
    ("kept", "share of its triangles that it keeps", |row, _| {
        let kept = f64::from(row.record.base_triangle_count) / f64::from(row.record.triangle_count);
        (!row.record.is_root() && row.record.triangle_count > 0).then_some(kept)
    }),
    ("triangles", "triangles", |row, _| Some(row.record.triangle_count.into())),
    ("shared", "share of shared vertices", |row, _| {
        Some(f64::from(row.record.shared_count) / f64::from(row.record.vertex_count))
    }),
    ("aspect", "longest side of its box by the second longest", |row, _| row.aspect),
    ("overlap", "share of its box that a sibling's takes", |row, _| row.overlap),
    ("acmr24", "cache misses a triangle", |row, _| Some(row.acmr()[1])),
    ("edge_span", "mean edge span", |row, _| Some(row.edge_span())),
    ("bytes_per_triangle", "page bytes a triangle", |row, _| {
        let triangles = row.record.triangle_count;
        (triangles > 0).then(|| f64::from(row.record.page_len) / f64::from(triangles))
    }),
    ("deviation", "deviation of normals, degrees", |row, _| Some(row.record.normal_deviation.into())),
];

/// Meaning of a measure, in words.
pub fn words(measure: &str) -> &'static str {
    MEASURES.iter().find(|(name, ..)| *name == measure).map_or("", |(_, words, _)| words)
}

/// The worst by each measure. What is zero is nobody's fault.
pub(super) fn of(rows: &[Row<'_>], levels: usize) -> Vec<Worst> {
    let errors = (0..levels as u32).map(|level| {
        let own = rows.iter().filter(|row| row.record.level == level);
        Spread::of(own.map(|row| row.record.max_error.into()))
    });
    let errors: Vec<Option<Spread>> = errors.collect();
    let all = MEASURES.into_iter().map(|(name, _, value)| {
        let named = rows.iter().filter_map(|row| {
            let value = value(row, &errors).filter(|value| *value > 0.0)?;
            Some(Named { cluster: row.id, level: row.record.level, value })
        });
        let mut clusters: Vec<Named> = named.collect();
        clusters.sort_by(|a, b| b.value.total_cmp(&a.value).then(a.cluster.cmp(&b.cluster)));
        clusters.truncate(NAMED);
        Worst { measure: name, clusters }
    });
    all.filter(|worst| !worst.clusters.is_empty()).collect()
}
