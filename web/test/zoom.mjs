import { launch, newPage, rest } from "./browser.mjs";
import { serve } from "./server.mjs";
import path from "node:path";
const web = path.resolve(new URL("..", import.meta.url).pathname);
const file = path.resolve(process.argv[2]);
const host = await serve([web, path.dirname(file)]);
const browser = await launch();
for (const culled of [false, true]) {
  const { page, said } = await newPage(browser);
  await page.setViewportSize({ width: 1920, height: 1080 });
  host.state.requests.length = 0;
  await page.goto(`${host.url}/view.html?file=${path.basename(file)}&up=z`);
  await page.evaluate((culled) => { document.getElementById("panel").open = false; document.getElementById("budget").value = 7.5; if (!culled) chpmView.orbit.planes = () => []; }, culled);
  await rest(page);
  for (let k = 0; k < 7; k++) {
    const told = await page.evaluate((k) => {
      const { orbit, model } = chpmView;
      if (k === 0) {
        const eye = orbit.eye();
        let best = null;
        for (const { cluster } of chpmView.drawn.cut) {
          const { center } = model.file.cluster(cluster).sphere;
          const d = Math.hypot(...center.map((x, i) => x - eye[i]));
          if (!best || d < best[0]) best = [d, center];
        }
        orbit.framed = null;
        orbit.target = best[1];
      }
      orbit.distance = orbit.size * 2 * 0.5 ** k;
      orbit.onChange();
      return { eye: orbit.eye(), target: orbit.target };
    }, k);
    await new Promise((r) => setTimeout(r, 100));
    await rest(page);
    const drawn = await page.evaluate(() => ({ t: chpmView.drawn.triangles, c: chpmView.drawn.clusters, r: chpmView.drawn.relaxed, f: chpmView.model.source.statistics.bytes }));
    const bytes = host.state.requests.reduce((sum, { length }) => sum + length, 0);
    console.log(culled, k, drawn.t, drawn.c, drawn.r, (bytes / 2 ** 20).toFixed(1), host.state.requests.length, told.eye.map((x) => x.toFixed(3)).join(","), told.target.map((x) => x.toFixed(3)).join(","));
  }
  console.log(said);
}
await browser.close(); host.close();
