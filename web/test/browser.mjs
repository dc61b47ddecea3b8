// The browser that the page is tried in.

import { existsSync } from "node:fs";

export const CHROMIUM = "/usr/bin/chromium";
export const playwright = await import("playwright-core").catch(() => null);
/** Why there is none, or nothing. */
export const reason = (!existsSync(CHROMIUM) && "no Chromium") || (!playwright && "no playwright-core") || null;
// The driver looks up its maker's hosts unless it is told not to.
export const OPTIONS = ["--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
