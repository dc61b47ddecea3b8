//! Opening a file that is in memory, and reading it in place.

mod volumes;

use crate::MEMORY_ALIGN;
use crate::error::{FilePart, FormatError, invalid, require, require_eq};
use crate::gaps::Gaps;
use crate::header::{Header, attribute_bits};
use crate::metadata::Metadata;
use crate::packed;
use crate::page::Page;
use crate::page_buf::PageBuf;
use crate::parents::{Parent, Parents, Step};
use crate::records::{ClusterRecord, GroupRecord, LevelRecord};
use crate::remnant::{self, Remnant};
use crate::scalars;
use crate::section::{SectionKind, Sections, check_sum};
use crate::sheet::{self, Sheet, SheetRecord};
use crate::structure::{Structure, member_range, place_pages};
use crate::volume::{self, Unit, VolumeRecord};
use bytemuck::Pod;
use chpm_mesh::{ClusterId, GroupId, Scalar};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A CHPM file over bytes in memory: a map, a vector. `D` must give the same bytes every time.
///
/// A page's checksum is compared before its first use, whichever way it is asked for, and then not again.
#[derive(Clone, Debug)]
pub struct Chpm<D> {
    data: D,
    volumes: Vec<D>,
    header: Header,
    sections: Sections,
    scalars: Vec<Scalar>,
    on_page: OnPage<D>,
    /// A bit for each cluster: whether its page has been found to be what was written.
    intact: Arc<[AtomicU64]>,
    parents: Arc<Parents>,
}

impl<D: AsRef<[u8]>> Chpm<D> {
    /// Opens a file: checks the header, the section table, all tables with their checksums, every id and every range,
    /// so that following them cannot fail. Reads no page. Time and scratch memory are O(clusters).
    ///
    /// # Errors
    /// The [`FormatError`] that names the damage; [`FormatError::Alignment`] if the bytes do not start at a multiple of 8;
    /// [`FormatError::Apart`] if pages are in volumes, which [`Chpm::open_at`] has.
    pub fn open(data: D) -> Result<Self, FormatError> {
        Self::open_with(data, |volumes| match volumes.len() {
            0 => Ok(Vec::new()),
            count => Err(FormatError::Apart { count }),
        })
    }

    fn open_with(
        data: D,
        volumes: impl FnOnce(&[VolumeRecord]) -> Result<Vec<D>, FormatError>,
    ) -> Result<Self, FormatError> {
        let bytes = data.as_ref();
        let header = Header::read(bytes, bytes.len() as u64)?;
        check_alignment(bytes, FilePart::File)?;
        let sections = Sections::read(&header, bytes)?;
        // No file has more records than bytes, and what is not listed is refused below.
        let words = sections.count(SectionKind::Clusters).div_ceil(u64::from(u64::BITS));
        let intact = (0..words).map(|_| AtomicU64::new(0)).collect();
        let scalars = scalars::decode(
            &bytes[sections.range(SectionKind::Scalars)],
            sections.count(SectionKind::Scalars),
            header.attributes().scalar_words,
        )?;
        let parents = Arc::default();
        let (on_page, apart) = (|_: &D, _: &[D], _: u64| (), Vec::new());
        let mut file = Chpm { data, volumes: apart, header, sections, scalars, on_page, intact, parents };
        file.structure().check()?;
        if file.has_remnants() {
            remnant::check(file.remnants(), file.clusters())?;
            remnant::check_rest(file.groups())?;
        }
        if header.has_sheets() {
            let texels = file.sections.range(SectionKind::Texels).len() as u64;
            let (place, count) = (FilePart::Section(SectionKind::Texels), file.clusters().len());
            require_eq(place, "count", count as u64, file.sections.count(SectionKind::Texels))?;
            sheet::check(file.sheets(), count, texels)?;
        }
        file.check_pages()?;
        if header.has_volumes() {
            volume::check(file.volume_records(), file.sections.body())?;
            volume::check_units(file.volume_records(), file.units())?;
            file.volumes = volumes(file.volume_records())?;
        }
        Ok(file)
    }

    /// Sheets and pages, in the order of the file.
    fn units(&self) -> impl Iterator<Item = Unit> + '_ {
        let first = self.sections.body().start;
        let of_sheet = move |sheet: &SheetRecord| (first + sheet.offset, sheet.checksum);
        let of_page = |cluster: &ClusterRecord| (cluster.page_offset, cluster.page_checksum);
        let units = self.sheets().iter().map(of_sheet).chain(self.clusters().iter().map(of_page));
        units.map(|(offset, checksum)| Unit { offset, checksum })
    }

    /// Has every page told to `on_page` when its bytes are asked for, with their number: whoever has mapped the data may want to let go
    /// of what was read. It is handed the data and those of all volumes.
    pub fn watched(self, on_page: OnPage<D>) -> Self {
        Chpm { on_page, ..self }
    }

    /// Pages must lie in table order, each at the first aligned place after the one before, and fill their section.
    fn check_pages(&self) -> Result<(), FormatError> {
        let place = FilePart::Section(SectionKind::Pages);
        let Range { start, end } = self.sections.range(SectionKind::Pages);
        require_eq(
            place,
            "count",
            u64::from(self.header.cluster_count),
            self.sections.count(SectionKind::Pages),
        )?;
        let lens = self.clusters().iter().map(|c| c.page_len);
        let pages_end = place_pages(start as u64, self.header.page_align.into(), lens, |index, offset| {
            let id = ClusterId(index as u32);
            require_eq(FilePart::Cluster(id), "page_offset", offset, self.clusters()[index].page_offset)
        })?;
        require_eq(place, "end of the last page", pages_end, end as u64)
    }

    pub(crate) fn structure(&self) -> Structure<'_> {
        Structure {
            header: &self.header,
            clusters: self.clusters(),
            groups: self.groups(),
            members: self.members(),
            levels: self.levels(),
        }
    }

    fn table<T: Pod>(&self, kind: SectionKind) -> &[T] {
        bytemuck::cast_slice(&self.data.as_ref()[self.sections.range(kind)])
    }

    /// The bytes of the file, but for those in volumes.
    pub fn bytes(&self) -> &[u8] {
        self.data.as_ref()
    }

    /// The data that it was opened from.
    pub fn get_ref(&self) -> &D {
        &self.data
    }

    /// Gives the data back.
    pub fn into_inner(self) -> D {
        self.data
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The named scalars that vertices have, in the order of their words.
    pub fn scalars(&self) -> &[Scalar] {
        &self.scalars
    }

    /// The cluster table; a [`ClusterId`] is an index into it.
    pub fn clusters(&self) -> &[ClusterRecord] {
        self.table(SectionKind::Clusters)
    }

    /// The group table; a [`GroupId`] is an index into it.
    pub fn groups(&self) -> &[GroupRecord] {
        self.table(SectionKind::Groups)
    }

    /// Gaps of a group; unknown where [`Header::has_gaps`] is false.
    ///
    /// # Panics
    /// For a group that the file does not have.
    pub fn gaps(&self, group: GroupId) -> Gaps {
        if self.header.has_gaps() { self.groups()[group.index()].gaps } else { Gaps::default() }
    }

    /// Whether errors and gaps together are distances to the whole source.
    pub fn has_gaps(&self) -> bool {
        self.header.has_gaps()
    }

    /// The cluster ids that groups name by ranges.
    pub fn members(&self) -> &[u32] {
        self.table(SectionKind::Members)
    }

    /// Remnants of components that vanish, by cluster; none where the file does not tell.
    pub fn remnants(&self) -> &[Remnant] {
        if self.has_remnants() { self.table(SectionKind::Remnants) } else { &[] }
    }

    /// Whether there are any, so that [`GroupRecord::rest`] means something.
    pub fn has_remnants(&self) -> bool {
        // What groups tell of the others has no place in earlier versions.
        self.header.version_minor >= 5 && self.sections.has(SectionKind::Remnants)
    }

    /// Records of the clusters' sheets, by cluster; none where the file has no sheets.
    pub fn sheets(&self) -> &[SheetRecord] {
        self.table(SectionKind::Textures)
    }

    /// Bytes of a cluster's sheet as it is stored, its layout and then its image, without a look at them: they may be damaged. None if there are no sheets.
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn sheet_bytes(&self, id: ClusterId) -> Option<&[u8]> {
        let record = self.header.has_sheets().then(|| &self.sheets()[id.index()])?;
        (self.on_page)(&self.data, &self.volumes, record.len());
        self.at(self.sections.body().start + record.offset, record.len())
    }

    /// A cluster's sheet, its checksum compared and its layout checked against the cluster's record; none if there are no sheets.
    ///
    /// # Errors
    /// [`FormatError::Checksum`] for a damaged sheet, or a layout that no sheet may have.
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn sheet(&self, id: ClusterId) -> Result<Option<Sheet<'_>>, FormatError> {
        self.sheet_bytes(id).map_or(Ok(None), |bytes| self.sheet_in(id, bytes))
    }

    /// As [`Chpm::sheet`], for the sheet's bytes in another place: read from the file, not mapped. `None` only where there are no sheets.
    ///
    /// # Errors
    /// As [`Chpm::sheet`].
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn sheet_in<'b>(&self, id: ClusterId, bytes: &'b [u8]) -> Result<Option<Sheet<'b>>, FormatError> {
        if !self.header.has_sheets() {
            return Ok(None);
        }
        let record = self.sheets()[id.index()];
        check_sum(FilePart::Sheet(id), record.checksum, bytes)?;
        Sheet::parse(record, bytes, self.clusters()[id.index()].triangle_count).map(Some)
    }

    /// The level table, leaves first.
    pub fn levels(&self) -> &[LevelRecord] {
        self.table(SectionKind::Levels)
    }

    /// The known sections: kind and byte range in the file.
    pub fn sections(&self) -> impl Iterator<Item = (SectionKind, Range<usize>)> + '_ {
        let there = SectionKind::ALL.into_iter().filter(|kind| self.sections.has(*kind));
        there.map(|kind| (kind, self.sections.range(kind)))
    }

    /// Decodes the metadata.
    ///
    /// # Errors
    /// [`FormatError::Metadata`] where it does not decode.
    pub fn metadata(&self) -> Result<Metadata, FormatError> {
        Metadata::decode(&self.data.as_ref()[self.sections.range(SectionKind::Metadata)])
    }

    /// Ids of a group's coarse clusters, ascending.
    ///
    /// # Panics
    /// For a group that the file does not have, as indexing does; ids that come from the file are in range.
    pub fn coarse(&self, group: GroupId) -> &[u32] {
        let record = &self.groups()[group.index()];
        &self.members()[member_range(record.coarse_first, record.coarse_count)]
    }

    /// Ids of a group's fine clusters, ascending; none for a group of leaves.
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn fine(&self, group: GroupId) -> &[u32] {
        let record = &self.groups()[group.index()];
        &self.members()[member_range(record.fine_first, record.fine_count)]
    }

    /// The clusters that no split brings, ascending: the coarsest cut.
    pub fn roots(&self) -> impl Iterator<Item = ClusterId> + '_ {
        let roots = self.clusters().iter().enumerate().filter(|(_, cluster)| cluster.is_root());
        roots.map(|(index, _)| ClusterId(index as u32))
    }

    /// Whether chunks of the tables have checksums of their own; see [`crate::RemoteChpm`].
    pub fn is_chunked(&self) -> bool {
        self.sections.has(SectionKind::Chunks)
    }

    /// The bytes of a section that is not in volumes; none if it is absent.
    pub(crate) fn section(&self, kind: SectionKind) -> &[u8] {
        &self.data.as_ref()[self.sections.range(kind)]
    }

    /// Whether detail of the source was left out, so that the leaves are not the source. O(clusters).
    pub fn is_trimmed(&self) -> bool {
        self.clusters().iter().any(ClusterRecord::is_trimmed)
    }

    /// The bytes of a cluster's page as it is stored, without padding, and without a look at them: they may be damaged.
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn page_bytes(&self, id: ClusterId) -> &[u8] {
        let record = &self.clusters()[id.index()];
        (self.on_page)(&self.data, &self.volumes, record.page_len.into());
        self.at(record.page_offset, record.page_len.into()).unwrap_or_default()
    }

    /// The same, and what was written: their checksum was compared, now or before.
    fn intact_bytes(&self, id: ClusterId) -> Result<&[u8], FormatError> {
        let bytes = self.page_bytes(id);
        let (word, bit) = (&self.intact[id.index() / 64], 1 << (id.index() % 64));
        // Nothing else hangs on the bit: whoever does not see it yet compares once more.
        if word.load(Ordering::Relaxed) & bit == 0 {
            check_sum(FilePart::Page(id), self.clusters()[id.index()].page_checksum, bytes)?;
            word.fetch_or(bit, Ordering::Relaxed);
        }
        Ok(bytes)
    }

    /// Whether a cluster's page is packed.
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn is_packed(&self, id: ClusterId) -> bool {
        self.header.is_packed() && self.clusters()[id.index()].flags & ClusterRecord::PACKED != 0
    }

    /// Bytes of a cluster's page in memory: when it is not packed.
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn page_len(&self, id: ClusterId) -> u64 {
        self.clusters()[id.index()].unpacked_len(self.header.attributes())
    }

    /// A cluster's page, its checksum compared if it was not before, its structure checked, and its header compared with the record; see [`Page::parse`]. In place, or
    /// unpacked.
    ///
    /// # Errors
    /// [`FormatError::Checksum`] for a damaged page, what [`Page::parse`] and [`crate::packed::unpack`] refuse, or a page that contradicts its record.
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn page(&self, id: ClusterId) -> Result<PageBuf<'_>, FormatError> {
        self.page_of(id, self.intact_bytes(id)?)
    }

    /// As [`Chpm::page`], but of what the page holds only the errors of its positions are looked at: to choose a position takes no more. See
    /// [`Page::view`] about wrong indices.
    ///
    /// # Errors
    /// As [`Chpm::page`], but for indices.
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn page_viewed(&self, id: ClusterId) -> Result<PageBuf<'_>, FormatError> {
        let page = self.page_known(id)?;
        page.view().check_errors().map_err(|error| error.in_page(id))?;
        compare(&self.header, id, &self.clusters()[id.index()], &page.view())?;
        Ok(page)
    }

    /// As [`Chpm::page`] for a page whose structure was checked before: only its header is looked at, and its checksum if that was not yet. See [`Page::view`]
    /// about wrong indices.
    ///
    /// # Errors
    /// [`FormatError::Checksum`] for a damaged page, what [`Page::view`] and [`crate::packed::unpack`] refuse.
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn page_known(&self, id: ClusterId) -> Result<PageBuf<'_>, FormatError> {
        self.loaded(id, self.intact_bytes(id)?)
    }

    fn loaded<'b>(&self, id: ClusterId, bytes: &'b [u8]) -> Result<PageBuf<'b>, FormatError> {
        if !self.is_packed(id) {
            return Page::view(bytes).map(PageBuf::from).map_err(|error| error.in_page(id));
        }
        let page = match self.above(id, bytes)? {
            None => PageBuf::unpacked(bytes, self.page_len(id)),
            Some(parent) => match self.parents.get(id) {
                Some(known) => known.to_own(&[]),
                None => PageBuf::unchained(bytes, self.page_len(id), &self.parent(parent)?.view()),
            },
        };
        page.map_err(|error| error.in_page(id))
    }

    /// The cluster whose page a chained one is told by: one of those that it replaces.
    ///
    /// # Errors
    /// A page that names none of them.
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn above(&self, id: ClusterId, bytes: &[u8]) -> Result<Option<ClusterId>, FormatError> {
        let place = self.is_packed(id) && self.header.is_chained();
        let Some(place) = place.then(|| packed::parent_place(bytes)).flatten() else { return Ok(None) };
        let record = &self.clusters()[id.index()];
        let coarse = if record.is_root() { &[] } else { self.coarse(record.parent_group()) };
        chosen(id, place, coarse.iter().copied().map(ClusterId)).map(Some)
    }

    /// Keeps at most so many bytes of pages that [chained](packed::chain) ones rest on, unpacked, and one page at least; 16 MiB unless this is called.
    pub fn keep_above(&self, bytes: u64) {
        self.parents.keep_bytes(usize::try_from(bytes).unwrap_or(usize::MAX));
    }

    /// The page of a cluster that others rest on.
    fn parent(&self, id: ClusterId) -> Result<Parent, FormatError> {
        let step = |(): &mut (), id| {
            let bytes = self.intact_bytes(id)?;
            Ok(match self.above(id, bytes)? {
                Some(parent) => Step::On(parent, Cow::Borrowed(bytes)),
                None => Step::Whole(Arc::new(self.page_of(id, bytes)?.to_own(bytes)?)),
            })
        };
        self.parents.page(id, &mut (), step, |(), id, bytes, parent| {
            let page = PageBuf::unchained(bytes, self.page_len(id), &parent.view());
            let page = page.map_err(|error| error.in_page(id))?;
            check_page(&self.header, id, &self.clusters()[id.index()], &page.view())?;
            Ok(page)
        })
    }

    /// Bits of a cluster's page as it is stored, by what they are for, in the order of [`packed::PARTS`]. Those of a packed page are found by packing it once more.
    ///
    /// # Errors
    /// As [`Chpm::page`].
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn page_sizes(
        &self,
        id: ClusterId,
        page: &PageBuf<'_>,
    ) -> Result<[u64; packed::PARTS.len()], FormatError> {
        if !self.is_packed(id) {
            return Ok(page.view().sizes());
        }
        let raw = page.bytes_or(&[]);
        let chained = match self.above(id, self.intact_bytes(id)?)? {
            Some(parent) => packed::chained_sizes(raw, &self.parent(parent)?.view())?,
            None => None,
        };
        chained.map_or_else(|| packed::sizes(raw), Ok)
    }

    fn page_of<'b>(&self, id: ClusterId, bytes: &'b [u8]) -> Result<PageBuf<'b>, FormatError> {
        let loaded = self.loaded(id, bytes)?;
        let record = &self.clusters()[id.index()];
        check_page(&self.header, id, record, &loaded.view())?;
        // Whoever reads a page goes on to those below, more often than not.
        if self.header.is_chained() && !self.groups()[record.group().index()].is_leaf() {
            self.parents.keep(id, || loaded.to_own(bytes))?;
        }
        Ok(loaded)
    }

    /// As [`Chpm::page`], and the checksum is compared again, whatever was found before.
    ///
    /// # Errors
    /// As [`Chpm::page`].
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn page_checked(&self, id: ClusterId) -> Result<PageBuf<'_>, FormatError> {
        self.page_checked_in(id, self.page_bytes(id))
    }

    /// As [`Chpm::page_checked`], for the page's bytes in another place: read from the file, not mapped.
    ///
    /// # Errors
    /// As [`Chpm::page_checked`].
    ///
    /// # Panics
    /// As [`Chpm::coarse`].
    pub fn page_checked_in<'b>(&self, id: ClusterId, bytes: &'b [u8]) -> Result<PageBuf<'b>, FormatError> {
        check_sum(FilePart::Page(id), self.clusters()[id.index()].page_checksum, bytes)?;
        self.page_of(id, bytes)
    }
}

/// Told of each page before it is looked at: the data of the file, those of its volumes, and how many bytes the page has.
type OnPage<D> = fn(&D, &[D], u64);

fn check_alignment(bytes: &[u8], place: FilePart) -> Result<(), FormatError> {
    match bytes.as_ptr().addr().is_multiple_of(MEMORY_ALIGN) {
        true => Ok(()),
        false => Err(FormatError::Alignment { place, expected: MEMORY_ALIGN }),
    }
}

/// The cluster at a place among those that a chained page may rest on.
pub(crate) fn chosen(
    id: ClusterId,
    place: u16,
    mut coarse: impl ExactSizeIterator<Item = ClusterId>,
) -> Result<ClusterId, FormatError> {
    let below = format!("below {}", coarse.len());
    let parent = coarse.nth(place.into());
    parent.ok_or_else(|| invalid(FilePart::Page(id), "place of the page above", below, place))
}

/// Checks a page and compares it with its record.
pub(crate) fn check_page(
    header: &Header,
    id: ClusterId,
    record: &ClusterRecord,
    page: &Page<'_>,
) -> Result<(), FormatError> {
    page.check().map_err(|error| error.in_page(id))?;
    compare(header, id, record, page)?;
    let (place, ids) = (FilePart::Page(id), header.shared_vertex_count);
    let largest = page.shared_ids.iter().max();
    let in_range = largest.is_none_or(|id| *id < ids);
    require(in_range, place, "shared id", format_args!("less than {ids}"), largest.unwrap_or(&0))
}

/// Compares the header of a page with its record.
fn compare(
    header: &Header,
    id: ClusterId,
    record: &ClusterRecord,
    page: &Page<'_>,
) -> Result<(), FormatError> {
    let place = FilePart::Page(id);
    for (field, expected, got) in [
        ("attributes", header.attributes, attribute_bits(page.attributes())),
        ("vertex_count", record.vertex_count, page.vertex_count() as u32),
        ("base_vertex_count", record.base_vertex_count, page.base_vertex_count as u32),
        ("triangle_count", record.triangle_count, page.triangles.len() as u32),
        ("base_triangle_count", record.base_triangle_count, page.base_triangle_count as u32),
        ("shared_count", record.shared_count, page.shared_ids.len() as u32),
    ] {
        require_eq(place, field, expected, got)?;
    }
    require_eq(place, "min_error", record.min_error, page.min_error)?;
    require_eq(place, "max_error", record.max_error, page.max_error())
}
