// node zoom.mjs FILE.chpm X,Y,Z
//
// Nears a point in steps, each in a page of its own that goes there at once, without culling and with it: triangles drawn, MiB of the model
// fetched, requests, and the eye.

import path from "node:path";
import { fileURLToPath } from "node:url";
import { launch, newPage, rest } from "./browser.mjs";
import { serve } from "./server.mjs";

const file = path.resolve(process.argv[2]);
const target = process.argv[3].split(",").map(Number);
const host = await serve([fileURLToPath(new URL("..", import.meta.url)), path.dirname(file)]);
const browser = await launch();
for (const step of [0, 2, 4, 6]) {
  for (const isCulled of [false, true]) {
    const { page } = await newPage(browser);
    await page.setViewportSize({ width: 1920, height: 1080 });
    host.state.requests.length = 0;
    await page.goto(`${host.url}/view.html?file=${encodeURIComponent(path.basename(file))}&up=z`);
    await page.waitForFunction(() => chpmView.model?.isReady);
    const eye = await page.evaluate(({ target, isCulled, step }) => {
      const { orbit } = chpmView;
      document.getElementById("panel").open = false;
      document.getElementById("budget").value = 7.5;
      if (!isCulled) orbit.planes = () => [];
      Object.assign(orbit, { framed: null, target, distance: 2 * orbit.size * 0.5 ** step });
      orbit.onChange();
      return orbit.eye();
    }, { target, isCulled, step });
    await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
    await rest(page);
    const triangles = await page.evaluate(() => chpmView.drawn.triangles);
    const bytes = host.state.requests.reduce((sum, { length }) => sum + length, 0);
    console.log([step, isCulled ? "culled" : "whole", triangles, (bytes / 2 ** 20).toFixed(1), host.state.requests.length, eye].join(" "));
    await page.close();
  }
}
await browser.close();
host.close();
