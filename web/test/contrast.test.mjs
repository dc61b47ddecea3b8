// Text on the page stands out from what is behind it, as WCAG asks: 4.5 to 1.

import assert from "node:assert/strict";
import path from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { launch, newPage, reason, rest } from "./browser.mjs";
import { serve } from "./server.mjs";
import { CHPM, chpm, temporary } from "./tools.mjs";

const skip = reason ?? (CHPM ? false : "CHPM names no command");
const folder = temporary();
let [browser, host] = [];

before(async () => {
  if (skip) return;
  chpm("synth", "torus", "--triangles", "20000", "-o", path.join(folder, "torus.ply"), "-f", "-q");
  chpm("build", path.join(folder, "torus.ply"), "-o", path.join(folder, "torus.chpm"), "-f", "-q");
  browser = await launch();
  host = await serve([fileURLToPath(new URL("..", import.meta.url)), folder]);
});

after(async () => {
  await browser?.close();
  host?.close();
});

/**
 * The contrast of each text, and of what marks controls without text, with what is behind it. Where that can be seen through, as a card over the model, the worst of a black and a white
 * picture counts.
 */
const contrasts = (page) =>
  page.evaluate(() => {
    const numbers = (color) => {
      const [r, g, b, a = 1] = color.match(/[\d.]+/g).map(Number);
      return [r, g, b, a];
    };
    const over = ([r, g, b, a], below) => [r, g, b].map((x, i) => a * x + (1 - a) * below[i]);
    const light = (rgb) => {
      const [r, g, b] = rgb.map((x) => x / 255).map((x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4));
      return 0.2126 * r + 0.7152 * g + 0.0722 * b;
    };
    const behind = (element, picture) => {
      const layers = [];
      for (let at = element; at && at !== document.body; at = at.parentElement) layers.unshift(numbers(getComputedStyle(at).backgroundColor));
      return layers.reduce((below, layer) => over(layer, below), picture);
    };
    const found = [];
    const isSeen = (element) => element.checkVisibility({ visibilityProperty: true, opacityProperty: true }) && !element.closest(":disabled, canvas");
    const look = (element, text) => {
      const { color } = getComputedStyle(element);
      const ratios = [[0, 0, 0], [255, 255, 255]].map((picture) => {
        const back = behind(element, picture);
        const [low, high] = [light(back), light(over(numbers(color), back))].sort((a, b) => a - b);
        return (high + 0.05) / (low + 0.05);
      });
      found.push([Math.min(...ratios), text, element.id || element.parentElement.id || element.className]);
    };
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
      const { parentElement: element, textContent } = walker.currentNode;
      if (textContent.trim() && !element.closest("script, style, option") && isSeen(element)) look(element, textContent.trim());
    }
    for (const control of document.querySelectorAll("select, input[type=file]")) if (isSeen(control)) look(control, `<${control.id}>`);
    return found;
  });

for (const scheme of ["light", "dark"]) {
  for (const [width, height] of [[900, 600], [390, 844]]) {
    test(`all text is read easily, ${scheme}, ${width} by ${height}`, { skip }, async () => {
      const { page } = await newPage(browser);
      await page.emulateMedia({ colorScheme: scheme });
      await page.setViewportSize({ width, height });
      await page.goto(`${host.url}/view.html?file=torus.chpm`);
      await rest(page);
      // All that there may be: notes, a legend, an outline, a measurement, a warning.
      await page.evaluate(() => {
        for (const details of document.querySelectorAll("details")) details.open = true;
        const tell = (id, text) => (document.getElementById(id).textContent = text);
        document.getElementById("note").hidden = false;
        [["note-title", "a title"], ["note-text", "a text"], ["credit", "a credit"]].forEach(([id, text]) => tell(id, text));
        const label = Object.assign(document.createElement("button"), { className: "note", textContent: "1" });
        document.getElementById("over").append(label);
      });
      await page.selectOption("#colors", "error");
      await page.selectOption("#clip", "1");
      await page.locator("#measure").click();
      await page.waitForFunction(() => chpmView.outline && chpmView.status === "settled");
      await page.evaluate(() => {
        document.getElementById("message").textContent = "a warning";
        document.getElementById("message").classList.add("error");
      });
      const found = await contrasts(page);
      for (const id of ["title", "pixels-told", "legend-most", "note-title", "note-text", "credit", "measured", "message", "bar-told", "outline-note", "save", "measure", "outline", "colors", "file"]) {
        assert.ok(found.some(([, , of]) => of === id), `nothing of ${id} in ${found.map(([, , of]) => of)}`);
      }
      assert.deepEqual(found.filter(([ratio]) => !(ratio >= 4.5)), []);
      await page.close();
    });
  }
}
