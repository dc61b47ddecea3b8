// The package for other pages: what it holds, three.js, the element, and the examples.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import path from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";
import { launch, newPage, reason } from "./browser.mjs";
import { serve } from "./server.mjs";
import { CHPM, chpm, temporary } from "./tools.mjs";

const web = fileURLToPath(new URL("..", import.meta.url));
const here = fileURLToPath(new URL(".", import.meta.url));
const folder = temporary();
const noModel = CHPM ? false : "CHPM names no command";
const three = await import("three").catch(() => null);
const inBrowser = reason ?? noModel ?? false;
let [browser, host] = [];

before(async () => {
  if (noModel) return;
  chpm("synth", "isosurface", "--triangles", "30000", "-o", path.join(folder, "in.ply"), "-f", "-q");
  chpm("build", path.join(folder, "in.ply"), "-o", path.join(folder, "model.chpm"), "-f", "-q", "--pages", "packed", "--cluster-triangles", "512");
  if (inBrowser) return;
  browser = await launch();
  host = await serve([web, folder, here]);
});

after(async () => {
  await browser?.close();
  host?.close();
});

test("the package that npm packs has what it says, and nothing else", { skip: noModel }, async () => {
  const out = path.join(folder, "package");
  execFileSync("npm", ["pack", "--pack-destination", folder, "--silent"], { cwd: web, encoding: "utf8" });
  const { version, exports } = JSON.parse(readFileSync(path.join(web, "package.json"), "utf8"));
  execFileSync("tar", ["xzf", `chpm-${version}.tgz`], { cwd: folder });
  const places = Object.values(exports).flatMap((place) => (typeof place === "string" ? [place] : Object.values(place)));
  for (const place of places) assert.ok(readFileSync(path.join(out, place), "utf8").length > 0, place);
  const files = execFileSync("tar", ["tzf", path.join(folder, `chpm-${version}.tgz`)], { encoding: "utf8" });
  assert.ok(!/test|node_modules|examples/.test(files), files);
  const packed = await import(pathToFileURL(path.join(out, exports["."].default)));
  const file = await packed.open(packed.memorySource(readFileSync(path.join(folder, "model.chpm"))));
  const cut = await packed.select(file, packed.level(0));
  assert.equal((await packed.extract(file, cut)).triangles.length / 3, file.header.sourceTriangleCount);
  await import(pathToFileURL(path.join(out, exports["./element"])));
});

test("a model of three.js refines itself, is met by rays, and keeps to its cache", { skip: noModel || (three ? false : "no three") }, async () => {
  const { memorySource } = await import("../chpm/index.js");
  const { withThree } = await import("../chpm/three.js");
  const { ChpmCache, ChpmMesh } = withThree(three);
  const source = memorySource(readFileSync(path.join(folder, "model.chpm")));
  const settle = async (mesh, camera) => {
    for (let quiet = 0; quiet < 3; ) {
      mesh.update(camera, 600);
      await new Promise((done) => setTimeout(done, 5));
      quiet = mesh.isSettled && mesh.regions ? quiet + 1 : 0;
    }
  };
  const corners = (mesh) => [...mesh.shown.values()].filter(({ mesh }) => mesh.visible).reduce((sum, { mesh }) => sum + mesh.geometry.index.count, 0);
  const camera = new three.PerspectiveCamera(45, 1.5, 0.001, 100);
  const look = (mesh, away) => {
    const middle = mesh.file.header.boxMin.map((x, axis) => (x + mesh.file.header.boxMax[axis]) / 2);
    camera.position.set(middle[0], middle[1], middle[2] + away);
    camera.lookAt(...middle);
    camera.updateMatrixWorld();
    return middle;
  };
  const mesh = await ChpmMesh.open(source);
  const size = Math.hypot(...mesh.file.header.boxMin.map((x, axis) => mesh.file.header.boxMax[axis] - x));
  look(mesh, 20 * size);
  await settle(mesh, camera);
  const far = corners(mesh);
  look(mesh, 1.2 * size);
  await settle(mesh, camera);
  const near = corners(mesh);
  assert.ok(near > 2 * far, `${near} ${far}`);

  const ray = new three.Raycaster();
  ray.setFromCamera(new three.Vector2(0, 0), camera);
  mesh.updateMatrixWorld(true);
  let hits = 0;
  for (let i = 0; i < 25; i++) {
    ray.setFromCamera(new three.Vector2(0.1 * (i % 5) - 0.2, 0.1 * Math.floor(i / 5) - 0.2), camera);
    const [hit] = ray.intersectObject(mesh, true).filter(({ object }) => object.visible);
    if (hit && hit.object.userData.error >= 0) hits += 1;
  }
  assert.ok(hits > 3, `${hits}`);

  // Twice as large in the scene is as near.
  const large = await ChpmMesh.open(source);
  large.scale.setScalar(2);
  const [x, y, z] = look(large, 1.2 * size).map((x) => 2 * x);
  camera.position.set(x, y, z + 2.4 * size);
  camera.updateMatrixWorld();
  await settle(large, camera);
  assert.equal(corners(large), near);

  const cache = new ChpmCache(300_000);
  const small = await ChpmMesh.open(source, { cache });
  look(small, 1.2 * size);
  await settle(small, camera);
  const most = cache.bytes;
  look(small, 40 * size);
  await settle(small, camera);
  assert.ok(most > 300_000 && most < 600_000 && cache.bytes <= 300_000, `${cache.bytes} of ${most}`);
  small.dispose();
  assert.equal(cache.bytes, 0);
});

test("the examples draw", { skip: inBrowser || (three ? false : "no three") }, async () => {
  const { page, said } = await newPage(browser);
  await page.goto(`${host.url}/examples/element.html`);
  await page.waitForFunction(() => [...document.querySelectorAll("chpm-viewer")].every((viewer) => viewer.drawn?.settled), null, { timeout: 120000 });
  const drawn = await page.evaluate(() => [...document.querySelectorAll("chpm-viewer")].map((viewer) => viewer.drawn.triangles));
  assert.ok(drawn[0] > 2 * drawn[1] && drawn[1] > 100, `${drawn}`);
  await page.goto(`${host.url}/examples/three.html`);
  await page.waitForFunction(() => globalThis.example?.isSettled, null, { timeout: 120000 });
  const shown = await page.evaluate(() => {
    const { models, renderer } = example;
    return { triangles: renderer.info.render.triangles, cache: models[0].cache === models[1].cache, meshes: models.map((model) => model.shown.size) };
  });
  assert.ok(shown.triangles > 1000 && shown.cache, JSON.stringify(shown));
  assert.deepEqual(said.filter((text) => !/GPU stall|favicon/.test(text)), []);
  await page.close();
});
