// What the tests share: the command, meshes as it writes them, and files that are changed with their checksums made right again.

import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { deflateSync } from "node:zlib";
import { xxh3 } from "../chpm/xxh3.js";

/** The command, as the tests of the project name it. */
export const CHPM = process.env.CHPM;

export function chpm(...args) {
  return execFileSync(CHPM, args, { encoding: "utf8", stdio: ["ignore", "pipe", "pipe"] });
}

/** A folder that goes when the tests end. */
export function temporary() {
  const folder = mkdtempSync(path.join(tmpdir(), "chpm-web-"));
  process.on("exit", () => rmSync(folder, { recursive: true, force: true }));
  return folder;
}

/** Numbers from a seed (mulberry32). */
export function random(seed) {
  return () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
  };
}

/** The triangles of a binary PLY, each as text of its corners' coordinates from the least corner on, sorted. */
export function trianglesOfPly(name) {
  const bytes = readFileSync(name);
  const end = bytes.indexOf("end_header\n") + "end_header\n".length;
  const header = bytes.subarray(0, end).toString("latin1");
  const count = (element) => Number(new RegExp(`element ${element} (\\d+)`).exec(header)[1]);
  const vertex = header.slice(header.indexOf("element vertex"), header.indexOf("element face"));
  const sizes = { float: 4, double: 8, uchar: 1, int: 4, uint: 4 };
  const properties = [...vertex.matchAll(/property (\w+) (\w+)/g)];
  const stride = properties.reduce((sum, [, type]) => sum + sizes[type], 0);
  const view = new DataView(bytes.buffer, bytes.byteOffset + end);
  const isDouble = properties[0][1] === "double";
  const read = (at) => (isDouble ? view.getFloat64(at, true) : view.getFloat32(at, true));
  const point = (i) => [0, 1, 2].map((axis) => read(i * stride + axis * (isDouble ? 8 : 4)));
  const faces = count("vertex") * stride;
  const triangles = [];
  for (let i = 0; i < count("face"); i++) {
    triangles.push([1, 5, 9].map((at) => point(view.getUint32(faces + 13 * i + at, true))));
  }
  return inOrder(triangles);
}

/** The same of a mesh that the reader made. */
export function trianglesOfMesh({ positions, triangles }) {
  const point = (i) => [...positions.subarray(3 * i, 3 * i + 3)];
  return inOrder(Array.from({ length: triangles.length / 3 }, (_, t) => [0, 1, 2].map((corner) => point(triangles[3 * t + corner]))));
}

function inOrder(triangles) {
  const turned = (corners) => {
    const texts = corners.map((corner) => corner.join(" "));
    const first = texts.indexOf([...texts].sort()[0]);
    return [0, 1, 2].map((i) => texts[(first + i) % 3]).join(", ");
  };
  return triangles.map(turned).sort();
}

/** The remainder that parts of a PNG end with. */
function crc(bytes) {
  let sum = ~0;
  for (const byte of bytes) {
    sum ^= byte;
    for (let bit = 0; bit < 8; bit++) sum = (sum >>> 1) ^ (sum & 1 ? 0xedb88320 : 0);
  }
  return ~sum >>> 0;
}

/** A PNG of a square; `color` answers red, green and blue by column and row, from 0 to 1, the lowest row first. */
export function png(side, color) {
  const part = (name, data) => {
    const bytes = Buffer.alloc(12 + data.length);
    bytes.writeUInt32BE(data.length, 0);
    bytes.write(name, 4, "latin1");
    bytes.set(data, 8);
    bytes.writeUInt32BE(crc(bytes.subarray(4, -4)), 8 + data.length);
    return bytes;
  };
  const head = Buffer.alloc(13);
  head.writeUInt32BE(side, 0);
  head.writeUInt32BE(side, 4);
  head.set([8, 2, 0, 0, 0], 8);
  const rows = Buffer.alloc(side * (1 + 3 * side));
  for (let y = 0; y < side; y++) {
    for (let x = 0; x < side; x++) rows.set(color((x + 0.5) / side, 1 - (y + 0.5) / side), y * (1 + 3 * side) + 1 + 3 * x);
  }
  const signature = Buffer.from([0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a]);
  return Buffer.concat([signature, part("IHDR", head), part("IDAT", deflateSync(rows)), part("IEND", Buffer.alloc(0))]);
}

/** Makes all checksums right again, but those of pages that are not in `pages`, and of sheets that are not in `sheets`. */
export function repaired(bytes, pages = [], sheets = []) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const count = view.getUint32(32, true);
  const sections = Array.from({ length: count }, (_, i) => {
    const at = 256 + 40 * i;
    return { at, kind: view.getUint32(at, true), offset: Number(view.getBigUint64(at + 8, true)), length: Number(view.getBigUint64(at + 16, true)) };
  });
  const part = (offset, length) => bytes.subarray(offset, offset + length);
  const clusters = sections.find(({ kind }) => kind === 1);
  for (const id of pages) {
    const at = clusters.offset + 128 * id;
    view.setBigUint64(at + 96, xxh3(part(Number(view.getBigUint64(at, true)), view.getUint32(at + 8, true))), true);
  }
  for (const id of sheets) {
    const [records, texels] = [8, 9].map((kind) => sections.find((section) => section.kind === kind));
    const at = records.offset + 64 * id;
    view.setBigUint64(at + 40, xxh3(part(texels.offset + Number(view.getBigUint64(at + 8, true)), view.getUint32(at + 16, true) + view.getUint32(at + 20, true))), true);
  }
  const chunks = sections.find(({ kind }) => kind === 0x80000001);
  if (chunks) {
    const chunkLength = Number(view.getBigUint64(chunks.offset, true));
    let at = chunks.offset + 8;
    for (const { offset, length } of [1, 2, 3].map((kind) => sections.find((section) => section.kind === kind))) {
      for (let start = 0; start < length; start += chunkLength, at += 8) {
        view.setBigUint64(at, xxh3(part(offset + start, Math.min(chunkLength, length - start))), true);
      }
    }
  }
  for (const { at, kind, offset, length } of sections) {
    if (kind !== 6 && kind !== 9) view.setBigUint64(at + 32, xxh3(part(offset, length)), true);
  }
  view.setBigUint64(240, xxh3(part(256, 40 * count)), true);
  view.setBigUint64(248, xxh3(part(0, 248)), true);
  return { bytes, sections };
}
