//! Sheets: an image of each cluster's surface, and where its triangles are in it.

use crate::error::{FilePart, FormatError, invalid, require, require_eq};
use crate::section_kind::SectionKind;
use bytemuck::{Pod, Zeroable};
use chpm_mesh::{Chart, ClusterId};
use std::{fmt, mem};

/// Longest side of a sheet, texels.
pub const MAX_SIDE: u16 = 8192;
/// Sides of a sheet are multiples of this.
pub const SIDE_STEP: u16 = 16;
/// Most charts of a sheet.
pub const MAX_CHARTS: usize = 65_535;
/// Sheets begin at multiples of this.
const ALIGN: u64 = 8;
/// Compression of layouts.
const ZSTD_LEVEL: i32 = 3;
const PLACE: FilePart = FilePart::Section(SectionKind::Textures);

/// Record of a cluster's sheet; see FORMAT.md, "Sheets".
#[derive(Clone, Copy, PartialEq, Pod, Zeroable, Debug, Default)]
#[repr(C)]
pub struct SheetRecord {
    /// The cluster, which is the record's number.
    pub cluster: u32,
    /// Charts of the layout.
    pub chart_count: u32,
    /// First byte, from the beginning of TEXELS on.
    pub offset: u64,
    /// Bytes of the layout.
    pub layout_len: u32,
    /// Bytes of the image, behind the layout.
    pub image_len: u32,
    /// Width and height, texels.
    pub size: [u16; 2],
    /// An [`ImageCodec`].
    pub codec: u32,
    /// Side of a texel, object units: the largest of its charts.
    pub texel: f32,
    /// Zero.
    pub padding: u32,
    /// Checksum of layout and image.
    pub checksum: u64,
    /// Zero.
    pub reserved: [u8; 16],
}

const _: () = assert!(mem::size_of::<SheetRecord>() == 64 && mem::offset_of!(SheetRecord, checksum) == 40);

/// Codec of a sheet's image.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[repr(u32)]
pub enum ImageCodec {
    /// Baseline JPEG.
    Jpeg = 1,
    /// PNG.
    Png = 2,
}

impl fmt::Display for ImageCodec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ImageCodec::Jpeg => "jpeg",
            ImageCodec::Png => "png",
        })
    }
}

impl SheetRecord {
    /// The codec; none for a code that [`crate::Chpm::open`] would have refused.
    pub fn codec(&self) -> Option<ImageCodec> {
        [ImageCodec::Jpeg, ImageCodec::Png].into_iter().find(|codec| *codec as u32 == self.codec)
    }

    /// Bytes of layout and image.
    #[expect(clippy::len_without_is_empty, reason = "no sheet is empty")]
    pub fn len(&self) -> u64 {
        u64::from(self.layout_len) + u64::from(self.image_len)
    }

    /// Whether all that later versions may use is zero.
    pub(crate) fn is_padded(&self) -> bool {
        self.padding == 0 && self.reserved == [0; 16]
    }
}

/// Puts sheets one behind the other.
pub(crate) fn place(sheets: &mut [SheetRecord]) {
    let mut end = 0u64;
    for (cluster, sheet) in (0..).zip(sheets) {
        (sheet.cluster, sheet.offset) = (cluster, end.next_multiple_of(ALIGN));
        end = sheet.offset + sheet.len();
    }
}

/// Bytes of TEXELS.
pub(crate) fn texels_len(sheets: &[SheetRecord]) -> u64 {
    sheets.last().map_or(0, |last| last.offset.saturating_add(last.len()))
}

/// Refuses records that no file may have.
pub(crate) fn check(sheets: &[SheetRecord], clusters: usize, texels: u64) -> Result<(), FormatError> {
    require_eq(PLACE, "count", clusters, sheets.len())?;
    let mut end = 0u64;
    for (id, sheet) in (0..).map(ClusterId).zip(sheets) {
        let place = FilePart::Sheet(id);
        require_eq(place, "cluster", id.0, sheet.cluster)?;
        require_eq(place, "offset", end.next_multiple_of(ALIGN), sheet.offset)?;
        end = sheet.offset.saturating_add(sheet.len());
        require(end <= texels, place, "end", format_args!("at most {texels}"), end)?;
        require(sheet.codec().is_some(), place, "codec", "1 or 2", sheet.codec)?;
        let sides = sheet.size.iter().all(|side| is_side(*side));
        let told = format_args!("multiples of {SIDE_STEP} from {SIDE_STEP} to {MAX_SIDE}");
        require(sides, place, "size", told, format_args!("{:?}", sheet.size))?;
        let charts = (1..=MAX_CHARTS as u32).contains(&sheet.chart_count);
        require(charts, place, "chart_count", format_args!("1 to {MAX_CHARTS}"), sheet.chart_count)?;
        let texel = sheet.texel.is_finite() && sheet.texel > 0.0;
        require(texel, place, "texel", "finite, above 0", sheet.texel)?;
    }
    require_eq(FilePart::Section(SectionKind::Texels), "len", end, texels)
}

fn is_side(side: u16) -> bool {
    (SIDE_STEP..=MAX_SIDE).contains(&side) && side.is_multiple_of(SIDE_STEP)
}

/// Where the triangles of a cluster are in its image.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct SheetLayout {
    /// The point that charts project from.
    pub origin: [f32; 3],
    /// The charts.
    pub charts: Vec<Chart>,
    /// By triangle of the finest mesh, its chart, at all positions.
    pub chart_of: Vec<u16>,
}

/// In front of the charts of a layout.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Head {
    origin: [f32; 3],
    reserved: u32,
}

impl SheetLayout {
    /// Bytes before compression.
    fn plain_len(charts: usize, triangles: usize) -> usize {
        mem::size_of::<Head>() + charts * mem::size_of::<Chart>() + 2 * triangles
    }

    /// The layout as it is stored.
    ///
    /// # Errors
    /// [`FormatError::Write`] if the compressor fails.
    pub fn encode(&self) -> Result<Vec<u8>, FormatError> {
        let mut plain = Vec::with_capacity(Self::plain_len(self.charts.len(), self.chart_of.len()));
        plain.extend_from_slice(bytemuck::bytes_of(&Head { origin: self.origin, reserved: 0 }));
        plain.extend_from_slice(bytemuck::cast_slice(&self.charts));
        plain.extend_from_slice(bytemuck::cast_slice(&self.chart_of));
        Ok(zstd::bulk::compress(&plain, ZSTD_LEVEL)?)
    }

    fn decode(bytes: &[u8], charts: usize, triangles: usize, place: FilePart) -> Result<Self, FormatError> {
        let len = Self::plain_len(charts, triangles);
        let plain = zstd::bulk::decompress(bytes, len)
            .map_err(|error| invalid(place, "layout", "a frame of zstd that holds it", error))?;
        require_eq(place, "length of the layout", len, plain.len())?;
        let (head, rest) = plain.split_at(mem::size_of::<Head>());
        let (charts, chart_of) = rest.split_at(charts * mem::size_of::<Chart>());
        let Head { origin, .. } = bytemuck::pod_read_unaligned(head);
        let layout = SheetLayout {
            origin,
            charts: charts.chunks_exact(mem::size_of::<Chart>()).map(bytemuck::pod_read_unaligned).collect(),
            chart_of: chart_of.as_chunks().0.iter().map(|pair| u16::from_le_bytes(*pair)).collect(),
        };
        Ok(layout)
    }

    /// Refuses what no sheet of a size may have.
    fn check(&self, size: [u16; 2], place: FilePart) -> Result<(), FormatError> {
        let finite = |numbers: &[f32]| numbers.iter().all(|number| number.is_finite());
        require(finite(&self.origin), place, "origin", "finite numbers", format_args!("{:?}", self.origin))?;
        for (at, chart) in self.charts.iter().enumerate() {
            let numbers = finite(chart.axes.as_flattened()) && finite(&chart.offset);
            require(numbers, place, "chart", "finite numbers", format_args!("others in chart {at}"))?;
            let [x, y, width, height] = chart.rect.map(u32::from);
            let inside =
                width > 0 && height > 0 && x + width <= size[0].into() && y + height <= size[1].into();
            let told = format_args!("within {size:?}");
            require(inside, place, "rectangle of a chart", told, format_args!("{:?}", chart.rect))?;
        }
        let count = self.charts.len();
        let largest = self.chart_of.iter().max().copied().unwrap_or(0);
        let told = format_args!("less than {count}");
        require(usize::from(largest) < count, place, "chart of a triangle", told, largest)
    }
}

/// A cluster's sheet.
#[derive(Clone, Debug)]
pub struct Sheet<'a> {
    /// Its record.
    pub record: SheetRecord,
    /// Where its triangles are.
    pub layout: SheetLayout,
    /// Bytes of its image, in the record's codec.
    pub image: &'a [u8],
}

impl<'a> Sheet<'a> {
    /// Reads the bytes of a sheet, those of a record, for a cluster of so many triangles.
    ///
    /// # Errors
    /// A layout that no sheet may have.
    pub fn parse(record: SheetRecord, bytes: &'a [u8], triangles: u32) -> Result<Self, FormatError> {
        let place = FilePart::Sheet(ClusterId(record.cluster));
        require_eq(place, "length", record.len(), bytes.len() as u64)?;
        let (layout, image) = bytes.split_at(record.layout_len as usize);
        let layout = SheetLayout::decode(layout, record.chart_count as usize, triangles as usize, place)?;
        layout.check(record.size, place)?;
        Ok(Sheet { record, layout, image })
    }

    /// Width and height that the image has by its own header; none if it has none of its codec.
    pub fn image_size(&self) -> Option<[u32; 2]> {
        match self.record.codec()? {
            ImageCodec::Jpeg => jpeg_size(self.image),
            ImageCodec::Png => png_size(self.image),
        }
    }
}

fn png_size(bytes: &[u8]) -> Option<[u32; 2]> {
    let head = bytes.strip_prefix(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR")?;
    let (sides, _) = head.split_first_chunk::<8>()?;
    let [a, b, c, d, e, f, g, h] = *sides;
    Some([u32::from_be_bytes([a, b, c, d]), u32::from_be_bytes([e, f, g, h])])
}

/// Goes from marker to marker until the frame's.
fn jpeg_size(bytes: &[u8]) -> Option<[u32; 2]> {
    let mut rest = bytes.strip_prefix(&[0xff, 0xd8])?;
    loop {
        let [0xff, marker, high, low] = *rest.first_chunk::<4>()? else { return None };
        if marker == 0xc0 {
            let [_, h1, h0, w1, w0] = *rest.get(4..)?.first_chunk::<5>()?;
            return Some([[w1, w0], [h1, h0]].map(|side| u16::from_be_bytes(side).into()));
        }
        rest = rest.get(2 + usize::from(u16::from_be_bytes([high, low]))..)?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout() -> SheetLayout {
        let chart =
            Chart { axes: [[1.0, 0.0, 0.5], [0.0, 2.0, 0.0]], offset: [4.0, 5.0], rect: [0, 0, 16, 9] };
        SheetLayout {
            origin: [1.0, -2.0, 3.0],
            charts: vec![chart, Chart { rect: [16, 20, 16, 12], ..chart }],
            chart_of: vec![0, 1, 1, 0, 0],
        }
    }

    fn record(layout: &[u8]) -> SheetRecord {
        SheetRecord {
            chart_count: 2,
            layout_len: layout.len() as u32,
            size: [32, 32],
            codec: 1,
            texel: 0.5,
            ..SheetRecord::default()
        }
    }

    #[test]
    fn a_layout_comes_back() {
        let bytes = layout().encode().unwrap();
        let sheet = Sheet::parse(record(&bytes), &bytes, 5).unwrap();
        assert_eq!(sheet.layout, layout());
        assert_eq!(sheet.image_size(), None);
    }

    #[test]
    fn wrong_layouts_are_refused() {
        let bytes = layout().encode().unwrap();
        assert!(Sheet::parse(record(&bytes), &bytes, 4).is_err(), "another number of triangles");
        let fewer = SheetRecord { chart_count: 1, ..record(&bytes) };
        assert!(Sheet::parse(fewer, &bytes, 5).is_err(), "another number of charts");
        assert!(Sheet::parse(record(&bytes), &bytes[..bytes.len() - 1], 5).is_err(), "cut short");
        let smaller = SheetRecord { size: [16, 32], ..record(&bytes) };
        assert!(Sheet::parse(smaller, &bytes, 5).is_err(), "a rectangle outside");
        for change in [
            |layout: &mut SheetLayout| layout.chart_of[2] = 2,
            |layout: &mut SheetLayout| layout.origin[1] = f32::NAN,
            |layout: &mut SheetLayout| layout.charts[1].axes[0][2] = f32::INFINITY,
            |layout: &mut SheetLayout| layout.charts[0].rect[2] = 0,
        ] {
            let mut wrong = layout();
            change(&mut wrong);
            let bytes = wrong.encode().unwrap();
            assert!(Sheet::parse(record(&bytes), &bytes, 5).is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn sizes_are_read_from_headers() {
        let jpeg = [0xff, 0xd8, 0xff, 0xe0, 0, 4, 1, 2, 0xff, 0xc0, 0, 17, 8, 0, 32, 1, 0];
        assert_eq!(jpeg_size(&jpeg), Some([256, 32]));
        assert_eq!((jpeg_size(&jpeg[..15]), jpeg_size(&jpeg[1..])), (None, None));
        let png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x01\0\0\0\0\x20\x08";
        assert_eq!((png_size(png), png_size(&png[..20])), (Some([256, 32]), None));
    }

    #[test]
    fn records_lie_one_behind_the_other() {
        let one = |image_len| SheetRecord { layout_len: 5, image_len, ..record(&[]) };
        let mut sheets = vec![one(6), one(7), one(9)];
        sheets.iter_mut().for_each(|sheet| sheet.layout_len = 5);
        place(&mut sheets);
        assert_eq!(sheets.iter().map(|sheet| sheet.offset).collect::<Vec<_>>(), [0, 16, 32]);
        assert_eq!(texels_len(&sheets), 46);
        check(&sheets, 3, 46).unwrap();
        assert!(
            check(&sheets, 2, 46).is_err()
                && check(&sheets, 3, 45).is_err()
                && check(&sheets, 3, 47).is_err()
        );
        for change in [
            |sheet: &mut SheetRecord| sheet.offset = 24,
            |sheet: &mut SheetRecord| sheet.cluster = 0,
            |sheet: &mut SheetRecord| sheet.codec = 3,
            |sheet: &mut SheetRecord| sheet.size[1] = 24,
            |sheet: &mut SheetRecord| sheet.size[0] = 8208,
            |sheet: &mut SheetRecord| sheet.chart_count = 0,
            |sheet: &mut SheetRecord| sheet.texel = 0.0,
            |sheet: &mut SheetRecord| sheet.texel = f32::NAN,
        ] {
            let mut wrong = sheets.clone();
            change(&mut wrong[1]);
            assert!(check(&wrong, 3, 46).is_err(), "{:?}", wrong[1]);
        }
    }
}
