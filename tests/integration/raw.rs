//! A `.chpm` file read by its bytes alone, as FORMAT.md says: nothing of the reader under test takes part.

/// The file's bytes.
pub(crate) struct Raw(pub(crate) Vec<u8>);

/// A record of CLUSTERS, and what its page holds.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cluster {
    pub(crate) page_len: u32,
    pub(crate) level: u32,
    pub(crate) vertices: u32,
    pub(crate) base_vertices: u32,
    pub(crate) triangle_count: u32,
    pub(crate) base_triangles: u32,
    pub(crate) shared: u32,
    pub(crate) group: u32,
    pub(crate) parent: u32,
    pub(crate) errors: [f32; 2],
    pub(crate) low: [f32; 3],
    pub(crate) high: [f32; 3],
    pub(crate) normal_deviation: f32,
    pub(crate) shared_ids: Vec<u32>,
    pub(crate) triangles: Vec<[u16; 3]>,
}

/// A record of GROUPS.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    pub(crate) coarse: u32,
    pub(crate) fine: Vec<u32>,
    pub(crate) level: u32,
}

impl Raw {
    pub(crate) fn u16(&self, at: usize) -> u16 {
        u16::from_le_bytes(self.0[at..at + 2].try_into().expect("two bytes"))
    }

    pub(crate) fn u32(&self, at: usize) -> u32 {
        u32::from_le_bytes(self.0[at..at + 4].try_into().expect("four bytes"))
    }

    pub(crate) fn u64(&self, at: usize) -> u64 {
        u64::from_le_bytes(self.0[at..at + 8].try_into().expect("eight bytes"))
    }

    pub(crate) fn f32(&self, at: usize) -> f32 {
        f32::from_bits(self.u32(at))
    }

    fn point(&self, at: usize) -> [f32; 3] {
        [0, 4, 8].map(|more| self.f32(at + more))
    }

    /// Where a section begins, its length and its records.
    pub(crate) fn section(&self, kind: u32) -> (usize, u64, u64) {
        let entries = (0..self.u32(32) as usize).map(|entry| 256 + 40 * entry);
        let at = entries.into_iter().find(|at| self.u32(*at) == kind).expect("the section");
        (self.u64(at + 8) as usize, self.u64(at + 16), self.u64(at + 24))
    }

    fn records(&self, kind: u32, len: usize) -> Vec<usize> {
        let (start, _, count) = self.section(kind);
        (0..count as usize).map(|record| start + len * record).collect()
    }

    /// All clusters; those of packed files without what the pages hold.
    pub(crate) fn clusters(&self) -> Vec<Cluster> {
        let packed = self.u32(16) & 1 == 1;
        let cluster = |at: usize| {
            let mut cluster = Cluster {
                page_len: self.u32(at + 8),
                level: self.u32(at + 12),
                vertices: self.u32(at + 16),
                base_vertices: self.u32(at + 20),
                triangle_count: self.u32(at + 24),
                base_triangles: self.u32(at + 28),
                shared: self.u32(at + 32),
                group: self.u32(at + 36),
                parent: self.u32(at + 40),
                errors: [self.f32(at + 48), self.f32(at + 52)],
                low: self.point(at + 56),
                high: self.point(at + 68),
                normal_deviation: self.f32(at + 104),
                ..Cluster::default()
            };
            if !packed {
                self.read_page(self.u64(at) as usize, &mut cluster);
            }
            cluster
        };
        self.records(1, 128).into_iter().map(cluster).collect()
    }

    fn read_page(&self, page: usize, cluster: &mut Cluster) {
        let attributes = self.u16(page + 6);
        let each = 12 + 12 * usize::from(attributes & 1) + 4 * usize::from(attributes >> 1 & 1);
        let ids = page + 64 + each * cluster.vertices as usize;
        let triangles = ids + 4 * cluster.shared as usize;
        cluster.shared_ids = (0..cluster.shared as usize).map(|i| self.u32(ids + 4 * i)).collect();
        let corners = |t: usize| [0, 2, 4].map(|corner| self.u16(triangles + 6 * t + corner));
        cluster.triangles = (0..cluster.triangle_count as usize).map(corners).collect();
    }

    pub(crate) fn groups(&self) -> Vec<Group> {
        let members = self.section(3).0;
        let group = |at: usize| {
            let (first, count) = (self.u32(at + 8) as usize, self.u32(at + 12) as usize);
            let fine = (first..first + count).map(|i| self.u32(members + 4 * i)).collect();
            Group { coarse: self.u32(at + 4), fine, level: self.u32(at + 16) }
        };
        self.records(2, 64).into_iter().map(group).collect()
    }

    /// Where the records of LEVELS are.
    pub(crate) fn levels(&self) -> Vec<usize> {
        self.records(4, 128)
    }
}
