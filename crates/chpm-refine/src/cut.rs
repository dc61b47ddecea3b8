//! A cut of the cluster hierarchy with a PM position for every cluster, and the uniform ways to choose one.

use crate::error::RefineError;
use crate::hierarchy::Hierarchy;
use crate::lod::Lod;
use crate::remnants::Beside;
use crate::select::{select_by, select_where};
use crate::splits::{Splits, parents, top_down};
use chpm_format::{Chpm, ClusterRecord, PageBuf};
use chpm_mesh::{ClusterId, GroupId, Level, TriMesh};

/// One cluster of a cut.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct Member {
    /// The cluster that is drawn.
    pub cluster: ClusterId,
    /// Its PM position: the number of vertices, from the base mesh's to the finest mesh's.
    pub vertices: u32,
}

impl Member {
    /// Answers the record of a cluster that is in the file, at a position that it has.
    fn record<'a, D: AsRef<[u8]>>(&self, file: &'a Chpm<D>) -> Result<&'a ClusterRecord, RefineError> {
        let &Member { cluster, vertices: got } = self;
        let count = file.clusters().len();
        let record = file.clusters().get(cluster.index()).ok_or(RefineError::Cluster { cluster, count })?;
        let (min, max) = (record.base_vertex_count, record.vertex_count);
        if (min..=max).contains(&got) {
            Ok(record)
        } else {
            Err(RefineError::Position { cluster, got, min, max })
        }
    }

    /// How far the source is from what the member draws, where that is nearest, and that from the source, at most; object units.
    ///
    /// # Errors
    /// [`RefineError::Cluster`] or [`RefineError::Position`] if the file lacks it; [`RefineError::Format`] for a damaged page.
    pub fn distance<D: AsRef<[u8]>>(&self, file: &Chpm<D>) -> Result<f32, RefineError> {
        let record = self.record(file)?;
        let error = file.page(self.cluster)?.view().error_at(self.vertices as usize);
        Ok(file.gaps(record.group()).distance(error))
    }

    /// Answers the page of a cluster that is in the file, at a position that it has.
    pub(crate) fn page<'a, D: AsRef<[u8]>>(&self, file: &'a Chpm<D>) -> Result<PageBuf<'a>, RefineError> {
        self.record(file)?;
        Ok(file.page(self.cluster)?)
    }
}

/// Which clusters are drawn, and at which positions: what a view, or a uniform rule, selects from the hierarchy
/// (Quick-VDR 5.1, the active cluster list).
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Cut {
    members: Vec<Member>,
    /// Remnants beside them; none where gaps tell how far anything is that is missing.
    beside: Option<Beside>,
}

impl Cut {
    /// A cut of these members; [`Cut::check`] tells whether it is legal.
    pub fn new(mut members: Vec<Member>) -> Self {
        members.sort_unstable();
        Cut { members, beside: None }
    }

    /// The members, by ascending cluster id.
    pub fn members(&self) -> &[Member] {
        &self.members
    }

    /// Numbers of the remnants that are drawn beside the members, ascending: triangles of components that these do not draw and that lie too far from them.
    pub fn remnants(&self) -> &[u32] {
        self.beside.as_ref().map_or(&[], |beside| &beside.drawn)
    }

    /// The triangles of [`Cut::remnants`], each with vertices of its own, normals decoded; relative to the header's origin.
    ///
    /// # Errors
    /// [`RefineError::Remnant`] for one that the file lacks; [`RefineError::Format`] for a damaged page.
    pub fn remnant_mesh<D: AsRef<[u8]>>(&self, file: &Chpm<D>) -> Result<TriMesh, RefineError> {
        self.check_remnants(file)?;
        self.beside.as_ref().map_or_else(|| Ok(TriMesh::default()), |beside| beside.mesh(file))
    }

    fn check_remnants<D: AsRef<[u8]>>(&self, file: &Chpm<D>) -> Result<(), RefineError> {
        let count = file.remnants().len();
        match self.remnants().last() {
            Some(number) if *number as usize >= count => Err(RefineError::Remnant { number: *number, count }),
            _ => Ok(()),
        }
    }

    /// The finest meshes of all clusters up to `level` that no cluster up to `level` replaces. Level 0 is the finest mesh, a
    /// level at or above the top the roots. Where only some members of a group are replaced, the others are at their base meshes,
    /// as the group borders between them are.
    pub fn at_level<D: AsRef<[u8]>>(file: &Chpm<D>, level: Level) -> Self {
        let splits = Splits::wanted(file, &top_down(file), |_, group| group.level > level.0);
        Cut {
            members: splits
                .active(file)
                .map(|(cluster, record)| {
                    let beside = parents(file, record.group()).any(|above| !splits.is_split(above));
                    let vertices = if beside { record.base_vertex_count } else { record.vertex_count };
                    Member { cluster, vertices }
                })
                .collect(),
            beside: None,
        }
    }

    /// The coarsest mesh whose every part has a stored error of at most `bound`, in object units: a group is split
    /// if its `min_error` is larger, and its clusters have the fewest vertices that keep to the bound. Where even the leaves
    /// have a larger error, it is their finest meshes. What has vanished counts by its size, as in pictures.
    ///
    /// # Errors
    /// [`RefineError::Bound`] unless `bound` is at least 0; [`RefineError::Format`] for a damaged page.
    pub fn at_error<D: AsRef<[u8]>>(file: &Chpm<D>, bound: f32) -> Result<Self, RefineError> {
        if bound.is_nan() || bound < 0.0 {
            return Err(RefineError::Bound { got: bound });
        }
        select_by(file, &Hierarchy::new(file), |_| bound)
    }

    /// The coarsest mesh of which no part is farther from the source than `distance`, nor any point of the source from it, in object units;
    /// nothing is exempt. Where even the leaves are farther, it is their finest meshes. Where the file has remnants, those of components that would be
    /// farther are drawn, so that a speck costs a triangle.
    ///
    /// # Errors
    /// As [`Cut::at_error`].
    pub fn at_distance<D: AsRef<[u8]>>(file: &Chpm<D>, distance: f32) -> Result<Self, RefineError> {
        Self::at_distance_while(file, distance, || Ok(()))
    }

    /// As [`Cut::at_distance`], by what is stored of the surface, while components that have vanished keep to another, smaller distance where remnants
    /// can do that: for whoever proves the rest.
    ///
    /// # Errors
    /// As [`Cut::at_error`].
    pub fn at_distances<D: AsRef<[u8]>>(
        file: &Chpm<D>,
        distance: f32,
        of_specks: f32,
    ) -> Result<Self, RefineError> {
        Self::by_distances(file, [distance, of_specks], || Ok(()))
    }

    /// As [`Cut::at_distance`], asking before each page is read whether to go on.
    pub(crate) fn at_distance_while<D: AsRef<[u8]>, E: From<RefineError>>(
        file: &Chpm<D>,
        distance: f32,
        go_on: impl FnMut() -> Result<(), E>,
    ) -> Result<Self, E> {
        Self::by_distances(file, [distance; 2], go_on)
    }

    fn by_distances<D: AsRef<[u8]>, E: From<RefineError>>(
        file: &Chpm<D>,
        [distance, of_specks]: [f32; 2],
        mut go_on: impl FnMut() -> Result<(), E>,
    ) -> Result<Self, E> {
        if let Some(got) = [distance, of_specks].into_iter().find(|d| d.is_nan() || *d < 0.0) {
            return Err(RefineError::Bound { got }.into());
        }
        let hierarchy = Hierarchy::new(file);
        if file.has_remnants() {
            return Self::with_remnants(file, &hierarchy, [distance, of_specks], go_on);
        }
        let bound = |group| file.gaps(group).error_within(distance);
        // What has vanished below a group comes back by a split only, what vanishes in it by a smaller error, if it has that. Gaps grow upward
        // like errors, so that whoever has to be split has only groups above that have to be.
        select_where(
            file,
            &hierarchy,
            |group| file.gaps(group).fine > distance || hierarchy.wants(group, bound(group)),
            bound,
            |cluster, bound| {
                go_on()?;
                Ok(position(file, cluster, bound)?)
            },
        )
    }

    /// Components that have vanished are drawn by their remnants, or come back by a split where they have none; at leaves, where nothing is left to split,
    /// by a smaller error, as by gaps.
    fn with_remnants<D: AsRef<[u8]>, E: From<RefineError>>(
        file: &Chpm<D>,
        hierarchy: &Hierarchy,
        [distance, of_specks]: [f32; 2],
        mut go_on: impl FnMut() -> Result<(), E>,
    ) -> Result<Self, E> {
        let is_far = |group: GroupId| file.groups()[group.index()].rest > distance;
        let mut cut = select_where(
            file,
            hierarchy,
            |group| is_far(group) || hierarchy.wants(group, distance),
            |group| if is_far(group) { file.gaps(group).error_within(distance) } else { distance },
            |cluster, bound| -> Result<Member, E> {
                go_on()?;
                Ok(position(file, cluster, bound)?)
            },
        )?;
        cut.beside = Some(Beside::within(file, &cut.members, of_specks, go_on)?);
        Ok(cut)
    }

    /// Triangles of the cut.
    ///
    /// # Errors
    /// [`RefineError::Cluster`] or [`RefineError::Position`] for a member that the file lacks;
    /// [`RefineError::Format`] for a damaged page.
    pub fn triangle_count<D: AsRef<[u8]>>(&self, file: &Chpm<D>) -> Result<u64, RefineError> {
        let mut lod = Lod::default();
        let clusters = self.members.iter().map(|member| count_triangles(file, *member, &mut lod));
        Ok(clusters.sum::<Result<u64, _>>()? + self.remnants().len() as u64)
    }

    /// The largest stored error of a member or remnant, object units; 0 for the empty cut.
    ///
    /// # Errors
    /// As [`Cut::triangle_count`].
    pub fn error<D: AsRef<[u8]>>(&self, file: &Chpm<D>) -> Result<f32, RefineError> {
        self.check_remnants(file)?;
        let remnants = self.remnants().iter().map(|number| file.remnants()[*number as usize].bound);
        self.members.iter().try_fold(remnants.fold(0.0, f32::max), |largest: f32, member| {
            Ok(largest.max(member.page(file)?.view().error_at(member.vertices as usize)))
        })
    }

    /// How far the source is from what a member at a position of this error draws, where that is nearest, and that from the source, at most; object
    /// units. Components that have vanished count here.
    pub(crate) fn distance_of<D: AsRef<[u8]>>(&self, file: &Chpm<D>, member: &Member, error: f32) -> f32 {
        let group = file.clusters()[member.cluster.index()].group();
        let gaps = file.gaps(group);
        match &self.beside {
            // Where less is missing, gaps are the smaller.
            Some(beside) => {
                error.max(file.groups()[group.index()].rest.min(gaps.at(error))).max(beside.far())
            }
            None => gaps.distance(error),
        }
    }

    /// The distance of each member, as [`Member::distance`] tells it where nothing is drawn beside them.
    ///
    /// # Errors
    /// As [`Cut::triangle_count`].
    pub fn distances<D: AsRef<[u8]>>(&self, file: &Chpm<D>) -> Result<Vec<f32>, RefineError> {
        let distance = |member: &Member| {
            let error = member.page(file)?.view().error_at(member.vertices as usize);
            Ok(self.distance_of(file, member, error))
        };
        self.members.iter().map(distance).collect()
    }

    /// How far the source is from the cut and the cut from the source, at most: the largest stored error or gap of a member, object units; 0
    /// for the empty cut.
    ///
    /// # Errors
    /// As [`Cut::triangle_count`].
    pub fn distance<D: AsRef<[u8]>>(&self, file: &Chpm<D>) -> Result<f32, RefineError> {
        Ok(self.distances(file)?.into_iter().fold(0.0, f32::max))
    }

    /// Checks that the members are in the file, at positions that they have, and that together they are a cut: every leaf
    /// is covered exactly once, by itself or by what replaces it, and no dependency group is split in part.
    /// Reads no page.
    ///
    /// # Errors
    /// [`RefineError::Cluster`], [`RefineError::Position`] or [`RefineError::Illegal`], for the first cluster that is wrong.
    pub fn check<D: AsRef<[u8]>>(&self, file: &Chpm<D>) -> Result<(), RefineError> {
        self.check_remnants(file)?;
        for member in &self.members {
            member.record(file)?;
        }
        let splits = Splits::that_bring(file, self.members.iter().map(|member| member.cluster));
        let mut members = self.members.iter().peekable();
        for (cluster, record) in (0..).map(ClusterId).zip(file.clusters()) {
            let expected = usize::from(splits.is_active(record));
            let mut got = 0;
            while members.next_if(|member| member.cluster == cluster).is_some() {
                got += 1;
            }
            if got != expected {
                return Err(RefineError::Illegal { cluster, expected, got });
            }
        }
        Ok(())
    }
}

/// The cluster with the fewest vertices whose error is at most `bound`.
pub(crate) fn position<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    cluster: ClusterId,
    bound: f32,
) -> Result<Member, RefineError> {
    let vertices = file.page_viewed(cluster)?.view().vertices_for(bound) as u32;
    Ok(Member { cluster, vertices })
}

pub(crate) fn count_triangles<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    member: Member,
    lod: &mut Lod,
) -> Result<u64, RefineError> {
    let record = member.record(file)?;
    if member.vertices == record.vertex_count {
        return Ok(u64::from(record.triangle_count));
    }
    let page = file.page(member.cluster)?;
    Ok(lod.count(&page.view().progressive_mesh(), member.vertices as usize) as u64)
}
