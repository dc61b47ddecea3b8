// node link.mjs SITE [WIDTHxHEIGHT [MEGABITS [MILLISECONDS]]]
//
// Opens a folder that `chpm share` wrote over a slow link, as Chromium emulates it, and writes as a line of JSON when there was a first picture, when 100,000
// triangles and when all (seconds since the address was asked for), and the requests and bytes by then, and the processor time of the page's thread, which
// a busy machine does not lengthen as it does the others; and the longest task of that thread (seconds, none below 0.05), and how long all above that were.

import path from "node:path";
import { launch, reason } from "./browser.mjs";
import { serve } from "./server.mjs";

if (reason) {
  console.error(reason);
  process.exit(3);
}
const [site, size = "900x600", megabits = "10", latency = "100"] = process.argv.slice(2);
const [width, height] = size.split("x").map(Number);
const host = await serve([path.resolve(site)]);
const browser = await launch();
const page = await browser.newPage({ viewport: { width, height } });
const session = await page.context().newCDPSession(page);
await session.send("Performance.enable", { timeDomain: "threadTicks" });
const busy = async () => (await session.send("Performance.getMetrics")).metrics.find(({ name }) => name === "TaskDuration").value;
const throughput = (Number(megabits) * 1e6) / 8;
await session.send("Network.enable");
await session.send("Network.emulateNetworkConditions", { offline: false, latency: Number(latency), downloadThroughput: throughput, uploadThroughput: throughput });
const sent = { requests: 0, bytes: 0 };
session.on("Network.requestWillBeSent", ({ request }) => (sent.requests += request.url.startsWith("http") ? 1 : 0));
session.on("Network.dataReceived", ({ dataLength }) => (sent.bytes += dataLength));
await page.addInitScript(() => {
  globalThis.marks = {};
  const mark = (name, is) => is && (marks[name] ??= performance.now() / 1000);
  const look = () => {
    const view = globalThis.chpmView;
    mark("first", view?.drawn);
    mark("fine", view?.drawn?.triangles >= 1e5);
    mark("settled", view?.status === "settled");
    requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
  const tasks = (list) => {
    for (const { duration } of list.getEntries()) {
      marks.longest = Math.max(marks.longest ?? 0, duration / 1000);
      marks.long = (marks.long ?? 0) + duration / 1000;
    }
  };
  new PerformanceObserver(tasks).observe({ type: "longtask", buffered: true });
});
await page.goto(`${host.url}/index.html`, { waitUntil: "commit" });
const told = {};
for (const name of ["first", "settled"]) {
  await page.waitForFunction((name) => marks[name], name, { timeout: 200000, polling: 50 });
  told[name] = { ...sent, busy: await busy() };
}
const { marks, drawn } = await page.evaluate(() => ({ marks, drawn: { triangles: chpmView.drawn.triangles, clusters: chpmView.drawn.clusters } }));
console.log(JSON.stringify({ ...marks, by: told, ...drawn }));
await browser.close();
host.close();
