// The page's worker: pages of a model come from it where a browser allows one, and look the same without.

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
const file = path.join(folder, "model.chpm");
let [browser, host] = [];

before(async () => {
  if (skip) return;
  chpm("synth", "isosurface", "--triangles", "60000", "-o", path.join(folder, "iso.ply"), "-f", "-q");
  chpm("build", path.join(folder, "iso.ply"), "-o", file, "-f", "-q", "--pages", "packed", "--cluster-triangles", "1024");
  chpm("share", file, "-o", path.join(folder, "site"), "-q");
  const bytes = readFileSync(file);
  const opened = await open(memorySource(bytes));
  await opened.needTables();
  for (let id = 0; id < opened.header.clusterCount; id++) if (opened.cluster(id).level === 0) bytes[opened.cluster(id).pageOffset + 60] ^= 1;
  writeFileSync(path.join(folder, "damaged.chpm"), bytes);
  browser = await launch();
  host = await serve([fileURLToPath(new URL("..", import.meta.url)), folder]);
});

after(async () => {
  await browser?.close();
  host?.close();
});

/** Opens a page that may have no workers, and tells what it came to. */
async function shown(address, policy) {
  const { page, said } = await newPage(browser);
  if (policy) {
    await page.route(({ pathname }) => pathname.endsWith(".html"), async (route) => {
      const response = await route.fetch();
      await route.fulfill({ response, headers: { ...response.headers(), "Content-Security-Policy": policy } });
    });
  }
  // Nothing but roots is asked for before the worker is there: which way pages come is not left to chance.
  await page.route(({ pathname }) => pathname.endsWith(".chpm"), async (route) => {
    const isDrawn = await page.evaluate(() => Boolean(globalThis.chpmView?.drawn));
    if (!policy && isDrawn) await page.waitForFunction(() => chpmView.model.decoder.isReady);
    await route.continue();
  });
  await page.goto(`${host.url}/${address}`);
  await rest(page);
  await page.waitForFunction(() => chpmView.drawn.settled);
  const told = await page.evaluate(() => ({ status: chpmView.status, message: chpmView.message, triangles: chpmView.drawn.triangles, cut: chpmView.drawn.cut.map(({ cluster, bound }) => `${cluster} ${bound}`).sort() }));
  const come = await page.evaluate(() => chpmView.model.decoder?.come ?? 0);
  const workers = page.workers().length;
  const picture = await page.locator("#canvas").screenshot();
  await page.unrouteAll({ behavior: "ignoreErrors" });
  await page.close();
  return { ...told, picture, workers, come, said: said.filter((text) => !/Content Security Policy|Content-Security-Policy/.test(text)) };
}

for (const address of ["site/index.html", "view.html?file=model.chpm"]) {
  test(`pages come from a worker, and are the same without, ${address}`, { skip }, async () => {
    const withOne = await shown(address);
    const without = await shown(address, "worker-src 'none'");
    assert.ok(withOne.workers === 1 && withOne.come > 0, `${withOne.workers} ${withOne.come}`);
    assert.equal(without.come, 0);
    assert.ok(withOne.picture.equals(without.picture));
    for (const { status, triangles, cut, said } of [withOne, without]) {
      assert.deepEqual([status, triangles, cut, said], ["settled", withOne.triangles, withOne.cut, []]);
    }
  });
}

test("damaged pages are told as without a worker", { skip }, async () => {
  const both = [await shown("view.html?file=damaged.chpm"), await shown("view.html?file=damaged.chpm", "worker-src 'none'")];
  for (const { status, message, triangles, cut } of both) {
    assert.equal(status, "damaged");
    assert.match(message, /cluster \d+ is damaged.*The rest/s);
    assert.deepEqual([triangles, cut], [both[0].triangles, both[0].cut]);
  }
});
