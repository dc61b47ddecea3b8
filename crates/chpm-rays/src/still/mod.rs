//! Pictures by rays: smooth edges, shadows of round lights, less light where much is near. No GPU.
//!
//! 1. Rays from the eye meet the mesh of a bound that grows as a pixel does. It is common to all of them.
//! 2. A ray toward a light is allowed what the eye allows where a caster is, and no more than where the shadow falls. Where all of a ray is nearer to the eye than its
//!    beginning, the first is the smaller one anyway, and it goes through the mesh that the eye sees. Groups whose box holds the beginning decide as they did for the
//!    eye, so no shadow comes of differing levels.
//! 3. Rays for the light from everywhere go through the mesh that the eye sees. They are of limited length: each reaches as far as its own number says, so that
//!    what is twice as near hides more.
//! 4. On smooth surfaces rays begin on the surface that the normals stand for (Hanika, *Hacking the shadow terminator*, Ray Tracing Gems II, 2021).
//! 5. Where clusters have images, these are what is seen; what they leave out is seen through by the eye, not by lights.
//! 6. Numbers come of the pixel and the place in its sequence alone: whatever the threads and the memory, a picture has the same bytes.

mod borders;
mod eye;
mod sequence;
mod shade;
mod sheet;
mod skin;
mod skins;

use crate::caster::{Caster, Memory};
use crate::error::RayError;
use crate::ray::{Hit, Ray, Seek};
use borders::Borders;
use chpm_format::Chpm;
use chpm_mesh::{Aabb, Bytes, ClusterId, Scalar};
use chpm_refine::Camera;
use eye::{Eye, Vector};
use rayon::prelude::*;
use sequence::Sequence;
use shade::{Light, Spot};
use skin::Skin;
use skins::Skins;
use std::ops::Range;

/// Meaning of colours.
#[derive(Clone, PartialEq, Debug)]
pub enum Paint {
    /// One colour.
    Plain,
    /// The source's: those of the images that clusters have, or of vertices; plain where there are neither.
    Own,
    /// A named scalar, from its lowest value (dark blue) to its highest (yellow), and where its words are among those of a vertex.
    Scalar(Range<usize>, Scalar),
}

/// A picture to be made. Coordinates are relative to the file's origin, each multiplied by `stretch`.
#[derive(Clone, PartialEq, Debug)]
pub struct Still {
    /// Where it is taken from; its upward direction is that of the ground, too.
    pub camera: Camera,
    /// Width and height, pixels.
    pub viewport: [u32; 2],
    /// Pixels of error that are allowed; 0 for the leaves.
    pub poe: f64,
    /// Rays of a pixel.
    pub samples: u32,
    /// Light by normals of vertices in place of planes of triangles.
    pub smooth: bool,
    /// Meaning of colours.
    pub paint: Paint,
    /// Red, green, blue behind the model, 0 to 1.
    pub background: [f32; 3],
    /// Nothing behind the model.
    pub transparent: bool,
    /// The light of a studio, as pictures of the GPU have it.
    pub studio: bool,
    /// Where key lights are: degrees to the right of the eye and above it. Together they are as bright as one.
    pub lights: Vec<[f64; 2]>,
    /// The angle under which each of them is seen, degrees; 0 for hard shadows.
    pub width: f64,
    /// Whether anything hides them.
    pub shadows: bool,
    /// How near what takes light from everywhere is, at most, in the picture's units; 0 for none.
    pub occlusion: f64,
    /// A ground that touches the model from below and is seen only by what falls onto it.
    pub ground: bool,
    /// Leaves out what is beyond a plane: its normal, of length 1, and its place.
    pub clip: Option<([f64; 3], f64)>,
    /// Factor on each coordinate of the file.
    pub stretch: [f64; 3],
}

/// Rays that were cast, by what for.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Cast {
    /// From the eye.
    pub camera: u64,
    /// Those of them that met the model.
    pub seen: u64,
    /// To lights.
    pub shadow: u64,
    /// For the light from everywhere.
    pub occlusion: u64,
}

/// A picture that was made.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Picture {
    /// Red, green, blue, alpha of each pixel, as displayed; rows from the top.
    pub pixels: Vec<u8>,
    /// Its rays.
    pub cast: Cast,
}

/// Memory of a picture.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct StillMemory {
    /// Of its rays.
    pub rays: Memory,
    /// For what meshes look like.
    skins: Bytes,
}

impl StillMemory {
    /// Bytes of a ray with all that is known of what it has met, beside what any ray has.
    const SPOT: u64 = 480;

    /// Divides what so many threads have.
    pub fn divide(all: Bytes, threads: usize) -> Self {
        let skins = Bytes(all.0 / 8);
        let rays = Memory::with_rays(Bytes(all.0 - skins.0), threads, Memory::RAY + Self::SPOT);
        StillMemory { rays, skins }
    }

    /// Bytes that a picture of a file takes, whatever is read.
    pub fn own<D: AsRef<[u8]>>(file: &Chpm<D>, viewport: [u32; 2]) -> u64 {
        let pixels = viewport.map(u64::from).iter().product::<u64>();
        let lists = 24 * file.clusters().len() as u64;
        let image = if file.header().has_sheets() { sheet::MOST } else { 0 };
        Memory::own(file) + Borders::memory(file) + lists + image + 8 * pixels
    }
}

/// Rays of a pixel for soft shadows and for light from everywhere, at least.
const SHADOWS: u32 = 16;
const OPENS: u32 = 32;

/// Most surfaces that a ray goes on behind.
const LAYERS: u64 = 64;
/// The first of the sequences that tell of half seen surfaces who sees them.
const HOLES: u64 = 1 << 32;

/// Takes a picture of the caster's file, on the threads of rayon's current pool. Asks `go_on` before each page, and tells `step` how many pixels more are done.
///
/// # Errors
/// [`RayError::View`] for a camera or an image that none can be, [`RayError::Format`] for a damaged page, [`RayError::Stopped`].
pub fn draw<D: AsRef<[u8]> + Sync>(
    caster: &mut Caster<'_, D>,
    still: &Still,
    memory: StillMemory,
    go_on: &(impl Fn() -> bool + Sync),
    mut step: impl FnMut(u64),
) -> Result<Picture, RayError> {
    let eye = Eye::new(&still.camera, still.viewport, still.poe, still.stretch, still.clip)?;
    let mut studio = Studio::new(caster.file, still, eye, memory);
    let finest = caster.finest(&eye.bound());
    let pixels = still.viewport.map(u64::from).iter().product::<u64>();
    let some = (memory.rays.rays as u64 / u64::from(still.samples.max(1))).max(1);
    let mut picture = Picture { pixels: Vec::with_capacity(4 * pixels as usize), cast: Cast::default() };
    let mut first = 0;
    while first < pixels {
        let end = pixels.min(first + some);
        studio.part(caster, &finest, first..end, go_on, &mut picture)?;
        step(end - first);
        first = end;
    }
    Ok(picture)
}

/// All that the parts of a picture have in common.
struct Studio<'s, 'a, D> {
    still: &'s Still,
    eye: Eye,
    samples: u32,
    shifts: Vec<[f64; 2]>,
    light: Light,
    lights: Vec<Vector>,
    /// Tangent of half of the lights' angle.
    half: f64,
    sky: Vector,
    /// Where along it the ground is.
    ground: Option<f64>,
    /// The box of the model in the picture.
    bounds: Aabb,
    /// Of the model and of its coordinates.
    size: f64,
    skins: Skins<'s, 'a, D>,
}

impl<'s, 'a, D: AsRef<[u8]> + Sync> Studio<'s, 'a, D> {
    fn new(file: &'a Chpm<D>, still: &'s Still, eye: Eye, memory: StillMemory) -> Self {
        let own = file.header().aabb();
        let [low, high] = [own.min, own.max].map(|corner| eye.point(corner.map(f64::from)));
        let bounds = Aabb { min: low.map(|x| x as f32).into(), max: high.map(|x| x as f32).into() };
        let sky = Vector::from(still.camera.up).try_normalize(0.0).unwrap_or(eye.up());
        let lowest =
            (0..3).map(|axis| sky[axis] * if sky[axis] > 0.0 { low[axis] } else { high[axis] }).sum::<f64>();
        let is_above = sky.dot(&eye.at) > lowest;
        Studio {
            still,
            eye,
            samples: still.samples.max(1),
            shifts: sequence::shifts(still.samples),
            light: Light::new(still.studio),
            lights: still.lights.iter().map(|light| eye.light(*light)).collect(),
            half: (0.5 * still.width.to_radians()).tan(),
            sky,
            ground: (still.ground && is_above && !own.is_empty()).then_some(lowest),
            bounds,
            size: (high - low).norm().max(low.amax()).max(high.amax()),
            skins: Skins::new(file, &still.paint, still.smooth, memory.skins.0, memory.rays.readers),
        }
    }

    /// Makes some pixels.
    fn part(
        &mut self,
        caster: &mut Caster<'_, D>,
        finest: &[bool],
        pixels: Range<u64>,
        go_on: &(impl Fn() -> bool + Sync),
        picture: &mut Picture,
    ) -> Result<(), RayError> {
        let samples = u64::from(self.samples);
        let count = (pixels.end - pixels.start) * samples;
        let place = |n: u64| (pixels.start + n / samples, (n % samples) as u32);
        let (eye, shifts) = (self.eye, self.shifts.clone());
        let sight = |n: u64| {
            let (pixel, sample) = place(n);
            eye.sight(pixel, shifts[sample as usize])
        };
        let nothing = Ray { reach: 0.0, ..Ray::new(self.eye.at.into(), [0.0, 0.0, 1.0]) };
        let rays = (0..count).into_par_iter();
        let rays: Vec<Ray> =
            rays.map(|n| self.eye.ray(self.eye.at, sight(n), f64::INFINITY).unwrap_or(nothing)).collect();
        let mut hits: Vec<Option<Hit>> = Vec::with_capacity(rays.len());
        caster.cast(&rays, &self.eye.bound(), Seek::Nearest, go_on, |hit, _| hits.push(hit))?;
        drop(rays);
        picture.cast.camera += count;
        if self.skins.have_holes() {
            picture.cast.camera += self.see_through(caster, finest, &mut hits, &place, &sight, go_on)?;
        }
        picture.cast.seen += hits.iter().flatten().count() as u64;

        // The ground, where nothing is before it. What lies on it is: that its points are below by less than single precision tells nothing.
        let mut spots: Vec<Option<Spot>> = Vec::new();
        if let Some(ground) = self.ground {
            let seen = hits.par_iter_mut().enumerate().map(|(n, hit)| {
                let way = sight(n as u64);
                let down = way.dot(&self.sky);
                let away = (ground - self.sky.dot(&self.eye.at)) / down;
                let least = ground - 4.0 * f64::from(f32::EPSILON) * self.size;
                let before = hit.is_none_or(|hit| self.sky.dot(&self.eye.point(hit.point)) < least);
                if !(down < 0.0 && before) {
                    return None;
                }
                *hit = None;
                Some(Spot::ground(self.eye.at + way * away, self.sky, self.size))
            });
            spots = seen.collect();
        }
        spots.resize(hits.len(), None);
        self.dress(finest, &hits, &mut spots, &sight, go_on)?;
        drop(hits);

        let (keys, opens) = self.light(caster, &spots, &place, go_on, &mut picture.cast)?;
        let mixed = (0..pixels.end - pixels.start).into_par_iter().map(|pixel| {
            let mut sum = [0.0_f32; 4];
            for n in pixel * samples..(pixel + 1) * samples {
                let at = n as usize;
                let Some(spot) = &spots[at] else { continue };
                let light =
                    self.light.on(spot, &sight(n), &self.sky, f64::from(opens[at]), keys[at].map(f64::from));
                let (color, alpha) = light;
                (0..3).for_each(|c| sum[c] += alpha * color[c]);
                sum[3] += alpha;
            }
            self.pixel(sum)
        });
        picture.pixels.par_extend(mixed.flatten_iter());
        Ok(())
    }

    /// A pixel of sums of colours, each times its share, and of these shares.
    fn pixel(&self, [red, green, blue, shown]: [f32; 4]) -> [u8; 4] {
        let all = self.samples as f32;
        let byte = |x: f32| (255.0 * x).round().clamp(0.0, 255.0) as u8;
        if self.still.transparent {
            let color = [red, green, blue].map(|c| if shown > 0.0 { byte(c / shown) } else { 0 });
            let alpha = byte(shown / all);
            return if alpha == 0 { [0; 4] } else { [color[0], color[1], color[2], alpha] };
        }
        let behind = self.still.background.map(|c| c * (all - shown).max(0.0));
        let [red, green, blue] =
            [red + behind[0], green + behind[1], blue + behind[2]].map(|c| byte(c / all));
        [red, green, blue, 255]
    }

    /// Passes rays on that have met what an image leaves out: where it is half seen, half of them.
    fn see_through(
        &mut self,
        caster: &mut Caster<'_, D>,
        finest: &[bool],
        hits: &mut [Option<Hit>],
        place: &(impl Fn(u64) -> (u64, u32) + Sync),
        sight: &(impl Fn(u64) -> Vector + Sync),
        go_on: &(impl Fn() -> bool + Sync),
    ) -> Result<u64, RayError> {
        let (eye, size, mut count) = (self.eye, self.size, 0);
        // Each hit is looked at once.
        let mut fresh = hits.to_vec();
        for layer in 0..LAYERS {
            let is_open = |skin: &Skin, hit: &Hit, n: u64| {
                let (pixel, sample) = place(n);
                let [least, _] = Sequence::new(pixel, HOLES + layer).square(sample);
                skin.opacity(hit.triangle, hit.point, eye.width(hit.point)) <= least
            };
            let mut open = Vec::new();
            self.visit(finest, &fresh, go_on, is_open, |n, is_open| {
                if is_open {
                    open.push(n);
                }
            })?;
            let ray = |n: &usize| {
                let (hit, way) = (fresh[*n]?, sight(*n as u64));
                let from = eye.point(hit.point) + way * (shade::LIFT * size);
                Some((*n, eye.ray(from, way, f64::INFINITY)?))
            };
            let (from, rays): (Vec<usize>, Vec<Ray>) = open.par_iter().filter_map(ray).unzip();
            open.iter().for_each(|n| hits[*n] = None);
            fresh.fill(None);
            if rays.is_empty() {
                break;
            }
            count += rays.len() as u64;
            let mut from = from.into_iter();
            caster.cast(&rays, &eye.bound(), Seek::Nearest, go_on, |hit, _| {
                let n = from.next().unwrap_or_default();
                (hits[n], fresh[n]) = (hit, hit);
            })?;
        }
        Ok(count)
    }

    /// Makes spots of hits.
    fn dress(
        &mut self,
        finest: &[bool],
        hits: &[Option<Hit>],
        spots: &mut [Option<Spot>],
        sight: &(impl Fn(u64) -> Vector + Sync),
        go_on: &(impl Fn() -> bool + Sync),
    ) -> Result<(), RayError> {
        let (eye, size, paint) = (self.eye, self.size, &self.still.paint);
        let spot = |skin: &Skin, hit: &Hit, n: u64| {
            let corners = skin.corners(hit.triangle);
            let seen = (hit.point, eye.width(hit.point));
            let color = |shares| skin.color(hit.triangle, shares, seen, paint);
            Spot::new(&eye, eye.point(hit.point), hit.normal, &corners, &sight(n), size, color)
        };
        self.visit(finest, hits, go_on, spot, |n, spot| spots[n] = Some(spot))
    }

    /// Looks at all hits, of some clusters at a time, and takes what is found at each, by its number.
    fn visit<T: Send>(
        &mut self,
        finest: &[bool],
        hits: &[Option<Hit>],
        go_on: &(impl Fn() -> bool + Sync),
        look: impl Fn(&Skin, &Hit, u64) -> T + Sync,
        mut take: impl FnMut(usize, T),
    ) -> Result<(), RayError> {
        let met = hits.par_iter().enumerate().filter_map(|(n, hit)| hit.map(|hit| (hit.cluster, n as u32)));
        let mut order: Vec<(ClusterId, u32)> = met.collect();
        order.par_sort_unstable();
        let mut clusters: Vec<ClusterId> = order.iter().map(|(cluster, _)| *cluster).collect();
        clusters.dedup();
        let (mut rest, mut clusters) = (order.as_slice(), clusters.as_slice());
        while !clusters.is_empty() {
            let (some, others) = clusters.split_at(self.skins.fitting(clusters));
            clusters = others;
            self.skins.put_on(finest, some, go_on)?;
            let last = some[some.len() - 1];
            let (now, later) = rest.split_at(rest.partition_point(|(cluster, _)| *cluster <= last));
            rest = later;
            let found = |(cluster, n): &(ClusterId, u32)| {
                let (skin, hit) = (self.skins.get(*cluster)?, hits[*n as usize].as_ref()?);
                Some(look(skin, hit, (*n).into()))
            };
            let found: Vec<Option<T>> = now.par_iter().map(found).collect();
            for ((_, n), found) in now.iter().zip(found) {
                if let Some(found) = found {
                    take(*n as usize, found);
                }
            }
        }
        Ok(())
    }

    /// For each spot what comes to it of the key lights, and what would if nothing hid them; and how much of the light from everywhere.
    fn light(
        &self,
        caster: &mut Caster<'_, D>,
        spots: &[Option<Spot>],
        place: &(impl Fn(u64) -> (u64, u32) + Sync),
        go_on: &(impl Fn() -> bool + Sync),
        cast: &mut Cast,
    ) -> Result<(Vec<[f32; 2]>, Vec<f32>), RayError> {
        let mut keys = vec![[0.0_f32; 2]; spots.len()];
        let each = if self.half > 0.0 { SHADOWS.div_ceil(self.samples) } else { 1 };
        for (number, light) in self.lights.iter().enumerate() {
            let falls = |spot: &Spot| (spot.normal.dot(light).max(0.0) / self.lights.len() as f64) as f32;
            let is_lit = |spot: &&Spot| falls(spot) > 0.0;
            keys.par_iter_mut().zip(spots).for_each(|(key, spot)| {
                let falls = spot.as_ref().filter(is_lit).map_or(0.0, falls);
                *key = key.map(|sum| sum + falls);
            });
            if !self.still.shadows {
                continue;
            }
            for turn in 0..each {
                let ray = |n: usize| {
                    let spot = spots[n].as_ref().filter(is_lit)?;
                    let (pixel, sample) = place(n as u64);
                    let point = Sequence::new(pixel, 1 + number as u64).square(sample * each + turn);
                    let way = shade::toward(light, self.half, point);
                    let cap = self.eye.cap(spot.at, way, &self.bounds);
                    Some(Ray { cap, ..self.eye.ray(spot.from, way, f64::INFINITY)? })
                };
                let mut take = |n: usize| {
                    let lost = spots[n].as_ref().map_or(0.0, falls) / each as f32;
                    keys[n][0] = (keys[n][0] - lost).max(0.0);
                };
                cast.shadow += self.hidden(caster, spots.len(), ray, &mut take, go_on)?;
            }
        }

        let mut opens = vec![1.0_f32; spots.len()];
        let each = OPENS.div_ceil(self.samples);
        for turn in 0..if self.still.occlusion > 0.0 { each } else { 0 } {
            let way = |n: usize, spot: &Spot| {
                let (pixel, sample) = place(n as u64);
                let [u, v, w] = Sequence::new(pixel, 0).cube(sample * each + turn);
                (spot.outward([u, v]), w * self.still.occlusion)
            };
            // The ground takes light from what is above it.
            let is_taken = |n: usize, spot: &Spot| {
                let (way, reach) = way(n, spot);
                let end = self.sky.dot(&(spot.from + way * reach));
                !spot.is_ground && self.ground.is_some_and(|ground| end < ground)
            };
            let part = 1.0 / each as f32;
            opens.par_iter_mut().zip(spots).enumerate().for_each(|(n, (open, spot))| {
                if spot.as_ref().is_some_and(|spot| is_taken(n, spot)) {
                    *open = (*open - part).max(0.0);
                }
            });
            let ray = |n: usize| {
                let spot = spots[n].as_ref()?;
                let (way, reach) = way(n, spot);
                if is_taken(n, spot) { None } else { self.eye.ray(spot.from, way, reach) }
            };
            let mut take = |n: usize| opens[n] = (opens[n] - part).max(0.0);
            cast.occlusion += self.hidden(caster, spots.len(), ray, &mut take, go_on)?;
        }
        Ok((keys, opens))
    }

    /// Casts the rays of places that have some, those with a limit of their own apart, and tells of those that meet something. How many there were.
    fn hidden(
        &self,
        caster: &mut Caster<'_, D>,
        places: usize,
        ray: impl Fn(usize) -> Option<Ray> + Sync,
        take: &mut impl FnMut(usize),
        go_on: &(impl Fn() -> bool + Sync),
    ) -> Result<u64, RayError> {
        let mut count = 0;
        for is_limited in [false, true] {
            let asked = (0..places).into_par_iter().filter_map(|n| Some((n as u32, ray(n)?)));
            let asked = asked.filter(|(_, ray)| ray.cap.is_finite() == is_limited);
            let (from, rays): (Vec<u32>, Vec<Ray>) = asked.unzip();
            count += rays.len() as u64;
            let mut from = from.into_iter();
            caster.cast(&rays, &self.eye.bound(), Seek::Any, go_on, |hit, _| {
                let n = from.next().unwrap_or_default();
                if hit.is_some() {
                    take(n as usize);
                }
            })?;
        }
        Ok(count)
    }
}
