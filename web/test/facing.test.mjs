// How the page shades models without normals.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import path from "node:path";
import { test } from "node:test";
import { memorySource, open } from "../chpm/index.js";
import { Borders, leftOf, ofFaces } from "../view/facing.js";
import { CHPM, chpm, random, temporary } from "./tools.mjs";

const skip = CHPM ? false : "CHPM names no command";

/** What the shader makes of a face's normal at a vertex. */
function made([x, y, z, kind], face) {
  const along = x * face[0] + y * face[1] + z * face[2];
  const way = [x, y, z].map((d) => d * along);
  const made = kind > 0 ? way : face.map((f, axis) => f - (kind < 0 ? way[axis] : 0));
  return made.map((d) => d / Math.hypot(...made));
}

const near = (a, b) => a.every((x, axis) => Math.abs(x - b[axis]) < 1e-9);

test("smooth faces have one normal, a crease keeps its sides, a corner its planes", () => {
  const side = (degrees) => [Math.cos((degrees * Math.PI) / 180), Math.sin((degrees * Math.PI) / 180), 0];
  const cap = [0, 0, 1];
  assert.ok(near(ofFaces([side(-15), side(15)]), [1, 0, 0, 1]));
  const rim = ofFaces([side(-11), cap, side(11)]);
  for (const [face, told] of [[side(-11), [1, 0, 0]], [side(11), [1, 0, 0]], [cap, cap]]) {
    assert.ok(near(made(rim, face), told), `${rim}: ${made(rim, face)}`);
  }
  assert.deepEqual(ofFaces([[1, 0, 0], [0, 1, 0], cap]), [0, 0, 0, 0]);
  assert.deepEqual(ofFaces([]), [0, 0, 0, 0]);
  assert.ok(Math.abs(made(ofFaces([cap, [0, 0.1, -1]]), cap)[2]) > 0.99);
});

test("vertices that clusters share face one way, whichever cluster comes first", { skip }, async () => {
  const folder = temporary();
  const [source, file] = ["iso.ply", "iso.chpm"].map((name) => path.join(folder, name));
  chpm("synth", "isosurface", "--triangles", "20000", "-o", source, "-f", "-q");
  chpm("build", source, "-o", file, "-f", "-q", "--cluster-triangles", "256");
  const model = await open(memorySource(readFileSync(file)));
  const all = Array.from({ length: model.header.clusterCount }, (_, id) => id);
  await model.needClusters(all);
  const groups = [...new Set(all.map((id) => model.cluster(id).group))];
  await model.needGroups(groups);
  await model.needMembers(groups.map((id) => model.group(id)));
  const [roots, pages] = [await model.roots(), await model.pages(all)];

  const next = random(7);
  const told = [];
  for (let turn = 0; turn < 3; turn++) {
    const borders = new Borders(model, roots, (id) => pages.get(id));
    const order = turn === 0 ? all : all.map((id) => [next(), id]).sort((a, b) => a[0] - b[0]).map(([, id]) => id);
    const [ways, allWays] = [new Map(), new Map()];
    for (const id of order) {
      const page = pages.get(id);
      const { array, turned } = borders.of(page);
      assert.equal(turned, page.cluster.vertexCount, "with all pages, all is known");
      const left = leftOf(page);
      page.ids().forEach((shared, vertex) => {
        if (shared < 0) return;
        const way = array.subarray(4 * vertex, 4 * vertex + 4).join(" ");
        allWays.set(`${id} ${shared}`, way);
        // What ends here may be told by the faces here.
        if (left[vertex] === 0) return;
        assert.equal(ways.get(shared) ?? way, way, `vertex ${shared}`);
        ways.set(shared, way);
      });
    }
    assert.ok(ways.size > 500);
    told.push([...allWays].sort((a, b) => a[0].localeCompare(b[0])).join(";"));
  }
  assert.ok(told[1] === told[0] && told[2] === told[0], "what is known depends on what was asked first");
});
