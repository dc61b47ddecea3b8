// node cameras.mjs FILE.chpm
//
// Shows a file in the page, what is hidden too, from twenty cameras, and writes for each, as a line of JSON, what the view was and what of the file was drawn. Ends with
// 3, and says why, where there is no browser or no driver for it.

import path from "node:path";
import { fileURLToPath } from "node:url";
import { launch, newPage, reason, rest } from "./browser.mjs";
import { serve } from "./server.mjs";
import { random } from "./tools.mjs";

if (reason) {
  console.error(reason);
  process.exit(3);
}
const file = path.resolve(process.argv[2]);
const host = await serve([fileURLToPath(new URL("..", import.meta.url)), path.dirname(file)]);
const browser = await launch();
const { page } = await newPage(browser);
await page.goto(`${host.url}/view.html?file=${encodeURIComponent(path.basename(file))}&occlusion=off`);
await rest(page);
const next = random(11);
// What it covers is not in the image.
await page.evaluate(() => (document.getElementById("panel").open = false));
for (let i = 0; i < 20; i++) {
  const camera = { turn: 6 * next(), rise: 3 * next() - 1.5, away: 0.2 + 40 * next() ** 4, pixels: String(7 * next() - 2), aside: [0, 0, 0].map(() => 2 * next() - 1) };
  await page.evaluate(({ turn, rise, away, pixels, aside }) => {
    const { orbit, model } = chpmView;
    const target = model.center.map((x, axis) => x + aside[axis] * orbit.size);
    Object.assign(orbit, { framed: null, turn, rise, target, distance: away * orbit.size });
    document.getElementById("pixels").value = pixels;
    document.getElementById("budget").value = document.getElementById("budget").max;
    orbit.onChange();
  }, camera);
  await rest(page);
  const drawn = await page.evaluate(() => {
    const { orbit, model, drawn, status, message } = chpmView;
    return {
      status,
      message,
      eye: orbit.eye(),
      target: orbit.target,
      up: orbit.axes()[1],
      near: orbit.range()[0],
      fov: orbit.fov,
      width: model.renderer.canvas.clientWidth,
      height: model.renderer.canvas.clientHeight,
      pixels: 2 ** Number(document.getElementById("pixels").value) * drawn.relaxed,
      clusters: drawn.clusters,
      triangles: drawn.triangles,
      // What JSON has no number for is that of a base mesh.
      cut: drawn.cut.map(({ cluster, bound }) => [cluster, bound === Infinity ? null : bound]),
    };
  });
  console.log(JSON.stringify(drawn));
}
await browser.close();
host.close();
