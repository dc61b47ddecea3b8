// Sheets: read beside the pages that they are of, and drawn where the source has them; what is damaged keeps the colours of vertices.

import assert from "node:assert/strict";
import { copyFileSync, existsSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import path from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { ChpmError, Copies, Sheets, memorySource, open } from "../chpm/index.js";
import { xxh3 } from "../chpm/xxh3.js";
import { launch, newPage, reason } from "./browser.mjs";
import { serve } from "./server.mjs";
import { CHPM, chpm, png, random, repaired, temporary } from "./tools.mjs";

const noModel = CHPM ? false : "CHPM names no command";
const skip = reason ?? noModel;
const web = fileURLToPath(new URL("..", import.meta.url));
const here = fileURLToPath(new URL(".", import.meta.url));
const folder = temporary();
const place = (name) => path.join(folder, name);
const SQUARES = 16;
const [LIGHT, DARK] = [[230, 200, 60], [40, 60, 150]];
let [browser, host] = [];

const height = (x, y) => 0.02 * Math.sin(17 * x) * Math.cos(13 * y);
/** Whether a point of the unit square is on a light square of the board. */
const isLight = (x, y) => (Math.floor(x * SQUARES) + Math.floor(y * SQUARES)) % 2 === 0;

/** Hills over the unit square with a board all over them. */
function hills(side) {
  const [vertices, faces] = [[], []];
  for (let y = 0; y <= side; y++) for (let x = 0; x <= side; x++) vertices.push(`v ${x / side} ${y / side} ${height(x / side, y / side)}\nvt ${x / side} ${y / side}`);
  for (let y = 0; y < side; y++) for (let x = 0; x < side; x++) {
    const [a, b] = [y, y + 1].map((row) => row * (side + 1) + x + 1);
    faces.push(`f ${[a, a + 1, b + 1, b].map((v) => `${v}/${v}`).join(" ")}`);
  }
  return ["mtllib hills.mtl", "usemtl a", ...vertices, ...faces, ""].join("\n");
}

before(async () => {
  if (noModel) return;
  writeFileSync(place("hills.obj"), hills(64));
  writeFileSync(place("hills.mtl"), "newmtl a\nmap_Kd board.png\n");
  writeFileSync(place("board.png"), png(512, (u, v) => (isLight(u, v) ? LIGHT : DARK)));
  for (const [name, texture] of [["hills", "sheets"], ["plain", "vertices"]]) {
    chpm("build", place("hills.obj"), "-o", place(`${name}.chpm`), "-q", "--texture", texture, "--cluster-triangles", "512", "--pages", "packed");
  }
  if (skip) return;
  browser = await launch();
  host = await serve([web, folder]);
});

after(async () => {
  await browser?.close();
  host?.close();
});

/** A file with all of its records, and the ids of its clusters. */
async function opened(source) {
  const file = await open(source);
  await file.needTables();
  const ids = Array.from({ length: file.header.clusterCount }, (_, id) => id);
  await file.sheets?.need(ids);
  return { file, ids };
}

test("copies of vertices are the page's mesh at every position, within their charts", { skip: noModel }, async () => {
  const { file, ids } = await opened(memorySource(readFileSync(place("hills.chpm"))));
  const pages = await file.pages(ids);
  let [seen, doubled] = [0, 0];
  await file.sheets.each(ids.map((id) => file.cluster(id)), (sheet) => {
    const page = pages.get(sheet.cluster.id);
    const { vertexCount: v, baseVertexCount: b } = page.cluster;
    const copies = new Copies(page, sheet);
    for (let n = b; n <= v; n++) {
      const corners = copies.indices(n);
      assert.deepEqual(Array.from(corners, (copy) => copies.vertexOf[copy]), [...page.indices(n)]);
      for (const copy of corners) assert.ok([0, 1].every((way) => copies.places[2 * copy + way] > 0 && copies.places[2 * copy + way] < 1), `cluster ${page.cluster.id}`);
    }
    assert.deepEqual([...copies.of(page.positions, 3).subarray(-3)], [...page.positions.subarray(-3)]);
    doubled += copies.count - v;
    seen += 1;
  });
  assert.ok(seen === ids.length && doubled > 0, `${seen} sheets, ${doubled} more vertices`);
  assert.equal((await open(memorySource(readFileSync(place("plain.chpm"))))).sheets, null);
});

/** A sheet by hand, its layout not compressed. */
function byHand(change) {
  const [charts, triangles] = [2, 3];
  const layout = new DataView(new ArrayBuffer(16 + 40 * charts + 2 * triangles));
  for (let chart = 0; chart < charts; chart++) {
    const at = 16 + 40 * chart;
    [1, 0, 0, 0, 1, 0, 4, 4].forEach((x, i) => layout.setFloat32(at + 4 * i, x, true));
    [16 * chart, 0, 16, 16].forEach((x, i) => layout.setUint16(at + 32 + 2 * i, x, true));
  }
  [0, 1, 1].forEach((chart, t) => layout.setUint16(96 + 2 * t, chart, true));
  const image = new DataView(new ArrayBuffer(24));
  [0x89504e47, 0x0d0a1a0a, 13, 0x49484452, 32, 32].forEach((word, i) => image.setUint32(4 * i, word));
  const record = new DataView(new ArrayBuffer(64));
  [[4, charts], [16, layout.byteLength], [20, 24], [28, 2]].forEach(([at, x]) => record.setUint32(at, x, true));
  [24, 26].forEach((at) => record.setUint16(at, 32, true));
  record.setFloat32(32, 0.5, true);
  change({ layout, image, record });
  const sheet = Buffer.concat([layout, image].map(({ buffer }) => Buffer.from(buffer)));
  record.setBigUint64(40, xxh3(new Uint8Array(sheet)), true);
  const bytes = Buffer.concat([Buffer.from(record.buffer), sheet]);
  const records = { offset: 0, length: 64, checksum: xxh3(new Uint8Array(record.buffer)) };
  return new Sheets(memorySource(bytes), records, { offset: 64, length: sheet.length }, (frame) => frame);
}

const read = async (change) => {
  const sheets = byHand(change);
  await sheets.need([0]);
  let found = null;
  await sheets.each([{ id: 0, triangleCount: 3 }], (sheet) => (found = sheet));
  return found;
};

test("a layout that no sheet may have is an error in words", async () => {
  const sound = await read(() => {});
  const at = new Float32Array(2);
  sound.place(1, [2, 6, 9], 0, at, 0);
  assert.deepEqual([[...at], [...sound.chartOf]], [[6 / 32, 10 / 32], [0, 1, 1]]);
  const wrong = {
    "a chart that is not there": ({ layout }) => layout.setUint16(98, 2, true),
    "a number that is none": ({ layout }) => layout.setFloat32(20, NaN, true),
    "an origin that is none": ({ layout }) => layout.setFloat32(4, Infinity, true),
    "a rectangle outside": ({ layout }) => layout.setUint16(88, 17, true),
    "a rectangle without width": ({ layout }) => layout.setUint16(52, 0, true),
    "too many charts": ({ record }) => record.setUint32(4, 3, true),
    "no charts": ({ record }) => record.setUint32(4, 0, true),
    "another size than the image's": ({ record }) => record.setUint16(24, 48, true),
    "an odd size": ({ record }) => record.setUint16(24, 40, true),
    "another kind of image": ({ record }) => record.setUint32(28, 1, true),
    "an unknown kind of image": ({ record }) => record.setUint32(28, 3, true),
    "an image that is none": ({ image }) => image.setUint32(0, 0),
    "a place outside": ({ record }) => record.setBigUint64(8, 8n, true),
    "another cluster": ({ record }) => record.setUint32(0, 1, true),
    "texels of no size": ({ record }) => record.setFloat32(32, 0, true),
  };
  for (const [what, change] of Object.entries(wrong)) {
    await assert.rejects(read(change), (error) => error instanceof ChpmError && /sheet/.test(error.message), what);
  }
  const sheets = byHand(() => {});
  await sheets.need([0]);
  await assert.rejects(sheets.each([{ id: 0, triangleCount: 4 }], () => {}), ChpmError);
});

/** Opens the page, seen from above and aside, and waits until all is there. */
async function show(name, use, { query = "", until = "settled" } = {}) {
  const { page, said } = await newPage(browser);
  try {
    await page.goto(`${host.url}/view.html?file=${name}&up=z${query}`);
    await page.waitForFunction(() => chpmView.model?.isReady);
    await page.evaluate(() => {
      const { orbit, model } = chpmView;
      document.getElementById("panel").open = false;
      Object.assign(orbit, { framed: null, turn: 0.4, rise: 1.0, target: model.center, distance: 1.8 });
      orbit.onChange();
      return new Promise(requestAnimationFrame);
    });
    await page.waitForFunction((until) => chpmView.status === until, until);
    await use(page);
    assert.deepEqual(said, []);
  } finally {
    await page.close();
  }
}

/** Allows 2^power pixels of error; the panel is closed. */
const allow = (page, power) => page.evaluate((power) => {
  document.getElementById("pixels").value = power;
  chpmView.orbit.onChange();
}, power);

const told = (page) => page.evaluate(() => {
  const { drawn, status, message, model: { renderer } } = chpmView;
  const counted = [...renderer.blocks.values()].reduce((sum, { bytes }) => sum + bytes, 0);
  return { status, message, triangles: drawn.triangles, clusters: drawn.clusters, painted: drawn.painted, bytes: renderer.bytes, counted };
});

/** Whether the picture is light, more yellow than blue, at points of the hills; null where nothing is drawn. */
const lightAt = (page, points) => page.evaluate((points) => {
  const { canvas } = chpmView.model.renderer;
  const { origin } = chpmView.model.file.header;
  chpmView.orbit.onChange();
  return new Promise((done) => requestAnimationFrame(() => {
    const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d");
    copy.drawImage(canvas, 0, 0);
    const { data, width } = copy.getImageData(0, 0, canvas.width, canvas.height);
    done(points.map((point) => {
      const [x, y] = chpmView.orbit.project(point.map((x, axis) => x - origin[axis]));
      const at = 4 * (Math.floor(y) * width + Math.floor(x));
      return data[at + 3] === 0 ? null : data[at] > data[at + 2];
    }));
  }));
}, points.map(([x, y]) => [x, y, height(x, y)]));

/** The share of points in the middle of squares that have another colour than their square. */
async function wrongSquares(page) {
  const middles = Array.from({ length: SQUARES * SQUARES }, (_, i) => [((i % SQUARES) + 0.5) / SQUARES, (Math.floor(i / SQUARES) + 0.5) / SQUARES]);
  const found = await lightAt(page, middles);
  return middles.filter(([x, y], i) => found[i] !== isLight(x, y)).length / middles.length;
}

test("the board is where it has to be, finely and coarsely", { skip }, async () => {
  await show("hills.chpm", async (page) => {
    const fine = await told(page);
    assert.ok(fine.painted === fine.clusters && fine.painted > 3, JSON.stringify(fine));
    assert.equal(await wrongSquares(page), 0);
    // Along a row: a pixel is some 4 thousandths.
    const row = Array.from({ length: 901 }, (_, i) => [0.05 + i / 1000, 5.5 / SQUARES]);
    const light = await lightAt(page, row);
    const borders = row.filter((_, i) => i > 0 && light[i] !== light[i - 1]).map(([x]) => x * SQUARES);
    assert.ok(borders.length === 15 && borders.every((x) => Math.abs(x - Math.round(x)) < 0.15), `${borders}`);

    await allow(page, 5);
    await page.waitForFunction(() => chpmView.status === "settled" && chpmView.drawn.clusters === 1);
    const coarse = await told(page);
    assert.ok(coarse.triangles < 250 && coarse.painted === 1, JSON.stringify(coarse));
    assert.ok((await wrongSquares(page)) < 0.02, `${await wrongSquares(page)}`);
    // The colours of so few vertices show no board.
    await page.keyboard.press("i");
    await page.waitForFunction(() => chpmView.status === "settled" && chpmView.drawn.painted === 0);
    assert.ok((await wrongSquares(page)) > 0.3, `${await wrongSquares(page)}`);
    await page.keyboard.press("i");
    await page.waitForFunction(() => chpmView.status === "settled" && chpmView.drawn.painted === 1);
    assert.ok((await wrongSquares(page)) < 0.02);
  });
});

test("sheets come behind the first picture, and a file without any asks for no more", { skip }, async () => {
  const whole = readFileSync(place("hills.chpm"));
  const { file, ids } = await opened(memorySource(whole));
  const { sections } = repaired(Buffer.from(whole));
  const [records, texels] = [8, 9].map((kind) => sections.find((section) => section.kind === kind));
  let release;
  host.state.requests.length = 0;
  host.state.hold = { from: records.offset, until: new Promise((done) => (release = done)) };
  // Pages lie behind the sheets, so only the roots' are let through.
  const first = Math.min(...(await file.roots()).map((id) => file.cluster(id).pageOffset));
  const { hold } = host.state;
  host.state.hold = { get from() { return records.offset; }, until: { then: (...done) => (host.state.requests.some(({ first: at }) => at >= first) ? hold.until.then(...done) : Promise.resolve().then(...done)) } };
  const { page } = await newPage(browser);
  await page.goto(`${host.url}/view.html?file=hills.chpm&up=z`);
  await page.waitForFunction(() => chpmView.drawn?.triangles > 0);
  assert.equal((await told(page)).painted, 0);
  host.state.hold = null;
  release();
  await page.waitForFunction(() => chpmView.status === "settled" && chpmView.drawn.painted === chpmView.drawn.clusters);
  await page.close();
  const isOfSheets = ({ first: at }) => at >= texels.offset && at < texels.offset + texels.length;
  const asked = host.state.requests.filter(isOfSheets);
  assert.ok(asked.length >= 1 && asked.length <= ids.length / 2, JSON.stringify(asked));

  await show("hills.chpm", async (page) => {
    assert.deepEqual(await page.locator("#colors option").allTextContents(), ["surface", "vertices, no images", "level", "cluster", "error"]);
  });
  host.state.requests.length = 0;
  await show("plain.chpm", async (page) => {
    assert.equal((await told(page)).painted, 0);
    assert.equal(await page.evaluate(() => chpmView.model.painter), null);
  });
  // How many requests there are depends on what comes first; none asks for what another has brought.
  const bytes = host.state.requests.reduce((sum, { length }) => sum + length, 0);
  const { length: size } = readFileSync(place("plain.chpm"));
  assert.ok(bytes > 0 && bytes <= size, `${bytes} of ${size} bytes`);
});

test("a damaged sheet keeps the colours of vertices, and is told once", { skip }, async () => {
  const whole = readFileSync(place("hills.chpm"));
  const { file } = await opened(memorySource(whole));
  const { sections } = repaired(Buffer.from(whole));
  const texels = sections.find(({ kind }) => kind === 9);
  const next = random(5);
  const leaves = Array.from({ length: file.header.clusterCount }, (_, id) => id).filter((id) => file.cluster(id).level === 0);
  const damaged = (change, ids, sums) => {
    const bytes = Buffer.from(whole);
    for (const id of ids) change(bytes, file.sheets.record(id), texels.offset + file.sheets.record(id).offset);
    return sums ? repaired(bytes, [], ids).bytes : bytes;
  };
  const noise = (bytes, from, to) => { for (let at = from; at < to; at++) bytes[at] = Math.floor(256 * next()); };
  const cases = {
    sum: [damaged((bytes, _, at) => (bytes[at + 7] ^= 1), [leaves[1]], false), 1, /checksum is another one; colours/],
    layouts: [damaged((bytes, { layoutLength }, at) => noise(bytes, at, at + layoutLength), leaves, true), leaves.length, /layout that cannot be expanded/],
    // Behind what the reader looks at, only the decoder can tell.
    images: [damaged((bytes, { layoutLength, length }, at) => bytes.fill(0xff, at + layoutLength + 180, at + length), leaves, true), leaves.length, /cannot be decoded/],
    records: [(() => { const bytes = Buffer.from(whole); bytes[sections.find(({ kind }) => kind === 8).offset + 70] ^= 1; return bytes; })(), Infinity, /table of sheets is damaged/],
  };
  for (const [name, [bytes, lost, message]] of Object.entries(cases)) {
    writeFileSync(place(`${name}.chpm`), bytes);
    host.state.requests.length = 0;
    await show(`${name}.chpm`, async (page) => {
      const rest = () => page.waitForFunction(() => chpmView.model.requests + chpmView.model.painter.requests === 0 && chpmView.drawn?.settled);
      await rest();
      const { message: said, painted, clusters } = await told(page);
      assert.match(said, message, name);
      assert.equal(painted, Math.max(clusters - lost, 0), name);
      // Split for the texels of sheets, meshes have vertices for the squares; without the table they are not.
      assert.ok((await wrongSquares(page)) < (lost < Infinity ? 0.1 : 0.6), name);
      const { length } = host.state.requests;
      await page.evaluate(() => (chpmView.orbit.onChange(), new Promise(requestAnimationFrame)));
      await rest();
      assert.equal(host.state.requests.length, length, `${name}: what is damaged is not asked for again and again`);
    }, { until: "damaged" });
  }
});

test("images take their part of the memory, and come back with a lost context", { skip }, async () => {
  await show("hills.chpm", async (page) => {
    const before = await told(page);
    assert.equal(before.counted, before.bytes);
    await page.evaluate(() => {
      globalThis.lose = chpmView.model.renderer.gl.getExtension("WEBGL_lose_context");
      lose.loseContext();
    });
    await page.waitForFunction(() => chpmView.status === "waiting");
    await page.evaluate(() => lose.restoreContext());
    await page.waitForFunction((painted) => chpmView.status === "settled" && chpmView.drawn.painted === painted, before.painted);
    assert.equal((await told(page)).triangles, before.triangles);
    assert.equal(await wrongSquares(page), 0);

    // With little memory images are smaller, and with more they are as they were.
    const remember = (bytes) => page.evaluate((bytes) => {
      const { model } = chpmView;
      model.memory = model.painter.memory = bytes;
      chpmView.orbit.onChange();
    }, bytes);
    await remember(2_000_000);
    await page.waitForFunction(() => chpmView.status === "settled" && chpmView.model.renderer.bytes < 2_000_000);
    const small = await told(page);
    assert.ok(small.painted === before.painted && small.triangles === before.triangles, JSON.stringify(small));
    assert.equal(small.counted, small.bytes);
    assert.equal(await wrongSquares(page), 0);
    await remember(512 << 20);
    await page.waitForFunction((bytes) => chpmView.status === "settled" && chpmView.model.renderer.bytes === bytes, before.bytes);
    // What is not drawn loses its images, and then itself.
    await remember(800_000);
    await allow(page, 5);
    await page.waitForFunction(() => chpmView.status === "settled" && chpmView.drawn.clusters === 1 && chpmView.model.renderer.bytes <= 800_000);
    // What was asked for before may still come.
    const last = await told(page);
    assert.equal(last.counted, last.bytes);
  });
});

test("a page of one file, one in pieces, and a file that is dropped draw sheets", { skip }, async () => {
  chpm("share", place("hills.chpm"), "-o", place("site"), "-q");
  chpm("share", place("hills.chpm"), "-o", place("split"), "-q", "--split");
  const settled = () => chpmView.status === "settled" && chpmView.drawn.painted > 0 && chpmView.drawn.painted === chpmView.drawn.clusters;
  for (const where of ["site", "split"]) {
    const { page, said } = await newPage(browser);
    host.state.ranges = where === "site";
    await page.goto(`${host.url}/${where}/index.html`);
    await page.waitForFunction(settled);
    assert.deepEqual(said, []);
    await page.close();
  }
  host.state.ranges = true;
  const { page } = await newPage(browser);
  await page.goto(`file://${place("site/index.html")}`);
  await page.setInputFiles("#file", place("hills.chpm"));
  await page.waitForFunction(settled);
  await page.close();
});

const noThree = existsSync(path.join(here, "node_modules/three")) ? false : "no three";
test("models of three.js have their sheets, and lay them down with their clusters", { skip: skip || noThree }, async () => {
  mkdirSync(place("three"));
  copyFileSync(place("hills.chpm"), place("three/model.chpm"));
  const own = await serve([web, here, place("three")]);
  after(() => own.close());
  const { page, said } = await newPage(browser);
  await page.goto(`${own.url}/examples/three.html`);
  await page.waitForFunction(() => globalThis.example?.isSettled);
  const middles = Array.from({ length: SQUARES * SQUARES }, (_, i) => [i % SQUARES, Math.floor(i / SQUARES)].map((n) => (n + 0.5) / SQUARES)).map(([x, y]) => [x, y, height(x, y)]);
  const found = await page.evaluate((points) => {
    const { models, renderer: { domElement: canvas }, camera, THREE } = example;
    const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d", { willReadFrequently: true });
    copy.drawImage(canvas, 0, 0);
    const light = points.map((point) => {
      const { x, y } = new THREE.Vector3(...point).project(camera);
      const [red, , blue] = copy.getImageData(((x + 1) / 2) * canvas.width, ((1 - y) / 2) * canvas.height, 1, 1).data;
      return red > blue;
    });
    const drawn = models.map((model) => [...model.shown.values()].filter(({ mesh }) => mesh.visible).map(({ texture }) => Boolean(texture)));
    const { cache } = models[0];
    const { memory } = example.renderer.info;
    const before = memory.textures;
    models.forEach((model) => model.dispose());
    return { light, drawn, bytes: cache.bytes, freed: before - memory.textures };
  }, middles);
  assert.ok(found.drawn.every((textures) => textures.length > 0 && textures.every(Boolean)), JSON.stringify(found.drawn));
  assert.deepEqual(middles.filter(([x, y], i) => found.light[i] !== isLight(x, y)), []);
  assert.equal(found.bytes, 0);
  assert.ok(found.freed >= found.drawn.flat().length, `${found.freed}`);
  assert.deepEqual(said.filter((text) => !/GPU stall|favicon/.test(text)), []);
  await page.close();
});
