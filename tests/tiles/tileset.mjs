// A tileset as a viewer sees it.
import { readFileSync } from "node:fs";
import { dirname, join, normalize } from "node:path";

/// The tileset with those that it refers to in place of the tiles that do.
export function whole(dir) {
  const load = (path) => {
    const { root } = JSON.parse(readFileSync(join(dir, path)));
    const walk = (tile) => {
      const uri = tile.content?.uri;
      if (uri?.endsWith(".json")) return load(normalize(join(dirname(path), uri)));
      tile.children = (tile.children ?? []).map(walk);
      return tile;
    };
    return walk(root);
  };
  return load("tileset.json");
}

/// How far a place is from a box whose axes are at right angles.
export function outside(box, place) {
  const from = [0, 1, 2].map((axis) => place[axis] - box[axis]);
  const ways = [3, 6, 9].map((at) => {
    const way = box.slice(at, at + 3);
    const half = Math.hypot(...way);
    return Math.max(Math.abs((way[0] * from[0] + way[1] * from[1] + way[2] * from[2]) / half) - half, 0);
  });
  return Math.hypot(...ways);
}
