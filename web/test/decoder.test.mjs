// Pages that a worker expands: the same as without, in the same order, with the same errors.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import path from "node:path";
import { before, test } from "node:test";
import { ChpmError, Decoder, answerPages, memorySource, open } from "../chpm/index.js";
import { CHPM, chpm, temporary } from "./tools.mjs";

const skip = CHPM ? false : "CHPM names no command";
const folder = temporary();

before(() => {
  if (skip) return;
  const source = path.join(folder, "in.ply");
  chpm("synth", "isosurface", "--triangles", "20000", "-o", source, "-f", "-q");
  for (const [name, ...more] of [["raw"], ["packed"], ["chained"], ["packed", "--normals", "computed"]]) {
    chpm("build", source, "-o", path.join(folder, `${[name, ...more].length > 1 ? "normals" : name}.chpm`), "-f", "-q", "--pages", name, "--cluster-triangles", "512", ...more);
  }
});

const bytesOf = (name) => readFileSync(path.join(folder, `${name}.chpm`));

/** A worker in the same thread: the two ends of a channel. */
async function worker() {
  const { port1, port2 } = new MessageChannel();
  for (const port of [port1, port2]) port.start();
  const sent = [];
  const events = new EventTarget();
  const near = {
    addEventListener: (type, hear) => (type === "message" ? port1 : events).addEventListener(type, hear),
    postMessage: (message, moved) => (sent.push(moved), port1.postMessage(message, moved)),
    terminate: () => (port1.close(), port2.close()),
  };
  const decoder = new Decoder(near);
  answerPages(port2);
  while (!decoder.isReady) await new Promise((done) => setImmediate(done));
  return { decoder, sent, end: near.terminate, fail: () => events.dispatchEvent(new Event("error", { cancelable: true })) };
}

async function all(file, signal) {
  await file.needTables();
  const pages = [];
  await file.eachPage(Array.from({ length: file.header.clusterCount }, (_, id) => id), (page) => pages.push(page), signal);
  return pages;
}

for (const name of ["raw", "packed", "chained", "normals"]) {
  test(`pages of a worker are those of the reader, ${name}`, { skip }, async () => {
    const { decoder, sent, end } = await worker();
    const own = await all(await open(memorySource(bytesOf(name))));
    const file = await open(memorySource(bytesOf(name)), { decoder });
    const others = await all(file);
    assert.ok(own.length > 20 && sent.length > 0);
    // What went there is not here any more.
    for (const [buffer] of sent) assert.equal(buffer.byteLength, 0);
    assert.deepEqual(others, own);
    assert.ok(others.every((page) => page.cluster === file.cluster(page.cluster.id) && page.errorAt(page.cluster.vertexCount) === page.cluster.minError));
    end();
  });
}

test("a damaged page is read once more, and told as without a worker", { skip }, async () => {
  const { decoder, end } = await worker();
  const bytes = Buffer.from(bytesOf("packed"));
  const whole = await open(memorySource(bytes));
  await whole.needTables();
  const { pageOffset } = whole.cluster(3);
  bytes[pageOffset + 60] ^= 1;
  const errors = [];
  for (const options of [{}, { decoder }]) {
    const source = memorySource(bytes);
    let reads = 0;
    const counted = { ...source, read: (offset, length, ...rest) => ((reads += offset === pageOffset ? 1 : 0), source.read(offset, length, ...rest)) };
    const error = await all(await open(counted, options)).catch((error) => error);
    assert.ok(error instanceof ChpmError);
    errors.push([error.message, error.isLost, reads]);
  }
  assert.deepEqual(errors[1], errors[0]);
  assert.match(errors[0][0], /cluster 3 is damaged/);
  // Damaged on its way alone, it is sound the second time.
  const source = memorySource(bytesOf("packed"));
  const once = { ...source, read: async (offset, length, signal, isFresh) => {
    const read = await source.read(offset, length);
    if (!isFresh && offset <= pageOffset && pageOffset < offset + length && length !== 32768) read[pageOffset + 60 - offset] ^= 1;
    return read;
  } };
  assert.deepEqual(await all(await open(once, { decoder })), await all(await open(memorySource(bytesOf("packed")))));
  end();
});

test("a worker that fails is done without, and nothing comes after a stop", { skip }, async () => {
  const { decoder, fail } = await worker();
  const expected = await all(await open(memorySource(bytesOf("packed"))));
  const coming = all(await open(memorySource(bytesOf("packed")), { decoder }));
  await new Promise((done) => setImmediate(done));
  fail();
  assert.deepEqual(await coming, expected);
  assert.equal(decoder.isReady, false);

  const other = await worker();
  const file = await open(memorySource(bytesOf("packed")), { decoder: other.decoder });
  await file.needTables();
  const stop = new AbortController();
  const taken = [];
  const ids = Array.from({ length: file.header.clusterCount }, (_, id) => id);
  await assert.rejects(file.eachPage(ids, (page) => (taken.push(page), stop.abort(new Error("enough"))), stop.signal), /enough/);
  assert.equal(taken.length, 1);
  other.end();
});
