// One site in two tabs, and in one that nobody looks at.

import assert from "node:assert/strict";
import path from "node:path";
import { after, before, test } from "node:test";
import { launch, reason, rest } from "./browser.mjs";
import { serve } from "./server.mjs";
import { CHPM, chpm, temporary } from "./tools.mjs";

const skip = reason ?? (CHPM ? false : "CHPM names no command");
const folder = temporary();
let [browser, host, context] = [];

before(async () => {
  if (skip) return;
  chpm("synth", "isosurface", "--triangles", "60000", "-o", path.join(folder, "iso.ply"), "-f", "-q");
  chpm("build", path.join(folder, "iso.ply"), "-o", path.join(folder, "model.chpm"), "-f", "-q", "--pages", "packed", "--cluster-triangles", "1024");
  chpm("share", path.join(folder, "model.chpm"), "-o", path.join(folder, "site"), "-q");
  browser = await launch();
  context = await browser.newContext({ viewport: { width: 900, height: 600 } });
  host = await serve([path.join(folder, "site")]);
});

after(async () => {
  await browser?.close();
  host?.close();
});

async function tab() {
  const page = await context.newPage();
  page.setDefaultTimeout(120000);
  const said = [];
  page.on("pageerror", (error) => said.push(error.stack));
  await page.addInitScript(() => {
    // A browser without a screen never hides a page: this is what one with a screen tells.
    globalThis.hide = (is) => {
      Object.defineProperty(document, "hidden", { value: is, configurable: true });
      document.dispatchEvent(new Event("visibilitychange"));
    };
  });
  return { page, said, go: () => page.goto(`${host.url}/index.html`) };
}

const told = (page) => page.evaluate(() => ({ status: chpmView.status, triangles: chpmView.drawn.triangles, cut: chpmView.drawn.cut.map(({ cluster, bound }) => `${cluster} ${bound}`).sort() }));

test("two tabs of one site settle, and show the same", { skip }, async () => {
  const both = await Promise.all([tab(), tab()]);
  await Promise.all(both.map(({ go }) => go()));
  await Promise.all(both.map(({ page }) => rest(page)));
  const [one, other] = await Promise.all(both.map(({ page }) => told(page)));
  assert.ok(one.status === "settled" && one.triangles > 1000, JSON.stringify(one));
  assert.deepEqual(one, other);
  const pictures = [];
  for (const { page } of both) {
    await page.bringToFront();
    pictures.push(await page.locator("#canvas").screenshot());
  }
  assert.ok(pictures[0].equals(pictures[1]));
  for (const { page, said } of both) {
    assert.deepEqual(said, []);
    await page.close();
  }
});

test("a tab that is hidden draws nothing and asks for nothing more, and goes on when it is shown", { skip }, async () => {
  const { page, said, go } = await tab();
  // What comes behind the first picture waits.
  let [ranges, held] = [0, []];
  await page.route("**/*.chpm", (route) => (held && ++ranges > 2 ? held.push(route) : route.continue()));
  await go();
  await page.waitForFunction(() => globalThis.chpmView?.drawn);
  await page.evaluate(() => hide(true));
  // A frame that was asked for before may still come.
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  await page.evaluate(() => (globalThis.before = chpmView.drawn));
  const waiting = held;
  held = null;
  await Promise.all(waiting.map((route) => route.continue()));
  await page.waitForFunction(() => chpmView.model.requests === 0 && chpmView.model.regions);
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  assert.ok(await page.evaluate(() => before === chpmView.drawn && chpmView.model.requests === 0 && chpmView.status === "loading"));
  await page.evaluate(() => hide(false));
  await page.waitForFunction(() => chpmView.status === "settled");
  const { triangles } = await told(page);
  assert.ok(triangles > (await page.evaluate(() => before.triangles)), `${triangles}`);
  assert.deepEqual(said, []);
  await page.close();
});
