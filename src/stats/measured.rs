//! Tightness: what `chpm measure --json` found, laid beside the levels.

use super::Stats;
use anyhow::{Context, Result, ensure};
use serde_json::Value;
use std::fs;
use std::path::Path;

impl Stats {
    /// Takes the stored by measured distances of each level, of all its collapses done, from a document of `chpm measure`.
    pub(crate) fn add_measured(&mut self, path: &Path) -> Result<()> {
        let text = fs::read(path).with_context(|| format!("cannot read '{}'", path.display()))?;
        let told =
            || format!("'{}' is no document of `chpm measure FILE --against SOURCE --json`", path.display());
        let document: Value = serde_json::from_slice(&text).with_context(told)?;
        ensure!(document["schema"] == "chpm-measure/2", told());
        let rows = document["levels"].as_array().with_context(told)?;
        let mut worst: Option<f64> = None;
        for row in rows.iter().filter(|row| row["collapsed"] == 1.0) {
            let level = row["level"].as_u64().with_context(told)?;
            let clusters = row["clusters"].as_u64();
            let found = self.levels.iter_mut().find(|own| u64::from(own.level) == level);
            let own = found.filter(|own| Some(u64::from(own.clusters)) <= clusters).with_context(|| {
                format!("'{}' is of another file: this one has no such level {level}", path.display())
            })?;
            own.tightness = Some(row["stored_by_measured"].clone()).filter(|tightness| !tightness.is_null());
            let median = row["stored_by_measured"]["median"].as_f64();
            worst = [worst, median].into_iter().flatten().reduce(f64::max);
        }
        if let Some(worst) = worst {
            self.measures.insert("tightness".to_owned(), worst.into());
        }
        Ok(())
    }
}
