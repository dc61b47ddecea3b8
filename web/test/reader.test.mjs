// The reader beside the command: the same triangles, and nothing but clear errors for damaged files.

import assert from "node:assert/strict";
import { execFileSync, spawnSync } from "node:child_process";
import { readFileSync, writeFileSync } from "node:fs";
import path from "node:path";
import { test } from "node:test";
import { ChpmError, camera, distance, extract, level, memorySource, open, select, selectFromMemory, uniform } from "../chpm/index.js";
import { xxh3 } from "../chpm/xxh3.js";
import { expand } from "../chpm/zstd.js";
import { CHPM, chpm, random, repaired, temporary, trianglesOfMesh, trianglesOfPly } from "./tools.mjs";

const skip = CHPM ? false : "CHPM names no command";
const folder = temporary();

/** Generated models: an open one, one of many parts, one in doubles far from the origin, one with normals and colours. */
const MODELS = {
  terrain: () => generated("terrain", 20000),
  isosurface: () => generated("isosurface", 30000),
  parts: () => generated("hard:components", 4000),
  far: () => generated("hard:far-double", 8000),
  computed: () => generated("hard:cylinder", 6000),
  colored: () => waves(60),
};

function generated(kind, triangles) {
  const source = path.join(folder, `${kind.replace(":", "-")}.ply`);
  chpm("synth", kind, "--triangles", String(triangles), "-o", source, "-f", "-q");
  return source;
}

/** A wavy sheet whose vertices have normals and colours. */
function waves(side) {
  const source = path.join(folder, "waves.ply");
  const vertices = [];
  const faces = [];
  for (let y = 0; y < side; y++) {
    for (let x = 0; x < side; x++) {
      vertices.push(`${x} ${y} ${Math.sin(x / 3) * Math.cos(y / 4)} 0 0 1 ${(4 * x) & 255} ${(4 * y) & 255} ${(x * y) & 255}`);
      const at = y * side + x;
      if (x > 0 && y > 0) faces.push(`3 ${at} ${at - 1} ${at - side}`, `3 ${at - 1} ${at - side - 1} ${at - side}`);
    }
  }
  const names = ["x", "y", "z", "nx", "ny", "nz"].map((name) => `property float ${name}`);
  const colors = ["red", "green", "blue"].map((name) => `property uchar ${name}`);
  const header = ["ply", "format ascii 1.0", `element vertex ${vertices.length}`, ...names, ...colors, `element face ${faces.length}`];
  writeFileSync(source, [...header, "property list uchar int vertex_indices", "end_header", ...vertices, ...faces, ""].join("\n"));
  return source;
}

function build(model) {
  const source = MODELS[model]();
  const file = source.replace(/ply$/, "chpm");
  const normals = model === "computed" ? ["--normals", "computed"] : [];
  chpm("build", source, "-o", file, "-f", "-q", "--pages", "raw", "--cluster-triangles", "256", ...normals);
  return file;
}

const norms = (normals) => Array.from({ length: normals.length / 3 }, (_, i) => Math.hypot(...normals.subarray(3 * i, 3 * i + 3)));

/** A sheet whose vertices have a quality, a time in doubles and a class, of which some are no number; and these by place. */
function named(side) {
  const source = path.join(folder, "named.ply");
  const [vertices, faces, values] = [[], [], new Map()];
  for (let y = 0; y < side; y++) {
    for (let x = 0; x < side; x++) {
      const [quality, time, kind] = [x % 9 === 4 ? NaN : Math.fround(x / 3), y / 7, (x * y) % 256];
      const z = Math.fround(Math.sin(x / 3) * Math.cos(y / 4));
      vertices.push(`${x} ${y} ${z} ${quality} ${time} ${kind}`);
      values.set(`${x} ${y}`, { quality, time, kind });
      const at = y * side + x;
      if (x > 0 && y > 0) faces.push(`3 ${at} ${at - 1} ${at - side}`, `3 ${at - 1} ${at - side - 1} ${at - side}`);
    }
  }
  const names = ["float x", "float y", "float z", "float quality", "double time", "uchar kind"].map((name) => `property ${name}`);
  const header = ["ply", "format ascii 1.0", `element vertex ${vertices.length}`, ...names, `element face ${faces.length}`];
  writeFileSync(source, [...header, "property list uchar int vertex_indices", "end_header", ...vertices, ...faces, ""].join("\n"));
  return { source, values };
}

test("named scalars are those of the source, packed or not", { skip }, async () => {
  const { source, values } = named(50);
  for (const pages of ["raw", "packed"]) {
    const out = path.join(folder, `named-${pages}.chpm`);
    chpm("build", source, "-o", out, "-f", "-q", "--keep", "all", "--pages", pages, "--cluster-triangles", "256");
    const file = await open(memorySource(new Uint8Array(readFileSync(out))));
    assert.deepEqual(file.header.scalars.map(({ name, type }) => `${name} ${type}`), ["quality float32", "time float64", "kind uint8"]);
    assert.deepEqual([file.header.scalars[2].low, file.header.scalars[2].count], [0, 2500]);
    for (const number of [0, 1, 2]) {
      const mesh = await extract(file, await select(file, level(number)));
      const count = mesh.positions.length / 3;
      assert.ok(number > 0 || count === 2500);
      for (let i = 0; i < count; i++) {
        const expected = values.get(`${mesh.positions[3 * i]} ${mesh.positions[3 * i + 1]}`);
        const got = Object.fromEntries(Object.keys(expected).map((name) => [name, mesh.scalars.get(name)[i]]));
        assert.deepEqual(got, expected);
      }
    }
  }
});

test("sums are those of XXH3", () => {
  // Made with another implementation.
  const sums = [
    [0, 0x2d06800538d394c2n],
    [1, 0x929e358d27ae3ee2n],
    [2, 0xf4861cd45aad8b47n],
    [3, 0xd95f511cd1108231n],
    [4, 0xca1c63ab788ab176n],
    [7, 0xd7280da47cd6d0cen],
    [8, 0xf9e91f27291ff523n],
    [9, 0xcaf43cf2dddbdf84n],
    [15, 0xe9e51bedac6d49c6n],
    [16, 0x1fbdc0fc5c58a1e6n],
    [17, 0xfee0a1ba3ee6ade1n],
    [31, 0x4b0449fbf02cb474n],
    [32, 0x1adce08a0a2bccb1n],
    [33, 0x95572f4bf59a18b5n],
    [63, 0xe4e9aff545ec0de3n],
    [64, 0x90747d80b02e5d03n],
    [65, 0x86c27660247dacf6n],
    [96, 0x3bef0ead69fab8e1n],
    [97, 0x8983a04553a1130cn],
    [128, 0x5852e3f29796b15dn],
    [129, 0xccdd55e72fcbe19an],
    [144, 0xc62c640955ec0025n],
    [200, 0xce99056e36afdebcn],
    [239, 0xc0c12958963c8f23n],
    [240, 0xfd89c11687b8b48an],
    [241, 0xae02df2598c4ffacn],
    [255, 0x72516c713c92e0e1n],
    [256, 0x60cc644797e04413n],
    [257, 0xb8cd1b37f65bbd96n],
    [512, 0x1c878490c27a1453n],
    [1023, 0x253c9fb70332e769n],
    [1024, 0x5a487b950ce18bdan],
    [1025, 0x1e0fb31a274c3954n],
    [1088, 0xe1dfa7e61af4af81n],
    [1089, 0x9cc807c8af5268ffn],
    [2047, 0xca55a01cd7d2d955n],
    [2048, 0x4af2f0321078031dn],
    [2049, 0x61d48507247a571an],
    [5000, 0x5e81b21c8a972975n],
    [16384, 0xb0bebd9ffb2ac74an],
    [100000, 0xb1535246cd3941d0n],  ];
  for (const [length, sum] of sums) {
    const bytes = Uint8Array.from({ length }, (_, i) => (i * 167 + (i >> 8) * 13 + 5) & 255);
    assert.equal(xxh3(bytes), sum, `${length} bytes`);
  }
});

for (const model in MODELS) {
  test(`${model}: cuts have the triangles that the command extracts`, { skip }, async () => {
    const name = build(model);
    const file = await open(memorySource(readFileSync(name)));
    const hasRemnants = JSON.parse(execFileSync(CHPM, ["info", name, "--json"], { encoding: "utf8" })).remnants > 0;
    const next = random(model.length);
    const out = path.join(folder, "cut.ply");
    for (let i = 0; i < 10; i++) {
      const most = file.header.maxError * 10 ** (-4 * next());
      const number = Math.floor(next() * file.header.levelCount);
      const [rule, args] = i % 3 === 2 ? [level(number), ["--level", String(number)]] : [distance(most), ["--error", String(most)]];
      chpm("extract", name, ...args, "-o", out, "-f", "-q");
      const mesh = await extract(file, await select(file, rule));
      // The command draws what is left of dust, where this reader refines for it.
      if (hasRemnants && i % 3 !== 2) {
        assert.ok(trianglesOfMesh(mesh).length >= trianglesOfPly(out).length, args.join(" "));
        continue;
      }
      assert.deepEqual(trianglesOfMesh(mesh), trianglesOfPly(out), args.join(" "));
      assert.equal(mesh.colors !== null, model === "colored");
      assert.equal(mesh.normals !== null, model === "colored" || model === "computed");
      if (model === "computed") assert.ok(norms(mesh.normals).every((norm) => Math.abs(norm - 1) < 1e-5));
    }
  });
}

test("cuts of cameras are whole, however little is in memory", { skip }, async () => {
  const file = await open(memorySource(readFileSync(build("terrain"))));
  const roots = await file.roots();
  const { boxMin, boxMax } = file.header;
  const next = random(7);
  const leaves = file.header.leafCount;
  for (let i = 0; i < 20; i++) {
    const eye = boxMin.map((x, axis) => x + (boxMax[axis] - x) * (3 * next() - 1));
    const rule = camera({ eye, fov: 45, height: 600, pixels: 4 * next() });
    const all = await select(file, rule);
    assert.deepEqual(await select(file, rule), all);
    const drawable = new Set(roots);
    for (const { cluster } of all) if (next() < 0.7) drawable.add(cluster);
    const { cut } = selectFromMemory(file, roots, rule, (id) => drawable.has(id));
    assert.ok(cut.every(({ cluster }) => drawable.has(cluster)));
    assert.ok(cut.length >= 1 && all.length <= leaves);
  }
});

test("a single error everywhere keeps to it", { skip }, async () => {
  const file = await open(memorySource(readFileSync(build("isosurface"))));
  for (const share of [1e-4, 1e-2, 0.1, 1]) {
    const { error } = await extract(file, await select(file, uniform(share * file.header.maxError)));
    assert.ok(error <= share * file.header.maxError);
  }
});

const fzstd = await import("fzstd").catch(() => null);
const skipOther = skip || (fzstd ? false : "no fzstd: `npm ci` in this folder");

/** Another decoder of zstd: more than `most` is refused. */
function zstd(frame, most) {
  const all = new Uint8Array(most);
  let length = 0;
  const take = (chunk) => {
    all.set(chunk, length);
    length += chunk.length;
  };
  new fzstd.Decompress(take).push(frame, true);
  return all.subarray(0, length);
}

/** A file with packed or chained pages, of a model whose positions are on a lattice where that is asked for. */
function pack(model, positions, pages = "packed") {
  const name = build(model);
  const packed = name.replace(/chpm$/, `${pages}.chpm`);
  if (positions) chpm("build", name.replace(/chpm$/, "ply"), "-o", packed, "-f", "-q", "--pages", pages, "--positions", positions, "--cluster-triangles", "256");
  else chpm("relayout", name, "-o", packed, "-f", "-q", "--pages", pages);
  return packed;
}

for (const [model, positions] of [...Object.keys(MODELS).map((model) => [model]), ["terrain", "lattice:14"]]) {
  test(`${model} ${positions ?? ""}: packed pages have the same triangles`, { skip }, async () => {
    const name = pack(model, positions);
    const bytes = readFileSync(name);
    const file = await open(memorySource(bytes));
    assert.ok(file.header.isPacked);
    const out = path.join(folder, "unpacked.ply");
    for (let number = 0; number < file.header.levelCount; number++) {
      chpm("extract", name, "--level", String(number), "-o", out, "-f", "-q");
      const mesh = await extract(file, await select(file, level(number)));
      assert.deepEqual(trianglesOfMesh(mesh), trianglesOfPly(out), `level ${number}`);
    }
    // What the vertices carry, and every error, is that of the raw pages.
    if (!positions) {
      const raw = await open(memorySource(readFileSync(build(model))));
      const ids = Array.from({ length: file.header.clusterCount }, (_, id) => id);
      await file.needClusters(ids);
      await raw.needClusters(ids);
      const [one, other] = [await file.pages(ids), await raw.pages(ids)];
      for (const id of ids) {
        const [{ cluster: a, ...parts }, { cluster: b, ...expected }] = [one.get(id), other.get(id)];
        assert.deepEqual(parts, expected, `page ${id}`);
      }
    }
  });
}

for (const [model, positions] of [...Object.keys(MODELS).map((model) => [model]), ["terrain", "lattice:14"]]) {
  test(`${model} ${positions ?? ""}: chained pages have the same triangles`, { skip }, async () => {
    const [packed, name] = [pack(model, positions), pack(model, positions, "chained")];
    const bytes = readFileSync(name);
    assert.ok(bytes.length < readFileSync(packed).length);
    // Of a file whose finest pages are asked for first, those above come with them.
    for (const options of [{}, { first: 4096 }]) {
      const [file, other] = [await open(memorySource(bytes), options), await open(memorySource(readFileSync(packed)), options)];
      assert.ok(file.header.isChained && !other.header.isChained);
      for (let number = 0; number < file.header.levelCount; number++) {
        const [mesh, expected] = [await extract(file, await select(file, level(number))), await extract(other, await select(other, level(number)))];
        assert.deepEqual(trianglesOfMesh(mesh), trianglesOfMesh(expected), `level ${number}`);
      }
      await file.needTables();
      await other.needTables();
      const ids = Array.from({ length: file.header.clusterCount }, (_, id) => id);
      const [own, others] = [await file.pages(ids), await other.pages(ids)];
      for (const id of ids) {
        const { cluster, ...parts } = own.get(id);
        const { cluster: _, ...expected } = others.get(id);
        assert.deepEqual(parts.errorCodes, expected.errorCodes);
        // What all vertices carry is the same, in whatever order those of the base mesh are.
        const rows = ({ positions, normals, colors, words }) =>
          Array.from({ length: cluster.vertexCount }, (_, v) => [[positions, 3], [normals ?? [], 3], [colors ?? [], 4], [words, words.length / cluster.vertexCount]].flatMap(([of, each]) => [...of.slice(each * v, each * v + each)]).join()).sort();
        assert.deepEqual(rows(parts), rows(expected), `page ${id}`);
      }
    }
  });
}

/** Bytes of all kinds: noise, repetitions, few values, waves, text; as zstd has blocks, codes and matches for them. */
function* samples() {
  const next = random(14);
  for (let i = 0; i < 60; i++) {
    const length = Math.floor(300000 ** next());
    yield Uint8Array.from({ length }, () => 256 * next() ** (i % 7));
    yield Uint8Array.from({ length }, (_, at) => 120 + 20 * Math.sin(at / 50) + (i % 3) * next());
    yield Uint8Array.from({ length }, (_, at) => (at % (1 + (i % 40))) + (next() < 0.01 ? 1 : 0));
  }
}

const program = spawnSync("zstd", ["--version"]).status === 0 ? false : "no command zstd";

test("zstd expands to what was packed", { skip: program }, () => {
  const ways = [["-1"], ["-19"], ["-3", "--no-check"], ["--fast=5"], ["-9", "--no-content-size"]];
  let count = 0;
  for (const bytes of samples()) {
    const way = ways[count++ % ways.length];
    const frame = new Uint8Array(execFileSync("zstd", ["-q", "-c", ...way], { input: bytes, maxBuffer: 1 << 24 }));
    assert.deepEqual(expand(frame, bytes.length), bytes, `sample ${count}, ${way}`);
    if (bytes.length > 0) assert.throws(() => expand(frame, bytes.length - 1), /zstd frame is damaged/);
    for (const end of [0, 3, 8, frame.length >> 1, frame.length - 1]) {
      assert.throws(() => expand(frame.subarray(0, end), bytes.length), /zstd frame is damaged/, `sample ${count}, cut at ${end}`);
    }
  }
});

test("damaged zstd is refused, or something else comes out", { skip: program }, () => {
  const next = random(15);
  const pick = (count) => Math.floor(next() * count);
  let refused = 0;
  for (const bytes of samples()) {
    const frame = new Uint8Array(execFileSync("zstd", ["-q", "-c", "-5", "--no-check"], { input: bytes, maxBuffer: 1 << 24 }));
    for (let i = 0; i < 20; i++) {
      const damaged = frame.slice();
      damaged[pick(Math.min(frame.length, i % 2 === 0 ? 40 : Infinity))] ^= 1 << pick(8);
      try {
        assert.ok(expand(damaged, bytes.length).length <= bytes.length);
      } catch (error) {
        assert.match(error.message, /zstd frame is damaged/);
        refused += 1;
      }
    }
  }
  assert.ok(refused > 1000, `${refused} of 3600`);
});

test("both decoders of zstd read packed pages alike", { skip: skipOther }, async () => {
  const bytes = readFileSync(pack("colored"));
  const [own, other] = [await open(memorySource(bytes)), await open(memorySource(bytes), { zstd })];
  assert.deepEqual(await extract(own, await select(own, level(0))), await extract(other, await select(other, level(0))));
});

for (const pages of ["packed", "chained"]) test(`damaged ${pages} pages with right checksums are survived`, { skip }, async () => {
  const whole = new Uint8Array(readFileSync(pack("colored", undefined, pages)));
  const { sections } = repaired(whole.slice());
  const clusters = sections.find(({ kind }) => kind === 1);
  const next = random(13);
  const pick = (count) => Math.floor(next() * count);
  let refused = 0;
  for (let i = 0; i < 400; i++) {
    const bytes = whole.slice();
    const view = new DataView(bytes.buffer);
    const record = clusters.offset + 128 * pick(clusters.length / 128);
    const [start, length] = [Number(view.getBigUint64(record, true)), view.getUint32(record + 8, true)];
    // Half of them in the head, where counts and lengths are.
    const at = start + pick(i % 2 === 0 ? 48 : length);
    bytes[at] = pick(256);
    repaired(bytes, [(record - clusters.offset) / 128]);
    if (!(await survives(bytes, `case ${i}: byte ${at - start} of a page`))) refused += 1;
  }
  assert.ok(refused > 100, `${refused} of 400 were refused`);
});

/** Opens a file and reads all of it. What is wrong has to be said as an error of the reader. */
async function readAll(bytes, options) {
  const file = await open(memorySource(bytes), options);
  await extract(file, await select(file, level(0)));
  await extract(file, await select(file, uniform(file.header.maxError / 50)));
}

async function survives(bytes, what, options) {
  try {
    await readAll(bytes, options);
    return true;
  } catch (error) {
    assert.ok(error instanceof ChpmError, `${what}: ${error.stack}`);
    return false;
  }
}

test("damage is named", { skip }, async () => {
  const whole = new Uint8Array(readFileSync(build("colored")));
  await readAll(whole);
  for (const length of [0, 7, 255, 256, 400, 4096, whole.length >> 1, whole.length - 1]) {
    assert.equal(await survives(whole.slice(0, length), `cut at ${length}`), false, `cut at ${length}`);
  }
  // The header, the sections, the tables, and the pages of leaves are read; all else may be as it likes.
  const { sections } = repaired(whole.slice());
  const file = await open(memorySource(whole));
  const leaves = (await select(file, level(0))).map(({ cluster }) => file.cluster(cluster));
  const pages = leaves.map(({ pageOffset: offset, pageLength: length }) => ({ offset, length }));
  const read = [{ offset: 0, length: 256 + 40 * sections.length }, ...sections.filter(({ kind }) => kind <= 3 || kind === 0x80000001), ...pages];
  const next = random(11);
  for (let i = 0; i < 200; i++) {
    const bytes = whole.slice();
    const { offset, length } = read[Math.floor(next() * read.length)];
    const at = offset + Math.floor(next() * length);
    bytes[at] ^= 1 << Math.floor(next() * 8);
    assert.equal(await survives(bytes, `byte ${at}`), false, `byte ${at}`);
  }
});

test("damage with right checksums is survived", { skip }, async () => {
  const whole = new Uint8Array(readFileSync(build("colored")));
  const { sections } = repaired(whole.slice());
  const values = [0, 1, 2, 0x7f, 0xff, 0xffff, 0x7fffffff, 0xfffffffe, 0xffffffff, 0x7f800000, 0x7fc00000];
  const next = random(12);
  const pick = (count) => Math.floor(next() * count);
  let refused = 0;
  for (let i = 0; i < 600; i++) {
    const bytes = whole.slice();
    const view = new DataView(bytes.buffer);
    const { kind, offset, length } = sections.filter(({ length }) => length > 0)[pick(sections.length)];
    const clusters = sections.find((section) => section.kind === 1);
    let pages = [];
    let at = offset + 4 * pick(length >> 2);
    if (i % 9 === 0) at = 4 * pick(64 + 10 * sections.length);
    if (kind === 6) {
      const id = pick(clusters.length / 128);
      pages = [id];
      at = Number(view.getBigUint64(clusters.offset + 128 * id, true)) + 4 * pick(view.getUint32(clusters.offset + 128 * id + 8, true) >> 2);
    }
    const value = next() < 0.3 ? view.getUint32(at, true) + pick(5) - 2 : values[pick(values.length)];
    view.setUint32(at, value, true);
    try {
      repaired(bytes, pages);
    } catch (error) {
      // The places of sections themselves were changed: then sums stay wrong.
      assert.ok(error instanceof RangeError || error instanceof TypeError);
    }
    if (!(await survives(bytes, `case ${i}: ${value} at ${at}, section ${kind}`))) refused += 1;
  }
  assert.ok(refused > 100, `${refused} of 600 were refused`);
});
