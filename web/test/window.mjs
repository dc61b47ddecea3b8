// node window.mjs FILE.chpm
//
// Triangles that the page draws beside those of the window, at the same camera and one pixel of error: the page's own first view, then six that random numbers
// turn, from far away and from within. CHPM names the command, one with the window. A line for each: of the page, of the window, their ratio, and whether the
// page's picture is that with nothing left out.

import { execFileSync } from "node:child_process";
import { unlinkSync } from "node:fs";
import path from "node:path";
import { fileURLToPath } from "node:url";
import { launch, newPage, reason, rest } from "./browser.mjs";
import { serve } from "./server.mjs";
import { CHPM, random, temporary } from "./tools.mjs";

if (reason || !CHPM) {
  console.error(reason ?? "CHPM names no command");
  process.exit(3);
}
const file = path.resolve(process.argv[2]);
const host = await serve([fileURLToPath(new URL("..", import.meta.url)), path.dirname(file)]);
const browser = await launch();

async function open(query) {
  const { page } = await newPage(browser);
  await page.goto(`${host.url}/view.html?file=${encodeURIComponent(path.basename(file))}${query}`);
  await rest(page);
  await page.evaluate(() => (document.getElementById("panel").open = false));
  return page;
}

/** Looks from a camera, or from where the page does, and tells what is drawn. */
async function look(page, camera) {
  await page.evaluate((camera) => {
    const { orbit, model } = chpmView;
    document.getElementById("budget").value = document.getElementById("budget").max;
    if (camera) {
      const { turn, rise, away, aside } = camera;
      const target = model.center.map((x, axis) => x + aside[axis] * orbit.size);
      Object.assign(orbit, { framed: null, turn, rise, target, distance: away * orbit.size });
    }
    orbit.onChange();
  }, camera);
  await rest(page);
  const drawn = await page.evaluate(() => {
    const { orbit, model, drawn } = chpmView;
    const { clientWidth, clientHeight } = model.renderer.canvas;
    return { camera: [...orbit.eye(), ...orbit.target, orbit.fov].join(), up: orbit.up, viewport: `${clientWidth}x${clientHeight}`, triangles: drawn.triangles };
  });
  return { ...drawn, picture: await page.locator("#canvas").screenshot() };
}

const [culled, whole] = [await open(""), await open("&occlusion=off")];
const next = random(11);
const still = path.join(temporary(), "still.png");
for (const away of [null, 1.6, 1.2, 0.8, 0.5, 0.3, 2.5]) {
  const camera = away && { turn: 6 * next(), rise: 3 * next() - 1.5, away, aside: [0, 0, 0].map(() => 0.2 * (2 * next() - 1)) };
  const [ours, all] = [await look(culled, camera), await look(whole, camera)];
  const words = ["render", file, "--camera", ours.camera, "--up", ours.up, "--viewport", ours.viewport, "--json", "-o", still];
  const { triangles } = JSON.parse(execFileSync(CHPM, words, { stdio: ["ignore", "pipe", "ignore"] })).frame;
  unlinkSync(still);
  console.log(ours.triangles, triangles, (ours.triangles / triangles).toFixed(3), ours.picture.equals(all.picture));
}
await browser.close();
host.close();
