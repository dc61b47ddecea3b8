//! Settings of the panel; the request for a frame follows from them.

use crate::gpu::Gpu;
use crate::request::{Accuracy, Clip, Coloring, FrameRequest, Look, Shading};
use crate::window::detail::Wish;
use chpm_mesh::Aabb;
use chpm_refine::{Camera, Up};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Pixels of error that the panel offers.
pub const POE: RangeInclusive<f64> = 0.1..=64.0;
/// Triangle budgets that the panel offers.
pub const TRIANGLES: RangeInclusive<u64> = 1_000..=100_000_000;

/// Milliseconds of a frame in motion that the panel offers.
pub const FRAME: RangeInclusive<f64> = 8.0..=500.0;

/// When edges are drawn without stairs, with four samples a pixel.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Smooth {
    /// Never.
    Off,
    /// In pictures that do not move and are complete: what moves loses no detail to it.
    Rest,
    /// Always.
    Always,
}

impl Smooth {
    /// All of them, with their names in the panel and what they do.
    pub const ALL: [(Smooth, &'static str, &'static str); 3] = [
        (Smooth::Off, "off", "edges have stairs"),
        (Smooth::Rest, "at rest", "edges are smooth once nothing moves"),
        (Smooth::Always, "4x", "edges are smooth, with four samples a pixel"),
    ];

    /// Samples of a frame that is at rest or not.
    pub fn samples(self, rests: bool) -> u32 {
        if self == Smooth::Always || self == Smooth::Rest && rests { 4 } else { 1 }
    }
}

/// All of it. Fields that a file does not have are as by default.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Pixels of error that are allowed, where no budget decides.
    pub poe: f64,
    /// The triangle budget.
    pub triangles: u64,
    /// Whether the budget decides.
    pub budgeted: bool,
    /// Milliseconds that a frame may take while something moves, at the cost of detail.
    pub frame: f64,
    /// Whether motion costs detail, and no more triangles are drawn than the image has pixels.
    pub adaptive: bool,
    /// Smooth shading.
    pub smooth: bool,
    /// When edges have no stairs, whatever the adapter; if not told, a processor that draws does it at rest, and others always.
    pub antialias: Option<Smooth>,
    /// Whether the key light throws shadows and corners are darker, whatever the adapter; if not told, unless a processor draws.
    pub shadows: Option<bool>,
    /// Where the key light is: degrees to the right of the eye, and above it.
    pub light: [f64; 2],
    /// Which axis a clipping plane is across: a place in [`Up::ALL`], from 1; 0 for no plane.
    pub clip: u8,
    /// The share of the model's box that it leaves.
    pub clip_share: f64,
    /// Whether the outline of what it cuts is drawn.
    pub outline: bool,
    /// Meaning of colours.
    #[serde(with = "color_name")]
    pub colors: Coloring,
    /// Edges over faces.
    pub wireframe: bool,
    /// Leaves out triangles that are seen from behind.
    pub one_sided: bool,
    /// Leaves out what is outside the image.
    pub frustum_culling: bool,
    /// Leaves out what is hidden.
    pub occlusion_culling: bool,
    /// Drags look around instead of going around.
    pub fly: bool,
    /// Whether the panel is shown.
    pub panel: bool,
    /// Whether what a developer looks at is unfolded in it.
    pub counters: bool,
    /// Whether scale bar and axes are.
    pub rulers: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            poe: 1.0,
            triangles: 1_000_000,
            budgeted: false,
            frame: 30.0,
            adaptive: true,
            smooth: true,
            antialias: None,
            shadows: None,
            light: Look::LIGHT,
            clip: 0,
            clip_share: 0.5,
            outline: true,
            colors: Coloring::Vertex,
            wireframe: false,
            one_sided: false,
            frustum_culling: true,
            occlusion_culling: true,
            fly: false,
            panel: true,
            counters: false,
            rulers: true,
        }
    }
}

impl Settings {
    /// Settings with this accuracy.
    pub fn with_accuracy(mut self, accuracy: Accuracy) -> Self {
        match accuracy {
            Accuracy::PoE(poe) => (self.poe, self.budgeted) = (poe, false),
            Accuracy::Triangles(triangles) => (self.triangles, self.budgeted) = (triangles, true),
        }
        self
    }

    /// When edges have no stairs, on this adapter.
    pub fn smooths(&self, gpu: &Gpu) -> Smooth {
        let usual = if gpu.is_software() { Smooth::Rest } else { Smooth::Always };
        if gpu.multisamples() { self.antialias.unwrap_or(usual) } else { Smooth::Off }
    }

    /// Whether there are shadows, on this adapter.
    pub fn shades(&self, gpu: &Gpu) -> bool {
        self.shadows.unwrap_or(!gpu.is_software())
    }

    /// How fine the mesh is at rest.
    pub fn accuracy(&self) -> Accuracy {
        if self.budgeted { Accuracy::Triangles(self.triangles) } else { Accuracy::PoE(self.poe) }
    }

    /// Wanted detail of the next frame, for an image of this size.
    pub fn wish(&self, [width, height]: [u32; 2]) -> Wish {
        let pixels = if self.adaptive { u64::from(width) * u64::from(height) } else { u64::MAX };
        Wish {
            poe: if self.budgeted { 0.0 } else { self.poe },
            triangles: if self.budgeted { self.triangles } else { pixels },
            ms: if self.adaptive { self.frame } else { f64::INFINITY },
        }
    }

    /// One frame with these settings on this adapter, not waiting.
    pub fn request_on(
        &self,
        gpu: &Gpu,
        camera: Camera,
        viewport: [u32; 2],
        select_from: Option<Camera>,
    ) -> FrameRequest {
        let shades = self.shades(gpu);
        let request = self.request(camera, viewport, select_from);
        FrameRequest { look: Look { shadows: shades, occlusion: shades, ..request.look }, ..request }
    }

    fn request(&self, camera: Camera, viewport: [u32; 2], select_from: Option<Camera>) -> FrameRequest {
        FrameRequest {
            accuracy: self.accuracy(),
            look: Look {
                shading: if self.smooth { Shading::Smooth } else { Shading::Flat },
                colors: self.colors,
                wireframe: self.wireframe,
                one_sided: self.one_sided,
                light: self.light,
                ..Look::default()
            },
            frustum_culling: self.frustum_culling,
            occlusion_culling: self.occlusion_culling,
            select_from,
            ..FrameRequest::new(camera, viewport)
        }
    }

    /// The clipping plane, if there is one, for a model in a box relative to an origin.
    pub fn plane(&self, bounds: &Aabb, origin: [f64; 3]) -> Option<Clip> {
        let side = Up::ALL.get(usize::from(self.clip).checked_sub(1)?)?;
        let axis = side.axis();
        let (low, high) = (f64::from(bounds.min[axis]), f64::from(bounds.max[axis]));
        // From the side that stays.
        let way = self.clip_share.clamp(0.0, 1.0) * (high - low);
        let place = if side.is_negative() { way - high } else { low + way };
        let normal = side.vector();
        Clip::new(normal.into(), place + normal.dot(&Vector3::from(origin)))
    }

    /// The next clipping plane: across each axis, from either side, or none.
    pub fn next_clip(&mut self) {
        self.clip = (self.clip + 1) % (Up::ALL.len() as u8 + 1);
    }

    /// Moves the clipping plane.
    pub fn move_clip(&mut self, by: f64) {
        self.clip_share = (self.clip_share + by).clamp(0.0, 1.0);
    }

    /// Moves the light with the pointer: half a circle for an image of this height.
    pub fn move_light(&mut self, [right, down]: [f64; 2], height: f64) {
        let unit = 180.0 / height.max(1.0);
        let [aside, above] = self.light;
        self.light = [
            (aside + right * unit + 180.0).rem_euclid(360.0) - 180.0,
            (above - down * unit).clamp(-89.0, 89.0),
        ];
    }

    /// Twice as coarse, or half: one step of what decides the accuracy.
    pub fn step_accuracy(&mut self, coarser: bool) {
        if self.budgeted {
            let next = if coarser { self.triangles / 2 } else { self.triangles.saturating_mul(2) };
            self.triangles = next.clamp(*TRIANGLES.start(), *TRIANGLES.end());
        } else {
            let next = if coarser { self.poe * 2.0 } else { self.poe / 2.0 };
            self.poe = next.clamp(*POE.start(), *POE.end());
        }
    }

    /// The colours that come after the present ones.
    pub fn next_colors(&mut self) {
        let all = &Coloring::ALL;
        let place = all.iter().position(|(colors, ..)| *colors == self.colors).unwrap_or(0);
        self.colors = all[(place + 1) % all.len()].0;
    }

    pub(super) fn check(&self) -> Result<(), String> {
        if !(self.poe >= 0.0 && self.poe.is_finite()) {
            return Err(format!("poe: a number of pixels expected, got {}", self.poe));
        }
        if !(self.frame > 0.0 && self.frame.is_finite()) {
            return Err(format!("frame: a number of milliseconds above 0 expected, got {}", self.frame));
        }
        let [aside, above] = self.light;
        if !(aside.is_finite() && above.is_finite()) {
            return Err(format!("light: two angles expected, got {aside} and {above}"));
        }
        if !(0.0..=1.0).contains(&self.clip_share) {
            return Err(format!("clip_share: 0 to 1 expected, got {}", self.clip_share));
        }
        if self.triangles == 0 {
            return Err("triangles: at least 1 expected, got 0".to_owned());
        }
        Ok(())
    }
}

mod color_name {
    use super::Coloring;
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(colors: &Coloring, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(colors.name())
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Coloring, D::Error> {
        let name = String::deserialize(from)?;
        Coloring::named(&name).ok_or_else(|| Error::custom(format_args!("no colours are called '{name}'")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_text_and_back() {
        for (colors, ..) in Coloring::ALL {
            for antialias in [None, Some(Smooth::Off), Some(Smooth::Rest), Some(Smooth::Always)] {
                let shadows = antialias.map(|smooth| smooth == Smooth::Rest);
                let settings =
                    Settings { colors, antialias, shadows, poe: 0.3, smooth: true, ..Settings::default() };
                let text = toml::to_string(&settings).unwrap();
                assert_eq!(toml::from_str::<Settings>(&text).unwrap(), settings);
            }
        }
        assert_eq!([Smooth::Off, Smooth::Rest, Smooth::Always].map(|it| it.samples(true)), [1, 4, 4]);
        assert_eq!([Smooth::Off, Smooth::Rest, Smooth::Always].map(|it| it.samples(false)), [1, 1, 4]);
        assert_eq!(toml::from_str::<Settings>("").unwrap(), Settings::default());
        assert!(toml::from_str::<Settings>("colors = \"ultraviolet\"").is_err());
        assert!(toml::from_str::<Settings>("poe = -1.0").unwrap().check().is_err());
        assert!(toml::from_str::<Settings>("poe = inf").unwrap().check().is_err());
        assert!(toml::from_str::<Settings>("triangles = 0").unwrap().check().is_err());
        assert!(toml::from_str::<Settings>("frame = 0.0").unwrap().check().is_err());
    }

    #[test]
    fn a_frame_is_what_was_set() {
        let camera = Camera::looking([0.0, 0.0, 2.0], [0.0; 3]);
        let settings = Settings {
            smooth: true,
            colors: Coloring::Level,
            wireframe: true,
            occlusion_culling: false,
            ..Settings::default().with_accuracy(Accuracy::Triangles(5000))
        };
        let request = settings.request(camera, [64, 32], Some(camera));
        assert_eq!((request.accuracy, request.viewport), (Accuracy::Triangles(5000), [64, 32]));
        assert_eq!((request.look.shading, request.look.colors), (Shading::Smooth, Coloring::Level));
        assert!(request.look.wireframe && request.frustum_culling && !request.occlusion_culling);
        assert!(request.select_from == Some(camera) && !request.wait);
        assert_eq!(settings.with_accuracy(Accuracy::PoE(0.5)).accuracy(), Accuracy::PoE(0.5));
    }

    #[test]
    fn a_picture_has_no_more_triangles_than_pixels_unless_that_is_asked_for() {
        let settings = Settings { poe: 0.5, frame: 20.0, ..Settings::default() };
        assert_eq!(settings.wish([640, 480]), Wish { poe: 0.5, triangles: 307_200, ms: 20.0 });
        let budgeted = Settings { budgeted: true, triangles: 5_000_000, ..settings.clone() };
        assert_eq!(budgeted.wish([640, 480]), Wish { poe: 0.0, triangles: 5_000_000, ms: 20.0 });
        let all = Settings { adaptive: false, ..settings }.wish([640, 480]);
        assert_eq!((all.poe, all.triangles, all.ms), (0.5, u64::MAX, f64::INFINITY));
    }

    #[test]
    fn steps_stay_within_what_is_offered() {
        for budgeted in [false, true] {
            let mut settings = Settings { budgeted, ..Settings::default() };
            settings.step_accuracy(true);
            settings.step_accuracy(false);
            assert_eq!(settings, Settings { budgeted, ..Settings::default() });
            (0..99).for_each(|_| settings.step_accuracy(true));
            assert!(POE.contains(&settings.poe) && TRIANGLES.contains(&settings.triangles));
            (0..99).for_each(|_| settings.step_accuracy(false));
            assert!(POE.contains(&settings.poe) && TRIANGLES.contains(&settings.triangles));
        }
    }

    #[test]
    fn a_clipping_plane_leaves_a_share_of_the_box() {
        let bounds = Aabb { min: [-1.0, 0.0, 2.0], max: [1.0, 4.0, 6.0] };
        let mut settings = Settings { clip_share: 0.25, ..Settings::default() };
        assert_eq!(settings.plane(&bounds, [0.0; 3]), None);
        let origin = [10.0, 20.0, 30.0];
        let inside = |clip: &Clip, point: [f64; 3]| {
            (0..3).map(|axis| clip.normal()[axis] * point[axis]).sum::<f64>() <= clip.offset_from(origin)
        };
        let mut left = Vec::new();
        for _ in Up::ALL {
            settings.next_clip();
            let clip = settings.plane(&bounds, origin).unwrap();
            // Along its axis, a quarter of the box is left, on the side away from the normal.
            let axis = clip.normal().iter().position(|x| *x != 0.0).unwrap();
            let at = |share: f32| {
                let mut point = [0.0, 2.0, 4.0];
                point[axis] = f64::from(bounds.min[axis] + share * (bounds.max[axis] - bounds.min[axis]));
                inside(&clip, point)
            };
            left.push((axis, [0.2, 0.3, 0.7, 0.8].map(at)));
        }
        left.sort_unstable();
        let (first, last) = ([true, false, false, false], [false, false, false, true]);
        let each = |axis| [(axis, last), (axis, first)];
        assert_eq!(left, [each(0), each(1), each(2)].concat());
        settings.next_clip();
        assert_eq!(settings.clip, 0);
        (0..99).for_each(|_| settings.move_clip(0.05));
        assert_eq!(settings.clip_share, 1.0);
        assert!(Settings { clip: 200, ..settings }.plane(&bounds, origin).is_none());
    }

    #[test]
    fn the_light_goes_with_the_pointer() {
        let mut settings = Settings::default();
        settings.move_light([100.0, -50.0], 600.0);
        let [aside, above] = settings.light;
        assert!(aside > Look::LIGHT[0] + 29.0 && above > Look::LIGHT[1] + 14.0);
        settings.move_light([600.0 * 9.0, 1e9], 600.0);
        assert!((-180.0..180.0).contains(&settings.light[0]) && settings.light[1] == -89.0);
        assert!(settings.check().is_ok());
        assert!(Settings { light: [f64::NAN, 0.0], ..settings }.check().is_err());
    }

    #[test]
    fn colours_come_round() {
        let mut settings = Settings::default();
        let mut seen = vec![settings.colors.name()];
        for _ in 1..Coloring::ALL.len() {
            settings.next_colors();
            seen.push(settings.colors.name());
        }
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), Coloring::ALL.len());
        settings.next_colors();
        assert_eq!(settings, Settings::default());
    }
}
