//! Everything of a file but its pages, as a builder hands it to the writer.

use crate::chunks::{self, CHUNKED};
use crate::error::{FilePart, FormatError, invalid, require, require_eq};
use crate::gaps::Gaps;
use crate::header::{
    BoundaryMode, CHAINED_PAGES, ErrorKind, HEADER_LEN, Header, MAGIC, NAMED_SCALARS, OCTAHEDRAL_NORMALS,
    PACKED_PAGES, SHEETS, VERSION_MAJOR, VOLUMES, page_align,
};
use crate::metadata::Metadata;
use crate::reader::Chpm;
use crate::records::{ClusterRecord, GroupRecord, LevelRecord};
use crate::remnant::{self, Remnant};
use crate::section::{SectionEntry, SectionKind};
use crate::sheet::{self, SheetRecord};
use crate::structure::{Structure, member_range, place_pages};
use crate::volume::{self, Unit, VolumeRecord};
use crate::{align_up, checksum, scalars};
use bytemuck::Zeroable;
use chpm_mesh::{Aabb, Attributes, ClusterId, GroupId, Scalar};
use std::mem;

/// Fields of the header that the tables do not tell.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct HeaderFields {
    /// Attributes of the vertices.
    pub attributes: Attributes,
    /// Vertices that leaf triangles use, each counted once.
    pub source_vertex_count: u64,
    /// How boundaries were treated.
    pub boundary_mode: BoundaryMode,
    /// Meaning of the errors.
    pub error_kind: ErrorKind,
    /// Number of shared vertex ids.
    pub shared_vertex_count: u32,
    /// Stored positions are relative to this point.
    pub origin: [f64; 3],
    /// Pages may be packed.
    pub packed: bool,
    /// Packed pages may be chained.
    pub chained: bool,
    /// Chunks of the tables have checksums of their own, for [`crate::RemoteChpm`]. The roots must then be the first clusters.
    pub chunked: bool,
    /// Most bytes of a volume's file; none where pages are in the file itself.
    pub volume_size: Option<u64>,
}

impl HeaderFields {
    /// Required flags of a file that has this, and the first minor version that has it.
    fn needs(&self) -> (u32, u16) {
        let Attributes { octahedral, scalar_words, .. } = self.attributes;
        let flags = [
            (self.packed, PACKED_PAGES),
            (octahedral, OCTAHEDRAL_NORMALS),
            (scalar_words > 0, NAMED_SCALARS),
            (self.chained, CHAINED_PAGES),
            (self.volume_size.is_some(), VOLUMES),
        ];
        let flags = flags.into_iter().filter(|(is_needed, _)| *is_needed).map(|(_, flag)| flag).sum();
        match () {
            () if scalar_words > 0 => (flags, 4),
            () if octahedral || self.chunked => (flags, 3),
            () if self.packed => (flags, 2),
            () => (flags, 1),
        }
    }
}

/// The tables of a file to be. [`crate::ChpmWriter::begin`] completes and checks them.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Tables {
    /// Fields that the other tables do not tell.
    pub header: HeaderFields,
    /// Clusters, in the order of their pages; `page_offset` is filled in.
    pub clusters: Vec<ClusterRecord>,
    /// Dependency groups.
    pub groups: Vec<GroupRecord>,
    /// Cluster ids that the groups name by ranges; every range is put in ascending order.
    pub members: Vec<u32>,
    /// Levels from the leaves up; all statistics that follow from the clusters are filled in.
    pub levels: Vec<LevelRecord>,
    /// Provenance.
    pub metadata: Metadata,
    /// Names and ranges of the scalars that vertices have.
    pub scalars: Vec<Scalar>,
    /// Remnants of components that vanish; put in order when the tables are encoded.
    pub remnants: Vec<Remnant>,
    /// Sheets, one a cluster in the order of the clusters, or none; `cluster` and `offset` are filled in.
    pub sheets: Vec<SheetRecord>,
}

impl Tables {
    /// The tables of a file, to write it anew. The source's detail that vanished is unknown to a file of version 1.0, and stays so.
    ///
    /// # Errors
    /// [`FormatError::Metadata`] where the metadata does not decode; a header that [`Chpm::open`] would have refused.
    pub fn of<D: AsRef<[u8]>>(file: &Chpm<D>) -> Result<Self, FormatError> {
        let header = file.header();
        let known = |field| move || invalid(FilePart::Header, field, "a code that is known", "another");
        let groups = (0..).map(GroupId).zip(file.groups());

        Ok(Tables {
            header: HeaderFields {
                attributes: header.attributes(),
                source_vertex_count: header.source_vertex_count,
                boundary_mode: header.boundary_mode().ok_or_else(known("boundary_mode"))?,
                error_kind: header.error_kind().ok_or_else(known("error_kind"))?,
                shared_vertex_count: header.shared_vertex_count,
                origin: header.origin,
                packed: header.is_packed(),
                chained: header.is_chained(),
                chunked: file.is_chunked(),
                // Into how large files its pages are to go is the writer's to say.
                volume_size: None,
            },
            clusters: file.clusters().to_vec(),
            groups: groups.map(|(id, group)| GroupRecord { gaps: known_gaps(file, id), ..*group }).collect(),
            members: file.members().to_vec(),
            levels: file.levels().to_vec(),
            metadata: file.metadata()?,
            scalars: file.scalars().to_vec(),
            remnants: file.remnants().to_vec(),
            sheets: file.sheets().to_vec(),
        })
    }

    /// Puts the clusters in another order: `order` has the ids of today, each once, in the order to come. Their pages and sheets are to follow.
    ///
    /// # Panics
    /// If an id is not that of a cluster.
    pub fn reorder(&mut self, order: &[ClusterId]) {
        let mut place = vec![0; self.clusters.len()];
        for (new, old) in (0..).zip(order) {
            place[old.index()] = new;
        }
        self.clusters = order.iter().map(|old| self.clusters[old.index()]).collect();
        if !self.sheets.is_empty() {
            self.sheets = order.iter().map(|old| self.sheets[old.index()]).collect();
            sheet::place(&mut self.sheets);
        }
        self.members.iter_mut().for_each(|id| *id = place[*id as usize]);
        self.remnants.iter_mut().for_each(|remnant| remnant.cluster = place[remnant.cluster().index()]);
    }

    /// Where the first page starts, for whoever writes pages before their lengths are known: each then follows at the next multiple of
    /// the alignment.
    ///
    /// # Errors
    /// Metadata above the limit.
    pub fn first_page_offset(&self) -> Result<u64, FormatError> {
        Ok(self.pages_offset(self.metadata.encode()?.len() as u64))
    }

    /// Length of the file to be, bytes.
    ///
    /// # Errors
    /// Metadata above the limit, or a file of 2^64 bytes.
    pub fn file_len(&self) -> Result<u64, FormatError> {
        let mut end = self.pages_offset(self.metadata.encode()?.len() as u64);
        end = place_pages(
            end,
            page_align(self.header.packed),
            self.clusters.iter().map(|c| c.page_len),
            |_, _| Ok(()),
        )?;
        Ok(end)
    }

    /// Places pages and sheets by their lengths alone, for a builder that writes them in any order before the rest of their
    /// records is known. Answers the file's length.
    ///
    /// # Errors
    /// As [`Tables::file_len`].
    pub fn assign_offsets(&mut self) -> Result<u64, FormatError> {
        sheet::place(&mut self.sheets);
        let start = self.pages_offset(self.metadata.encode()?.len() as u64);
        let lens: Vec<u32> = self.clusters.iter().map(|c| c.page_len).collect();
        place_pages(start, page_align(self.header.packed), lens, |index, offset| {
            self.clusters[index].page_offset = offset;
            Ok(())
        })
    }

    /// Where the first sheet is to be; where the first page is without any.
    ///
    /// # Errors
    /// Metadata above the limit.
    pub fn first_sheet_offset(&self) -> Result<u64, FormatError> {
        let pages = self.first_page_offset()?;
        if self.sheets.is_empty() {
            return Ok(pages);
        }
        let metadata_len = self.metadata.encode()?.len() as u64;
        let kinds = self.kinds().filter(|kind| !matches!(kind, SectionKind::Texels | SectionKind::Pages));
        let tables_end = self.end_of(kinds, metadata_len);
        Ok(self.aligned(tables_end, SectionKind::Texels))
    }

    /// Volumes of the file to be, which their lengths of pages and sheets decide; none where pages are in the file itself.
    ///
    /// # Errors
    /// A size that a page or sheet does not fit, or of which there would be too many; as [`Tables::file_len`].
    pub fn volumes(&self) -> Result<Vec<VolumeRecord>, FormatError> {
        let start = if self.header.volume_size.is_some() { self.first_sheet_offset()? } else { 0 };
        let mut volumes = self.volumes_from_zero()?;
        volumes.iter_mut().for_each(|volume| volume.offset += start);
        Ok(volumes)
    }

    /// The same, with the first at 0: how many there are decides where it begins.
    fn volumes_from_zero(&self) -> Result<Vec<VolumeRecord>, FormatError> {
        let Some(size) = self.header.volume_size else { return Ok(Vec::new()) };
        let mut sheets = self.sheets.clone();
        sheet::place(&mut sheets);
        let of_sheet = |sheet: &SheetRecord| Unit { offset: sheet.offset, checksum: sheet.checksum };
        let mut units: Vec<Unit> = sheets.iter().map(of_sheet).collect();
        let pages = self.aligned(sheet::texels_len(&sheets), SectionKind::Pages);
        let lens = self.clusters.iter().map(|cluster| cluster.page_len);
        let end = place_pages(pages, page_align(self.header.packed), lens, |index, offset| {
            units.push(Unit { offset, checksum: self.clusters[index].page_checksum });
            Ok(())
        })?;
        volume::cut(&units, end, size)
    }

    /// Completes and checks the tables; answers all bytes of the file before its first sheet, or before its first page if there is none.
    ///
    /// # Errors
    /// [`FormatError::Value`] for tables that no file may have.
    pub fn encode(&mut self) -> Result<Vec<u8>, FormatError> {
        Ok(self.head()?.0)
    }

    fn section_len(&self, kind: SectionKind, metadata_len: u64) -> u64 {
        let count = match kind {
            SectionKind::Clusters => self.clusters.len(),
            SectionKind::Groups => self.groups.len(),
            SectionKind::Members => self.members.len(),
            SectionKind::Levels => self.levels.len(),
            SectionKind::Metadata => return metadata_len,
            SectionKind::Scalars => return scalars::section_len(&self.scalars),
            SectionKind::Chunks => return chunks::section_len(CHUNKED.map(|kind| self.section_len(kind, 0))),
            SectionKind::Remnants => self.remnants.len(),
            SectionKind::Textures => self.sheets.len(),
            SectionKind::Texels => return sheet::texels_len(&self.sheets),
            // What refuses volumes is told by who asks for them.
            SectionKind::Volumes => self.volumes_from_zero().map_or(0, |volumes| volumes.len()),
            SectionKind::Pages => 0,
        };
        count as u64 * u64::from(kind.record_len())
    }

    fn pages_offset(&self, metadata_len: u64) -> u64 {
        self.aligned(self.end_of(self.kinds(), metadata_len), SectionKind::Pages)
    }

    /// Where the last of some sections ends.
    fn end_of(&self, kinds: impl Iterator<Item = SectionKind>, metadata_len: u64) -> u64 {
        kinds.fold(self.table_end() as u64, |end, kind| {
            self.aligned(end, kind) + self.section_len(kind, metadata_len)
        })
    }

    /// The sections, in the order in which they are laid out.
    fn kinds(&self) -> impl Iterator<Item = SectionKind> + use<> {
        let (chunked, has_scalars) = (self.header.chunked, !self.scalars.is_empty());
        let (has_remnants, has_sheets) = (!self.remnants.is_empty(), !self.sheets.is_empty());
        let has_volumes = self.header.volume_size.is_some();
        SectionKind::ALL.into_iter().filter(move |kind| match kind {
            SectionKind::Chunks => chunked,
            SectionKind::Scalars => has_scalars,
            SectionKind::Remnants => has_remnants,
            SectionKind::Textures | SectionKind::Texels => has_sheets,
            SectionKind::Volumes => has_volumes,
            _ => true,
        })
    }

    fn aligned(&self, end: u64, kind: SectionKind) -> u64 {
        align_up(end, kind.align(self.header.volume_size.is_some())).unwrap_or(u64::MAX)
    }

    /// Where the section table ends.
    fn table_end(&self) -> usize {
        HEADER_LEN + self.kinds().count() * mem::size_of::<SectionEntry>()
    }

    /// Fills in what follows from other fields: order of groups and members, statistics of levels, places of pages.
    fn complete(&mut self, pages_offset: u64) -> Result<(), FormatError> {
        if self.header.chunked {
            chunks::sort(&mut self.clusters, &mut self.groups, &mut self.members);
        }
        for group in &self.groups {
            for (first, count) in
                [(group.coarse_first, group.coarse_count), (group.fine_first, group.fine_count)]
            {
                // A range outside is refused by the check that follows.
                if let Some(ids) = self.members.get_mut(member_range(first, count)) {
                    ids.sort_unstable();
                }
            }
        }
        self.remnants.sort_unstable_by_key(Remnant::key);
        sheet::place(&mut self.sheets);
        self.levels = statistics(&self.clusters, &self.levels);
        let lens: Vec<u32> = self.clusters.iter().map(|c| c.page_len).collect();
        place_pages(pages_offset, page_align(self.header.packed), lens, |index, offset| {
            self.clusters[index].page_offset = offset;
            Ok(())
        })?;
        Ok(())
    }

    fn header(&self) -> Result<Header, FormatError> {
        let place = FilePart::File;
        fn count(field: &'static str, len: usize, place: &FilePart) -> Result<u32, FormatError> {
            u32::try_from(len).map_err(|_| invalid(*place, field, "less than 2^32", len))
        }
        let bounds = bounds(&self.clusters);
        let (mut required_flags, mut version_minor) = self.header.needs();
        if !self.remnants.is_empty() {
            version_minor = 5;
        }
        if !self.sheets.is_empty() {
            (required_flags, version_minor) = (required_flags | SHEETS, 6);
        }
        if self.header.chained {
            version_minor = 8;
        }
        if self.header.volume_size.is_some() {
            version_minor = 9;
        }

        Ok(Header {
            magic: MAGIC,
            version_major: VERSION_MAJOR,
            version_minor,
            required_flags,
            header_len: HEADER_LEN as u32,
            section_count: self.kinds().count() as u32,
            section_table_offset: HEADER_LEN as u32,
            page_align: page_align(self.header.packed) as u32,
            attributes: crate::header::attribute_bits(self.header.attributes),
            source_vertex_count: self.header.source_vertex_count,
            source_triangle_count: leaf_triangles(&self.clusters),
            cluster_count: count("clusters", self.clusters.len(), &place)?,
            group_count: count("groups", self.groups.len(), &place)?,
            level_count: count("levels", self.levels.len(), &place)?,
            root_count: self.clusters.iter().filter(|c| c.is_root()).count() as u32,
            leaf_count: self.clusters.iter().filter(|c| c.is_leaf()).count() as u32,
            boundary_mode: self.header.boundary_mode as u32,
            error_kind: self.header.error_kind as u32,
            shared_vertex_count: self.header.shared_vertex_count,
            origin: self.header.origin,
            aabb_min: bounds.min,
            aabb_max: bounds.max,
            max_error: max_error(&self.clusters),
            ..Header::zeroed()
        })
    }

    /// Completes and checks the tables; answers all bytes of the file before its first sheet or page, and the file's length.
    pub(crate) fn head(&mut self) -> Result<(Vec<u8>, u64), FormatError> {
        let metadata = self.metadata.encode()?;
        let pages_offset = self.pages_offset(metadata.len() as u64);
        self.complete(pages_offset)?;

        // What is wrong here would be refused by every reader: it is found before a byte is written.
        let mut header = self.header()?;
        let structure = Structure {
            header: &header,
            clusters: &self.clusters,
            groups: &self.groups,
            members: &self.members,
            levels: &self.levels,
        };
        structure.check()?;
        if self.header.chunked {
            chunks::check_order(&self.clusters, &self.groups, &self.members)?;
        }
        scalars::check(&self.scalars, self.header.attributes.scalar_words)?;
        if !self.remnants.is_empty() {
            remnant::check(&self.remnants, &self.clusters)?;
            remnant::check_rest(&self.groups)?;
        }
        if !self.sheets.is_empty() {
            sheet::check(&self.sheets, self.clusters.len(), sheet::texels_len(&self.sheets))?;
        }
        let origin = self.header.origin.iter().all(|x| x.is_finite());
        require(
            origin,
            FilePart::Header,
            "origin",
            "finite numbers",
            format_args!("{:?}", self.header.origin),
        )?;
        header.file_len = self.file_len()?;
        let volumes = self.volumes()?;

        let tables: [&[u8]; 3] = [
            bytemuck::cast_slice(&self.clusters),
            bytemuck::cast_slice(&self.groups),
            bytemuck::cast_slice(&self.members),
        ];
        let mut head = vec![0; self.table_end()];
        let mut entries = vec![SectionEntry::zeroed(); self.kinds().count()];
        let mut end = head.len() as u64;
        for (kind, entry) in self.kinds().zip(&mut entries) {
            let offset = self.aligned(end, kind);
            // Sheets are as long as all else, and so are not here; nor is what comes behind them.
            let is_here = self.sheets.is_empty() || !matches!(kind, SectionKind::Texels | SectionKind::Pages);
            if is_here {
                head.resize(offset as usize, 0);
            }
            match kind {
                SectionKind::Chunks => head.extend_from_slice(bytemuck::cast_slice(&chunks::encode(tables))),
                SectionKind::Volumes => head.extend_from_slice(bytemuck::cast_slice(&volumes)),
                SectionKind::Clusters => head.extend_from_slice(tables[0]),
                SectionKind::Groups => head.extend_from_slice(tables[1]),
                SectionKind::Members => head.extend_from_slice(tables[2]),
                SectionKind::Levels => head.extend_from_slice(bytemuck::cast_slice(&self.levels)),
                SectionKind::Metadata => head.extend_from_slice(&metadata),
                SectionKind::Scalars => head.extend_from_slice(&scalars::encode(&self.scalars)),
                SectionKind::Remnants => head.extend_from_slice(bytemuck::cast_slice(&self.remnants)),
                SectionKind::Textures => head.extend_from_slice(bytemuck::cast_slice(&self.sheets)),
                SectionKind::Texels | SectionKind::Pages => {}
            }
            let len = if is_here { head.len() as u64 - offset } else { self.section_len(kind, 0) };
            end = offset + len;
            *entry = SectionEntry {
                kind: kind as u32,
                record_len: kind.record_len(),
                offset,
                len,
                count: match kind {
                    SectionKind::Scalars => self.scalars.len() as u64,
                    SectionKind::Texels => self.sheets.len() as u64,
                    _ => len.checked_div(u64::from(kind.record_len())).unwrap_or(1),
                },
                checksum: if is_here { checksum(&head[offset as usize..]) } else { 0 },
            };
        }

        // The pages come last and carry their own checksums, so that they can be written before these tables.
        if let Some(pages) = entries.last_mut() {
            (pages.len, pages.count, pages.checksum) =
                (header.file_len - pages_offset, self.clusters.len() as u64, 0);
            require_eq(FilePart::File, "offset of the pages", pages_offset, pages.offset)?;
        }

        // The file itself ends where volumes begin.
        if let Some(first) = volumes.first() {
            head.resize(first.offset as usize, 0);
        }

        // From the inside out: each checksum is of bytes that no longer change.
        let table: &[u8] = bytemuck::cast_slice(&entries);
        head[HEADER_LEN..HEADER_LEN + table.len()].copy_from_slice(table);
        header.section_table_checksum = checksum(table);
        header.header_checksum = header.own_checksum();
        head[..HEADER_LEN].copy_from_slice(bytemuck::bytes_of(&header));
        Ok((head, header.file_len))
    }
}

/// The gaps of a group; the largest where nothing is known.
pub(crate) fn known_gaps<D: AsRef<[u8]>>(file: &Chpm<D>, group: GroupId) -> Gaps {
    if file.has_gaps() { file.gaps(group) } else { Gaps { fine: f32::MAX, base: f32::MAX, from: 0.0 } }
}

/// The level table that belongs to `clusters`, with what a builder supplies taken from `given`.
pub(crate) fn statistics(clusters: &[ClusterRecord], given: &[LevelRecord]) -> Vec<LevelRecord> {
    let mut levels: Vec<_> = given.iter().map(LevelRecord::without_statistics).collect();
    for cluster in clusters {
        // A level outside is refused by the check of the structure.
        if let Some(level) = levels.get_mut(cluster.level as usize) {
            level.add(cluster);
        }
    }
    levels
}

/// The union of the clusters' boxes.
pub(crate) fn bounds(clusters: &[ClusterRecord]) -> Aabb {
    let mut bounds = Aabb::EMPTY;
    for cluster in clusters {
        bounds.merge(&cluster.aabb());
    }
    bounds
}

/// Largest error of a base mesh.
pub(crate) fn max_error(clusters: &[ClusterRecord]) -> f32 {
    clusters.iter().map(|c| c.max_error).fold(0.0, f32::max)
}

/// Triangles of all leaf clusters.
pub(crate) fn leaf_triangles(clusters: &[ClusterRecord]) -> u64 {
    clusters.iter().filter(|c| c.is_leaf()).map(|c| u64::from(c.triangle_count)).sum()
}
