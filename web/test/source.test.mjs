// The way to a file on a host: what is lost is asked for again, what is old or damaged is not believed.

import assert from "node:assert/strict";
import { test } from "node:test";
import { ChpmError, httpSource } from "../chpm/index.js";
import { readSound } from "../chpm/source.js";

const FILE = Uint8Array.from({ length: 1000 }, (_, i) => (i * 7) & 255);

/** A range of a file. */
function answer(range, { tag = '"1"', file = FILE, status = 206, cut = false } = {}) {
  const [first, last] = /^bytes=(\d+)-(\d+)$/.exec(range).slice(1).map(Number);
  const bytes = file.slice(first, last + 1);
  const pieces = new ReadableStream({
    start(to) {
      to.enqueue(bytes.subarray(0, bytes.length >> 1));
      if (cut) return to.error(new TypeError("terminated"));
      to.enqueue(bytes.subarray(bytes.length >> 1));
      to.close();
    },
  });
  return new Response(pieces, { status, headers: { ETag: tag, "Content-Range": `bytes ${first}-${first + bytes.length - 1}/${file.length}` } });
}

/** A source whose host does what each of `deeds` says in turn, and then the last for ever; and how it was asked. */
function source(deeds, options) {
  const asked = [];
  const get = async (_, { headers, cache, signal }) => {
    const deed = deeds[Math.min(asked.length, deeds.length - 1)];
    asked.push(cache);
    return deed(headers.Range, signal);
  };
  return { asked, from: httpSource("http://host/a.chpm", { fetch: get, waits: [0, 1], patience: 50, ...options }) };
}

const good = (range) => answer(range);
const lost = () => Promise.reject(new TypeError("fetch failed"));
const silent = (_, signal) =>
  new Promise((_, failed) => (signal.aborted ? failed(signal.reason) : signal.addEventListener("abort", () => failed(signal.reason))));

test("a lost request is made again, and told when it stays lost", async () => {
  for (const bad of [lost, silent, (range) => answer(range, { cut: true }), (range) => answer(range, { status: 503 })]) {
    const { asked, from } = source([bad, bad, good]);
    assert.deepEqual(await from.read(10, 20), FILE.slice(10, 30));
    assert.equal(asked.length, 3);
    const gone = source([bad]);
    await assert.rejects(gone.from.read(10, 20), (error) => error instanceof ChpmError && error.isLost && /a\.chpm/.test(error.message));
    assert.equal(gone.asked.length, 3);
  }
});

test("what will not get better is told at once", async () => {
  for (const [bad, told] of [
    [(range) => answer(range, { status: 404 }), /not there/],
    [(range) => answer(range, { status: 403 }), /answers 403/],
    [(range) => answer(range, { status: 200 }), /whole files only/],
    [() => answer("bytes=500-519"), /another range/],
  ]) {
    const { asked, from } = source([bad]);
    await assert.rejects(from.read(10, 20), (error) => error instanceof ChpmError && !error.isLost && told.test(error.message));
    assert.equal(asked.length, 1);
  }
});

test("whoever stops is not kept waiting", async () => {
  for (const deeds of [[silent], [lost]]) {
    const { from } = source(deeds, { waits: [1e6], patience: 1e6 });
    const stop = new AbortController();
    setTimeout(() => stop.abort(), 5);
    await assert.rejects(from.read(0, 10, stop.signal), { name: "AbortError" });
    await assert.rejects(from.read(0, 10, stop.signal), { name: "AbortError" });
  }
});

test("the cache is asked after the host was, and not believed where it has another version", async () => {
  const old = (range) => answer(range, { tag: '"0"', file: FILE.slice(0, 900) });
  const { asked, from } = source([good, good, old, good, old]);
  for (const at of [0, 100, 200]) assert.deepEqual(await from.read(at, 20), FILE.slice(at, at + 20));
  assert.deepEqual(asked, ["no-cache", "force-cache", "force-cache", "reload"]);
  await assert.rejects(from.read(300, 20), (error) => !error.isLost && /changed since/.test(error.message));
  assert.deepEqual(asked.slice(4), ["force-cache", "reload"]);
});

test("what came damaged is fetched once more, past the cache", async () => {
  const damaged = (range) => answer(range, { file: FILE.map((byte) => byte ^ 1) });
  const look = (bytes) => {
    if (bytes[0] !== FILE[5]) throw new ChpmError("damaged");
    return bytes;
  };
  const { asked, from } = source([damaged, good]);
  assert.deepEqual(await readSound(from, 5, 9, "a page", undefined, look), FILE.slice(5, 14));
  assert.deepEqual(asked, ["no-cache", "reload"]);
  await assert.rejects(readSound(source([damaged]).from, 5, 9, "a page", undefined, look), /damaged/);
});
