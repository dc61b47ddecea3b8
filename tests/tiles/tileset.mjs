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
