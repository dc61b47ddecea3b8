// <chpm-viewer src="scan.chpm" up="z" pixels="1"></chpm-viewer>: a model in any page.

import { httpSource } from "../chpm/index.js";
import { Model } from "./model.js";
import { Orbit } from "./orbit.js";
import { Renderer } from "./renderer.js";

/** Bytes of the graphics card for pages of one model, and most triangles of a picture. */
const MEMORY = 256 << 20;
const BUDGET = 2e6;

const STYLE = ":host { display: block; min-height: 200px; position: relative; } canvas { width: 100%; height: 100%; display: block; touch-action: none; }";

/** Says `load` when there is a picture, `settled` when it is all that is wanted, `error` with a message in `detail`. */
class ChpmViewer extends (globalThis.HTMLElement ?? class {}) {
  static observedAttributes = ["src", "up", "pixels"];

  connectedCallback() {
    const root = this.shadowRoot ?? this.attachShadow({ mode: "open" });
    const style = document.createElement("style");
    style.textContent = STYLE;
    this.canvas = document.createElement("canvas");
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", this.getAttribute("alt") ?? "a model: drag or arrow keys to turn");
    root.replaceChildren(style, this.canvas);
    try {
      this.renderer = new Renderer(this.canvas);
    } catch (error) {
      return this.#say("error", error.message);
    }
    this.orbit = new Orbit(this.canvas, () => this.#changed());
    this.canvas.addEventListener("webglcontextlost", (event) => (event.preventDefault(), this.model?.forget()));
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.renderer = new Renderer(this.canvas);
      this.#open();
    });
    this.watcher = new ResizeObserver(() => (this.orbit.fit(), this.#changed()));
    this.watcher.observe(this.canvas);
    this.#open();
  }

  disconnectedCallback() {
    this.watcher?.disconnect();
    this.model?.close();
    this.model = null;
  }

  attributeChangedCallback(name, before, now) {
    if (!this.orbit || before === now) return;
    if (name === "src") this.#open();
    if (name === "up") this.orbit.up = now ?? "y";
    this.#changed();
  }

  async #open() {
    this.model?.close();
    this.model = null;
    const src = this.getAttribute("src");
    if (!src || !this.renderer) return;
    const told = (type) => (error) => this.model === opened && this.#say(type, error?.message);
    const hear = { changed: () => this.#changed(), damaged: told("error"), lost: told("error"), found: told("found") };
    const opened = new Model(httpSource(new URL(src, document.baseURI)), this.renderer, hear, MEMORY);
    this.model = opened;
    try {
      await opened.open();
      if (this.model !== opened) return;
      this.orbit.up = this.getAttribute("up") ?? "y";
      this.orbit.frame(opened.points, opened.radius);
      this.#say("load");
    } catch (error) {
      if (this.model === opened) this.#say("error", error.message);
    }
  }

  #changed() {
    if (this.isDue) return;
    this.isDue = true;
    requestAnimationFrame(() => {
      this.isDue = false;
      if (!this.model?.isReady || !this.isConnected) return;
      const pixels = Number(this.getAttribute("pixels")) || 1;
      this.drawn = this.model.draw(this.orbit, { pixels, budget: BUDGET, colorOf: () => null, shading: "smooth", studio: true, rest: true, sheets: true, clip: null, scalar: null });
      if (this.drawn.settling) this.#changed();
      else if (this.drawn.settled) this.#say("settled");
    });
  }

  #say(type, message = "") {
    this.dispatchEvent(new CustomEvent(type, { detail: message }));
  }
}

globalThis.customElements?.define("chpm-viewer", ChpmViewer);
export { ChpmViewer };
