//! Generated meshes: large ones streamed from a short description, and small ones by [`hand`].
//!
//! A [`Synth`] knows its exact counts before it emits anything and emits vertices and triangles in batches, so a
//! hundred million triangles need no more memory than a thousand do, or one slab for the isosurface. The same
//! description gives the same bits on every machine.
#![forbid(unsafe_code)]

mod grid;
pub mod hand;
pub mod hard;
mod isosurface;
mod noise;
pub mod odd;
mod plant;
mod plates;
mod sphere;

use chpm_mesh::TriMesh;
use std::{fmt, str::FromStr};

/// Kinds of generated meshes.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Shape {
    /// A fractal height field over the unit square: one component with an open boundary.
    Terrain,
    /// A noisy isosurface in a volume: closed, high genus, many components of every size.
    Isosurface,
    /// The unit sphere as a rounded cube: closed, genus 0, no vertex of high valence.
    Sphere,
    /// A torus of radii 1 and 0.4: closed, genus 1.
    Torus,
    /// Drilled plates: several closed components with sharp edges, holes and slivers of aspect 1000 and more.
    Plates,
    /// Pipes, bolts and tanks beside each other: as many closed components as are asked for.
    Plant,
}

impl Shape {
    /// Every shape that has one size: of a plant the number of parts is asked for, too.
    pub const ALL: [Shape; 5] =
        [Shape::Terrain, Shape::Isosurface, Shape::Sphere, Shape::Torus, Shape::Plates];

    fn name(self) -> &'static str {
        match self {
            Shape::Terrain => "terrain",
            Shape::Isosurface => "isosurface",
            Shape::Sphere => "sphere",
            Shape::Torus => "torus",
            Shape::Plates => "plates",
            Shape::Plant => "plant",
        }
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// Why a text names no shape.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[error("'{0}' is not a shape: choose terrain, isosurface, sphere, torus, plates or plant")]
pub struct ParseShapeError(String);

impl FromStr for Shape {
    type Err = ParseShapeError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Shape::ALL
            .into_iter()
            .chain([Shape::Plant])
            .find(|s| s.name() == text)
            .ok_or_else(|| ParseShapeError(text.to_owned()))
    }
}

/// Takes one batch of items; its error ends the generation.
pub type Sink<'a, T, E> = &'a mut dyn FnMut(&[T]) -> Result<(), E>;

/// The description of a generated mesh.
///
/// ```
/// use chpm_synth::{Shape, Synth};
///
/// let torus = Synth::new(Shape::Torus, 10_000, 0);
/// let mesh = torus.to_mesh();
/// assert_eq!(mesh.triangles.len() as u64, torus.triangle_count());
/// assert!(torus.triangle_count().abs_diff(10_000) < 500);
/// ```
#[derive(Clone, Debug)]
pub struct Synth {
    shape: Shape,
    plan: Plan,
}

#[derive(Clone, Debug)]
enum Plan {
    Terrain(grid::Terrain),
    Isosurface(isosurface::Isosurface),
    Sphere(sphere::Sphere),
    Torus(grid::Torus),
    Plates(plates::Plates),
    Plant(plant::Plant),
}

/// Calls the same method on whichever plan it is.
macro_rules! each {
    ($plan:expr, $bound:ident => $call:expr) => {
        match $plan {
            Plan::Terrain($bound) => $call,
            Plan::Isosurface($bound) => $call,
            Plan::Sphere($bound) => $call,
            Plan::Torus($bound) => $call,
            Plan::Plates($bound) => $call,
            Plan::Plant($bound) => $call,
        }
    };
}

impl Synth {
    /// The most triangles that a generated mesh aims at: indices are 32 bits.
    pub const MAX_TRIANGLES: u64 = 1 << 32;

    /// Plans a mesh of about `target_triangles`: within 5 % from 3000 triangles on; below, each shape has a least
    /// size. `seed` changes terrain, isosurface, plates and plant. Planning an isosurface counts it, in about as long as
    /// emitting its vertices; the others are planned at once.
    pub fn new(shape: Shape, target_triangles: u64, seed: u64) -> Self {
        let target = target_triangles.min(Self::MAX_TRIANGLES);
        let plan = match shape {
            Shape::Terrain => Plan::Terrain(grid::Terrain::new(target, seed)),
            Shape::Isosurface => Plan::Isosurface(isosurface::Isosurface::new(target, seed)),
            Shape::Sphere => Plan::Sphere(sphere::Sphere::new(target)),
            Shape::Torus => Plan::Torus(grid::Torus::new(target)),
            Shape::Plates => Plan::Plates(plates::Plates::new(target, seed)),
            Shape::Plant => return Self::plant((target / Self::PART).max(1), target, seed),
        };
        Synth { shape, plan }
    }

    /// Triangles of a part of a plant, where nothing tells how many parts there are.
    pub const PART: u64 = 2_000;
    /// Parts of a plant, at most.
    pub const MAX_PARTS: u64 = 10_000_000;

    /// Plans a plant of so many parts, and of about so many triangles where that is no fewer than 200 a part.
    pub fn plant(parts: u64, target_triangles: u64, seed: u64) -> Self {
        let (parts, target) = (parts.min(Self::MAX_PARTS), target_triangles.min(Self::MAX_TRIANGLES));
        Synth { shape: Shape::Plant, plan: Plan::Plant(plant::Plant::new(parts, target, seed)) }
    }

    /// Shape that it generates.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// The exact number of vertices that [`Self::for_each_vertices`] emits.
    pub fn vertex_count(&self) -> u64 {
        each!(&self.plan, plan => plan.vertex_count())
    }

    /// The exact number of triangles that [`Self::for_each_triangles`] emits.
    pub fn triangle_count(&self) -> u64 {
        each!(&self.plan, plan => plan.triangle_count())
    }

    /// Hands all vertices to `sink` in order, in batches that are never empty; stops at its first error.
    pub fn for_each_vertices<E>(&self, sink: Sink<'_, [f32; 3], E>) -> Result<(), E> {
        let mut batch = Batch::new(sink);
        each!(&self.plan, plan => plan.vertices(&mut batch))?;
        batch.finish()
    }

    /// Hands all triangles to `sink` in order, in batches that are never empty; stops at its first error.
    pub fn for_each_triangles<E>(&self, sink: Sink<'_, [u32; 3], E>) -> Result<(), E> {
        let mut batch = Batch::new(sink);
        each!(&self.plan, plan => plan.triangles(&mut batch))?;
        batch.finish()
    }

    /// The whole mesh in core.
    pub fn to_mesh(&self) -> TriMesh {
        let mut mesh = TriMesh::default();
        let Ok(()) = self.for_each_vertices::<std::convert::Infallible>(&mut |batch| {
            mesh.positions.extend_from_slice(batch);
            Ok(())
        });
        let Ok(()) = self.for_each_triangles::<std::convert::Infallible>(&mut |batch| {
            mesh.triangles.extend_from_slice(batch);
            Ok(())
        });
        mesh
    }
}

/// Collects items and hands them on a few thousand at a time.
struct Batch<'a, T, E> {
    items: Vec<T>,
    sink: Sink<'a, T, E>,
}

impl<'a, T, E> Batch<'a, T, E> {
    const LEN: usize = 8192;

    fn new(sink: Sink<'a, T, E>) -> Self {
        Batch { items: Vec::with_capacity(Self::LEN), sink }
    }

    fn push(&mut self, item: T) -> Result<(), E> {
        self.items.push(item);
        if self.items.len() == Self::LEN {
            (self.sink)(&self.items)?;
            self.items.clear();
        }
        Ok(())
    }

    fn finish(self) -> Result<(), E> {
        if self.items.is_empty() { Ok(()) } else { (self.sink)(&self.items) }
    }
}

impl<E> Batch<'_, [u32; 3], E> {
    /// A quad given around its outline, cut along its first corner's diagonal.
    fn push_quad(&mut self, [a, b, c, d]: [u32; 4]) -> Result<(), E> {
        self.push([a, b, c])?;
        self.push([a, c, d])
    }
}

#[cfg(test)]
mod tests;
