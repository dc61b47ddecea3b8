//! The stateless selection: the cut of a view, from the tables and that view alone.

use crate::cut::{Cut, Member, position};
use crate::error::RefineError;
use crate::hierarchy::Hierarchy;
use crate::splits::Splits;
use crate::view::View;
use chpm_format::{Chpm, ClusterRecord};
use chpm_mesh::{ClusterId, GroupId};

/// Selects what a view needs: a group is split if and only if its error is above the bound that the view allows in the group's
/// sphere; every cluster has the fewest vertices that keep to the bound of its group (Quick-VDR 5.1, without
/// forced splits). Any view gives a legal cut without cracks.
///
/// # Errors
/// [`RefineError::Format`] for a damaged page.
pub fn select<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    hierarchy: &Hierarchy,
    view: &View,
) -> Result<Cut, RefineError> {
    select_while(file, hierarchy, view, || Ok(()))
}

/// As [`select`], asking before each page is read whether to go on.
pub(crate) fn select_while<D: AsRef<[u8]>, E: From<RefineError>>(
    file: &Chpm<D>,
    hierarchy: &Hierarchy,
    view: &View,
    mut go_on: impl FnMut() -> Result<(), E>,
) -> Result<Cut, E> {
    let bound = |group| hierarchy.bound(group, view);
    select_where(
        file,
        hierarchy,
        |group| hierarchy.wants(group, bound(group)),
        bound,
        |cluster, bound| {
            go_on()?;
            Ok(position(file, cluster, bound)?)
        },
    )
}

/// Selects by an error-bound for every group, whatever they are. Where a group wants to be split and one above it does not, it
/// is not; the clusters of a group that is there in part are at their base meshes, as what replaces the others is: so
/// the cut is legal and without cracks nevertheless.
///
/// # Errors
/// As [`select`].
pub fn select_by<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    hierarchy: &Hierarchy,
    bound: impl Fn(GroupId) -> f32,
) -> Result<Cut, RefineError> {
    select_where(
        file,
        hierarchy,
        |group| hierarchy.wants(group, bound(group)),
        &bound,
        |cluster, bound| position(file, cluster, bound),
    )
}

/// The same, with the groups that want to be split named apart from the bounds that the others are drawn by, and with whoever tells the
/// position of a cluster for a bound.
pub(crate) fn select_where<D: AsRef<[u8]>, E>(
    file: &Chpm<D>,
    hierarchy: &Hierarchy,
    wants: impl Fn(GroupId) -> bool,
    bound: impl Fn(GroupId) -> f32,
    mut position: impl FnMut(ClusterId, f32) -> Result<Member, E>,
) -> Result<Cut, E> {
    let splits = Splits::wanted(file, hierarchy.top_down(), |group, _| wants(group));
    let members = splits.active(file).map(|(cluster, record)| {
        let group = record.group();
        let bound = if splits.is_whole(file, group) { bound(group) } else { f32::INFINITY };
        position(cluster, bound)
    });
    Ok(Cut::new(members.collect::<Result<_, _>>()?))
}

/// Whether a cluster can be in the image: its box is not wholly outside one plane of the frustum.
pub fn is_visible(cluster: &ClusterRecord, view: &View) -> bool {
    view.holds(&cluster.sphere()) || !view.misses_box(&cluster.aabb())
}
