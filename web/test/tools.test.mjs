// What can be done with a model on the page.

import assert from "node:assert/strict";
import { writeFileSync } from "node:fs";
import path from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { launch, newPage, reason, rest } from "./browser.mjs";
import { serve } from "./server.mjs";
import { CHPM, chpm, temporary } from "./tools.mjs";

const skip = reason ?? (CHPM ? false : "CHPM names no command");
const folder = temporary();
const web = fileURLToPath(new URL("..", import.meta.url));
let [browser, host] = [];

/** A plate of 4 by 2 that lies at z = 1, of small triangles, with a number for each vertex, and one triangle alone. */
function plate() {
  const rows = [];
  const faces = [];
  for (let y = 0; y <= 20; y++) for (let x = 0; x <= 40; x++) rows.push(`${500000 + x / 10} ${5400000 + y / 10} 1 ${x}`);
  for (let y = 0; y < 20; y++) for (let x = 0; x < 40; x++) {
    const at = 41 * y + x;
    faces.push(`3 ${at} ${at + 1} ${at + 42}`, `3 ${at} ${at + 42} ${at + 41}`);
  }
  const vertex = ["x", "y", "z"].map((name) => `property double ${name}`).join("\n") + "\nproperty float quality";
  return `ply\nformat ascii 1.0\nelement vertex ${rows.length}\n${vertex}\nelement face ${faces.length}\nproperty list uchar int vertex_indices\nend_header\n${rows.join("\n")}\n${faces.join("\n")}\n`;
}

before(async () => {
  if (skip) return;
  writeFileSync(path.join(folder, "plate.ply"), plate());
  chpm("build", path.join(folder, "plate.ply"), "-o", path.join(folder, "plate.chpm"), "-q", "--keep", "quality");
  writeFileSync(path.join(folder, "one.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  chpm("build", path.join(folder, "one.obj"), "-o", path.join(folder, "one \u00e4 #%.chpm"), "-q");
  browser = await launch();
  host = await serve([web, folder]);
});

after(async () => {
  await browser?.close();
  host?.close();
});

async function show(name, use, size = [900, 600]) {
  const { page, said } = await newPage(browser);
  await page.setViewportSize({ width: size[0], height: size[1] });
  await page.goto(`${host.url}/view.html?file=${encodeURIComponent(name)}&up=z`);
  await rest(page);
  await use(page);
  assert.deepEqual(said, []);
  await page.close();
}

/** Where a point of the file, relative to its middle, is on the canvas. */
const seenAt = (page, offset) => page.evaluate((offset) => chpmView.orbit.project(chpmView.model.center.map((x, axis) => x + offset[axis])).slice(0, 2), offset);

test("a distance is measured between two points, far from zero", { skip }, async () => {
  await show("plate.chpm", async (page) => {
    await page.keyboard.press("m");
    for (const x of [-1, 1.5]) await page.mouse.click(...(await seenAt(page, [x, 0.25, 0])));
    await rest(page);
    const [a, b] = await page.evaluate(() => chpmView.marks.map(({ point, error }) => ({ point, error })));
    const away = Math.hypot(...a.point.map((x, axis) => x - b.point[axis]));
    // A pixel is some 6 thousandths.
    assert.ok(Math.abs(away - 2.5) < 0.02 && Math.abs(a.point[2] - b.point[2]) < 1e-6, `${away}`);
    const text = await page.locator("#measured").innerText();
    assert.match(text, /^2\.\d+ units, within .*the ends within/);
    assert.ok(Math.abs(parseFloat(text) - away) < 1e-3, text);
    await page.keyboard.press("Escape");
    assert.equal(await page.locator("#measured").innerText(), "");
    // Beside the model is nothing.
    await page.keyboard.press("m");
    await page.mouse.click(890, 590);
    assert.equal(await page.evaluate(() => chpmView.marks.length), 0);
  });
});

test("a cut leaves half, numbers are colours with a legend, the bar has its length", { skip }, async () => {
  await show("plate.chpm", async (page) => {
    const count = () => page.evaluate(() => {
      const { canvas } = chpmView.model.renderer;
      chpmView.orbit.onChange();
      return new Promise((done) => requestAnimationFrame(() => {
        const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d");
        copy.drawImage(canvas, 0, 0);
        const { data } = copy.getImageData(0, 0, canvas.width, canvas.height);
        let [all, yellow] = [0, 0];
        for (let i = 0; i < data.length; i += 4) {
          all += data[i + 3] > 0;
          yellow += data[i + 3] > 0 && data[i] > 1.6 * data[i + 2];
        }
        done([all, yellow]);
      }));
    });
    const [whole] = await count();
    await page.selectOption("#clip", "0");
    await rest(page);
    const [half] = await count();
    await page.locator("#clip-flip").check();
    await rest(page);
    const [other] = await count();
    assert.ok(Math.abs(half + other - whole) < 0.03 * whole && half > 0.3 * whole && other > 0.3 * whole, `${half} and ${other} of ${whole}`);
    await page.selectOption("#clip", "");
    await page.selectOption("#colors", "scalar quality");
    await rest(page);
    const [, yellow] = await count();
    assert.ok(yellow > 0.1 * whole && yellow < 0.6 * whole, `${yellow} of ${whole}`);
    assert.deepEqual(await page.locator("#legend-least, #legend-most").allInnerTexts(), ["0", "40"]);
    const bar = await page.evaluate(() => [parseFloat(document.getElementById("bar-told").textContent), document.getElementById("bar").clientWidth]);
    const [left, right] = [await seenAt(page, [-0.5, 0, 0]), await seenAt(page, [0.5, 0, 0])];
    const unit = Math.hypot(left[0] - right[0], left[1] - right[1]);
    // The plate lies aslant, and so is a little shorter.
    assert.ok(bar[1] > 30 && bar[1] / bar[0] < 1.3 * unit && bar[1] / bar[0] > 0.9 * unit, `${bar} ${unit}`);
  });
});

test("a narrow screen shows the model, and all is reached by keys", { skip }, async () => {
  await show("one \u00e4 #%.chpm", async (page) => {
    assert.equal(await page.evaluate(() => document.getElementById("panel").open), false);
    const boxes = await page.locator("#tools button").evaluateAll((buttons) => buttons.map((button) => [button.clientWidth, button.clientHeight, button.getAttribute("aria-label")]));
    assert.ok(boxes.every(([width, height, label]) => width >= 44 && height >= 44 && label), JSON.stringify(boxes));
    const reached = new Set();
    for (let i = 0; i < 8; i++) {
      await page.keyboard.press("Tab");
      reached.add(await page.evaluate(() => document.activeElement.id));
    }
    for (const id of ["canvas", "title", "home", "measure", "turn", "full"]) assert.ok(reached.has(id) || (id === "title" && reached.has("")), [...reached].join());
    const before = await page.evaluate(() => chpmView.orbit.turn);
    await page.locator("#canvas").focus();
    await page.keyboard.press("ArrowLeft");
    await page.keyboard.press("t");
    await page.waitForTimeout(300);
    await page.keyboard.press("t");
    assert.notEqual(await page.evaluate(() => chpmView.orbit.turn), before);
    assert.equal(await page.locator("#turn").getAttribute("aria-pressed"), "false");
    // A button's words are its name; a sign is none.
    const unnamed = await page.evaluate(() => [...document.querySelectorAll("button, input, select")].filter((part) => !(part.getAttribute("aria-label") || part.closest("label")?.textContent.trim() || /\p{L}{2}/u.test(part.textContent))).map(({ id }) => id));
    assert.deepEqual(unnamed, []);
  }, [390, 844]);
});

test("a window of no size, and a lost context, are survived", { skip }, async () => {
  await show("plate.chpm", async (page) => {
    const before = await page.evaluate(() => [chpmView.drawn.triangles, chpmView.orbit.turn]);
    await page.evaluate(() => (document.getElementById("canvas").style.height = "0px"));
    await page.waitForTimeout(100);
    await page.evaluate(() => (document.getElementById("canvas").style.height = ""));
    await rest(page);
    await page.evaluate(() => {
      globalThis.lose = chpmView.model.renderer.gl.getExtension("WEBGL_lose_context");
      lose.loseContext();
    });
    await page.waitForFunction(() => chpmView.status === "waiting");
    await page.evaluate(() => lose.restoreContext());
    await page.waitForFunction(() => chpmView.status === "settled");
    assert.deepEqual(await page.evaluate(() => [chpmView.drawn.triangles, chpmView.orbit.turn]), before);
  });
});
