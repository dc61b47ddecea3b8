// What `chpm share` writes: a page of one file, on hosts of all kinds.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { mkdirSync, writeFileSync } from "node:fs";
import path from "node:path";
import { after, before, test } from "node:test";
import { pathToFileURL } from "node:url";
import { launch, newPage, reason, rest } from "./browser.mjs";
import { serve } from "./server.mjs";
import { CHPM, chpm, temporary } from "./tools.mjs";

const skip = reason ?? (CHPM ? false : "CHPM names no command");
const folder = temporary();
/** A folder in a folder, with whatever names may have. */
const odd = path.join(folder, "B\u00fcsten & K\u00f6pfe #1", "100%25 fertig");
let [browser, host] = [];

before(async () => {
  if (skip) return;
  mkdirSync(odd, { recursive: true });
  const source = path.join(folder, "in.ply");
  writeFileSync(path.join(folder, "notes"), JSON.stringify([{ at: [0.3, 0.3, 0.3], title: "A <b>note</b>", text: "What it says" }]));
  chpm("synth", "isosurface", "--triangles", "60000", "-o", source, "-f", "-q");
  chpm("share", source, "-o", path.join(odd, "site"), "-q", "--title", "K\u00f6pfe \u201c1\u201d", "--credit", "a museum", "--background", "203040", "--notes", path.join(folder, "notes"));
  chpm("share", path.join(odd, "site", "model.chpm"), "-o", path.join(folder, "split"), "-q", "--split");
  browser = await launch();
  host = await serve([folder]);
});

after(async () => {
  await browser?.close();
  host?.close();
});

const address = (...parts) => `${host.url}/${parts.flatMap((part) => part.split("/")).map(encodeURIComponent).join("/")}`;
const told = (page) => page.evaluate(() => ({ status: chpmView.status, message: chpmView.message, triangles: chpmView.drawn?.triangles }));

test("the first picture takes three requests, and the page is shown as was said", { skip }, async () => {
  const { page, said } = await newPage(browser);
  const asked = [];
  page.on("request", (request) => request.url().startsWith("http") && asked.push(request.headers().range ?? request.url()));
  // What comes after the page, the head and the roots waits for the first picture.
  let [ranges, held] = [0, []];
  await page.route("**/*", (route) => (held && route.request().headers().range && ++ranges > 2 ? held.push(route) : route.continue()));
  await page.goto(address(path.relative(folder, odd), "site", "index.html"));
  await page.waitForFunction(() => globalThis.chpmView?.drawn);
  const waiting = held;
  held = null;
  await Promise.all(waiting.map((route) => route.continue()));
  await rest(page);
  assert.equal((await told(page)).status, "settled");
  assert.ok(asked[0].endsWith("index.html") && asked[1] === "bytes=0-32767", JSON.stringify(asked.slice(0, 4)));
  assert.equal(await page.title(), "K\u00f6pfe \u201c1\u201d");
  assert.equal(await page.locator("#credit").innerText(), "a museum");
  assert.equal(await page.evaluate(() => getComputedStyle(document.body).backgroundColor), "rgb(32, 48, 64)");
  await page.locator(".note").click();
  assert.deepEqual(await page.locator("#note h2, #note p").allInnerTexts(), ["A <b>note</b>", "What it says"]);
  await page.locator("#note-close").click();
  assert.deepEqual(said, []);
  await page.close();
});

test("a model in pieces needs no ranges", { skip }, async () => {
  const whole = await newPage(browser);
  await whole.page.goto(address(path.relative(folder, odd), "site", "index.html"));
  await rest(whole.page);
  const expected = (await told(whole.page)).triangles;
  await whole.page.close();
  host.state.ranges = false;
  const { page, said } = await newPage(browser);
  await page.goto(address("split", "index.html"));
  await rest(page);
  assert.deepEqual(await told(page), { status: "settled", message: "", triangles: expected });
  assert.deepEqual(said, []);
  // One that is gone is told, and the rest drawn.
  await page.close();
  host.state.ranges = true;
});

test("the host that Python has will do", { skip }, async () => {
  const python = spawn("python3", ["-u", "-m", "http.server", "0", "--bind", "127.0.0.1", "--directory", path.join(folder, "split")]);
  try {
    const port = await new Promise((done, failed) => {
      python.on("error", failed);
      python.stdout.on("data", (text) => /port (\d+)/.test(text) && done(/port (\d+)/.exec(text)[1]));
      python.on("exit", () => failed(new Error("no server")));
    });
    const { page, said } = await newPage(browser);
    await page.goto(`http://127.0.0.1:${port}/`);
    await rest(page);
    const { status, triangles } = await told(page);
    assert.ok(status === "settled" && triangles > 1000, status);
    assert.deepEqual(said, []);
    await page.close();
  } finally {
    python.kill();
  }
});

test("opened by double click, the page says what to do, and does it with a file that is dropped", { skip }, async () => {
  const { page } = await newPage(browser);
  await page.goto(pathToFileURL(path.join(odd, "site", "index.html")).href);
  await page.waitForFunction(() => globalThis.chpmView?.message);
  assert.match((await told(page)).message, /opened from a disk.*http\.server.*drop/s);
  await page.setInputFiles("#file", path.join(odd, "site", "model.chpm"));
  await page.waitForFunction(() => chpmView.status === "settled");
  await page.close();
});
