//! Request for one frame.

use chpm_mesh::Bytes;
use chpm_refine::Camera;
use std::str::FromStr;
use std::time::Duration;

/// Memory that a viewer may use; both limits hold on models that are many times larger.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Budgets {
    /// Main memory for pages and what is made of them.
    pub memory: Bytes,
    /// GPU memory for vertices and triangles.
    pub gpu_memory: Bytes,
}

impl Default for Budgets {
    fn default() -> Self {
        Budgets { memory: Bytes::mib(1024), gpu_memory: Bytes::mib(512) }
    }
}

/// How fine the mesh is.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Accuracy {
    /// Pixels of error that are allowed.
    PoE(f64),
    /// The finest mesh that draws at most about so many triangles, by pixels of error that are found by and by: a frame that does not wait
    /// takes a step towards them, one that waits finds them.
    Triangles(u64),
}

/// How light falls on triangles.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Shading {
    /// Each triangle by its own plane.
    Flat,
    /// By the normals of the file; where it has none, by what the triangles about a vertex have in common: those that lean more than 40 degrees
    /// from each other meet in a crease.
    #[default]
    Smooth,
}

impl Shading {
    /// Both, by their names on the command line, in the panel and in files, with what they do.
    pub const ALL: [(Shading, &'static str, &'static str); 2] = [
        (Shading::Flat, "flat", "each triangle by its own plane"),
        (
            Shading::Smooth,
            "smooth",
            "by the model's normals; without, by the triangles about each vertex, with creases from 40 degrees on",
        ),
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(shading, ..)| *shading == self).map_or("", |(_, name, _)| name)
    }

    /// The one of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, known, _)| *known == name).map(|(shading, ..)| *shading)
    }
}

/// Meaning of colours.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Coloring {
    /// One colour.
    Plain,
    /// The source's colours; plain where it has none.
    #[default]
    Vertex,
    /// A colour for each cluster.
    Cluster,
    /// Its height above the leaves, from the least that is shown (dark blue) to the most (yellow).
    Level,
    /// The error of what is drawn of a cluster, from the least that is shown (dark blue) to the most (yellow).
    Error,
    /// How long a cluster's data has been on the GPU: new ones are red, old ones green.
    Residency,
    /// Visible before (green), newly visible (yellow), and with a frozen selection occluded (red) or outside its image (blue).
    Visibility,
    /// A colour for each dependency group.
    Group,
    /// A colour for each triangle.
    Ids,
}

impl Coloring {
    /// All of them, by their names on the command line, in the panel and in files, with what they show.
    pub const ALL: [(Coloring, &'static str, &'static str); 9] = [
        (Coloring::Plain, "plain", "one colour"),
        (Coloring::Vertex, "vertex", "the model's own colours, where it has some"),
        (Coloring::Cluster, "cluster", "a colour for each cluster"),
        (
            Coloring::Level,
            "level",
            "height above the leaves, from the least shown (dark blue) to the most (yellow)",
        ),
        (
            Coloring::Error,
            "error",
            "the error of what is drawn, from the least shown (dark blue) to the most (yellow)",
        ),
        (Coloring::Residency, "residency", "new on the GPU (yellow) to old (dark blue)"),
        (
            Coloring::Visibility,
            "visibility",
            "visible before (green), newly visible (yellow), occluded (red), outside (blue)",
        ),
        (Coloring::Group, "group", "a colour for each dependency group"),
        (Coloring::Ids, "ids", "a colour for each triangle"),
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(colors, ..)| *colors == self).map_or("", |(_, name, _)| name)
    }

    /// The one of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, known, _)| *known == name).map(|(colors, ..)| *colors)
    }
}

/// A plane beyond which nothing is drawn, in the model's coordinates: where its normal, of length 1, times a point is above the offset.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Clip {
    normal: [f64; 3],
    offset: f64,
}

impl Clip {
    fn parse(text: &str) -> Option<Self> {
        let (side, place) = text.rsplit_once(':')?;
        let place: f64 = place.trim().parse().ok()?;
        let (name, negative) = side.strip_prefix('-').map_or((side, false), |name| (name, true));
        if let Some(axis) = ["x", "y", "z"].iter().position(|axis| *axis == name.trim_start_matches('+')) {
            let sign = if negative { -1.0 } else { 1.0 };
            let normal = std::array::from_fn(|a| if a == axis { sign } else { 0.0 });
            return Clip::new(normal, sign * place);
        }
        let numbers: Option<Vec<f64>> = side.split(',').map(|n| n.trim().parse().ok()).collect();
        let [x, y, z] = numbers?.try_into().ok()?;
        Clip::new([x, y, z], place)
    }

    /// Beyond `offset` along a direction of any length but 0; none where that is not a plane.
    pub fn new(normal: [f64; 3], offset: f64) -> Option<Self> {
        let length = normal.iter().fold(0.0, |length: f64, x| length.hypot(*x));
        let sound = length > 0.0 && length.is_finite() && offset.is_finite();
        sound.then(|| Clip { normal: normal.map(|x| x / length), offset })
    }

    /// Its normal, of length 1.
    pub fn normal(&self) -> [f64; 3] {
        self.normal
    }

    /// The same plane in coordinates relative to an origin, and where it is along the normal.
    pub fn offset_from(&self, origin: [f64; 3]) -> f64 {
        self.offset - (0..3).map(|axis| self.normal[axis] * origin[axis]).sum::<f64>()
    }
}

impl FromStr for Clip {
    type Err = String;

    /// `x:10` leaves out what is beyond x = 10, `-x:10` what is below; `NX,NY,NZ:OFFSET` what is beyond any plane.
    fn from_str(text: &str) -> Result<Self, String> {
        Clip::parse(text).ok_or_else(|| {
            format!(
                "'{text}' is no plane: write an axis and where it is cut, as in z:10 or -z:10, or a normal, as in 1,1,0:10"
            )
        })
    }
}

/// How a mesh is drawn.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Look {
    /// Flat or smooth.
    pub shading: Shading,
    /// Meaning of colours.
    pub colors: Coloring,
    /// Edges as lines, over the faces.
    pub wireframe: bool,
    /// Leaves out triangles whose corners do not go around counterclockwise as seen from the camera, instead of drawing both sides.
    pub one_sided: bool,
    /// Red, green, blue behind the model, 0 to 1, as displayed.
    pub background: [f32; 3],
    /// Nothing behind the model: alpha is the share of a pixel that it covers, and colours are its own. What a picture without a window may be.
    pub transparent: bool,
    /// Where the key light is, as seen from the model: degrees to the right of the eye, and above it.
    pub light: [f64; 2],
    /// The light of a studio: from the sky and a key, less of it in corners and on the ground below the model.
    pub studio: bool,
    /// Whether the key light throws shadows.
    pub shadows: bool,
    /// Less light in corners, by the depths around a pixel; a studio has that anyway.
    pub occlusion: bool,
}

impl Look {
    /// Where the key light is if nobody moves it.
    pub const LIGHT: [f64; 2] = [24.23, 30.66];
}

impl Default for Look {
    fn default() -> Self {
        Look {
            shading: Shading::default(),
            colors: Coloring::default(),
            wireframe: false,
            one_sided: false,
            background: [0.09, 0.1, 0.12],
            transparent: false,
            light: Look::LIGHT,
            studio: false,
            shadows: false,
            occlusion: false,
        }
    }
}

/// One frame.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct FrameRequest {
    /// Where it is drawn from, in the model's (the source's) coordinates.
    pub camera: Camera,
    /// Width and height, pixels.
    pub viewport: [u32; 2],
    /// How fine.
    pub accuracy: Accuracy,
    /// How it looks.
    pub look: Look,
    /// Whether surface outside the image is neither drawn nor refined.
    pub frustum_culling: bool,
    /// Whether hidden surface is neither drawn nor refined.
    pub occlusion_culling: bool,
    /// Clipping plane: surface beyond it is never drawn, and neither refined nor read where `frustum_culling` is on.
    pub clip: Option<Clip>,
    /// A frozen selection: the mesh is selected and culled for this camera, and drawn from the other one.
    pub select_from: Option<Camera>,
    /// Waits until all that the view wants is there, refined, and nothing has come into sight any more: the exact picture,
    /// whatever was drawn before. Otherwise a frame never waits, and draws coarser clusters in place of missing ones.
    pub wait: bool,
    /// Pictures, each moved by a part of a pixel, whose mean a picture without a window is that waits; 1 has hard edges. A frame that does
    /// not wait has four samples a pixel for any more than 1, where the adapter has them.
    pub samples: u32,
    /// How long a frame that does not wait may take to refine: to send what splits bring to the GPU, and, where the camera rests, to wait
    /// for pages that are on their way.
    pub patience: Duration,
    /// The target still has the last frame that did not wait. Nothing is drawn where this one would be the same.
    pub kept: bool,
}

/// Time that a frame may take to refine, by default.
const PATIENCE: Duration = Duration::from_millis(10);

impl FrameRequest {
    /// One pixel of error, with culling, not waiting.
    pub fn new(camera: Camera, viewport: [u32; 2]) -> Self {
        FrameRequest {
            camera,
            viewport,
            accuracy: Accuracy::PoE(1.0),
            look: Look::default(),
            frustum_culling: true,
            occlusion_culling: true,
            clip: None,
            select_from: None,
            wait: false,
            samples: 1,
            patience: PATIENCE,
            kept: false,
        }
    }

    /// The same, without any culling.
    pub fn without_culling(self) -> Self {
        FrameRequest { frustum_culling: false, occlusion_culling: false, ..self }
    }
}

/// Target of a frame; its size is the request's viewport. The viewer brings its own depth and clears both.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// The colour attachment, of usage `RENDER_ATTACHMENT`.
    pub color: &'a wgpu::TextureView,
    /// Its format: one of 8 bits a channel, linear or sRGB.
    pub format: wgpu::TextureFormat,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_an_axis_or_a_normal_and_a_place() {
        let plane = |text: &str| text.parse::<Clip>().map(|clip| (clip.normal, clip.offset));
        assert_eq!(plane("x:1.5"), Ok(([1.0, 0.0, 0.0], 1.5)));
        assert_eq!(plane("-z:-2"), Ok(([0.0, 0.0, -1.0], 2.0)));
        assert_eq!(plane("0, 3, 4:10"), Ok(([0.0, 0.6, 0.8], 10.0)));
        assert_eq!(plane("-1,0,0:2"), Ok(([-1.0, 0.0, 0.0], 2.0)));
        for bad in ["", "x", "w:1", "x:", "x:nan", "0,0,0:1", "1,2:3", "1,inf,2:3", "x:inf", "1,2,3,4:5"] {
            assert!(plane(bad).is_err(), "{bad}");
        }
        // Far from the zero point, what is relative to an origin keeps its place.
        let clip: Clip = "y:4000001".parse().unwrap();
        assert_eq!(clip.offset_from([7.0, 4e6, 9.0]), 1.0);
    }
}
