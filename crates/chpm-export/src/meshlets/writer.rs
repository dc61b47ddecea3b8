//! The file of meshlets: what decides what is drawn lies at its front, and behind it the blocks of meshes, which are written as they come.

use super::Rule;
use super::block::Block;
use crate::error::{ExportError, expect};
use crate::tiles::Mesh;
use chpm_format::Chpm;
use chpm_mesh::{ClusterId, GroupId};
use std::io::{self, Seek, SeekFrom, Write};

const FORMAT: &str = "meshlets";
const MAGIC: &[u8; 8] = b"CHPMmlts";
const VERSION: u32 = 1;
const HEADER: u64 = 144;
const GROUP: u64 = 32;
const MESH: u64 = 96;

/// How much was written.
#[derive(Clone, Copy, Default, PartialEq, Eq, Debug)]
pub struct Totals {
    /// Meshes of the hierarchy.
    pub meshes: u64,
    /// Meshlets of all of them.
    pub meshlets: u64,
    /// Triangles of all of them.
    pub triangles: u64,
    /// Vertices of all of them.
    pub vertices: u64,
    /// Length of the file.
    pub bytes: u64,
}

/// Writes a file of meshlets, block by block.
pub struct Writer<W> {
    out: W,
    /// The header up to what only the blocks tell.
    head: Words,
    groups: Words,
    meshes: Words,
    /// Meshes that there will be.
    expected: u64,
    totals: Totals,
}

impl<W: Write + Seek> Writer<W> {
    /// Memory for each mesh.
    pub const EACH: u64 = MESH;

    /// Begins a file of meshlets of up to `limit` triangles; with `normals`, its vertices get some that the source does not have.
    ///
    /// # Errors
    /// [`ExportError::TooLarge`] for a hierarchy of more meshes than have numbers, [`ExportError::Write`].
    pub fn new<D: AsRef<[u8]>>(
        mut out: W,
        file: &Chpm<D>,
        rule: &Rule,
        limit: u32,
        normals: bool,
    ) -> Result<Self, ExportError> {
        let clusters = (0..file.header().cluster_count).map(ClusterId);
        let expected: u64 = clusters.map(|id| Mesh::of(file, id).len() as u64).sum();
        let count = u32::try_from(expected).map_err(|_| ExportError::TooLarge {
            format: FORMAT,
            what: "meshes",
            limit: u32::MAX.into(),
            got: expected,
            remedy: "build it with larger clusters",
        })?;
        let groups = group_records(file, rule);
        let begin = HEADER + groups.0.len() as u64 + MESH * expected;

        let header = file.header();
        let attributes = header.attributes().decoded();
        let flags = u32::from(attributes.normals || normals) | u32::from(attributes.colors) << 1;
        let mut head = Words(Vec::new());
        head.0.extend(MAGIC);
        head.u32s(&[
            VERSION,
            HEADER as u32,
            flags,
            limit,
            header.level_count,
            file.groups().len() as u32,
            count,
            0,
        ]);
        head.u64s(&[HEADER, HEADER + groups.0.len() as u64, begin]);
        head.0.extend(header.origin.map(f64::to_le_bytes).as_flattened());
        let bounds = header.aabb();
        head.f32s(&bounds.min);
        head.f32s(&bounds.max);
        out.seek(SeekFrom::Start(begin)).map_err(failed)?;
        let meshes = Words(Vec::with_capacity((MESH * expected) as usize));
        let totals = Totals { bytes: begin, ..Totals::default() };
        Ok(Writer { out, head, groups, meshes, expected, totals })
    }

    /// Adds the next mesh; they come in the order of clusters, and of a cluster the base first.
    ///
    /// # Errors
    /// [`ExportError::Write`].
    pub fn add(&mut self, block: &Block) -> Result<(), ExportError> {
        let (record, totals) = (&block.record, &mut self.totals);
        self.meshes.u64s(&[totals.bytes]);
        let [(own, own_group), (above, above_group)] = record.range;
        let meshes = &mut self.meshes;
        meshes.u32s(&[block.bytes.len() as u32, record.vertices, record.meshlets, record.triangles]);
        meshes.u32s(&[own_group, above_group]);
        meshes.f32s(&[own, above]);
        meshes.u32s(&[record.level, record.cluster.0]);
        meshes.f32s(&record.bounds.min);
        meshes.f32s(&record.bounds.max);
        meshes.u32s(&record.tables);
        meshes.u32s(&[0]);
        self.out.write_all(&block.bytes).map_err(failed)?;
        totals.meshes += 1;
        totals.meshlets += u64::from(record.meshlets);
        totals.triangles += u64::from(record.triangles);
        totals.vertices += u64::from(record.vertices);
        totals.bytes += block.bytes.len() as u64;
        Ok(())
    }

    /// Writes what is at the front; answers what was written into.
    ///
    /// # Errors
    /// [`ExportError::Count`] if a mesh is missing, [`ExportError::Write`].
    pub fn finish(mut self) -> Result<(W, Totals), ExportError> {
        let Totals { meshes, meshlets, triangles, vertices, bytes } = self.totals;
        expect("meshes", self.expected, meshes)?;
        self.head.u64s(&[bytes, meshlets, triangles, vertices]);
        self.out.seek(SeekFrom::Start(0)).map_err(failed)?;
        for part in [&self.head, &self.groups, &self.meshes] {
            self.out.write_all(&part.0).map_err(failed)?;
        }
        self.out.flush().map_err(failed)?;
        Ok((self.out, self.totals))
    }
}

/// Records of all groups: boxes and errors.
fn group_records<D: AsRef<[u8]>>(file: &Chpm<D>, rule: &Rule) -> Words {
    let mut records = Words(Vec::with_capacity(GROUP as usize * file.groups().len()));
    for (id, group) in (0..).map(GroupId).zip(file.groups()) {
        let bounds = rule.bounds.around(id);
        records.f32s(&bounds.min);
        records.f32s(&[rule.bounds.error(id)]);
        records.f32s(&bounds.max);
        records.u32s(&[group.level]);
    }
    records
}

fn failed(source: io::Error) -> ExportError {
    ExportError::Write { format: FORMAT, source }
}

/// Numbers in little-endian order.
struct Words(Vec<u8>);

impl Words {
    fn u32s(&mut self, numbers: &[u32]) {
        numbers.iter().for_each(|number| self.0.extend(number.to_le_bytes()));
    }

    fn u64s(&mut self, numbers: &[u64]) {
        numbers.iter().for_each(|number| self.0.extend(number.to_le_bytes()));
    }

    fn f32s(&mut self, numbers: &[f32]) {
        numbers.iter().for_each(|number| self.0.extend(number.to_le_bytes()));
    }
}
