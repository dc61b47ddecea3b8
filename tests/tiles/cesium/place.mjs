// node place.mjs FOLDER NAME...
//
// Shows tilesets FOLDER/NAME to CesiumJS in a browser without a window, asks it for heights at the places of FOLDER/NAME.json (degrees of longitude and latitude, and metres), and
// fails where one is a metre off or nothing is there.
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { browse } from "./browse.mjs";

const [folder, ...names] = process.argv.slice(2);
const { failure, ...results } = await browse("place.html", (path) => {
  if (path === "/names.json") return JSON.stringify(names);
  return path.startsWith("/sets/") ? readFileSync(join(folder, path.slice(6))) : null;
});

let fails = Boolean(failure);
if (fails) console.error(failure);
for (const name of names) {
  const { code, points } = JSON.parse(readFileSync(join(folder, `${name}.json`)));
  const heights = results[name] ?? [];
  const off = points.map(([, , height], i) => (typeof heights[i] === "number" ? Math.abs(heights[i] - height) : Infinity));
  const [most, lost] = [Math.max(...off), off.filter((x) => x === Infinity).length];
  console.log(`${name} (EPSG:${code}): ${points.length} places, ${lost} without a tile, at most ${most.toFixed(3)} m off`);
  fails ||= !(most <= 1);
}
process.exit(fails ? 1 : 0);
