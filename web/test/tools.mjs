// What the tests share: the command, meshes as it writes them, and files that are changed with their checksums made right again.

import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
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

/** Makes all checksums right again, but those of pages that are not in `pages`. */
export function repaired(bytes, pages = []) {
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
    if (kind !== 6) view.setBigUint64(at + 32, xxh3(part(offset, length)), true);
  }
  view.setBigUint64(240, xxh3(part(256, 40 * count)), true);
  view.setBigUint64(248, xxh3(part(0, 248)), true);
  return { bytes, sections };
}
