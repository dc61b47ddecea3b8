// The outline of what the page's clipping plane cuts: drawn, told, and saved as a drawing.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import path from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { launch, newPage, reason, rest } from "./browser.mjs";
import { serve } from "./server.mjs";
import { CHPM, chpm, temporary } from "./tools.mjs";

const skip = reason ?? (CHPM ? false : "CHPM names no command");
const folder = temporary();
let [browser, host, torus] = [];

before(async () => {
  if (skip) return;
  chpm("synth", "torus", "--triangles", "40000", "-o", path.join(folder, "torus.ply"), "-f", "-q");
  torus = path.join(folder, "torus.chpm");
  chpm("build", path.join(folder, "torus.ply"), "-o", torus, "-f", "-q", "--cluster-triangles", "1024");
  browser = await launch();
  host = await serve([fileURLToPath(new URL("..", import.meta.url)), folder]);
});

after(async () => {
  await browser?.close();
  host?.close();
});

/** The page with a model that is cut across z, at rest. */
async function cut(query, use, size = { width: 900, height: 600 }) {
  const { page, said } = await newPage(browser);
  try {
    await page.setViewportSize(size);
    await page.goto(`${host.url}/view.html?file=torus.chpm${query}`);
    await rest(page);
    await page.evaluate(() => (document.getElementById("panel").open = true));
    assert.equal(await page.locator("#cut").isVisible(), false);
    await page.selectOption("#clip", "2");
    await settled(page);
    await use(page);
    assert.deepEqual(said, []);
  } finally {
    await page.close();
  }
}

const settled = (page) => page.waitForFunction(() => chpmView.outline && chpmView.status === "settled");

/** How much of a pixel the outline covers, at a point of the model, from 0 to 255. */
const alphaAt = (page, point) =>
  page.evaluate((point) => {
    const canvas = document.getElementById("cut");
    const ratio = canvas.width / canvas.clientWidth;
    const [x, y] = chpmView.orbit.project(point).map((x) => Math.round(x * ratio));
    const copy = new OffscreenCanvas(1, 1).getContext("2d");
    copy.drawImage(canvas, -x, -y);
    return copy.getImageData(0, 0, 1, 1).data[3];
  }, point);

/** Looks from above or below, where z is up. */
const look = async (page, rise) => {
  await page.evaluate((rise) => {
    Object.assign(chpmView.orbit, { rise });
    chpmView.orbit.onChange();
  }, rise);
  await settled(page);
};

test("a cut is filled where it is closed, and told as the command tells it", { skip }, async () => {
  const told = JSON.parse(chpm("section", torus, "--plane", "0,0,1:0", "--json", "-q")).sections[0];
  await cut("&up=z&pixels=0.5", async (page) => {
    await look(page, 0.8);
    const { length, area, closed, openEnds, error, plane } = await page.evaluate(() => chpmView.outline);
    assert.ok(Math.abs(length / told.length - 1) < 0.01 && Math.abs(area / told.area - 1) < 0.01, JSON.stringify([length, area, told]));
    assert.deepEqual([closed, openEnds], [2, 0]);
    assert.deepEqual(plane, [[0, 0, 1], 0]);
    const words = await page.locator("#clip-more").innerText();
    const shown = (x, roundingMode = "halfExpand") => new Intl.NumberFormat("en", { maximumSignificantDigits: 4, roundingMode }).format(x);
    for (const part of [`${shown(length)} units`, `${shown(area)} square units`, "2, all closed", `within ${shown(error, "ceil")} units of the source`, "Nothing bounds"]) {
      assert.ok(words.includes(part), `${part} in ${words}`);
    }
    // Between the two circles, in the hole, and outside.
    const places = [[1, 0, 0], [0, 1, 0], [0, 0, 0], [1.7, 0, 0]];
    const covered = async () => Promise.all(places.map((place) => alphaAt(page, place)));
    const before = await covered();
    assert.ok(before[0] > 150 && before[1] > 150 && before[2] === 0 && before[3] === 0, `${before}`);
    // From where the model is before it, nothing is filled.
    await look(page, -0.8);
    assert.deepEqual(await covered(), [0, 0, 0, 0]);
    await page.check("#clip-flip");
    await page.waitForFunction(() => chpmView.outline?.plane[0][2] === -1);
    await settled(page);
    const after = await covered();
    assert.ok(after[0] > 150 && after[2] === 0, `${after}`);
    assert.ok(Math.abs((await page.evaluate(() => chpmView.outline.area)) / area - 1) < 0.01);
  });
});

test("the outline follows the plane and the camera, and goes with the plane", { skip }, async () => {
  await cut("&up=z", async (page) => {
    await look(page, 0.8);
    await page.locator("#clip-at").fill("0.75");
    assert.equal(await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(chpmView.outline?.plane[1] === 0))))), false);
    await settled(page);
    const { area, plane } = await page.evaluate(() => chpmView.outline);
    assert.ok(plane[1] > 0.1 && area > 1, JSON.stringify([area, plane]));
    const first = await page.evaluate(() => JSON.stringify(chpmView.outline));
    // What has not changed is not cut again.
    await page.evaluate(() => { globalThis.known = chpmView.outline; chpmView.orbit.onChange(); });
    await settled(page);
    assert.ok(await page.evaluate(() => known === chpmView.outline), first.slice(0, 80));
    // Near enough that it is behind the eye in part.
    await page.evaluate(() => { Object.assign(chpmView.orbit, { framed: null, target: [1, 0, 0.2], distance: 0.4, rise: 0.5 }); chpmView.orbit.onChange(); });
    await settled(page);
    assert.ok((await alphaAt(page, [1, 0, 0.2])) > 150);
    await page.selectOption("#clip", "");
    await page.waitForFunction(() => !chpmView.outline);
    await page.waitForFunction(() => document.getElementById("cut").hidden);
    assert.equal(await page.locator("#save").isDisabled(), true);
  });
});

for (const [width, height] of [[900, 600], [390, 844]]) {
  test(`the outline is saved to scale, ${width} by ${height}`, { skip }, async () => {
    await cut("&pixels=0.5", async (page) => {
      const button = page.getByRole("button", { name: "Save outline as SVG" });
      await button.scrollIntoViewIfNeeded();
      const box = await button.boundingBox();
      assert.ok(box.x >= 0 && box.x + box.width <= width && box.y + box.height <= height, JSON.stringify(box));
      assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth && document.getElementById("panel").scrollWidth <= document.getElementById("panel").clientWidth));
      const [download] = await Promise.all([page.waitForEvent("download"), button.click()]);
      assert.equal(download.suggestedFilename(), "torus,_0,0,1_0.svg");
      const text = readFileSync(await download.path(), "utf8");
      const drawn = await page.evaluate((text) => {
        const { documentElement: root } = new DOMParser().parseFromString(text, "image/svg+xml");
        const d = root.querySelector("path")?.getAttribute("d") ?? "";
        const rings = d.split("M").filter(Boolean).map((ring) => ring.replace("Z", "").split("L").map((point) => point.split(" ").map(Number)));
        const areaOf = (ring) => Math.abs(ring.reduce((sum, [x, y], i) => sum + x * ring[(i + 1) % ring.length][1] - ring[(i + 1) % ring.length][0] * y, 0)) / 2;
        return { name: root.nodeName, words: root.textContent, areas: rings.map(areaOf).sort((a, b) => b - a) };
      }, text);
      const { area, error } = await page.evaluate(() => chpmView.outline);
      assert.equal(drawn.name, "svg");
      assert.ok(error === 0 || /coarse mesh, points within [\d.e-]+ of the source/.test(drawn.words), drawn.words);
      const scale = Number(/1 unit = ([\d.]+) mm/.exec(drawn.words)[1]);
      assert.equal(drawn.areas.length, 2);
      const paper = (drawn.areas[0] - drawn.areas[1]) / scale ** 2;
      assert.ok(Math.abs(paper / area - 1) < 1e-3, `${paper} ${area}`);
    }, { width, height });
  });
}
