//! Nodes of a glTF: which meshes are drawn, and where.

use super::document::{Document, Node, entry, refused};
use crate::error::ImportError;

/// An affine map: what the axes become, and the zero point.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Placement {
    axes: [[f64; 3]; 3],
    zero: [f64; 3],
}

impl Placement {
    pub(super) const IDENTITY: Placement =
        Placement { axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], zero: [0.0; 3] };

    fn of(node: &Node) -> Option<Placement> {
        if let Some(matrix) = &node.matrix {
            let column = |at: usize| [matrix[at], matrix[at + 1], matrix[at + 2]];
            let last = [matrix[3], matrix[7], matrix[11], matrix[15] - 1.0];
            // Programs round.
            let is_affine = last.iter().all(|x| x.abs() < 1e-5);
            return is_affine
                .then(|| Placement { axes: [column(0), column(4), column(8)], zero: column(12) });
        }
        let mut placement = Placement::IDENTITY;
        if let Some(rotation) = &node.rotation {
            let length = rotation.iter().map(|x| x * x).sum::<f64>().sqrt();
            if !length.is_normal() {
                return None;
            }
            placement.axes = rotated(rotation.map(|x| x / length));
        }
        if let Some(scale) = &node.scale {
            for (axis, scale) in placement.axes.iter_mut().zip(**scale) {
                axis.iter_mut().for_each(|x| *x *= scale);
            }
        }
        if let Some(translation) = &node.translation {
            placement.zero = **translation;
        }
        Some(placement)
    }

    /// Moves a point. The identity keeps every bit.
    pub(super) fn point(&self, p: [f64; 3]) -> [f64; 3] {
        if *self == Placement::IDENTITY {
            return p;
        }
        let turned = self.direction(p);
        [0, 1, 2].map(|axis| turned[axis] + self.zero[axis])
    }

    fn direction(&self, p: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = self.axes;
        [0, 1, 2].map(|axis| p[0] * x[axis] + p[1] * y[axis] + p[2] * z[axis])
    }

    /// This one after `inner`.
    fn after(&self, inner: &Placement) -> Placement {
        match (*self == Placement::IDENTITY, *inner == Placement::IDENTITY) {
            (true, _) => *inner,
            (_, true) => *self,
            _ => {
                Placement { axes: inner.axes.map(|axis| self.direction(axis)), zero: self.point(inner.zero) }
            }
        }
    }

    /// The matrix that takes normals where this takes surfaces: the inverse transpose, but for its length, which does
    /// not matter, and which a flat placement has none of.
    pub(super) fn of_normals(&self) -> Placement {
        let [x, y, z] = self.axes;
        let sign = if self.is_mirrored() { -1.0 } else { 1.0 };
        let axes = [cross(y, z), cross(z, x), cross(x, y)].map(|axis| axis.map(|x| x * sign));
        Placement { axes, zero: [0.0; 3] }
    }

    /// A normal of length one, or zero.
    pub(super) fn normal(&self, n: [f64; 3]) -> [f64; 3] {
        if *self == Placement::IDENTITY {
            return n;
        }
        let turned = self.direction(n);
        // In steps, so that no length is too large or small to be squared.
        let most = turned.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        if most == 0.0 || !most.is_finite() {
            return [0.0; 3];
        }
        let turned = turned.map(|x| x / most);
        let length = turned.iter().map(|x| x * x).sum::<f64>().sqrt();
        turned.map(|x| x / length)
    }

    /// Whether it turns a surface inside out.
    pub(super) fn is_mirrored(&self) -> bool {
        let [x, y, z] = self.axes;
        let across = cross(x, y);
        across[0] * z[0] + across[1] * z[1] + across[2] * z[2] < 0.0
    }
}

fn cross([a, b, c]: [f64; 3], [x, y, z]: [f64; 3]) -> [f64; 3] {
    [b * z - c * y, c * x - a * z, a * y - b * x]
}

/// Axes after a turn by a unit quaternion.
fn rotated([x, y, z, w]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)],
        [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)],
        [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// A mesh at its place.
pub(super) struct Instance {
    pub(super) mesh: u32,
    pub(super) placement: Placement,
}

/// The meshes of the default scene, node by node, children after their parents in order; and what is left out, in words. Where
/// there are no scenes, all nodes are one; where there are no nodes, every mesh stands where it is.
pub(super) fn instances(document: &Document) -> Result<(Vec<Instance>, Vec<String>), ImportError> {
    let nodes = &document.nodes;
    let mut warnings = Vec::new();
    if nodes.is_empty() {
        let placement = Placement::IDENTITY;
        let all = (0..document.meshes.len() as u32).map(|mesh| Instance { mesh, placement });
        return Ok((all.collect(), warnings));
    }
    let roots: Vec<u32> = if document.scenes.is_empty() {
        let mut is_child = vec![false; nodes.len()];
        for child in nodes.iter().flat_map(|node| &node.children) {
            entry(nodes, *child, "node")?;
            is_child[*child as usize] = true;
        }
        (0..nodes.len() as u32).filter(|node| !is_child[*node as usize]).collect()
    } else {
        let scene = document.scene.unwrap_or(0);
        if document.scenes.len() > 1 {
            warnings.push(format!("read scene {scene} of {}", document.scenes.len()));
        }
        entry(&document.scenes, scene, "scene")?.nodes.clone()
    };

    let (mut instances, mut seen) = (Vec::new(), vec![false; nodes.len()]);
    let (mut skinned, mut instanced, mut hidden) = (0, 0, 0);
    // A stack, since nodes may be nested as deep as the file likes.
    let mut stack: Vec<(u32, Placement)> =
        roots.iter().rev().map(|root| (*root, Placement::IDENTITY)).collect();
    while let Some((number, parent)) = stack.pop() {
        let node = entry(nodes, number, "node")?;
        if std::mem::replace(&mut seen[number as usize], true) {
            return Err(refused(format!("node {number} is below itself, or below two nodes")));
        }
        if node.extensions.visibility.is_some_and(|visibility| !visibility.visible) {
            hidden += 1;
            continue;
        }
        let own = Placement::of(node);
        let own = own.ok_or_else(|| {
            refused(format!("node {number} has a matrix that is no affine map, or a rotation of length zero"))
        })?;
        let placement = parent.after(&own);
        instances.extend(node.mesh.map(|mesh| Instance { mesh, placement }));
        skinned += u64::from(node.skin.is_some());
        instanced += u64::from(node.extensions.instancing.is_some());
        stack.extend(node.children.iter().rev().map(|child| (*child, placement)));
    }
    if instances.is_empty() && hidden > 0 {
        return Err(refused(
            "all of its meshes are hidden (KHR_node_visibility): show one, and save it again",
        ));
    }
    let mut warn = |count: u64, text: String| warnings.extend((count > 0).then_some(text));
    warn(skinned, format!("read {skinned} nodes with skins as they are before any bone moves"));
    warn(instanced, format!("read {instanced} nodes of EXT_mesh_gpu_instancing once each"));
    warn(hidden, format!("left out {hidden} hidden nodes, with all below them (KHR_node_visibility)"));
    Ok((instances, warnings))
}
