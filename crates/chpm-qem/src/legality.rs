//! The list of tests that a collapse has to pass; what fails has a reason that is counted.

use crate::adjacency::{Adjacency, Wing};
use crate::one_ring::{MAX_VALENCE, OneRing, OneRingKind};
use crate::patch::{Given, Patch};
use crate::refusal::Refusal;
use crate::ring::{Ring, bits, following};
use chpm_mesh::geom::area_vector;
use wide::f64x2;

/// A collapse is a flip if the cosine between a face's normals before and after is not above this.
const MIN_COSINE: f64 = 0.25;
/// A margin over the squared limit that no rounding explains; products above this have all their digits.
const CLEAR: f64 = 1.000_001;
const LEAST_SQUARES: f64 = 1e-250;

/// "The edge has no apex on this side": no vertex.
const NO_APEX: u32 = u32::MAX;

/// Whether u -> v may be carried out, given the one-ring of u, whose loop is then turned to begin at v. The tests go from cheap to dear.
pub(crate) fn check(
    given: &Given<'_>,
    mesh: &Adjacency,
    one_ring: &mut OneRing,
    v: u16,
) -> Result<(), Refusal> {
    check_topology(given, mesh, one_ring, v)?;
    if one_ring.turn_to(given, v) && is_far_from_flips(&one_ring.ring) {
        return Ok(());
    }
    check_flips(given.patch, one_ring, v)
}

/// The tests that do not ask where vertices are. They ask for faces of v that are none of u's.
pub(crate) fn check_topology(
    given: &Given<'_>,
    mesh: &Adjacency,
    one_ring: &OneRing,
    v: u16,
) -> Result<(), Refusal> {
    match one_ring.kind() {
        OneRingKind::Broken => return Err(Refusal::NonManifold),
        OneRingKind::Open(first, last) if v != first && v != last => return Err(Refusal::Boundary),
        _ => {}
    }

    let degree = one_ring.wings.len();
    if mesh.count(v) > 4 * MAX_VALENCE {
        return Err(Refusal::Valence);
    }

    let (mut before, mut after) = (NO_APEX, NO_APEX);
    for wing in &one_ring.wings {
        before = if wing.b == v { wing.a.into() } else { before };
        after = if wing.a == v { wing.b.into() } else { after };
    }

    if given.is_locked(v) && joins_locked(given, one_ring, [v.into(), before, after]) {
        return Err(Refusal::LockedEdge);
    }
    check_link(mesh, one_ring, v, [before, after])?;
    let dying = usize::from(before != NO_APEX) + usize::from(after != NO_APEX);
    if mesh.count(v) - dying + degree > MAX_VALENCE + 4 {
        return Err(Refusal::Valence);
    }
    // Whether something stays: a face of u, or one that v has beyond an apex.
    let is_beyond = |wing: &Wing| {
        !wing.has(one_ring.vertex())
            && [wing.a, wing.b].iter().any(|w| [before, after].contains(&u32::from(*w)))
    };
    if degree == dying && !mesh.wings(v).iter().any(is_beyond) {
        return Err(Refusal::Component);
    }
    Ok(())
}

/// Whether a new edge at the locked vertex v would end at another locked vertex, or the last of three faces would have
/// locked corners only: another cluster may own such an edge or face.
fn joins_locked(given: &Given<'_>, one_ring: &OneRing, apexes: [u32; 3]) -> bool {
    if one_ring.wings.len() == 3 && one_ring.wings.iter().all(|wing| given.is_locked(wing.a)) {
        return true;
    }
    let beyond = |w: u16| !apexes.contains(&w.into()) && given.is_locked(w);
    one_ring.wings.iter().any(|wing| beyond(wing.a) || beyond(wing.b))
}

/// The link condition: besides the apexes of the edge, u and v have no neighbour in common, and no face of v lies opposite to
/// the edge.
fn check_link(
    mesh: &Adjacency,
    one_ring: &OneRing,
    v: u16,
    [before, after]: [u32; 2],
) -> Result<(), Refusal> {
    // The faces at the edge itself have no vertex but u and the apexes.
    let is_apex = |w: u16| (before == w.into()) | (after == w.into());
    let linked = mesh.wings(v).iter().fold(false, |linked, wing| {
        let (a, b) = (is_apex(wing.a), is_apex(wing.b));
        linked | (one_ring.has(wing.a) & !a) | (one_ring.has(wing.b) & !b) | (a & b)
    });
    if linked { Err(Refusal::Link) } else { Ok(()) }
}

/// Whether all faces are so far from turning by the limit, and from losing their area, that it needs no root to tell.
fn is_far_from_flips(ring: &Ring) -> bool {
    let ([x, y, z], [areas_x, areas_y, areas_z]) = (ring.places(), ring.areas());
    let v = ring.point(0);
    let v = [v.x, v.y, v.z].map(f64x2::splat);
    fn product(a: [f64x2; 3], b: [f64x2; 3]) -> f64x2 {
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    }
    let least_squares = f64x2::splat(LEAST_SQUARES);
    let mut clear = 0;
    for pair in 0..ring.pairs() {
        let a = [x[pair] - v[0], y[pair] - v[1], z[pair] - v[2]];
        let b = [following(x, pair) - v[0], following(y, pair) - v[1], following(z, pair) - v[2]];
        let new = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        let old = [areas_x[pair], areas_y[pair], areas_z[pair]];
        let (dot, squares) = (product(old, new), product(old, old) * product(new, new));
        let far = dot.simd_gt(f64x2::ZERO)
            & squares.simd_gt(least_squares)
            & (dot * dot).simd_gt(CLEAR * MIN_COSINE * MIN_COSINE * squares);
        clear |= u64::from(far.to_bitmask()) << (2 * pair);
    }
    // The first and the last face are at v and go.
    let stay = bits(1..ring.len() - 1);
    clear & stay == stay
}

/// No face may turn by more than the limit or lose its area. A face that has none already cannot get worse.
fn check_flips(patch: &Patch<'_>, one_ring: &OneRing, v: u16) -> Result<(), Refusal> {
    fn position(w: u16, patch_positions: &[[f32; 3]]) -> [f32; 3] {
        patch_positions[usize::from(w)]
    }
    let (from, to) = (position(one_ring.vertex(), patch.positions), position(v, patch.positions));
    for wing in one_ring.wings.iter().filter(|wing| !wing.has(v)) {
        let (a, b) = (position(wing.a, patch.positions), position(wing.b, patch.positions));
        let (old, new) = (area_vector(from, a, b), area_vector(to, a, b));
        let (old_squared, new_squared) = (old.norm_squared(), new.norm_squared());
        if old_squared == 0.0 {
            continue;
        }
        if new_squared == 0.0 {
            return Err(Refusal::Degenerate);
        }
        // Two roots: the product of the squares could underflow.
        if old.dot(&new) <= MIN_COSINE * old_squared.sqrt() * new_squared.sqrt() {
            return Err(Refusal::Flip);
        }
    }
    Ok(())
}
