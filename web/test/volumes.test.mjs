// Pages in files of their own, read as one: over HTTP, from memory, and from files that were picked together.

import assert from "node:assert/strict";
import { readFileSync, readdirSync, writeFileSync } from "node:fs";
import path from "node:path";
import { test } from "node:test";
import { ChpmError, blobSource, extract, httpSource, level, memorySource, open, select } from "../chpm/index.js";
import { volumeOf } from "../chpm/source.js";
import { volumesSource } from "../chpm/volumes.js";
import { serve } from "./server.mjs";
import { CHPM, chpm, temporary, trianglesOfMesh, trianglesOfPly } from "./tools.mjs";

const skip = CHPM ? false : "CHPM names no command";
const folder = temporary();
const at = (name) => path.join(folder, name);

function build(pages) {
  chpm("synth", "isosurface", "--triangles", "12000", "-o", at("in.ply"), "-f", "-q");
  const options = ["-f", "-q", "--cluster-triangles", "256", "--pages", pages, "--volume-size", pages === "raw" ? "100K" : "20K"];
  chpm("build", at("in.ply"), "-o", at("in.chpm"), ...options);
  return readdirSync(folder).filter((name) => /^in\.\d{4}\.pages$/.test(name)).sort();
}

/** Reads all pages. */
async function everything(file) {
  await file.needTables();
  await file.eachPage(Array.from({ length: file.header.clusterCount }, (_, id) => id), () => {});
}

const finest = async (file) => trianglesOfMesh(await extract(file, await select(file, level(0))));

test("a volume is beside its model, and is named as it is", () => {
  assert.equal(volumeOf("scan.chpm", 1), "scan.0001.pages");
  assert.equal(volumeOf("http://a/b.c/scan%20x.chpm?token=1#2", 20), "http://a/b.c/scan%20x.0020.pages?token=1#2");
  assert.equal(volumeOf("scan", 3), "scan.0003.pages");
});

test("a model in volumes is the model, wherever it comes from", { skip }, async () => {
  for (const pages of ["raw", "packed", "chained"]) {
    const names = build(pages);
    assert.ok(names.length > 2, `${names}`);
    const expected = trianglesOfPly(at("in.ply"));
    const bytes = ["in.chpm", ...names].map((name) => readFileSync(at(name)));
    assert.deepEqual(await finest(await open(memorySource(bytes[0], bytes.slice(1)))), expected);
    const files = ["in.chpm", ...names].map((name, i) => new File([bytes[i]], name));
    assert.deepEqual(await finest(await open(blobSource(files[0], files))), expected);
    const host = await serve([folder]);
    try {
      const file = await open(httpSource(`${host.url}/in.chpm`));
      assert.deepEqual(await finest(file), expected);
      await everything(file);
      assert.ok(file.source.statistics.bytes > bytes.slice(1).reduce((sum, { length }) => sum + length - 8192, 0));
      assert.deepEqual([...new Set(host.requests.map(({ file }) => file))].sort(), [...names, "in.chpm"].sort());
    } finally {
      host.close();
    }
  }
});

test("what is not its volume is named", { skip }, async () => {
  const names = build("raw");
  const bytes = ["in.chpm", ...names].map((name) => readFileSync(at(name)));
  const told = async (volumes, pattern) =>
    await assert.rejects(async () => everything(await open(memorySource(bytes[0], volumes))), (error) => error instanceof ChpmError && pattern.test(error.message));
  await told([], /in \d volumes, which are not here.*relayout/);
  await told([bytes[1].subarray(0, 9000), ...bytes.slice(2)], /volume 1 has 9000 bytes/);
  chpm("build", at("in.ply"), "-o", at("other.chpm"), "-f", "-q", "--cluster-triangles", "128", "--volume-size", "100K");
  const other = Buffer.from(bytes[2]);
  readFileSync(at("other.0002.pages")).copy(other, 0, 0, Math.min(other.length, readFileSync(at("other.0002.pages")).length));
  await told([bytes[1], other, ...bytes.slice(3)], /volume 2 is not volume 2 of/);
  const [file, first] = ["in.chpm", names[0]].map((name, i) => new File([bytes[i]], name));
  await assert.rejects(async () => everything(await open(blobSource(file, [file, first]))), /in\.0002\.pages is not here/);
  await assert.rejects(async () => everything(await open(blobSource(file))), /volumes, which are not here/);
  // A host that has not all of them.
  const host = await serve([folder]);
  host.state.gone.add(names[1]);
  try {
    await assert.rejects(async () => everything(await open(httpSource(`${host.url}/in.chpm`))), /in\.0002\.pages is not there/);
  } finally {
    host.close();
  }
});

test("no table of volumes is believed", { skip }, async () => {
  const names = build("raw");
  const bytes = ["in.chpm", ...names].map((name) => readFileSync(at(name)));
  for (let at = 0; at < 4096; at += 7) {
    const damaged = Buffer.from(bytes[0]);
    damaged[at] ^= 0x40;
    // Either it is refused, or what was changed is nothing that is read.
    await open(memorySource(damaged, bytes.slice(1))).catch((error) => assert.ok(error instanceof ChpmError, String(error)));
  }
  writeFileSync(at("short.chpm"), bytes[0].subarray(0, bytes[0].length - 1));
  await assert.rejects(open(memorySource(readFileSync(at("short.chpm")))), /cut short/);
});

test("a read looks at few of many volumes", async () => {
  let looks = 0;
  const volumes = Array.from({ length: 4096 }, (_, i) => ({ length: 10, get offset() { return looks++, 1000 + 10 * i; } }));
  const bytes = (number) => ({ name: `${number}`, size: async () => 4106, read: async (offset, length) => new Uint8Array(length).fill(number) });
  const main = { name: "main", read: async (_, length) => new Uint8Array(length), volume: bytes };
  const read = async (offset, length) => [...(await volumesSource(main, volumes).read(offset, length))];
  assert.deepEqual(await read(21508, 4), [51, 51, 52, 52].map((byte) => byte + 2000 & 255));
  assert.deepEqual(await read(998, 4), [0, 0, 1, 1]);
  assert.deepEqual(await read(1000 + 40950, 10), Array(10).fill(4096 & 255));
  assert.ok(looks < 200, `${looks} looks`);
});
