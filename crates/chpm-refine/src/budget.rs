//! The best mesh of at most so many triangles: the least error that all of it can have alike, and then the worst of it first, until
//! the triangles are used up.

use crate::cut::{Cut, count_within};
use crate::error::RefineError;
use crate::fill::Fill;
use crate::hierarchy::Hierarchy;
use crate::lod::Lod;
use crate::select::select_by;
use crate::splits::Splits;
use crate::view::View;
use chpm_format::{Chpm, ClusterRecord};
use chpm_mesh::GroupId;

impl Cut {
    /// The mesh of at most `limit` triangles: of the least uniform error that keeps to it, and then refined further, the largest stored
    /// errors first, as far as triangles are left; so none of it has a larger error, and no more than a few triangles are left where the
    /// source has enough. It is the roots' base meshes where even those have more, which [`Cut::triangle_count`] tells.
    ///
    /// # Errors
    /// [`RefineError::Format`] for a damaged page.
    pub fn at_triangles<D: AsRef<[u8]>>(file: &Chpm<D>, limit: u64) -> Result<Self, RefineError> {
        let hierarchy = Hierarchy::new(file);
        let search = Search { file, hierarchy: &hierarchy, bound: |_, error| error };
        search.best(limit, |_, error| Some(f64::from(error)))
    }
}

/// The mesh of at most `limit` triangles for a view, whose own pixels of error do not matter: of the fewest pixels everywhere that keep to
/// the limit, and then refined further where its errors cover most pixels, as far as triangles are left. What the view culls stays as coarse as
/// it gets.
///
/// # Errors
/// [`RefineError::Format`] for a damaged page.
pub fn select_triangles<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    hierarchy: &Hierarchy,
    view: &View,
    limit: u64,
) -> Result<Cut, RefineError> {
    let bound = |group, pixels: f32| hierarchy.bound(group, &view.with_pixels(f64::from(pixels)));
    let pixels = |group, error| {
        let region = hierarchy.region(group);
        (!view.culls(region)).then(|| view.pixels_of(error, region))
    };
    Search { file, hierarchy, bound }.best(limit, pixels)
}

/// Cuts by one number, with which the bounds of all groups grow.
struct Search<'a, D, B> {
    file: &'a Chpm<D>,
    hierarchy: &'a Hierarchy,
    bound: B,
}

impl<D: AsRef<[u8]>, B: Fn(GroupId, f32) -> f32> Search<'_, D, B> {
    /// The cut of the least number that has at most `limit` triangles, refined where `weight` tells until they are used up.
    fn best(&self, limit: u64, weight: impl Fn(GroupId, f32) -> Option<f64>) -> Result<Cut, RefineError> {
        let mut lod = Lod::default();
        // Numbers that are not negative order as their bits do. Triangles fall with the number.
        let (mut low, mut high) = (0, f32::MAX.to_bits());
        while low < high {
            let middle = low + (high - low) / 2;
            if self.fits(f32::from_bits(middle), limit, &mut lod)? {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        let least = f32::from_bits(high);
        let cut = if self.fits(least, limit, &mut lod)? {
            select_by(self.file, self.hierarchy, |group| (self.bound)(group, least))?
        } else {
            // A camera in the middle of it all allows no error there, whatever the number.
            select_by(self.file, self.hierarchy, |_| f32::INFINITY)?
        };
        Fill::new(self.file, cut, limit, weight)?.run()
    }

    /// Whether the cut of a number has at most `limit` triangles.
    fn fits(&self, number: f32, limit: u64, lod: &mut Lod) -> Result<bool, RefineError> {
        let (file, bound) = (self.file, |group| (self.bound)(group, number));
        let wants = |group, _: &_| self.hierarchy.wants(group, bound(group));
        let splits = Splits::wanted(file, self.hierarchy.top_down(), wants);
        let total = |count: fn(&ClusterRecord) -> u32| -> u64 {
            splits.active(file).map(|(_, cluster)| u64::from(count(cluster))).sum()
        };
        // The tables alone decide wherever the number selects far more or far fewer triangles.
        if total(|cluster| cluster.triangle_count) <= limit {
            return Ok(true);
        }
        let mut least = total(|cluster| cluster.base_triangle_count);
        for (cluster, record) in splits.active(file) {
            if least > limit {
                return Ok(false);
            }
            let group = record.group();
            let bound = if splits.is_whole(file, group) { bound(group) } else { f32::INFINITY };
            let count = count_within(file, cluster, bound, lod)?;
            least += count.saturating_sub(u64::from(record.base_triangle_count));
        }
        Ok(least <= limit)
    }
}
