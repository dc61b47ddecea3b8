//! Tightness: what `chpm measure --json` found, laid beside the levels.

use super::Stats;
use crate::error::ReportError;
use serde_json::Value;

impl Stats {
    /// Takes the stored by measured distances of each level, of all its collapses done, from a document of `chpm measure`.
    ///
    /// # Errors
    /// [`ReportError::Measured`] if it is none, [`ReportError::OtherFile`] if it is of another file.
    pub fn add_measured(&mut self, document: &Value) -> Result<(), ReportError> {
        if document["schema"] != "chpm-measure/2" {
            return Err(ReportError::Measured);
        }
        let rows = document["levels"].as_array().ok_or(ReportError::Measured)?;
        let mut worst: Option<f64> = None;
        for row in rows.iter().filter(|row| row["collapsed"] == 1.0) {
            let level = row["level"].as_u64().ok_or(ReportError::Measured)?;
            let clusters = row["clusters"].as_u64();
            let found = self.levels.iter_mut().find(|own| u64::from(own.level) == level);
            let own = found.filter(|own| Some(u64::from(own.clusters)) <= clusters);
            let own = own.ok_or(ReportError::OtherFile { level })?;
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
