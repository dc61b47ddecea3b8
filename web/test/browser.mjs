// The browser that the page is tried in.

import { existsSync } from "node:fs";

const CHROMIUM = "/usr/bin/chromium";
const playwright = await import("playwright-core").catch(() => null);
/** Why there is none, or nothing. */
export const reason = (!existsSync(CHROMIUM) && "no Chromium") || (!playwright && "no playwright-core") || null;
// The driver looks up its maker's hosts unless it is told not to.
const OPTIONS = ["--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];

export const launch = () => playwright.chromium.launch({ executablePath: CHROMIUM, args: OPTIONS });

/** An empty page, and what its console and its errors are going to say. */
export async function newPage(browser) {
  const page = await browser.newPage({ viewport: { width: 900, height: 600 } });
  // Machines may have more to do.
  page.setDefaultTimeout(120000);
  const said = [];
  page.on("console", (message) => said.push(message.text()));
  page.on("pageerror", (error) => said.push(error.stack));
  return { page, said };
}

/** Waits until nothing more is to come: not before the frame that follows what was done last, which a tab that is hidden does not draw. */
export async function rest(page) {
  await page.evaluate(() => new Promise((done) => {
    setTimeout(done, 500);
    requestAnimationFrame(() => requestAnimationFrame(done));
  }));
  await page.waitForFunction(() => !["loading", undefined].includes(document.documentElement.dataset.status), null, { timeout: 120000 });
}
