//! The JSON of a tileset, and of those that it refers to.

use super::{Mesh, Options, Tree, subtree_path, tile_path};
use crate::error::ExportError;
use chpm_format::Chpm;
use chpm_mesh::{Aabb, ClusterId};
use serde_json::{Value, json};

/// One file of a tileset.
pub struct Tileset {
    /// Where it lies in the tileset's folder.
    pub path: String,
    /// Content of the file.
    pub json: String,
}

/// The error of drawing nothing, in diagonals of the model. With one, a viewer would draw nothing where the model is a few pixels large.
const NOTHING: f64 = 1000.0;

/// Writes all tilesets of a file, from the top.
///
/// # Errors
/// [`ExportError::Transform`] for one that goes too far, which JSON has no numbers for; what `sink` answers.
pub fn tilesets<D: AsRef<[u8]>, E: From<ExportError>>(
    file: &Chpm<D>,
    tree: &Tree,
    options: &Options,
    mut sink: impl FnMut(Tileset) -> Result<(), E>,
) -> Result<(), E> {
    let mut writer = Writer { file, tree, options, waiting: Vec::new() };
    if let Some([.., x, y, z, _]) = writer.transform()
        && ![x, y, z].iter().all(|x| x.is_finite())
    {
        return Err(ExportError::Transform { got: [x, y, z] }.into());
    }
    sink(Tileset { path: "tileset.json".to_owned(), json: writer.top()? })?;
    while let Some(cluster) = writer.waiting.pop() {
        let mut root = writer.tile(cluster, "../../")?;
        root["refine"] = "REPLACE".into();
        let json =
            json!({ "asset": { "version": "1.1" }, "geometricError": root["geometricError"], "root": root });
        sink(Tileset { path: subtree_path(cluster), json: json.to_string() })?;
    }
    Ok(())
}

struct Writer<'a, D> {
    file: &'a Chpm<D>,
    tree: &'a Tree,
    options: &'a Options,
    /// Clusters that have a tileset of their own.
    waiting: Vec<ClusterId>,
}

impl<D: AsRef<[u8]>> Writer<'_, D> {
    fn top(&mut self) -> Result<String, ExportError> {
        let header = self.file.header();
        let size = header.aabb().diagonal();

        let roots: Vec<ClusterId> = self.file.roots().collect();
        let mut root = match roots[..] {
            [root] => self.tile(root, "")?,
            _ => {
                let children: Vec<Value> =
                    roots.iter().map(|root| self.tile(*root, "")).collect::<Result<_, _>>()?;
                let mut bounds = Aabb::EMPTY;
                roots.iter().for_each(|root| bounds.merge(self.bounds(*root)));
                json!({ "boundingVolume": self.volume(&bounds)?, "geometricError": NOTHING * size, "children": children })
            }
        };

        root["refine"] = "REPLACE".into();
        if let Some(transform) = self.transform() {
            root["transform"] = json!(transform);
        }

        let asset = json!({ "version": "1.1", "extras": { "generator": self.options.generator } });
        let levels = json!({ "triangles": header.source_triangle_count, "diagonal": size });
        let set = json!({ "asset": asset, "geometricError": NOTHING * size, "extras": levels, "root": root });
        Ok(set.to_string())
    }

    /// A cluster's tile and what is below it, as far as it lies in the same file, which `up` leads out of.
    fn tile(&mut self, cluster: ClusterId, up: &str) -> Result<Value, ExportError> {
        let (file, options) = (self.file, self.options);
        let record = &file.clusters()[cluster.index()];
        let mut tile = self.node(cluster)?;
        tile["content"] = self.content(cluster, Mesh::Base, up)?;

        let mut children = Vec::new();
        for child in self.tree.children(file, cluster) {
            let level = file.clusters()[child.index()].level;
            if level / options.span == record.level / options.span {
                children.push(self.tile(child, up)?);
                continue;
            }
            let mut outside = self.node(child)?;
            outside["content"] = json!({ "uri": format!("{up}{}", subtree_path(child)) });
            children.push(outside);
            self.waiting.push(child);
        }

        if Mesh::of(file, cluster).contains(&Mesh::Finest) {
            let mut finest = self.node(cluster)?;
            finest["geometricError"] = 0.into();
            finest["content"] = self.content(cluster, Mesh::Finest, up)?;
            children.push(finest);
        }

        if !children.is_empty() {
            tile["children"] = children.into();
        }
        Ok(tile)
    }

    /// Error and bounds that a viewer decides by: the same for all coarse clusters of a group.
    fn node(&self, cluster: ClusterId) -> Result<Value, ExportError> {
        let error = f64::from(self.tree.error(self.file.clusters()[cluster.index()].group()));
        let bounds = self.bounds(cluster);
        let reprojected = self.options.reprojection.as_ref().map(|map| map.error(error, bounds.diagonal()));
        let error = reprojected.unwrap_or(error);
        Ok(json!({ "boundingVolume": self.volume(bounds)?, "geometricError": error }))
    }

    fn bounds(&self, cluster: ClusterId) -> &Aabb {
        self.tree.bounds(self.file.clusters()[cluster.index()].group())
    }

    /// A mesh, and the box around it, which culls better than that of its group.
    fn content(&self, cluster: ClusterId, mesh: Mesh, up: &str) -> Result<Value, ExportError> {
        let record = &self.file.clusters()[cluster.index()];
        let volume = self.volume(&Aabb { min: record.aabb_min, max: record.aabb_max })?;
        Ok(json!({ "uri": format!("{up}{}", tile_path(cluster, mesh)), "boundingVolume": volume }))
    }

    /// A box as its middle and half of each axis.
    fn volume(&self, bounds: &Aabb) -> Result<Value, ExportError> {
        let [low, high] = [bounds.min, bounds.max].map(|corner| corner.map(f64::from));
        let half: [f64; 3] = std::array::from_fn(|axis| (high[axis] - low[axis]) / 2.0);
        if let Some(reprojection) = &self.options.reprojection {
            let origin = self.file.header().origin;
            let middle = std::array::from_fn(|axis| origin[axis] + low[axis] + half[axis]);
            return Ok(json!({ "box": reprojection.volume(middle, half)?.as_flattened() }));
        }
        // Some viewers divide by the length of an axis.
        let least = half.iter().fold(0.0, |most: f64, x| most.max(*x)) * 1e-6 + f64::from(f32::MIN_POSITIVE);
        let mut numbers = self.options.upright(std::array::from_fn(|axis| low[axis] + half[axis])).to_vec();
        for axis in 0..3 {
            let mut way = [0.0; 3];
            way[axis] = half[axis].max(least);
            numbers.extend(self.options.upright(way).map(|x| x + 0.0));
        }
        Ok(json!({ "box": numbers }))
    }

    /// From the frame of the tiles to the world, column by column: the origin, and then what was asked for.
    fn transform(&self) -> Option<[f64; 16]> {
        if self.options.reprojection.is_some() {
            return self.options.transform;
        }
        let origin = self.file.header().origin;
        let [x, y, z] = self.options.upright(origin);
        let Some(world) = self.options.transform else {
            return (origin != [0.0; 3])
                .then_some([1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, x, y, z, 1.0]);
        };
        let mut transform = world;
        for row in 0..4 {
            transform[12 + row] += world[row] * x + world[4 + row] * y + world[8 + row] * z;
        }
        Some(transform)
    }
}
