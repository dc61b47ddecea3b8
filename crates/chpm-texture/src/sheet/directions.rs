//! Directions: connected triangles that face one direction at every position become charts.

use super::plan::Surface;
use super::vector::{Vector, add, dot, doubled_area, scale, unit};

/// Cosines between a chart's direction and its triangles: at the finest position, and at all.
const FINEST: f64 = 0.5;
const EVERY: f64 = 0.17364817766693036;
/// The same where a few triangles join a chart that is there.
const JOINED: f64 = 0.13;
/// Weight of a lone triangle's finest normal beside that of its states.
const OWN: f64 = 0.25;
/// Triangles below which a chart joins a neighbour.
const CRUMB: usize = 12;
/// No triangle.
const NONE: u32 = u32::MAX;

/// A chart to be.
#[derive(Clone, Debug)]
pub(super) struct Facing {
    pub(super) direction: Vector,
    pub(super) triangles: Vec<u32>,
}

/// Normals of triangles, and what is beside each.
pub(super) struct Faces<'a> {
    surface: &'a Surface<'a>,
    /// Doubled areas along normals, and unit normals; zero where there is no area.
    areas: Vec<Vector>,
    normals: Vec<Vector>,
    /// Sums over the corners of what the triangles about them have.
    smooth: Vec<Vector>,
    /// Triangles across the three edges.
    beside: Vec<[u32; 3]>,
}

impl<'a> Faces<'a> {
    pub(super) fn new(surface: &'a Surface<'a>) -> Self {
        let areas: Vec<Vector> =
            surface.triangles.iter().map(|corners| doubled_area(surface.corners(*corners))).collect();
        let normals = areas.iter().map(|area| unit(*area).unwrap_or_default()).collect();
        let mut about = vec![[0.0; 3]; surface.positions.len()];
        for (corners, area) in surface.triangles.iter().zip(&areas) {
            for corner in corners {
                let sum = &mut about[usize::from(*corner)];
                *sum = add(*sum, *area);
            }
        }
        let smooth = |corners: &[u16; 3]| {
            let sum = corners.iter().fold([0.0; 3], |sum, corner| add(sum, about[usize::from(*corner)]));
            unit(sum).unwrap_or_default()
        };
        let smooth = surface.triangles.iter().map(smooth).collect();
        Faces { surface, areas, normals, smooth, beside: neighbours(surface.triangles) }
    }

    /// Whether a triangle faces a direction at every position where it is there.
    fn is_facing(&self, triangle: u32, direction: Vector, finest: f64, every: f64) -> bool {
        let at = triangle as usize;
        if self.normals[at] != [0.0; 3] && dot(self.normals[at], direction) < finest {
            return false;
        }
        self.surface.mesh().states(self.surface.triangles[at]).all(|state| {
            let normal = unit(doubled_area(self.surface.corners(state)));
            normal.is_none_or(|normal| dot(normal, direction) >= every)
        })
    }

    /// Divides all triangles into charts.
    pub(super) fn charts(&self) -> Vec<Facing> {
        let all: Vec<u32> = (0..self.surface.triangles.len() as u32).collect();
        let mut set = vec![NONE; all.len()];
        let (mut left, mut charts, mut next) = (vec![all], Vec::new(), 0);
        while let Some(some) = left.pop() {
            let direction = self.direction(&some);
            let mut joined: Vec<u32> = Vec::new();
            for triangle in &some {
                if self.is_facing(*triangle, direction, FINEST, EVERY) {
                    joined.push(*triangle);
                }
            }
            let direction = if joined.is_empty() {
                // A mean that none faces: begin with the largest.
                let largest = self.largest(&some);
                joined.push(largest);
                self.direction_of_one(largest)
            } else {
                direction
            };
            let is_joined = next;
            joined.iter().for_each(|triangle| set[*triangle as usize] = is_joined);
            let rest: Vec<u32> =
                some.into_iter().filter(|triangle| set[*triangle as usize] != is_joined).collect();
            let is_left = next + 1;
            rest.iter().for_each(|triangle| set[*triangle as usize] = is_left);
            next += 2;
            for triangles in self.components(&joined, is_joined, &mut set) {
                charts.push(Facing { direction, triangles });
            }
            left.extend(self.components(&rest, is_left, &mut set));
        }
        self.join_crumbs(charts)
    }

    /// The mean of smoothed normals.
    fn direction(&self, triangles: &[u32]) -> Vector {
        let weighted = |sum: Vector, triangle: &u32| {
            let at = *triangle as usize;
            let area = dot(self.areas[at], self.areas[at]).sqrt();
            add(sum, scale(self.smooth[at], area))
        };
        let sum = triangles.iter().fold([0.0; 3], weighted);
        let whole: f64 = triangles
            .iter()
            .map(|triangle| {
                let area = self.areas[*triangle as usize];
                dot(area, area).sqrt()
            })
            .sum();
        // What is closed faces nowhere in the mean.
        match unit(sum).filter(|_| dot(sum, sum).sqrt() > 0.05 * whole) {
            Some(direction) => direction,
            None => unit(self.areas[self.largest(triangles) as usize]).unwrap_or([0.0, 0.0, 1.0]),
        }
    }

    /// Direction of a triangle alone, which turns too far for any other: that of its states by area, since what is small when the mesh is fine may take the place
    /// of all about it when it is coarse, and has to find their colours then; and a part of its own, so that it is not seen from the edge.
    fn direction_of_one(&self, triangle: u32) -> Vector {
        let mesh = self.surface.mesh();
        let states = mesh.states(self.surface.triangles[triangle as usize]);
        let sum = states.fold([0.0; 3], |sum, state| add(sum, doubled_area(self.surface.corners(state))));
        let own = unit(self.areas[triangle as usize]).unwrap_or_default();
        unit(sum).and_then(|mean| unit(add(mean, scale(own, OWN)))).unwrap_or([0.0, 0.0, 1.0])
    }

    fn largest(&self, triangles: &[u32]) -> u32 {
        let area = |triangle: u32| dot(self.areas[triangle as usize], self.areas[triangle as usize]);
        triangles
            .iter()
            .copied()
            .fold(triangles[0], |best, triangle| if area(triangle) > area(best) { triangle } else { best })
    }

    /// The connected parts of triangles, all of which have the number `of` in `set`; it is taken from them.
    fn components(&self, triangles: &[u32], of: u32, set: &mut [u32]) -> Vec<Vec<u32>> {
        let mut parts = Vec::new();
        for first in triangles {
            if set[*first as usize] != of {
                continue;
            }
            let mut part = vec![*first];
            set[*first as usize] = NONE;
            let mut at = 0;
            while let Some(triangle) = part.get(at).copied() {
                at += 1;
                for other in self.beside[triangle as usize] {
                    if other != NONE && set[other as usize] == of {
                        set[other as usize] = NONE;
                        part.push(other);
                    }
                }
            }
            part.sort_unstable();
            parts.push(part);
        }
        parts
    }

    /// Small charts join the neighbour that they have the most edges with, of those that they face.
    fn join_crumbs(&self, mut charts: Vec<Facing>) -> Vec<Facing> {
        let mut chart_of = vec![NONE; self.surface.triangles.len()];
        for (number, chart) in (0..).zip(&charts) {
            chart.triangles.iter().for_each(|triangle| chart_of[*triangle as usize] = number);
        }
        let mut crumbs: Vec<u32> = (0..charts.len() as u32)
            .filter(|chart| charts[*chart as usize].triangles.len() < CRUMB)
            .collect();
        crumbs.sort_by_key(|chart| charts[*chart as usize].triangles.len());
        let mut beside: Vec<(u32, u32)> = Vec::new();
        for crumb in crumbs {
            let triangles = std::mem::take(&mut charts[crumb as usize].triangles);
            beside.clear();
            for other in triangles.iter().flat_map(|triangle| self.beside[*triangle as usize]) {
                let Some(chart) = chart_of.get(other as usize).filter(|chart| **chart != crumb) else {
                    continue;
                };
                match beside.iter_mut().find(|(known, _)| known == chart) {
                    Some((_, edges)) => *edges += 1,
                    None => beside.push((*chart, 1)),
                }
            }
            beside.sort_unstable_by_key(|(chart, edges)| (std::cmp::Reverse(*edges), *chart));
            let faces = |chart: u32| {
                let direction = charts[chart as usize].direction;
                triangles.iter().all(|triangle| self.is_facing(*triangle, direction, JOINED, JOINED))
            };
            let home = beside.iter().map(|(chart, _)| *chart).find(|chart| faces(*chart)).unwrap_or(crumb);
            triangles.iter().for_each(|triangle| chart_of[*triangle as usize] = home);
            charts[home as usize].triangles.extend(triangles);
        }
        charts.retain(|chart| !chart.triangles.is_empty());
        charts.iter_mut().for_each(|chart| chart.triangles.sort_unstable());
        charts
    }

    /// Connected parts of some triangles of one chart.
    pub(super) fn parts(&self, triangles: &[u32], scratch: &mut Vec<u32>) -> Vec<Vec<u32>> {
        scratch.resize(self.surface.triangles.len(), NONE);
        triangles.iter().for_each(|triangle| scratch[*triangle as usize] = 0);
        self.components(triangles, 0, scratch)
    }

    pub(super) fn beside(&self, triangle: u32) -> impl Iterator<Item = u32> {
        self.beside[triangle as usize].into_iter().filter(|other| *other != NONE)
    }

    pub(super) fn area(&self, triangle: u32) -> f64 {
        let area = self.areas[triangle as usize];
        dot(area, area).sqrt() / 2.0
    }

    pub(super) fn normal(&self, triangle: u32) -> Vector {
        self.normals[triangle as usize]
    }
}

/// By triangle, those across its edges; of an edge of more than two, the next in order.
fn neighbours(triangles: &[[u16; 3]]) -> Vec<[u32; 3]> {
    let mut edges: Vec<(u16, u16, u32, u8)> = Vec::with_capacity(3 * triangles.len());
    for (number, [a, b, c]) in (0..).zip(triangles) {
        for (edge, (from, to)) in (0..).zip([(*a, *b), (*b, *c), (*c, *a)]) {
            edges.push((from.min(to), from.max(to), number, edge));
        }
    }
    edges.sort_unstable();
    let mut beside = vec![[NONE; 3]; triangles.len()];
    for about in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        if about.len() < 2 {
            continue;
        }
        for (at, (_, _, number, edge)) in about.iter().enumerate() {
            beside[*number as usize][usize::from(*edge)] = about[(at + 1) % about.len()].2;
        }
    }
    beside
}
