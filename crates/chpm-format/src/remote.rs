//! Reading a file of which only ranges can be had: one on a server, for instance.
//!
//! [`crate::Chpm`] has checked all tables before it says anything. Here a record is checked when it is asked for, and the chunk of the table that it lies in; what was
//! not asked for is not known to be sound. A file without checksums of chunks is read in the same way, each table as one chunk.

use crate::chunks::{self, CHUNKED};
use crate::error::{FilePart, FormatError, require, require_eq};
use crate::header::{Header, require_len};
use crate::packed;
use crate::page_buf::PageBuf;
use crate::parents::{Parents, Step};
use crate::reader::{check_page, chosen};
use crate::records::{ClusterRecord, GroupRecord};
use crate::scalars;
use crate::section::{SectionKind, Sections, check_sum, table_range};
use crate::structure::{check_cluster, check_group, member_range};
use crate::volume::{self, VolumeRecord};
use bytemuck::Pod;
use chpm_mesh::{ClusterId, GroupId, Scalar};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io;
use std::ops::Range;
use std::sync::Arc;

/// Bytes that are read first: they hold the header, the list of chunks and, unless the file is very large, the records of the coarsest clusters.
pub const FIRST_BYTES: u64 = 32 << 10;

/// A CHPM file that is read in ranges: `R` fills a buffer with the bytes from an offset on, of the file itself, 0, or of a volume by its number from 1. Each chunk is read once,
/// and kept.
#[derive(Clone, Debug)]
pub struct RemoteChpm<R> {
    source: Source<R>,
    header: Header,
    sections: Sections,
    chunked: bool,
    scalars: Vec<Scalar>,
    volumes: Vec<VolumeRecord>,
    tables: [Table; 3],
    parents: Arc<Parents>,
}

#[derive(Clone, Debug)]
struct Source<R> {
    read: R,
    first: Vec<u8>,
}

impl<R: FnMut(usize, u64, &mut [u8]) -> io::Result<()>> Source<R> {
    fn fill(&mut self, offset: usize, bytes: &mut [u8]) -> Result<(), FormatError> {
        match self.first.get(offset..offset + bytes.len()) {
            Some(here) => {
                bytes.copy_from_slice(here);
                Ok(())
            }
            None => (self.read)(0, offset as u64, bytes).map_err(FormatError::Read),
        }
    }

    fn bytes(&mut self, range: Range<usize>) -> Result<Vec<u8>, FormatError> {
        let mut bytes = vec![0; range.len()];
        self.fill(range.start, &mut bytes)?;
        Ok(bytes)
    }
}

/// A table by its chunks.
#[derive(Clone, Debug)]
struct Table {
    kind: SectionKind,
    range: Range<usize>,
    chunk_len: usize,
    sums: Vec<u64>,
    /// Those that were asked for.
    here: BTreeMap<usize, Vec<u8>>,
}

impl Table {
    /// Every table as one chunk.
    fn whole(sections: &Sections) -> [Table; 3] {
        CHUNKED.map(|kind| {
            let range = sections.range(kind);
            let (chunk_len, sums) = (range.len().max(1), vec![sections.checksum(kind)]);
            Table { kind, range, chunk_len, sums, here: BTreeMap::new() }
        })
    }

    /// Record `index`, which must be in the table. Records are not cut by chunks.
    fn record<T: Pod, R: FnMut(usize, u64, &mut [u8]) -> io::Result<()>>(
        &mut self,
        source: &mut Source<R>,
        index: usize,
    ) -> Result<T, FormatError> {
        let at = index * size_of::<T>();
        let (chunk, start) = (at / self.chunk_len, at % self.chunk_len);
        if !self.here.contains_key(&chunk) {
            let first = self.range.start + chunk * self.chunk_len;
            let bytes = source.bytes(first..self.range.end.min(first + self.chunk_len))?;
            check_sum(FilePart::Section(self.kind), self.sums[chunk], &bytes)?;
            self.here.insert(chunk, bytes);
        }
        Ok(bytemuck::pod_read_unaligned(&self.here[&chunk][start..start + size_of::<T>()]))
    }
}

impl<R: FnMut(usize, u64, &mut [u8]) -> io::Result<()>> RemoteChpm<R> {
    /// Opens a file of `len` bytes without its volumes: reads the first [`FIRST_BYTES`] of it, what of the list of chunks is not in them, and the lists of volumes and scalars.
    /// Volumes are not looked at: a page of another build has another checksum.
    ///
    /// # Errors
    /// The [`FormatError`] that names the damage; [`FormatError::Read`] with what `read` answered.
    pub fn open(len: u64, read: R) -> Result<Self, FormatError> {
        let mut source = Source { read, first: Vec::new() };
        source.first = source.bytes(0..len.min(FIRST_BYTES) as usize)?;
        let header = Header::read(&source.first, len)?;
        let range = table_range(&header)?;
        let (place, expected) = (FilePart::SectionTable, range.end as u64);
        if expected > len {
            return Err(FormatError::Truncated { place, expected, got: len });
        }
        let sections = Sections::read_places(&header, &source.bytes(range)?)?;
        if header.has_volumes() {
            require_len(sections.body().start, len)?;
        }
        for (kind, expected) in [
            (SectionKind::Clusters, header.cluster_count),
            (SectionKind::Groups, header.group_count),
            (SectionKind::Levels, header.level_count),
            (SectionKind::Pages, header.cluster_count),
        ] {
            require_eq(FilePart::Section(kind), "count", u64::from(expected), sections.count(kind))?;
        }
        let (roots, clusters) = (header.root_count, header.cluster_count);
        let told = format_args!("1 to {clusters}");
        require((1..=clusters).contains(&roots), FilePart::Header, "root_count", told, roots)?;

        let mut tables = Table::whole(&sections);
        let chunked = sections.has(SectionKind::Chunks);
        if chunked {
            let list = source.bytes(sections.range(SectionKind::Chunks))?;
            let place = FilePart::Section(SectionKind::Chunks);
            check_sum(place, sections.checksum(SectionKind::Chunks), &list)?;
            let lens = CHUNKED.map(|kind| sections.range(kind).len() as u64);
            let (chunk_len, sums) = chunks::decode(&list, lens)?;
            for (table, sums) in tables.iter_mut().zip(sums) {
                (table.chunk_len, table.sums) = (chunk_len as usize, sums);
            }
        }
        let mut volumes = Vec::new();
        if header.has_volumes() {
            let kind = SectionKind::Volumes;
            let list = source.bytes(sections.range(kind))?;
            check_sum(FilePart::Section(kind), sections.checksum(kind), &list)?;
            volumes =
                list.chunks_exact(size_of::<VolumeRecord>()).map(bytemuck::pod_read_unaligned).collect();
            volume::check(&volumes, sections.body())?;
        }
        let mut scalars = Vec::new();
        if sections.has(SectionKind::Scalars) || header.attributes().scalar_words > 0 {
            let kind = SectionKind::Scalars;
            let list = source.bytes(sections.range(kind))?;
            check_sum(FilePart::Section(kind), sections.checksum(kind), &list)?;
            scalars = scalars::decode(&list, sections.count(kind), header.attributes().scalar_words)?;
        }
        Ok(RemoteChpm {
            source,
            header,
            sections,
            chunked,
            scalars,
            volumes,
            tables,
            parents: Arc::default(),
        })
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The named scalars that vertices have, in the order of their words.
    pub fn scalars(&self) -> &[Scalar] {
        &self.scalars
    }

    /// Records of its volumes; none where pages are in the file itself.
    pub fn volumes(&self) -> &[VolumeRecord] {
        &self.volumes
    }

    /// Whether tables are read in chunks, and not as a whole.
    pub fn is_chunked(&self) -> bool {
        self.chunked
    }

    /// A cluster's record.
    ///
    /// # Errors
    /// A cluster that the file does not have, a chunk that is damaged, a record that no file may have, and [`FormatError::Read`].
    pub fn cluster(&mut self, id: ClusterId) -> Result<ClusterRecord, FormatError> {
        let (place, count) = (FilePart::Cluster(id), self.header.cluster_count);
        require(id.0 < count, place, "id", format_args!("less than {count}"), id.0)?;
        let record: ClusterRecord = self.tables[0].record(&mut self.source, id.index())?;
        check_cluster(&self.header, place, &record)?;
        if self.chunked {
            let (is_first, first) = (id.0 < self.header.root_count, self.header.root_count);
            let told = format_args!("of the first {first} clusters, and of no others, none");
            require(record.is_root() == is_first, place, "parent_group", told, record.parent_group)?;
        }
        let Range { start, end } = self.sections.range(SectionKind::Pages);
        let page = record.page_offset..record.page_offset.saturating_add(record.page_len.into());
        let lies = page.start.is_multiple_of(self.header.page_align.into())
            && start as u64 <= page.start
            && page.end <= end as u64;
        let told = format_args!("aligned, and within {start} to {end}");
        require(lies, place, "page", told, format_args!("{page:?}"))?;
        Ok(record)
    }

    /// A group's record. Its gaps mean something where [`Header::has_gaps`] is true.
    ///
    /// # Errors
    /// As [`RemoteChpm::cluster`].
    pub fn group(&mut self, id: GroupId) -> Result<GroupRecord, FormatError> {
        let (place, count) = (FilePart::Group(id), self.header.group_count);
        require(id.0 < count, place, "id", format_args!("less than {count}"), id.0)?;
        let record: GroupRecord = self.tables[1].record(&mut self.source, id.index())?;
        check_group(&self.header, place, &record)?;
        Ok(record)
    }

    /// The clusters that no split brings, ascending. Without [chunks](RemoteChpm::is_chunked) it takes all records to find them.
    ///
    /// # Errors
    /// As [`RemoteChpm::cluster`].
    pub fn roots(&mut self) -> Result<Vec<ClusterId>, FormatError> {
        let (roots, clusters) = (self.header.root_count, self.header.cluster_count);
        let mut found = Vec::new();
        for id in (0..if self.chunked { roots } else { clusters }).map(ClusterId) {
            if self.cluster(id)?.is_root() {
                found.push(id);
            }
        }
        require_eq(FilePart::Header, "root_count", found.len(), roots as usize)?;
        Ok(found)
    }

    /// A group's coarse clusters, ascending.
    ///
    /// # Errors
    /// As [`RemoteChpm::cluster`], and clusters that contradict their group.
    pub fn coarse(&mut self, id: GroupId) -> Result<Vec<ClusterId>, FormatError> {
        let group = self.group(id)?;
        let members = self.members(id, group.coarse_first, group.coarse_count)?;
        for member in &members {
            let (place, cluster) = (FilePart::Cluster(*member), self.cluster(*member)?);
            require_eq(place, "group of a coarse member", id, cluster.group())?;
            require_eq(place, "level of a coarse member", group.level, cluster.level)?;
        }
        Ok(members)
    }

    /// A group's fine clusters, ascending; none for a group of leaves. Their levels are lower, so that going down comes to an end.
    ///
    /// # Errors
    /// As [`RemoteChpm::coarse`].
    pub fn fine(&mut self, id: GroupId) -> Result<Vec<ClusterId>, FormatError> {
        let group = self.group(id)?;
        let members = self.members(id, group.fine_first, group.fine_count)?;
        for member in &members {
            let (place, cluster) = (FilePart::Cluster(*member), self.cluster(*member)?);
            require_eq(place, "parent group of a fine member", id, cluster.parent_group())?;
            let below = format_args!("less than {}", group.level);
            require(cluster.level < group.level, place, "level of a fine member", below, cluster.level)?;
        }
        Ok(members)
    }

    /// A range of MEMBERS.
    fn members(&mut self, id: GroupId, first: u32, count: u32) -> Result<Vec<ClusterId>, FormatError> {
        let (place, range) = (FilePart::Group(id), member_range(first, count));
        let len = self.sections.count(SectionKind::Members) as usize;
        let told = format_args!("within {len}");
        require(range.end <= len, place, "range of members", told, format_args!("{range:?}"))?;
        let mut members: Vec<ClusterId> = Vec::new();
        for index in range {
            let member = ClusterId(self.tables[2].record(&mut self.source, index)?);
            let ascends = members.last().is_none_or(|last| *last < member);
            require(ascends, place, "members", "ascending", member.0)?;
            members.push(member);
        }
        Ok(members)
    }

    /// A cluster's page, its checksum and its structure checked. A chained page takes those above it, each of which is read if it is not here.
    ///
    /// # Errors
    /// As [`RemoteChpm::cluster`], and as [`crate::Chpm::page_checked`].
    pub fn page(&mut self, id: ClusterId) -> Result<PageBuf<'static>, FormatError> {
        let parents = Arc::clone(&self.parents);
        let parent = match self.step(id)? {
            Step::Whole(page) => return page.to_own(&[]),
            Step::On(parent, bytes) => (parents.page(parent, self, Self::step, Self::unchain)?, bytes),
        };
        let (parent, bytes) = parent;
        let page = self.unchain(id, &bytes, &parent)?;
        let group = self.cluster(id)?.group();
        if !self.group(group)?.is_leaf() {
            parents.keep(id, || page.to_own(&[]))?;
        }
        Ok(page)
    }

    /// A page that rests on no other, or the bytes of one that does.
    fn step(&mut self, id: ClusterId) -> Result<Step<'static>, FormatError> {
        let record = self.cluster(id)?;
        let (place, len) = (FilePart::Page(id), record.page_len as usize);
        // A page is read in place and needs the alignment of words.
        let mut words = vec![0_u32; len.div_ceil(size_of::<u32>())];
        let bytes = &mut bytemuck::cast_slice_mut(&mut words)[..len];
        match volume::place(&self.volumes, record.page_offset) {
            (0, offset) => self.source.fill(offset as usize, bytes)?,
            (part, offset) => (self.source.read)(part, offset, bytes).map_err(FormatError::Read)?,
        }
        check_sum(place, record.page_checksum, bytes)?;
        let is_packed = self.header.is_packed() && record.flags & ClusterRecord::PACKED != 0;
        let parent = is_packed && self.header.is_chained();
        if let Some(parent) = parent.then(|| packed::parent_place(bytes)).flatten() {
            let bytes = bytes.to_vec();
            let coarse = if record.is_root() { Vec::new() } else { self.coarse(record.parent_group())? };
            return Ok(Step::On(chosen(id, parent, coarse.into_iter())?, Cow::Owned(bytes)));
        }
        let page = if is_packed {
            PageBuf::unpacked(bytes, record.unpacked_len(self.header.attributes()))
        } else {
            PageBuf::in_words(words, len)
        };
        let page = page.map_err(|error| error.in_page(id))?;
        check_page(&self.header, id, &record, &page.view())?;
        Ok(Step::Whole(Arc::new(page)))
    }

    /// The page of a chained one's bytes.
    fn unchain(
        &mut self,
        id: ClusterId,
        bytes: &[u8],
        parent: &PageBuf<'_>,
    ) -> Result<PageBuf<'static>, FormatError> {
        let record = self.cluster(id)?;
        let len = record.unpacked_len(self.header.attributes());
        let page = PageBuf::unchained(bytes, len, &parent.view()).map_err(|error| error.in_page(id))?;
        check_page(&self.header, id, &record, &page.view())?;
        Ok(page)
    }
}
