// The page in a browser. Skipped where there is no Chromium, or its driver was not installed (`npm ci` in this folder).

import assert from "node:assert/strict";
import { readFileSync, writeFileSync } from "node:fs";
import path from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { memorySource, open } from "../chpm/index.js";
import { launch, newPage, reason, rest } from "./browser.mjs";
import { serve } from "./server.mjs";
import { CHPM, chpm, temporary } from "./tools.mjs";

const skip = reason ?? (CHPM ? false : "CHPM names no command");

const folder = temporary();
const web = fileURLToPath(new URL("..", import.meta.url));
let browser;
let host;

before(async () => {
  if (skip) return;
  chpm("synth", "isosurface", "--triangles", "60000", "-o", path.join(folder, "iso.ply"), "-f", "-q");
  chpm("build", path.join(folder, "iso.ply"), "-o", path.join(folder, "iso.chpm"), "-f", "-q", "--pages", "raw", "--cluster-triangles", "1024");
  browser = await launch();
  host = await serve([web, folder]);
});

after(async () => {
  await browser?.close();
  host?.close();
});

/** Opens the page, and waits until nothing more is to come. */
async function show(query, use) {
  const { page, said } = await newPage(browser);
  try {
    await page.goto(`${host.url}/view.html${query}`);
    await rest(page);
    await use(page, said);
  } finally {
    await page.close();
  }
}

const state = (page) => page.evaluate(() => ({ status: chpmView.status, message: chpmView.message, triangles: chpmView.drawn?.triangles, clusters: chpmView.drawn?.clusters }));

test("packed pages and lattices are drawn, with the same triangles where they are the same", { skip }, async () => {
  const [name, packed, lattice] = ["iso.chpm", "packed.chpm", "lattice.chpm"];
  chpm("relayout", path.join(folder, name), "-o", path.join(folder, packed), "-f", "-q", "--pages", "packed");
  const more = ["--pages", "packed", "--positions", "lattice:14", "--cluster-triangles", "1024"];
  chpm("build", path.join(folder, "iso.ply"), "-o", path.join(folder, lattice), "-f", "-q", ...more);
  const drawn = [];
  for (const file of [name, packed, lattice]) {
    await show(`?file=${file}`, async (page, said) => {
      const told = await state(page);
      assert.equal(told.status, "settled", told.message);
      assert.ok((await drawnPixels(page)) > 0.02);
      assert.deepEqual(said, []);
      drawn.push([told.triangles, told.clusters]);
    });
  }
  assert.deepEqual(drawn[1], drawn[0]);
});

/** The share of the image that is drawn on. */
const drawnPixels = async (page) => (await drawn(page)).share;

/** What is drawn: its share of the image, its mean light from 0 to 1, and its leftmost column. */
async function drawn(page) {
  return page.evaluate(() => {
    const { canvas } = chpmView.model.renderer;
    chpmView.orbit.onChange();
    return new Promise((done) => requestAnimationFrame(() => {
      const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d");
      copy.drawImage(canvas, 0, 0);
      const { data } = copy.getImageData(0, 0, canvas.width, canvas.height);
      let [count, light, left] = [0, 0, canvas.width];
      for (let i = 3; i < data.length; i += 4) {
        if (data[i] === 0) continue;
        count += 1;
        light += data[i - 1] / 255;
        left = Math.min(left, ((i - 3) / 4) % canvas.width);
      }
      done({ share: count / (canvas.width * canvas.height), light: light / count, left: left / (canvas.width / canvas.clientWidth) });
    }));
  });
}

test("models of any size look alike, beside the panel", { skip }, async () => {
  const seen = [];
  for (const size of ["winding", "tiny", "huge"]) {
    chpm("synth", `hard:${size}`, "--triangles", "5000", "-o", path.join(folder, `${size}.ply`), "-f", "-q");
    chpm("build", path.join(folder, `${size}.ply`), "-o", path.join(folder, `${size}.chpm`), "-f", "-q");
    await show(`?file=${size}.chpm&pixels=0.5`, async (page, said) => {
      seen.push(await drawn(page));
      assert.deepEqual(said, []);
      const told = await page.locator("#statistics").innerText();
      assert.ok(!/0\.0000/.test(told), told);
      const panel = await page.locator("#panel").boundingBox();
      assert.ok(seen.at(-1).left > panel.x + panel.width, JSON.stringify(seen));
      await page.locator("#title").click();
      await rest(page);
      const alone = await drawn(page);
      assert.ok(alone.left < seen.at(-1).left - 50, JSON.stringify([alone, seen]));
    });
  }
  for (const { share, light } of seen) {
    assert.ok(Math.abs(share / seen[0].share - 1) < 0.02 && Math.abs(light / seen[0].light - 1) < 0.02, JSON.stringify(seen));
  }
});

test("a model is drawn, finer with less error, and within a budget", { skip }, async () => {
  await show("?file=iso.chpm", async (page, said) => {
    const first = await state(page);
    assert.equal(first.status, "settled", first.message);
    assert.ok(first.triangles > 1000);
    await page.locator("#pixels").fill("4");
    await rest(page);
    const coarse = await state(page);
    assert.ok(coarse.triangles < first.triangles, `${coarse.triangles} of ${first.triangles}`);
    await page.locator("#pixels").fill("-1");
    await page.locator("#budget").fill("4.5");
    await page.waitForFunction(() => chpmView.status === "settled" && chpmView.drawn.triangles <= 10 ** 4.5 && chpmView.drawn.relaxed > 1);
    for (const colors of ["level", "cluster", "error"]) await page.selectOption("#colors", colors);
    await page.selectOption("#up", "z");
    await page.mouse.move(600, 300);
    await page.mouse.down();
    await page.mouse.move(680, 340);
    await page.mouse.up();
    await page.mouse.wheel(0, -300);
    await rest(page);
    assert.equal((await state(page)).status, "settled");
    assert.deepEqual(said, []);
  });
});

test("what is outside the image is not drawn, and the picture is the same", { skip }, async () => {
  const near = async (isCulled) => {
    const { page } = await newPage(browser);
    host.state.requests.length = 0;
    await page.goto(`${host.url}/view.html?file=iso.chpm&pixels=0.5`);
    await page.waitForFunction(() => chpmView.model?.isReady);
    await page.evaluate((isCulled) => {
      const { orbit, model } = chpmView;
      document.getElementById("panel").hidden = true;
      if (!isCulled) orbit.planes = () => [];
      Object.assign(orbit, { framed: null, target: model.points[0], distance: 0.15 * orbit.size });
      orbit.onChange();
    }, isCulled);
    await page.waitForFunction(() => chpmView.status === "settled" && chpmView.drawn.relaxed === 1);
    const picture = await page.locator("#canvas").screenshot();
    const told = { ...(await state(page)), share: await drawnPixels(page), picture };
    await page.close();
    return { ...told, bytes: host.state.requests.reduce((sum, { length }) => sum + length, 0) };
  };
  const [whole, culled] = [await near(false), await near(true)];
  assert.ok(whole.share > 0.02, `${whole.share}`);
  assert.ok(culled.picture.equals(whole.picture));
  assert.ok(culled.triangles < 0.7 * whole.triangles, `${culled.triangles} of ${whole.triangles}`);
  assert.ok(culled.bytes <= whole.bytes, `${culled.bytes} of ${whole.bytes}`);
});

test("what is hidden is not drawn, the picture is the same, and what comes into sight is made finer", { skip }, async () => {
  chpm("build", path.join(folder, "iso.ply"), "-o", path.join(folder, "small.chpm"), "-f", "-q", "--cluster-triangles", "256");
  const look = async (query, cameras) => {
    const { page, said } = await newPage(browser);
    await page.goto(`${host.url}/view.html?file=small.chpm&pixels=0.25${query}`);
    await page.waitForFunction(() => chpmView.model?.isReady);
    const seen = [];
    for (const turn of cameras) {
      await page.evaluate((turn) => {
        const { orbit, model } = chpmView;
        document.getElementById("panel").hidden = true;
        document.getElementById("budget").value = document.getElementById("budget").max;
        Object.assign(orbit, { framed: null, target: model.center, distance: 0.5 * orbit.size, turn });
        orbit.onChange();
      }, turn);
      await rest(page);
      const picture = await page.locator("#canvas").screenshot();
      seen.push({ ...(await state(page)), picture, cut: await page.evaluate(() => chpmView.drawn.cut.length) });
    }
    assert.deepEqual(said, []);
    await page.close();
    return seen;
  };
  const [all, culled] = [await look("&occlusion=off", [0, 2]), await look("", [0, 2])];
  for (const [i, { picture, triangles, status }] of culled.entries()) {
    assert.ok(picture.equals(all[i].picture), `camera ${i}`);
    assert.ok(status === "settled" && triangles <= all[i].triangles, `${triangles} of ${all[i].triangles}`);
  }
  const sum = (views, key) => views.reduce((sum, view) => sum + view[key], 0);
  assert.ok(sum(culled, "triangles") < 0.8 * sum(all, "triangles"), `${sum(culled, "triangles")} of ${sum(all, "triangles")}`);
  // What was seen before is of no weight: the same as for whoever looks from there first.
  const [first] = await look("", [2]);
  assert.ok(first.picture.equals(culled[1].picture));
  assert.ok(Math.abs(first.triangles / culled[1].triangles - 1) < 0.1, `${first.triangles}, ${culled[1].triangles}`);
});

test("the first picture takes few requests", { skip }, async () => {
  host.state.requests.length = 0;
  await show("?file=iso.chpm", async () => {
    const file = await open(memorySource(readFileSync(path.join(folder, "iso.chpm"))));
    const roots = await file.roots();
    const first = Math.min(...roots.map((id) => file.cluster(id).pageOffset));
    const before = host.state.requests.findIndex(({ first: from }) => from >= first);
    assert.ok(before >= 1 && before <= 3, JSON.stringify(host.state.requests.slice(0, 6)));
    const bytes = host.state.requests.slice(0, before).reduce((sum, { length }) => sum + length, 0);
    assert.ok(bytes <= 512 << 10, `${bytes} bytes`);
    // Splits alike come together: of 127 pages, most that are wanted at once are next to each other.
    const { length } = host.state.requests;
    assert.ok(length >= before && length <= 18, `${length} requests`);
  });
});

test("what changes before the first page is there is harmless", { skip }, async () => {
  const file = await open(memorySource(readFileSync(path.join(folder, "iso.chpm"))));
  const roots = await file.roots();
  let release;
  host.state.hold = { from: Math.min(...roots.map((id) => file.cluster(id).pageOffset)), until: new Promise((done) => (release = done)) };
  const { page, said } = await newPage(browser);
  try {
    await page.goto(`${host.url}/view.html?file=iso.chpm`);
    await page.waitForFunction(() => chpmView.model?.roots);
    await page.locator("#pixels").fill("2");
    await page.setViewportSize({ width: 700, height: 500 });
    await page.locator("#home").click();
    await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
    assert.equal((await state(page)).status, "loading");
    release();
    await page.waitForFunction(() => chpmView.status === "settled");
    assert.deepEqual(said, []);
    assert.ok((await drawnPixels(page)) > 0.02);
  } finally {
    host.state.hold = null;
    release();
    await page.close();
  }
});

test("what goes wrong is a message on the page", { skip }, async () => {
  const whole = readFileSync(path.join(folder, "iso.chpm"));
  const file = await open(memorySource(whole));
  const damaged = Buffer.from(whole);
  for (let id = 0; id < file.header.clusterCount; id++) {
    await file.needClusters([id]);
    if (file.cluster(id).level === 0) damaged[file.cluster(id).pageOffset + 80] ^= 1;
  }
  writeFileSync(path.join(folder, "damaged.chpm"), damaged);
  writeFileSync(path.join(folder, "short.chpm"), whole.subarray(0, whole.length >> 1));
  writeFileSync(path.join(folder, "other.chpm"), "ply\nformat ascii 1.0\n".repeat(100));

  const cases = [
    ["short.chpm", "failed", /cut short/],
    ["other.chpm", "failed", /no \.chpm file/],
    ["absent.chpm", "failed", /not there/],
    ["damaged.chpm", "damaged", /damaged.*The rest/s],
  ];
  for (const [name, status, message] of cases) {
    await show(`?file=${name}`, async (page, said) => {
      const told = await state(page);
      assert.equal(told.status, status, told.message);
      assert.match(told.message, message);
      // The browser itself tells of an answer of 404.
      assert.deepEqual(said.filter((text) => !text.includes("404")), []);
      if (status === "damaged") assert.ok((await drawnPixels(page)) > 0.02);
    });
  }
});

test("what is lost on its way is fetched again, and the page says so while it waits", { skip }, async () => {
  let left = 1;
  // Each time another request than the one before.
  host.state.lose = (file) => file === "iso.chpm" && (left = (left + 1) % 3) === 0;
  await show("?file=iso.chpm", async (page) => assert.equal((await state(page)).status, "settled"));
  let isGone = false;
  host.state.lose = (file) => isGone && file === "iso.chpm";
  await show("?file=iso.chpm&pixels=32", async (page) => {
    const before = await state(page);
    isGone = true;
    await page.evaluate(() => { chpmView.orbit.distance *= 0.2; chpmView.orbit.onChange(); });
    await page.locator("#pixels").fill("-1");
    await page.waitForFunction(() => chpmView.status === "waiting");
    assert.match((await state(page)).message, /iso\.chpm cannot be reached.*tried again/s);
    assert.ok((await drawnPixels(page)) > 0.02);
    isGone = false;
    await page.waitForFunction(() => chpmView.status === "settled");
    const after = await state(page);
    assert.ok(after.message === "" && after.triangles > before.triangles, JSON.stringify([before, after]));
  });
  // Gone before the first byte.
  isGone = true;
  const { page } = await newPage(browser);
  await page.goto(`${host.url}/view.html?file=iso.chpm`);
  await page.waitForFunction(() => chpmView.status === "waiting");
  isGone = false;
  await page.waitForFunction(() => chpmView.status === "settled");
  await page.close();
  host.state.lose = () => false;
});

test("what a browser has of a file is not fetched again, and of an older file nothing is taken", { skip }, async () => {
  const context = await browser.newContext();
  const name = path.join(folder, "again.chpm");
  writeFileSync(name, readFileSync(path.join(folder, "iso.chpm")));
  const visit = async () => {
    const page = await context.newPage();
    host.state.requests.length = 0;
    await page.goto(`${host.url}/view.html?file=again.chpm`);
    await rest(page);
    const { status, triangles } = await state(page);
    await page.close();
    const asked = host.state.requests.filter(({ file }) => file === "again.chpm");
    return { status, triangles, requests: asked.length, bytes: asked.reduce((sum, { length }) => sum + length, 0) };
  };
  const first = await visit();
  // On a busy machine Chromium now and then keeps only some of what it was sent, and the rest the next time.
  let again = await visit();
  for (let tries = 0; tries < 3 && again.bytes > 0; tries++) again = await visit();
  assert.ok(first.requests > 3 && first.status === "settled", JSON.stringify(first));
  // Whether it is still the same file.
  assert.deepEqual(again, { ...first, requests: 1, bytes: 0 });
  writeFileSync(name, readFileSync(path.join(folder, "packed.chpm")));
  const other = await visit();
  assert.ok(other.status === "settled" && other.triangles === first.triangles && other.bytes > 0, JSON.stringify(other));
  await context.close();
});

test("a host without ranges is told, and so is a file that vanishes", { skip }, async () => {
  host.state.ranges = false;
  await show("?file=iso.chpm", async (page) => assert.match((await state(page)).message, /whole files only/));
  host.state.ranges = true;
  await show("?file=iso.chpm&pixels=32", async (page, said) => {
    host.state.gone.add("iso.chpm");
    // Nearer, so that something has to be fetched.
    await page.evaluate(() => { chpmView.orbit.distance *= 0.2; chpmView.orbit.onChange(); });
    await page.locator("#pixels").fill("-1");
    await page.waitForFunction(() => chpmView.status === "damaged");
    assert.match((await state(page)).message, /not there/);
    assert.ok((await drawnPixels(page)) > 0.02);
    assert.deepEqual(said.filter((text) => !text.includes("404")), []);
    host.state.gone.clear();
  });
});

test("without a model the page says what to do", { skip }, async () => {
  await show("", async (page, said) => {
    assert.match((await state(page)).message, /Open a \.chpm file/);
    await page.setInputFiles("#file", path.join(folder, "iso.chpm"));
    await page.waitForFunction(() => chpmView.status === "settled");
    assert.deepEqual(said, []);
  });
});
