//! Remnants beside a cut: of the components that its clusters do not draw, those that lie too far from what they do.
//!
//! A component that has vanished alone is kept in the file as the triangle that was left last ([`chpm_format::Remnant`]). Where the ball about its points is
//! within a distance of one drawn triangle, so are they all. Where it is not, its own triangle is drawn, which they are as near to as the file
//! says, and which may be near enough to others in turn.

use crate::cut::Member;
use crate::error::RefineError;
use crate::splits::Splits;
use crate::surface::Surface;
use chpm_format::{Chpm, Remnant};
use chpm_mesh::geom::{round_up, to_f64};
use chpm_mesh::{Aabb, ClusterId, TriMesh};
use nalgebra::Point3;

/// Remnants that are drawn beside the members of a cut.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct Beside {
    /// Their numbers, ascending.
    pub(crate) drawn: Vec<u32>,
    /// Bits of [`Beside::far`].
    far: u32,
}

impl Beside {
    /// How far the points of any component that has a remnant and is missing are from what is drawn, and remnants that are drawn from these, at most.
    pub(crate) fn far(&self) -> f32 {
        f32::from_bits(self.far)
    }

    /// Chooses those that the members need to keep to a distance. Asks before each page is read whether to go on.
    pub(crate) fn within<D: AsRef<[u8]>, E: From<RefineError>>(
        file: &Chpm<D>,
        members: &[Member],
        distance: f32,
        mut go_on: impl FnMut() -> Result<(), E>,
    ) -> Result<Beside, E> {
        let mut missing = Missing::of(file, members, distance);
        let mut surface = Surface::default();
        for member in members {
            if missing.find_near(&file.clusters()[member.cluster.index()].aabb()) {
                go_on()?;
                let page = file.page(member.cluster).map_err(RefineError::from)?;
                surface.fill(&page.view(), member.vertices as usize);
                missing.cover(&surface);
            }
        }

        // What is still open is drawn, in the order of the file, unless one that was drawn before will do.
        let mut drawn = Vec::new();
        for (number, at) in missing.left() {
            if !missing.balls[at].is_open {
                continue;
            }
            go_on()?;
            let remnant = &file.remnants()[number as usize];
            surface.fill_one(corners(file, remnant)?);
            missing.balls[at].is_open = false;
            missing.far = missing.far.max(remnant.bound.into());
            drawn.push(number);
            if missing.find_near(&surface.bounds()) {
                missing.cover(&surface);
            }
        }
        Ok(Beside { drawn, far: round_up(missing.far).to_bits() })
    }

    /// Their triangles, each with vertices of its own.
    pub(crate) fn mesh<D: AsRef<[u8]>>(&self, file: &Chpm<D>) -> Result<TriMesh, RefineError> {
        let mut mesh = TriMesh::default();
        for number in &self.drawn {
            let remnant = &file.remnants()[*number as usize];
            let page = file.page(remnant.cluster())?;
            let first = mesh.positions.len() as u32;
            mesh.gather(page.view().vertices, remnant.corners.into_iter().map(usize::from));
            mesh.triangles.push([first, first + 1, first + 2]);
        }
        mesh.decode_normals();
        Ok(mesh)
    }
}

fn corners<D: AsRef<[u8]>>(file: &Chpm<D>, remnant: &Remnant) -> Result<[[f32; 3]; 3], RefineError> {
    let page = file.page(remnant.cluster())?;
    let page = page.view();
    Ok(remnant.corners.map(|corner| page.positions[usize::from(corner)]))
}

/// The points of a component that no cluster draws.
struct Ball {
    number: u32,
    center: Point3<f64>,
    radius: f64,
    /// Whether nothing that is near enough has been found.
    is_open: bool,
}

/// Components that no cluster draws, by x.
struct Missing {
    balls: Vec<Ball>,
    distance: f64,
    far: f64,
    near: Vec<usize>,
}

impl Missing {
    fn of<D: AsRef<[u8]>>(file: &Chpm<D>, members: &[Member], distance: f32) -> Self {
        let splits = Splits::that_bring(file, members.iter().map(|member| member.cluster));
        let position = |cluster: ClusterId| {
            let at = members.binary_search_by_key(&cluster, |member| member.cluster).ok()?;
            Some(members[at].vertices)
        };
        let is_missing = |remnant: &Remnant| match position(remnant.cluster()) {
            Some(vertices) => remnant.is_missing_at(vertices),
            // Finer clusters draw it, coarser ones do not.
            None => !splits.is_split(file.clusters()[remnant.cluster().index()].group()),
        };
        let ball = |(number, remnant): (u32, &Remnant)| Ball {
            number,
            center: to_f64(remnant.center),
            radius: remnant.radius.into(),
            is_open: true,
        };
        let all = (0..).zip(file.remnants());
        let mut balls: Vec<Ball> = all.filter(|(_, remnant)| is_missing(remnant)).map(ball).collect();
        balls.sort_by(|a, b| a.center.x.total_cmp(&b.center.x));
        Missing { balls, distance: distance.into(), far: 0.0, near: Vec::new() }
    }

    /// Finds what is open and may be near enough to something in a box; answers whether there is any.
    fn find_near(&mut self, bounds: &Aabb) -> bool {
        let (low, high) = (bounds.min.map(f64::from), bounds.max.map(f64::from));
        let reach = self.distance;
        let first = self.balls.partition_point(|ball| ball.center.x < low[0] - reach);
        let beside = self.balls[first..].iter().take_while(|ball| ball.center.x <= high[0] + reach);
        let away = |center: &Point3<f64>, axis: usize| {
            (low[axis] - center[axis]).max(center[axis] - high[axis]).max(0.0)
        };
        let near = (first..).zip(beside).filter(|(_, ball)| {
            ball.is_open && (0..3).map(|axis| away(&ball.center, axis).powi(2)).sum::<f64>() <= reach * reach
        });
        self.near.clear();
        self.near.extend(near.map(|(at, _)| at));
        !self.near.is_empty()
    }

    /// Closes those of them that are near enough to a surface.
    fn cover(&mut self, surface: &Surface) {
        for at in &self.near {
            let ball = &mut self.balls[*at];
            if let Some(distance) = surface.within(ball.center, self.distance - ball.radius) {
                ball.is_open = false;
                self.far = self.far.max(distance + ball.radius);
            }
        }
    }

    /// Numbers and places of what is open, by number.
    fn left(&self) -> Vec<(u32, usize)> {
        let open = self.balls.iter().enumerate().filter(|(_, ball)| ball.is_open);
        let mut left: Vec<(u32, usize)> = open.map(|(at, ball)| (ball.number, at)).collect();
        left.sort_unstable();
        left
    }
}
