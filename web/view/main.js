// The page: opens a model, draws it when something changes, and tells what is drawn.

import { blobSource, httpSource, piecesSource, prefetched } from "../chpm/index.js";
import { planeName, svg } from "./drawing.js";
import { Model } from "./model.js";
import { Orbit } from "./orbit.js";
import { Outline } from "./outline.js";
import { Overlay, atMost, length, readNotes, scaleBar } from "./overlay.js";
import { $, offer, settings, tellDrawn, tellOutline } from "./panel.js";
import { pick } from "./pick.js";
import { Renderer } from "./renderer.js";
import { isWorker } from "./worker.js";

/** Whether this is a phone, or something like it: few bytes of graphics memory, and little to cool it. */
function isSmall() {
  const { deviceMemory = 8, maxTouchPoints = 0 } = navigator;
  return deviceMemory <= 4 || (maxTouchPoints > 0 && Math.min(screen.width, screen.height) < 800);
}

/** Bytes of the graphics card that pages may take. */
const MEMORY = (isSmall() ? 160 : 512) << 20;
/** Radians that a turntable goes in a second. */
const SPEED = 0.35;

let renderer;
let overlay;
let outline;
let model = null;
let shown = null;
let scheduled = false;
let last = null;
/** Whether what was drawn last is all that is wanted: then it is drawn once more as a picture at rest. */
let isAtRest = false;
let isMeasuring = false;
let spun = null;
/** Whether what is hidden is left out; tests compare. */
let culls = true;

/** For tests, and for whoever embeds the page: what happens, and what is drawn. */
const state = { status: "empty", message: "", get drawn() { return last; }, get model() { return model; }, get marks() { return overlay.marks; }, get outline() { return outline.found; }, orbit: null };
globalThis.chpmView = state;

function tell(status, message = "") {
  Object.assign(state, { status, message });
  document.documentElement.dataset.status = status;
  $("message").textContent = message;
  $("message").classList.toggle("error", ["failed", "damaged", "waiting"].includes(status));
}

function draw(now) {
  scheduled = false;
  if (!model?.isReady) return;
  if (spun !== null) state.orbit.turn -= SPEED * Math.min((now - spun) / 1000, 0.1);
  const look = settings(model.file.header, last?.error ?? 0);
  const before = last;
  const rest = isAtRest && spun === null;
  last = model.draw(state.orbit, { ...look, rest, culls });
  overlay.place(state.orbit, model.place.stretch);
  // A turntable never rests: the first outline that can be had is the one that turns.
  const isCalm = rest || (spun !== null && last.isComplete && !outline.found);
  const plane = model.clipOf(look.clip);
  outline.follow(plane, plane && isCalm ? drawnParts() : null);
  outline.draw(state.orbit, model.place.stretch);
  scale();
  const isSame = !last.settling && (look.colors !== "error" || before?.error === last.error);
  if (spun !== null) return void ((spun = now), again(), tellDrawn(model, last));
  isAtRest = last.settled && isSame;
  if (state.status === "loading" || state.status === "settled") tell(last.settled && (rest || !isAtRest) ? "settled" : "loading");
  if (!isSame || (isAtRest && !rest)) again();
  tellDrawn(model, last);
}

function again() {
  // Nobody sees a page that is hidden: it goes on when it is shown.
  if (scheduled || document.hidden) return;
  scheduled = true;
  requestAnimationFrame(draw);
}

/** Pages of all of the drawn cut, whatever of it is in the image, and the positions that they are at. */
function drawnParts() {
  return last.cut.map(({ cluster, bound }) => {
    const page = renderer.page(cluster);
    return { page, position: page.position(bound) };
  });
}

function changed() {
  isAtRest = false;
  if (spun === null) outline.disturb();
  if (state.status === "settled") tell("loading");
  again();
}

/** The bar that says how large things are, in the middle of what is looked at. */
function scale() {
  const { orbit } = state;
  const unit = orbit.canvas.clientHeight / 2 / (Math.tan((orbit.fov * Math.PI) / 360) * orbit.distance);
  const isEven = model.place.stretch.every((factor) => factor === 1);
  $("bar").hidden = !(isEven && unit > 0 && unit < Infinity);
  if ($("bar").hidden) return;
  const bar = scaleBar(unit, Math.min(160, orbit.canvas.clientWidth / 4));
  $("bar").style.width = `${bar.pixels}px`;
  $("bar-told").textContent = `${length(bar.length)} units`;
}

/** How a model stands: what is up, and the direction that it is seen along first. */
function stand(seen) {
  if (!seen) return;
  if (!new URLSearchParams(location.search).has("up")) $("up").value = state.orbit.up = seen.up;
  state.orbit.look(seen.sight);
}

/**
 * Opens a model. `seen` is from where it is seen, if whoever made the page knows: `{ up, sight, points, stretch, note, title, credit, background, notes }`. With
 * `keep` the camera stays as it is.
 */
async function show(source, name, seen, keep = false) {
  model?.close();
  last = null;
  shown = [source, name, seen];
  overlay.clear();
  outline.clear();
  $("title").textContent = name;
  $("credit").textContent = seen?.credit ?? "";
  document.title = seen?.title ?? `${name} - chpm`;
  document.body.style.background = seen?.background ? `#${seen.background}` : "";
  tell("loading", `opening ${name}`);
  // What is damaged stays so, also when a connection comes back.
  let damage = null;
  const isShown = (then) => (...told) => model === opened && then(...told);
  const hear = {
    changed: isShown(changed),
    answered: isShown(again),
    damaged: isShown(({ message }) => tell("damaged", (damage = `${message}. The rest of the model is drawn.`))),
    lost: isShown(({ message }) => tell("waiting", `${message}. It is tried again.`)),
    found: isShown(() => (damage ? tell("damaged", damage) : tell("loading"))),
  };
  const opened = new Model(source, renderer, hear, MEMORY);
  model = opened;
  try {
    await opened.open(seen);
    opened.note = seen?.note;
    if (model !== opened) return;
    tell("loading");
    offer(opened.file.header);
    if (keep) return void changed();
    stand(seen);
    state.orbit.frame(opened.points, opened.radius);
    await annotate(seen?.notes, opened);
  } catch (error) {
    if (model === opened) tell("failed", error.message);
  }
}

/** Puts the notes of a JSON beside the page on the model; without it, the model is shown all the same. */
async function annotate(name, opened) {
  const list = name && (await fetch(new URL(name, location.href)).then((answer) => (answer.ok ? answer.json() : [])).catch(() => []));
  if (!list || model !== opened) return;
  overlay.annotate(readNotes(list, opened.file.header.origin), (note) => {
    [$("note-title").textContent, $("note-text").textContent] = [note.title, note.text];
    $("note").hidden = false;
  });
  changed();
}

/** Pixels at the left that the panel covers, unless that is most of them. */
function covered() {
  const { right } = $("panel").getBoundingClientRect();
  return $("panel").open && right < $("canvas").clientWidth / 2 ? right : 0;
}

/** What browsers do not do for a page that was opened by double click. */
const BY_HAND =
  "This page was opened from a disk, where browsers let no page read the files beside it. Put its folder on a web host; or start one here, in a terminal " +
  "in this folder: python3 -m http.server (for a folder of chpm share --split) or chpm serve model.chpm; or drop a .chpm file here.";

/** An address beside the page, of a name that may have any letters; a whole address is taken as it is. */
function beside(path) {
  const isWhole = /^https?:\/\//.test(path);
  return new URL(isWhole ? path : path.split("/").map(encodeURIComponent).join("/"), location.href);
}

/** Where a model comes from: what a page that was made for it needs first is asked for at once. */
function sourceOf(name, seen) {
  const { pieces, first } = seen ?? {};
  const source = pieces ? piecesSource(beside(pieces.folder), pieces) : httpSource(beside(name));
  return first ? prefetched(source, first) : source;
}

/** What is at a point of the canvas: in the file's coordinates, with its error. */
function at(x, y) {
  const { stretch } = model.place;
  const unstretched = (v) => v.map((x, axis) => x / stretch[axis]);
  const clip = model.clipOf(settings(model.file.header, 0).clip);
  const isKept = ([x, y, z]) => !clip || clip[0][0] * x + clip[0][1] * y + clip[0][2] * z <= clip[1];
  const blocks = last.cut.map(({ cluster }) => renderer.blocks.get(cluster)).filter((block) => block?.used === renderer.frame);
  return pick(blocks, unstretched(state.orbit.eye()), unstretched(state.orbit.ray(x, y)), isKept);
}

/** Hands the outline out as a drawing. */
function save() {
  const { found } = outline;
  if (!found) return;
  const { origin } = model.file.header;
  const name = `${shown[1].split("/").at(-1).replace(/\.chpm$/, "")}, ${planeName(found.plane, origin)}`;
  const about = found.error > 0 ? `; a coarse mesh, points within ${atMost(found.error)} of the source` : "";
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([svg(found, name + about, origin)], { type: "image/svg+xml" }));
  link.download = `${name.replace(/[^\p{L}\p{N}.,-]+/gu, "_")}.svg`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}

const press = (id, is) => $(id).setAttribute("aria-pressed", is);

function measure(is) {
  isMeasuring = is;
  press("measure", is);
  $("canvas").classList.toggle("measuring", is);
  overlay.unmark();
  if (is) $("measured").textContent = "Choose two points of the model.";
  changed();
}

function spin(is) {
  spun = is ? performance.now() : null;
  press("turn", is);
  changed();
}

function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else document.documentElement.requestFullscreen?.().catch(() => {});
}

/** Shows images, or the colours of vertices instead. */
function paint() {
  if (!model?.file?.sheets) return;
  $("colors").value = $("colors").value === "surface" ? "vertices" : "surface";
  changed();
}

const home = () => model?.isReady && state.orbit.frame(model.points, model.radius);
const KEYS = { h: home, m: () => measure(!isMeasuring), t: () => spin(spun === null), f: fullScreen, i: paint, Escape: () => measure(false) };

function listen() {
  const canvas = $("canvas");
  $("panel").addEventListener("toggle", changed);
  canvas.addEventListener("webglcontextlost", (event) => {
    event.preventDefault();
    model?.forget();
    tell("waiting", "the graphics driver was reset; the model comes back when it does");
  });
  canvas.addEventListener("webglcontextrestored", () => {
    renderer = new Renderer(canvas);
    if (shown) show(...shown, true);
  });
  const inputs = ["pixels", "budget", "colors", "shading", "light", "clip", "clip-at", "clip-flip"];
  for (const id of inputs) $(id).addEventListener("input", () => (tellDrawn(model, last), changed()));
  $("save").addEventListener("click", save);
  $("theme").addEventListener("input", () => ((document.documentElement.style.colorScheme = $("theme").value), changed()));
  $("up").addEventListener("input", () => {
    state.orbit.up = $("up").value;
    changed();
  });
  $("home").addEventListener("click", home);
  $("measure").addEventListener("click", () => measure(!isMeasuring));
  $("turn").addEventListener("click", () => spin(spun === null));
  $("full").addEventListener("click", fullScreen);
  document.addEventListener("visibilitychange", () => document.hidden || changed());
  document.addEventListener("fullscreenchange", () => press("full", Boolean(document.fullscreenElement)));
  $("note-close").addEventListener("click", () => ($("note").hidden = true));
  addEventListener("keydown", (event) => {
    const isTyping = event.target.closest?.("input, select, textarea") || event.ctrlKey || event.altKey || event.metaKey;
    if (!isTyping && KEYS[event.key]) KEYS[event.key]();
  });
  // Where the pointer went down and came up at one place, it was a click.
  let down = null;
  canvas.addEventListener("pointerdown", ({ offsetX, offsetY }) => (down = [offsetX, offsetY]));
  canvas.addEventListener("pointerup", ({ offsetX, offsetY }) => {
    const isClick = down && Math.hypot(offsetX - down[0], offsetY - down[1]) < 5;
    const found = isClick && isMeasuring && last ? at(offsetX, offsetY) : null;
    if (found) overlay.mark(found), changed();
  });
  state.orbit.onTouch = () => spun !== null && spin(false);
  new ResizeObserver(() => (state.orbit.fit(), changed())).observe(canvas);
  // A model's volumes come with it.
  const take = (files) => {
    const file = [...files].find(({ name }) => name.endsWith(".chpm")) ?? files[0];
    if (file) show(blobSource(file, files), file.name);
  };
  $("file").addEventListener("input", () => take([...$("file").files]));
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    take([...event.dataTransfer.files]);
  });
}

function start() {
  overlay = new Overlay($("over"), $("line"), $("measured"));
  outline = new Outline($("cut"), (found) => (tellOutline(found), found && again()));
  try {
    renderer = new Renderer($("canvas"));
  } catch (error) {
    tell("failed", error.message);
    return;
  }
  state.orbit = new Orbit($("canvas"), changed, covered);
  listen();
  const query = new URLSearchParams(location.search);
  const asked = Number(query.get("pixels"));
  if (asked > 0) $("pixels").value = Math.log2(asked);
  culls = query.get("occlusion") !== "off";
  if (query.get("shading") === "flat") $("shading").value = "flat";
  // Where it would lie over most of the model, the panel is only its title until somebody opens it.
  $("panel").open = innerWidth >= 640 && innerHeight >= 320;
  if (isSmall()) $("budget").value = "5.8";
  tellDrawn(null, null);
  const up = query.get("up");
  if ([...$("up").options].some((option) => option.value === up)) $("up").value = state.orbit.up = up;
  // A page that was made for one model names it.
  const name = query.get("file") ?? document.body.dataset.file;
  const seen = document.body.dataset.view && JSON.parse(document.body.dataset.view);
  if (name && location.protocol === "file:") tell("empty", BY_HAND);
  else if (name) show(sourceOf(name, seen), seen?.title ?? name, seen);
  else tell("empty", "Open a .chpm file, or drop one here. A page's address may name one: view.html?file=model.chpm");
}

if (!isWorker) start();
