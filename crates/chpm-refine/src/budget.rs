//! The best mesh of at most so many triangles: the least error that all of it can have alike, and then the worst of it first, until
//! the triangles are used up.

use crate::cut::{Cut, Member};
use crate::error::RefineError;
use crate::fill::Fill;
use crate::hierarchy::Hierarchy;
use crate::profile::Profiles;
use crate::select::select_where;
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
        best_anywhere(file, limit, ROOM, || Ok(()))
    }
}

/// Bytes for what is kept of clusters while a cut is chosen, where the caller names none.
const ROOM: u64 = 4 << 20;

/// As [`Cut::at_triangles`], keeping so many bytes about clusters, and asking before each page is read whether to go on.
pub(crate) fn best_anywhere<D: AsRef<[u8]>, E: From<RefineError>>(
    file: &Chpm<D>,
    limit: u64,
    room: u64,
    go_on: impl FnMut() -> Result<(), E>,
) -> Result<Cut, E> {
    let hierarchy = Hierarchy::new(file);
    let profiles = Profiles::new(file, room, go_on);
    let search = BudgetSearch { file, hierarchy: &hierarchy, bound: |_, error| error, profiles };
    search.best(limit, |_, error| Some(f64::from(error)))
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
    best_in_view(file, hierarchy, view, limit, ROOM, || Ok(()))
}

/// As [`select_triangles`], keeping and asking as [`best_anywhere`] does.
pub(crate) fn best_in_view<D: AsRef<[u8]>, E: From<RefineError>>(
    file: &Chpm<D>,
    hierarchy: &Hierarchy,
    view: &View,
    limit: u64,
    room: u64,
    go_on: impl FnMut() -> Result<(), E>,
) -> Result<Cut, E> {
    let bound = |group, pixels: f32| hierarchy.bound(group, &view.with_pixels(f64::from(pixels)));
    let profiles = Profiles::new(file, room, go_on);
    BudgetSearch { file, hierarchy, bound, profiles }.best(limit, |group, error| {
        let region = hierarchy.region(group);
        (!view.culls(region)).then(|| view.pixels_of(error, region))
    })
}

/// Cuts by one number, with which the bounds of all groups grow.
struct BudgetSearch<'a, D, B, G> {
    file: &'a Chpm<D>,
    hierarchy: &'a Hierarchy,
    bound: B,
    profiles: Profiles<'a, D, G>,
}

impl<D, E, B, G> BudgetSearch<'_, D, B, G>
where
    D: AsRef<[u8]>,
    E: From<RefineError>,
    B: Fn(GroupId, f32) -> f32,
    G: FnMut() -> Result<(), E>,
{
    /// The cut of the least number that has at most `limit` triangles, refined where `weight` tells until they are used up.
    fn best(mut self, limit: u64, weight: impl Fn(GroupId, f32) -> Option<f64>) -> Result<Cut, E> {
        // Numbers that are not negative order as their bits do. Triangles fall with the number.
        let (mut low, mut high) = (0, f32::MAX.to_bits());
        while low < high {
            let middle = low + (high - low) / 2;
            if self.fits(f32::from_bits(middle), limit)? {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        let least = f32::from_bits(high);
        // A camera in the middle of it all allows no error there, whatever the number.
        let fits = self.fits(least, limit)?;
        let BudgetSearch { file, hierarchy, bound, mut profiles } = self;
        let bound = |group| if fits { bound(group, least) } else { f32::INFINITY };
        let wants = |group| hierarchy.wants(group, bound(group));
        let cut = select_where(file, hierarchy, wants, bound, |cluster, bound| {
            Ok::<_, E>(Member { cluster, vertices: profiles.of(cluster)?.vertices_for(bound) as u32 })
        })?;
        Fill::new(file, cut, limit, weight, profiles)?.run()
    }

    /// Whether the cut of a number has at most `limit` triangles.
    fn fits(&mut self, number: f32, limit: u64) -> Result<bool, E> {
        let (file, bound) = (self.file, |group| (self.bound)(group, number));
        let splits = Splits::wanted(file, self.hierarchy.top_down(), |group, _: &_| {
            self.hierarchy.wants(group, bound(group))
        });
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
            let mut meshes = self.profiles.of(cluster)?;
            let count = meshes.triangles(meshes.vertices_for(bound));
            least += count.saturating_sub(u64::from(record.base_triangle_count));
        }
        Ok(least <= limit)
    }
}
