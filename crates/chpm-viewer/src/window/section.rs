//! The outline of the clipping plane: the lines in which it cuts the source's own triangles, and what lies in them.

use crate::request::Clip;
use crate::transform::Transform;
use crate::window::desk::Desk;
use crate::window::frustum::Sight;
use chpm_refine::Camera;
use egui::epaint::{Mesh, Vertex, WHITE_UV};
use egui::{Color32, Id, LayerId, Order, Painter, Pos2, Shape, Stroke, pos2};
use nalgebra::{Point3, Vector3};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::{self, JoinHandle};

/// Of the lines, and of what lies in them.
const EDGE: Color32 = Color32::from_rgb(255, 190, 90);
const FACE: Color32 = Color32::from_rgba_premultiplied(150, 78, 38, 215);
/// Of lines that the model most likely hides.
const FAINT: Color32 = Color32::from_rgba_premultiplied(90, 67, 32, 90);
/// Points of a line that are nearer to each other than this are drawn as one, in points of the panel.
const CLOSE: f32 = 0.6;

/// Cuts models.
pub trait Slice: Send + Sync {
    /// Cuts the finest mesh of a CHPM by a plane, in its own coordinates. Asks `go_on` now and then.
    ///
    /// # Errors
    /// What to tell the user.
    fn slice(&self, model: &Path, plane: &Clip, go_on: &(dyn Fn() -> bool + Sync)) -> Result<Face, String>;

    /// The same as a drawing to scale, an SVG.
    ///
    /// # Errors
    /// What to tell the user.
    fn draw(&self, model: &Path, plane: &Clip) -> Result<Vec<u8>, String>;
}

/// The lines of a plane, and its inside.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Face {
    /// Lines, and whether the last point of each is joined to its first.
    pub lines: Vec<(Vec<[f64; 3]>, bool)>,
    /// Corners of triangles that fill what is closed.
    pub points: Vec<[f64; 3]>,
    /// Places of corners in the points.
    pub triangles: Vec<[u32; 3]>,
    /// Of all lines, in the model's units.
    pub length: f64,
    /// Of what is closed; none where closed lines of a model cross each other.
    pub area: Option<f64>,
    /// Ends of lines that are not closed.
    pub open_ends: u64,
}

impl Face {
    /// Both of two models.
    fn and(mut self, other: Face) -> Face {
        let before = self.points.len() as u32;
        self.lines.extend(other.lines);
        self.points.extend(other.points);
        self.triangles.extend(other.triangles.iter().map(|corners| corners.map(|corner| corner + before)));
        self.length += other.length;
        self.area = self.area.zip(other.area).map(|(a, b)| a + b);
        self.open_ends += other.open_ends;
        self
    }

    fn moved(mut self, place: &Transform) -> Face {
        let lines = self.lines.iter_mut().flat_map(|(points, _)| points);
        lines.chain(&mut self.points).for_each(|point| *point = place.apply(*point));
        self
    }
}

/// A plane, and where the models are.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Cutting {
    pub(super) clip: Clip,
    pub(super) places: [Transform; 2],
}

impl Cutting {
    /// Whether it is the same but for how far along the plane's normal.
    fn is_beside(&self, other: &Cutting) -> bool {
        self.clip.normal() == other.clip.normal() && self.places == other.places
    }
}

/// Knowledge about the plane that is shown.
#[derive(Clone, Copy, Debug)]
pub(super) enum Known<'a> {
    /// It is looked for.
    Soon,
    Face(&'a Face),
    /// Why there is nothing.
    Fault(&'a str),
}

/// Outlines of open models, cut by a thread of their own.
pub(super) struct Sections {
    desk: Arc<Desk<Cutting, Face>>,
    thread: Option<JoinHandle<()>>,
    wanted: Option<Cutting>,
    known: Option<(Cutting, Result<Face, String>)>,
}

impl Sections {
    /// For these files, two at most; `hear` is told the answers from another thread.
    pub(super) fn new(
        slice: &Arc<dyn Slice>,
        models: Vec<PathBuf>,
        hear: impl Fn(Cutting, Result<Face, String>) + Send + Sync + 'static,
    ) -> Result<Self, String> {
        let desk = Arc::new(Desk::new(hear));
        let (slice, at) = (Arc::clone(slice), Arc::clone(&desk));
        let answer = move || {
            while let Some(cutting) = at.take() {
                at.tell(cutting, cut(&*slice, &models, &cutting, &|| !at.is_old(cutting)));
            }
        };
        let thread = thread::Builder::new().name("section".to_owned()).spawn(answer);
        let thread = Some(thread.map_err(|error| format!("cannot start a thread: {error}"))?);
        Ok(Sections { desk, thread, wanted: None, known: None })
    }

    /// From now on the outline of this plane is shown, or none.
    pub(super) fn want(&mut self, cutting: Option<Cutting>) {
        if cutting == self.wanted {
            return;
        }
        self.wanted = cutting;
        match cutting {
            Some(cutting) => self.desk.ask(cutting),
            None => {
                self.desk.rest();
                self.known = None;
            }
        }
    }

    /// An answer has come.
    pub(super) fn hear(&mut self, cutting: Cutting, answer: Result<Face, String>) {
        if self.wanted.is_some() {
            self.known = Some((cutting, answer));
        }
    }

    /// Of the plane that is shown, if there is one.
    pub(super) fn known(&self) -> Option<Known<'_>> {
        let wanted = self.wanted.as_ref()?;
        Some(match &self.known {
            Some((cutting, Ok(face))) if cutting == wanted => Known::Face(face),
            Some((cutting, Err(told))) if cutting == wanted => Known::Fault(told),
            _ => Known::Soon,
        })
    }

    /// Draws the outline over the model; while a plane moves, the last one that there is.
    pub(super) fn show(&self, context: &egui::Context, camera: &Camera, size: [u32; 2], scale: f32) {
        let (Some(wanted), Some((cutting, Ok(face)))) = (&self.wanted, &self.known) else { return };
        if !cutting.is_beside(wanted) {
            return;
        }
        let painter = context.layer_painter(LayerId::new(Order::Background, Id::unique("section")));
        let canvas = Canvas { sight: Sight::of(camera, size), scale, painter: &painter };
        // What is left lies behind the plane for whoever looks at its outer side; from the other side it hides the cut.
        if cutting.clip.offset_from(camera.position) < 0.0 {
            canvas.fill(face, FACE);
            canvas.lines(face, Stroke::new(1.6, EDGE));
        } else {
            canvas.lines(face, Stroke::new(1.0, FAINT));
        }
    }
}

impl Drop for Sections {
    fn drop(&mut self) {
        self.desk.close();
        // One that panicked has told so.
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

fn cut(
    slice: &dyn Slice,
    models: &[PathBuf],
    cutting: &Cutting,
    go_on: &(dyn Fn() -> bool + Sync),
) -> Result<Face, String> {
    let mut all = Face { area: Some(0.0), ..Face::default() };
    for (model, place) in models.iter().zip(&cutting.places) {
        if let Some(plane) = place.plane(&cutting.clip) {
            all = all.and(slice.slice(model, &plane, go_on)?.moved(place));
        }
    }
    Ok(all)
}

/// Where outlines are drawn.
struct Canvas<'a> {
    sight: Sight,
    /// Pixels of the image for one of the panel's points.
    scale: f32,
    painter: &'a Painter,
}

impl Canvas<'_> {
    fn at(&self, [x, y]: [f64; 2]) -> Pos2 {
        pos2(x as f32 / self.scale, y as f32 / self.scale)
    }

    fn lines(&self, face: &Face, stroke: Stroke) {
        let mut run = Vec::new();
        for (points, is_closed) in &face.lines {
            let ends = points.iter().chain(points.first().filter(|_| *is_closed));
            let mut before: Option<Vector3<f64>> = None;
            for end in ends.map(|point| self.sight.see(Point3::from(*point))) {
                if let Some(from) = before.replace(end) {
                    self.segment([from, end], &mut run, stroke);
                }
            }
            self.stroke(&mut run, stroke);
        }
    }

    /// One more segment of a run; a run ends where it leaves what is seen.
    fn segment(&self, ends: [Vector3<f64>; 2], run: &mut Vec<Pos2>, stroke: Stroke) {
        let line = self.sight.line(ends).map(|line| line.map(|pixel| self.at(pixel)));
        let seen = self.painter.clip_rect().expand(stroke.width);
        let Some([from, to]) =
            line.filter(|[from, to]| seen.intersects(egui::Rect::from_two_pos(*from, *to)))
        else {
            return self.stroke(run, stroke);
        };
        // A run that was cut off before the camera begins anew behind it.
        if run.last().is_some_and(|last| last.distance(from) > CLOSE) {
            self.stroke(run, stroke);
        }
        if run.is_empty() {
            run.push(from);
        }
        if run.last().is_some_and(|last| last.distance(to) > CLOSE) {
            run.push(to);
        }
    }

    fn stroke(&self, run: &mut Vec<Pos2>, stroke: Stroke) {
        if run.len() > 1 {
            self.painter.add(Shape::line(std::mem::take(run), stroke));
        }
        run.clear();
    }

    fn fill(&self, face: &Face, color: Color32) {
        let mut mesh = Mesh::default();
        let seen: Vec<Vector3<f64>> =
            face.points.iter().map(|point| self.sight.see(Point3::from(*point))).collect();
        let vertex =
            |seen: &Vector3<f64>| Vertex { pos: self.at(self.sight.pixel(seen)), uv: WHITE_UV, color };
        // Those behind the camera are not asked for.
        mesh.vertices = seen.iter().map(vertex).collect();
        for corners in &face.triangles {
            let points = corners.map(|corner| seen[corner as usize]);
            if points.iter().all(|point| self.sight.is_before(point)) {
                mesh.indices.extend(corners);
                continue;
            }
            // Three corners, or four: what a plane leaves of a triangle.
            let first = mesh.vertices.len() as u32;
            for side in 0..3 {
                let [from, to] = [points[side], points[(side + 1) % 3]];
                let is_before = [from, to].map(|point| self.sight.is_before(&point));
                if is_before[0] {
                    mesh.vertices.push(vertex(&from));
                }
                if is_before[0] != is_before[1] {
                    mesh.vertices.push(vertex(&self.sight.cut(&from, &to)));
                }
            }
            let last = mesh.vertices.len() as u32;
            (first + 2..last).for_each(|corner| mesh.indices.extend([first, corner - 1, corner]));
        }
        self.painter.add(Shape::mesh(mesh));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::epaint::ClippedShape;
    use std::sync::mpsc::channel;

    /// A square about the zero point in the plane z = 0, with a line beside it.
    fn square() -> Face {
        let ring = vec![[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
        let line = vec![[2.0, 0.0, 0.0], [2.00001, 0.0, 0.0], [3.0, 0.0, 0.0]];
        Face {
            points: ring.clone(),
            lines: vec![(ring, true), (line, false)],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            length: 9.0,
            area: Some(4.0),
            open_ends: 2,
        }
    }

    struct Squares;

    impl Slice for Squares {
        fn slice(&self, model: &Path, plane: &Clip, _: &(dyn Fn() -> bool + Sync)) -> Result<Face, String> {
            match plane.offset_from([0.0; 3]) {
                x if x < 0.0 => Err(format!("{} is damaged", model.display())),
                _ => Ok(square()),
            }
        }

        fn draw(&self, _: &Path, _: &Clip) -> Result<Vec<u8>, String> {
            Ok(Vec::new())
        }
    }

    fn cutting(offset: f64) -> Cutting {
        let clip = Clip::new([0.0, 0.0, 1.0], offset).unwrap();
        Cutting { clip, places: [Transform::STILL; 2] }
    }

    /// Lines and filled areas that are drawn for a camera, in an image of 200 x 100.
    fn drawn(sections: &Sections, camera: &Camera) -> (Vec<Vec<Pos2>>, Vec<Mesh>) {
        let context = egui::Context::default();
        let screen = egui::Rect::from_min_size(Pos2::ZERO, egui::vec2(200.0, 100.0));
        let raw = egui::RawInput { screen_rect: Some(screen), ..Default::default() };
        let mut output = context.run_pass(raw, |context| sections.show(context, camera, [200, 100], 1.0));
        output.textures_delta.clear();
        let (mut lines, mut meshes) = (Vec::new(), Vec::new());
        for ClippedShape { shape, .. } in output.shapes {
            match shape {
                Shape::Path(path) => lines.push(path.points),
                Shape::LineSegment { points, .. } => lines.push(points.to_vec()),
                Shape::Mesh(mesh) => meshes.push((*mesh).clone()),
                _ => {}
            }
        }
        (lines, meshes)
    }

    #[test]
    fn an_outline_is_drawn_where_the_plane_is_seen() {
        let (sender, heard) = channel();
        let slice: Arc<dyn Slice> = Arc::new(Squares);
        let hear = move |cutting, face| drop(sender.send((cutting, face)));
        let mut sections = Sections::new(&slice, vec!["a.chpm".into()], hear).unwrap();
        let above = Camera { fov: 90.0, ..Camera::looking([0.0, 0.0, 10.0], [0.0; 3]) };
        assert!(sections.known().is_none() && drawn(&sections, &above) == (vec![], vec![]));

        sections.want(Some(cutting(0.0)));
        assert!(matches!(sections.known(), Some(Known::Soon)));
        let (question, answer) = heard.recv().unwrap();
        sections.hear(question, answer);
        assert!(matches!(sections.known(), Some(Known::Face(face)) if *face == square()));
        // Ten units away, one unit is five pixels. Points of a line that are closer than a pixel are one.
        let (lines, meshes) = drawn(&sections, &above);
        assert_eq!(lines.iter().map(Vec::len).collect::<Vec<_>>(), [5, 2]);
        let corners: Vec<_> = lines[0].iter().map(|p| [p.x.round(), p.y.round()]).collect();
        assert_eq!(corners, [[95.0, 55.0], [105.0, 55.0], [105.0, 45.0], [95.0, 45.0], [95.0, 55.0]]);
        assert_eq!((meshes.len(), meshes[0].indices.len()), (1, 6));

        // From the side that is left the lines are faint, and nothing is filled.
        let below = Camera { position: [0.0, 0.0, -10.0], ..above };
        let (lines, meshes) = drawn(&sections, &below);
        assert_eq!((lines.len(), meshes.len()), (2, 0));

        // Another plane of the same side is shown where the last one was until there is something better, and one that cannot be cut not at all.
        sections.want(Some(cutting(-1.0)));
        assert!(matches!(sections.known(), Some(Known::Soon)) && !drawn(&sections, &above).0.is_empty());
        let (question, answer) = heard.recv().unwrap();
        sections.hear(question, answer);
        assert!(matches!(sections.known(), Some(Known::Fault("a.chpm is damaged"))));
        assert!(drawn(&sections, &above).0.is_empty());
        sections.want(None);
        assert!(sections.known().is_none());
    }

    #[test]
    fn what_lies_behind_the_camera_is_not_drawn() {
        let slice: Arc<dyn Slice> = Arc::new(Squares);
        let mut sections = Sections::new(&slice, vec!["a.chpm".into()], |_, _| {}).unwrap();
        sections.want(Some(cutting(0.0)));
        sections.hear(cutting(0.0), Ok(square()));
        // Just above the square, looking along it: half of it lies behind.
        let camera = Camera::looking([0.0, 0.0, 0.1], [10.0, 0.0, 0.0]);
        let camera = Camera { fov: 90.0, up: [0.0, 0.0, 1.0], ..camera };
        let (lines, meshes) = drawn(&sections, &camera);
        let points = lines.iter().flatten().chain(
            meshes
                .iter()
                .flat_map(|mesh| mesh.indices.iter().map(|corner| &mesh.vertices[*corner as usize].pos)),
        );
        let points: Vec<_> = points.collect();
        assert!(points.len() > 8 && points.iter().all(|p| p.x.is_finite() && p.y > 49.0), "{points:?}");
    }

    #[test]
    fn two_models_are_cut_where_they_are() {
        let moved = Transform::new([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [10.0, 0.0, 5.0]);
        let cutting = Cutting { places: [Transform::STILL, moved], ..cutting(5.0) };
        let models = ["a.chpm", "b.chpm"].map(PathBuf::from);
        let face = cut(&Squares, &models, &cutting, &|| true).unwrap();
        assert_eq!((face.lines.len(), face.points.len(), face.triangles[3]), (4, 8, [4, 6, 7]));
        assert_eq!((face.lines[2].0[0], face.points[4]), ([9.0, -1.0, 5.0], [9.0, -1.0, 5.0]));
        assert_eq!((face.length, face.area, face.open_ends), (18.0, Some(8.0), 4));
    }
}
