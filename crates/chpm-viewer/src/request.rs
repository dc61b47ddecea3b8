//! What one frame is asked for.

use chpm_mesh::Bytes;
use chpm_refine::Camera;
use std::time::Duration;

/// What a viewer may use; both hold on models that are many times larger.
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
    #[default]
    Flat,
    /// Normals of the vertices: those of the file, or the mean of the triangles about a vertex in its cluster.
    Smooth,
}

/// What colours show.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Coloring {
    /// One colour.
    Plain,
    /// The source's colours; plain where it has none.
    #[default]
    Vertex,
    /// A colour for each cluster.
    Cluster,
    /// Its height above the leaves, from the least that is shown (blue) to the most (red).
    Level,
    /// The error of what is drawn of a cluster, from the least that is shown (blue) to the most (red).
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
        (Coloring::Level, "level", "height above the leaves, from the least shown (blue) to the most (red)"),
        (
            Coloring::Error,
            "error",
            "the error of what is drawn, from the least shown (blue) to the most (red)",
        ),
        (Coloring::Residency, "residency", "new on the GPU (red) to old (green)"),
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

/// How a mesh is drawn.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Look {
    /// Flat or smooth.
    pub shading: Shading,
    /// What colours show.
    pub colors: Coloring,
    /// Edges as lines, over the faces.
    pub wireframe: bool,
    /// Leaves out triangles whose corners do not go around counterclockwise as seen from the camera, instead of drawing both sides.
    pub one_sided: bool,
    /// Red, green, blue behind the model, 0 to 1, as displayed.
    pub background: [f32; 3],
    /// Nothing behind the model: alpha is the share of a pixel that it covers, and colours are its own. What a picture without a window may be.
    pub transparent: bool,
    /// The light of a studio: from the sky and a key, less of it in corners and on the ground below the model.
    pub studio: bool,
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
            studio: false,
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
    /// What lies outside the image is neither drawn nor refined.
    pub frustum_culling: bool,
    /// What is hidden is neither drawn nor refined.
    pub occlusion_culling: bool,
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

/// What a frame may take to refine, if nothing else is told.
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

/// What a frame is drawn into; its size is the request's viewport. The viewer brings its own depth and clears both.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// The colour attachment, of usage `RENDER_ATTACHMENT`.
    pub color: &'a wgpu::TextureView,
    /// Its format: one of 8 bits a channel, linear or sRGB.
    pub format: wgpu::TextureFormat,
}
