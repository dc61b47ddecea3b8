//! Small components are left out where that is asked for: their triangles, and the vertices that only they have.
//!
//! A component is as large as the diagonal of the box around its vertices, in the source's own coordinates. Boxes go along the links of
//! [`components`], from later vertices to earlier ones, until the first vertex of a component has all of its box.

use super::components;
use super::local::each;
use super::used::Used;
use super::{Columns, TRIANGLES};
use crate::config::Length;
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::Id;
use crate::join;
use crate::report::SmallComponents;
use crate::vertex_columns::{ColumnMap, POSITIONS};
use bytemuck::{Pod, Zeroable};
use chpm_extmem::{Buckets, BufferWriter, Column};
use chpm_mesh::Aabb;
use chpm_texture::TexturedTriangle;
use std::path::Path;

/// Vertices whose boxes are in memory at once.
const SLICE: usize = 1 << 18;
/// Bytes that the boxes for a slice gather.
const BLOCK: usize = 1 << 13;
/// Vertices whose boxes are put together before they go to a slice.
const RECENT: usize = 1 << 10;

/// Arrays of what is left, and the textured ones of its triangles where these are kept.
type Left<I> = (Columns<I>, Option<Column<TexturedTriangle>>);

/// Leaves out the components that are smaller than `size`, and counts them.
pub(super) fn leave_out<I: Id>(
    columns: Columns<I>,
    textured: Option<Column<TexturedTriangle>>,
    size: Length,
    path: &Path,
    context: &Context<'_>,
) -> Result<(Left<I>, SmallComponents), BuildError> {
    let Columns { vertices, doubles, triangles, used, .. } = &columns;
    let singles = &vertices.positions;
    let before = triangles.len();
    let (numbers, kept, components) = match singles.is_empty() {
        true => Mesh { path, positions: doubles, triangles, used }.sort_out(size, context)?,
        false => Mesh { path, positions: singles, triangles, used }.sort_out(size, context)?,
    };
    if components == 0 {
        return Ok(((columns, textured), SmallComponents::default()));
    }

    // Triangles first, by their old corners; then everything gets its new number.
    let Columns { vertices, doubles, triangles, .. } = columns;
    let stays = |[a, _, _]: &[I; 3]| kept.contains(a.index());
    let mut triangles = filtered(triangles, TRIANGLES, context, |_, some, out| {
        out.extend(some.iter().filter(|triangle| stays(triangle)));
        Ok(())
    })?;
    join::run(&mut triangles, &numbers, context)?;
    let textured = textured.map(|textured| renumbered(textured, &kept, &numbers, context)).transpose()?;
    drop(kept);
    let kept = Kept { numbers: &numbers, context };
    let vertices = vertices.map(&kept)?;
    let doubles = kept.map(doubles, POSITIONS)?;

    let (mut bounds, mut used) = (Aabb::EMPTY, Used::new(&context.store)?);
    each(&vertices.positions, context, |_, points| {
        bounds.merge(&Aabb::of_points(points));
        Ok(())
    })?;
    let count = vertices.positions.len() + doubles.len();
    each(&triangles, context, |_, triangles| used.add(triangles, count))?;
    let counts = SmallComponents { components, triangles: (before - triangles.len()) as u64 };
    Ok(((Columns { vertices, doubles, triangles, used, bounds }, textured), counts))
}

/// The textured triangles that stay, with the new numbers of their vertices.
fn renumbered<I: Id>(
    textured: Column<TexturedTriangle>,
    kept: &Used,
    numbers: &Column<I>,
    context: &Context<'_>,
) -> Result<Column<TexturedTriangle>, BuildError> {
    const NAME: &str = "textured triangles";
    let stays = |triangle: &&TexturedTriangle| kept.contains(triangle.vertices[0] as usize);
    let textured = filtered(textured, NAME, context, |_, some, out| {
        out.extend(some.iter().filter(stays));
        Ok(())
    })?;
    let mut corners = BufferWriter::new(&context.store, TRIANGLES, textured.len())?;
    let mut block = Vec::new();
    each(&textured, context, |_, some| {
        block.clear();
        block.extend(some.iter().map(|triangle| triangle.vertices.map(|vertex| I::of(vertex as usize))));
        Ok(corners.extend_from_slice(&block)?)
    })?;
    let mut corners = corners.finish_column()?;
    join::run(&mut corners, numbers, context)?;
    let mut scratch = Vec::new();
    filtered(textured, NAME, context, |first, some, out| {
        let corners = corners.read(first..first + some.len(), &mut scratch)?;
        out.extend(
            some.iter()
                .zip(corners)
                .map(|(triangle, ids)| (triangle, ids.map(|id| id.index() as u32)))
                .map(|(triangle, vertices)| TexturedTriangle { vertices, ..*triangle }),
        );
        Ok(())
    })
}

/// Vertices that stay: those that have a number.
struct Kept<'a, I: Id> {
    numbers: &'a Column<I>,
    context: &'a Context<'a>,
}

impl<I: Id> ColumnMap for Kept<'_, I> {
    fn map<T: Pod + Send + Sync>(
        &self,
        items: Column<T>,
        what: &'static str,
    ) -> Result<Column<T>, BuildError> {
        let mut scratch = Vec::new();
        filtered(items, what, self.context, |first, some, out| {
            let numbers = self.numbers.read(first..first + some.len(), &mut scratch)?;
            out.extend(
                some.iter().zip(numbers).filter(|(_, number)| **number != I::NONE).map(|(item, _)| *item),
            );
            Ok(())
        })
    }
}

/// Items that `choose` takes, some at a time.
fn filtered<T: Pod>(
    items: Column<T>,
    what: &'static str,
    context: &Context<'_>,
    mut choose: impl FnMut(usize, &[T], &mut Vec<T>) -> Result<(), BuildError>,
) -> Result<Column<T>, BuildError> {
    let (mut chosen, mut some) = (BufferWriter::new(&context.store, what, 0)?, Vec::new());
    each(&items, context, |first, items| {
        some.clear();
        choose(first, items, &mut some)?;
        Ok(chosen.extend_from_slice(&some)?)
    })?;
    Ok(chosen.finish_column()?)
}

/// A mesh as its source has it.
struct Mesh<'a, T: Pod, I: Id> {
    path: &'a Path,
    positions: &'a Column<[T; 3]>,
    triangles: &'a Column<[I; 3]>,
    used: &'a Used,
}

impl<T: Pod + Into<f64>, I: Id> Mesh<'_, T, I> {
    /// By vertex its new number or [`Id::NONE`], the vertices of the components that stay, and how many do not.
    fn sort_out(&self, size: Length, context: &Context<'_>) -> Result<(Column<I>, Used, u64), BuildError> {
        let links = components::links(self.triangles, self.positions.len(), context)?;
        let least = size.of(self.whole(context)?.size());
        let mut kept = Used::none(self.positions.len(), &context.store)?;
        let components = self.judge(least, &links, &mut kept, context)?;
        Ok((self.number(links, &mut kept, context)?, kept, components))
    }

    /// The box of all vertices that triangles use.
    fn whole(&self, context: &Context<'_>) -> Result<Extent, BuildError> {
        let mut whole = Extent::NONE;
        each(self.positions, context, |first, points| {
            let used = (first..).zip(points).filter(|(vertex, _)| self.used.contains(*vertex));
            used.for_each(|(_, point)| whole.add(&Extent::of(*point)));
            Ok(())
        })?;
        Ok(whole)
    }

    /// Puts the first vertex of every component that is at least as large as `least` into `kept`, and counts the other components.
    fn judge(
        &self,
        least: f64,
        links: &Column<I>,
        kept: &mut Used,
        context: &Context<'_>,
    ) -> Result<u64, BuildError> {
        let (store, count) = (&context.store, self.positions.len());
        let _share = store
            .budget
            .reserve_work("boxes of components", (count.min(SLICE) * size_of::<Extent>()) as u64)?;
        let slices = count.div_ceil(SLICE);
        let mut parts = Buckets::new(store, "boxes of components", slices, BLOCK);
        let mut recent = [Part { extent: Extent::NONE, vertex: 0 }; RECENT];
        let (mut extents, mut block) = (Vec::new(), Vec::new());
        let (mut points, mut ups) = (Vec::new(), Vec::new());
        let (mut small, mut largest) = (0, None::<f64>);
        for slice in (0..slices).rev() {
            context.check()?;
            for part in recent.iter_mut().filter(|part| !part.extent.is_none()) {
                parts.push(part.vertex as usize / SLICE, *part)?;
                part.extent = Extent::NONE;
            }

            // The boxes that later slices sent to vertices of this one.
            let first = slice * SLICE;
            let range = first..count.min(first + SLICE);
            extents.clear();
            extents.resize(range.len(), Extent::NONE);
            for number in 0..parts.block_count(slice) {
                parts.read_block(slice, number, &mut block)?;
                block.iter().for_each(|part: &Part| extents[part.vertex as usize - first].add(&part.extent));
            }
            parts.clear(slice);

            // From the last vertex to the first, each box goes on to an earlier vertex, in this slice or one to come; a vertex that has none
            // is the first of its component, and has all of its box.
            let points = self.positions.read(range.clone(), &mut points)?;
            let ups = links.read(range.clone(), &mut ups)?;
            for vertex in range.rev().filter(|vertex| self.used.contains(*vertex)) {
                let at = vertex - first;
                let up = ups[at].index();
                let mut extent = extents[at];
                extent.add(&Extent::of(points[at]));
                if up == vertex {
                    largest = Some(largest.map_or(extent.size(), |largest| largest.max(extent.size())));
                    match extent.size() < least {
                        true => small += 1,
                        false => drop(kept.insert(vertex)),
                    }
                } else if up >= first {
                    extents[up - first].add(&extent);
                } else {
                    let part = &mut recent[up % RECENT];
                    if part.vertex != up as u64 && !part.extent.is_none() {
                        parts.push(part.vertex as usize / SLICE, *part)?;
                        part.extent = Extent::NONE;
                    }
                    part.vertex = up as u64;
                    part.extent.add(&extent);
                }
            }
        }

        if kept.count() == 0 {
            let (path, largest) = (self.path.to_owned(), largest.unwrap_or(0.0));
            return Err(BuildError::AllSmall { path, components: small, least, largest });
        }
        Ok(small)
    }

    /// Puts all vertices of the components into `kept` whose first one is there, and numbers what stays: these and all that no triangle
    /// uses.
    fn number(
        &self,
        links: Column<I>,
        kept: &mut Used,
        context: &Context<'_>,
    ) -> Result<Column<I>, BuildError> {
        let mut numbers = BufferWriter::new(&context.store, "numbers of vertices", links.len())?;
        let (mut next, mut some) = (0, Vec::new());
        each(&links, context, |first, links| {
            some.clear();
            for (vertex, link) in (first..).zip(links) {
                if kept.contains(link.index()) {
                    kept.insert(vertex);
                }
                let stays = kept.contains(vertex) || !self.used.contains(vertex);
                some.push(if stays { I::of(next) } else { I::NONE });
                next += usize::from(stays);
            }
            Ok(numbers.extend_from_slice(&some)?)
        })?;
        Ok(numbers.finish_column()?)
    }
}

/// A box, in double precision: sources have their coordinates so.
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
#[repr(C)]
struct Extent {
    low: [f64; 3],
    high: [f64; 3],
}

/// The box of vertices whose links lead to a vertex.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Part {
    extent: Extent,
    vertex: u64,
}

impl Extent {
    const NONE: Extent = Extent { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };

    fn of<T: Into<f64>>(point: [T; 3]) -> Self {
        let point = point.map(Into::into);
        Extent { low: point, high: point }
    }

    fn is_none(&self) -> bool {
        self.low[0] > self.high[0]
    }

    fn add(&mut self, other: &Extent) {
        for axis in 0..3 {
            self.low[axis] = self.low[axis].min(other.low[axis]);
            self.high[axis] = self.high[axis].max(other.high[axis]);
        }
    }

    /// The diagonal.
    fn size(&self) -> f64 {
        let [x, y, z] = std::array::from_fn(|axis| self.high[axis] - self.low[axis]);
        (x * x + y * y + z * z).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vertex_columns::VertexColumns;
    use chpm_extmem::Store;
    use chpm_extmem::{Cancel, Silent};
    use chpm_mesh::Vertices;
    use std::path::Path;

    fn column<T: Pod>(store: &Store, items: &[T]) -> Column<T> {
        let mut writer = BufferWriter::new(store, "items", items.len()).unwrap();
        writer.extend_from_slice(items).unwrap();
        writer.finish_column().unwrap()
    }

    /// Strips of ten vertices each, as many as take three slices of boxes. Every third is long; numbers and order are shuffled, so that no
    /// slice has all of a strip, and every eleventh vertex belongs to none.
    #[test]
    fn components_across_slices_are_judged_by_all_of_their_box() {
        const STRIPS: u32 = 60_000;
        const VERTICES: u32 = 11 * STRIPS;
        let number = |i: u32| (u64::from(i) * 1_000_003 % u64::from(VERTICES)) as u32;
        let is_long = |strip: u32| strip.is_multiple_of(3);

        let mut positions = vec![[0.0f32; 3]; VERTICES as usize];
        let mut triangles = Vec::new();
        for strip in 0..STRIPS {
            let step = if is_long(strip) { 1.0 } else { 0.5 };
            let vertex = |i: u32| number(11 * strip + i);
            for i in 0..10 {
                positions[vertex(i) as usize] = [step * i as f32, strip as f32, 0.0];
            }
            triangles.extend((0..8).map(|i| [vertex(i + 2), vertex(i), vertex(i + 1)]));
        }

        triangles.sort_unstable_by_key(|t| t[0].wrapping_mul(0x9e37_79b9));
        let vertices = Vertices {
            positions,
            colors: (0..VERTICES).map(u32::to_le_bytes).collect(),
            ..Vertices::default()
        };
        let positions = &vertices.positions;
        let dir = tempfile::tempdir().unwrap();

        for memory in [0, 1 << 30] {
            let store = Store::create(dir.path(), memory).unwrap();
            let mut used = Used::new(&store).unwrap();
            used.add(&triangles, VERTICES as usize).unwrap();
            let columns = Columns {
                vertices: VertexColumns::of(vertices.view(), &store),
                doubles: column(&store, &[]),
                triangles: column(&store, &triangles),
                used,
                bounds: Aabb::of_points(positions),
            };
            let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
            let context = Context::new(store, pool, &Silent, Cancel::default());
            // Every other one, told apart by its material.
            let textured: Vec<TexturedTriangle> = (0..)
                .zip(&triangles)
                .step_by(2)
                .map(|(material, vertices)| TexturedTriangle {
                    vertices: *vertices,
                    uv: [[0.5; 2]; 3],
                    material,
                })
                .collect();
            let some = Some(column(&context.store, &textured));
            let run = || leave_out(columns, some, Length::Units(5.0), Path::new("strips"), &context);
            let ((kept, left), counts) = context.pool.install(run).unwrap();
            let strips = u64::from(STRIPS);

            assert_eq!(
                counts,
                SmallComponents { components: 2 * strips / 3, triangles: 8 * (2 * strips / 3) }
            );
            assert_eq!(kept.used.count(), 10 * strips / 3);

            let mut stays = vec![false; VERTICES as usize];
            for (strip, i) in (0..STRIPS).flat_map(|strip| (0..11).map(move |i| (strip, i))) {
                stays[number(11 * strip + i) as usize] = is_long(strip) || i == 10;
            }
            let names: Vec<u32> = (0..VERTICES).filter(|v| stays[*v as usize]).collect();

            let (mut items, mut points) = (Vec::new(), Vec::new());
            let colors = kept.vertices.colors.as_ref().unwrap();
            let colors = colors.read(0..colors.len(), &mut Vec::new()).unwrap().to_vec();
            assert!(colors.iter().map(|bytes| u32::from_le_bytes(*bytes)).eq(names.iter().copied()));
            let points = kept.vertices.positions.read(0..names.len(), &mut points).unwrap();
            assert!(names.iter().zip(points).all(|(name, point)| positions[*name as usize] == *point));
            assert_eq!(kept.bounds, Aabb::of_points(points));
            let items = kept.triangles.read(0..kept.triangles.len(), &mut items).unwrap();
            let told = items.iter().map(|t| t.map(|v| names[v as usize]));
            assert!(told.eq(triangles.iter().copied().filter(|t| stays[t[0] as usize])));
            let (left, mut items) = (left.unwrap(), Vec::new());
            let left = left.read(0..left.len(), &mut items).unwrap();
            let told = left.iter().map(|t| (t.vertices.map(|v| names[v as usize]), t.material));
            let expected = textured.iter().filter(|t| stays[t.vertices[0] as usize]);
            assert!(told.eq(expected.map(|t| (t.vertices, t.material))));
        }
    }
}
