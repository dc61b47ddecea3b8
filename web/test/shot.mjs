import { chromium } from "playwright-core";
import { serve } from "./server.mjs";
import path from "node:path";
const [file, out, ...query] = process.argv.slice(2);
const host = await serve([path.resolve("."), path.dirname(path.resolve(file))]);
const browser = await chromium.launch({ executablePath: "/usr/bin/chromium", args: ["--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"] });
const page = await browser.newPage({ viewport: { width: 1000, height: 700 } });
page.on("console", (m) => console.log("console", m.type(), m.text()));
page.on("pageerror", (e) => console.log("pageerror", e.stack));
await page.goto(`${host.url}/view.html?file=${path.basename(file)}&${query[0] ?? ""}`);
await page.waitForFunction(() => ["settled", "failed", "damaged"].includes(document.documentElement.dataset.status), null, { timeout: 240000 });
console.log(await page.evaluate(() => ({ status: chpmView.status, message: chpmView.message, drawn: chpmView.drawn && { t: chpmView.drawn.triangles, c: chpmView.drawn.clusters, e: chpmView.drawn.error, traffic: chpmView.model.source.statistics } })));
if (query[1]) { await page.selectOption("#colors", query[1]); await page.waitForTimeout(1500); }
await page.screenshot({ path: out });
await browser.close(); host.close();
