// The page: opens a model, draws it when something changes, and tells what is drawn.

import { blobSource, httpSource } from "../chpm/index.js";
import { GRADIENT, distinct, viridis } from "./colors.js";
import { Model } from "./model.js";
import { Orbit } from "./orbit.js";
import { Renderer } from "./renderer.js";

const $ = (id) => document.getElementById(id);
const numbers = new Intl.NumberFormat("en", { maximumSignificantDigits: 3 });
const powers = new Intl.NumberFormat("en", { notation: "scientific", maximumSignificantDigits: 3 });
const whole = new Intl.NumberFormat("en", { maximumFractionDigits: 0 });

let renderer;
let model = null;
let scheduled = false;
let last = null;

/** For tests, and for whoever embeds the page: what happens, and what is drawn. */
const state = { status: "empty", message: "", get drawn() { return last; }, get model() { return model; }, orbit: null };
globalThis.chpmView = state;

function tell(status, message = "") {
  Object.assign(state, { status, message });
  document.documentElement.dataset.status = status;
  $("message").textContent = message;
  $("message").classList.toggle("error", status === "failed" || status === "damaged" || status === "waiting");
}

/** A length: as people write it, unless that is long. */
const length = (x) => (x === 0 || (x >= 1e-4 && x < 1e9) ? numbers : powers).format(x);

function bytes(count) {
  const unit = count >= 1 << 20 ? [1 << 20, "MiB"] : [1 << 10, "KiB"];
  return `${numbers.format(count / unit[0])} ${unit[1]}`;
}

const COLORS = {
  surface: () => null,
  level: ({ level }, _, { levelCount }) => viridis(level / Math.max(levelCount - 1, 1)),
  cluster: ({ id }) => distinct(id),
  error: (_, error, __, largest) => viridis(error / (largest || 1)),
};

const settings = () => ({ pixels: 2 ** Number($("pixels").value), budget: 10 ** Number($("budget").value), colors: $("colors").value, shading: $("shading").value });

function draw() {
  scheduled = false;
  if (!model?.isReady) return;
  const { pixels, budget, colors, shading } = settings();
  const largest = last?.error ?? 0;
  const colorOf = (cluster, error) => COLORS[colors](cluster, error, model.file.header, largest);
  last = model.draw(state.orbit, { pixels, budget, colorOf, shading });
  if (state.status === "loading" || state.status === "settled") tell(last.settled ? "settled" : "loading");
  if (last.settling || (colors === "error" && largest !== last.error)) changed();
  statistics();
}

function changed() {
  if (scheduled) return;
  scheduled = true;
  if (state.status === "settled") tell("loading");
  requestAnimationFrame(draw);
}

/** What the colours of numbers stand for. */
function legend(colors, header) {
  const most = { level: `level ${header.levelCount - 1}`, error: `${length(last.error)} units` }[colors];
  $("legend").hidden = !most;
  $("legend-bar").style.background = GRADIENT;
  [$("legend-least").textContent, $("legend-most").textContent] = ["0", most ?? ""];
}

function statistics() {
  const { pixels, budget, colors } = settings();
  $("pixels-told").value = `${numbers.format(pixels)} px`;
  $("budget-told").value = numbers.format(budget / 1e6) + " M";
  if (!last || !model?.file) return;
  const { header } = model.file;
  const { statistics: traffic } = model.source;
  legend(colors, header);
  const counters = {
    clusters: `${last.clusters} of ${whole.format(header.clusterCount)}`,
    ...(traffic && { fetched: `${bytes(traffic.bytes)}, ${traffic.requests} requests` }),
    file: bytes(header.fileLength),
    ...(model.note && { note: model.note }),
  };
  list($("counters"), counters);
  list($("statistics"), {
    source: `${whole.format(header.sourceTriangleCount)} triangles`,
    drawn: `${whole.format(last.triangles)} triangles`,
    error: `${length(last.error)} units`,
    ...(last.relaxed > 1 && { allowed: `${numbers.format(pixels * last.relaxed)} px, to keep the budget` }),
  });
}

/** Names and what is told of them. */
function list(element, rows) {
  element.replaceChildren(
    ...Object.entries(rows).flatMap(([name, value]) => {
      const [term, told] = [document.createElement("dt"), document.createElement("dd")];
      [term.textContent, told.textContent] = [name, value];
      return [term, told];
    }),
  );
}

/** How a model stands: what is up, and the direction that it is seen along first. */
function stand(seen) {
  if (!seen) return;
  if (!new URLSearchParams(location.search).has("up")) $("up").value = state.orbit.up = seen.up;
  state.orbit.look(seen.sight);
}

/** Opens a model. `seen` is from where it is seen, if whoever made the page knows: `{ up, sight, points, stretch, note }`. */
async function show(source, name, seen) {
  model?.close();
  last = null;
  $("title").textContent = name;
  document.title = `${name} - chpm`;
  tell("loading", `opening ${name}`);
  // What is damaged stays so, also when a connection comes back.
  let damage = null;
  const isShown = (then) => (...told) => model === opened && then(...told);
  const opened = new Model(source, renderer, {
    changed: isShown(changed),
    damaged: isShown(({ message }) => tell("damaged", (damage = `${message}. The rest of the model is drawn.`))),
    lost: isShown(({ message }) => tell("waiting", `${message}. It is tried again.`)),
    found: isShown(() => (damage ? tell("damaged", damage) : tell("loading"))),
  });
  model = opened;
  try {
    await opened.open(seen);
    opened.note = seen?.note;
    if (model !== opened) return;
    tell("loading");
    stand(seen);
    state.orbit.frame(opened.points, opened.radius);
  } catch (error) {
    if (model === opened) tell("failed", error.message);
  }
}

/** Pixels at the left that the panel covers, unless that is most of them. */
function covered() {
  const { right } = $("panel").getBoundingClientRect();
  return $("panel").open && right < $("canvas").clientWidth / 2 ? right : 0;
}

function start() {
  try {
    renderer = new Renderer($("canvas"));
  } catch (error) {
    tell("failed", error.message);
    return;
  }
  state.orbit = new Orbit($("canvas"), changed, covered);
  $("panel").addEventListener("toggle", changed);
  $("canvas").addEventListener("webglcontextlost", (event) => {
    event.preventDefault();
    tell("failed", "the graphics driver was reset; load the page again");
  });
  for (const id of ["pixels", "budget", "colors", "shading"]) $(id).addEventListener("input", () => (statistics(), changed()));
  $("up").addEventListener("input", () => {
    state.orbit.up = $("up").value;
    changed();
  });
  $("home").addEventListener("click", () => model?.isReady && state.orbit.frame(model.points, model.radius));
  new ResizeObserver(() => (state.orbit.fit(), changed())).observe($("canvas"));
  const take = (file) => file && show(blobSource(file), file.name);
  $("file").addEventListener("input", () => take($("file").files[0]));
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    take(event.dataTransfer.files[0]);
  });

  const query = new URLSearchParams(location.search);
  const asked = Number(query.get("pixels"));
  if (asked > 0) $("pixels").value = Math.log2(asked);
  if (query.get("shading") === "flat") $("shading").value = "flat";
  // Where it would lie over most of the model, the panel is only its title until somebody opens it.
  $("panel").open = innerWidth >= 480 && innerHeight >= 320;
  statistics();
  const up = query.get("up");
  if ([...$("up").options].some((option) => option.value === up)) $("up").value = state.orbit.up = up;
  // A page that was made for one model names it.
  const name = query.get("file") ?? document.body.dataset.file;
  const seen = document.body.dataset.view && JSON.parse(document.body.dataset.view);
  if (name) show(httpSource(new URL(name, location.href)), name, seen);
  else tell("empty", "Open a .chpm file, or drop one here. A page's address may name one: view.html?file=model.chpm");
}

start();
