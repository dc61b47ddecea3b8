// Records of fixed size, as the file format lays them out: the header, the section table, clusters and groups.

import { ChpmError } from "./source.js";

/** An id that names nothing. */
export const NONE = 0xffffffff;
export const CLUSTERS = 1;
export const GROUPS = 2;
export const MEMBERS = 3;
export const SCALARS = 7;
export const TEXTURES = 8;
export const TEXELS = 9;
export const VOLUMES = 10;
export const PAGES = 6;
export const CHUNKS = 0x80000001;

const HEADER_LEN = 256;
const ENTRY_LEN = 40;
const MAX_SECTIONS = 64;
const KINDS = { 1: 128, 2: 64, 3: 4, 4: 128, 5: 0, 6: 0, 7: 0, 8: 64, 9: 0, 10: 24 };
/** Types of scalars, by their numbers less one. */
const SCALAR_TYPES = ["int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"];
const MAGIC = [0x89, 0x43, 0x48, 0x50, 0x4d, 0x0d, 0x0a, 0x1a];
/** Features of a file that whoever reads it has to know. */
const PACKED = 1;
const OCTAHEDRAL = 2;
const SCALARS_FLAG = 4;
const SHEETS = 8;
/** As version 1.7 had it, which was never released. */
const OUTDATED_CHAINED = 16;
const CHAINED = 32;
const VOLUMES_FLAG = 64;

export function expect(is, message) {
  if (!is) throw new ChpmError(message());
}

export function viewOf(bytes) {
  return new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
}

// Offsets are below 2^53 in any file that a browser can reach.
export function u64(view, at) {
  const value = view.getBigUint64(at, true);
  expect(value <= BigInt(Number.MAX_SAFE_INTEGER), () => `a number of ${value} at byte ${at} is too large`);
  return Number(value);
}

function floats(view, at, count) {
  return Array.from({ length: count }, (_, i) => view.getFloat32(at + 4 * i, true));
}

export function readHeader(bytes, xxh3) {
  expect(bytes.byteLength >= HEADER_LEN, () => `no .chpm file: ${bytes.byteLength} bytes are less than a header`);
  expect(MAGIC.every((byte, i) => bytes[i] === byte), () => "no .chpm file: it does not begin like one");
  const view = viewOf(bytes);
  const major = view.getUint16(8, true);
  expect(major === 1, () => `version ${major} of the format; this reader knows version 1`);
  const sum = view.getBigUint64(248, true);
  expect(xxh3(bytes.subarray(0, 248)) === sum, () => "the header is damaged: its checksum is another one");
  const required = view.getUint32(16, true);
  expect((required & OUTDATED_CHAINED) === 0, () => `the file has chained pages of version 1.7, not of 1.8: build it again (${required})`);
  expect((required & ~(PACKED | OCTAHEDRAL | SCALARS_FLAG | SHEETS | CHAINED | VOLUMES_FLAG)) === 0, () => `the file uses features that this reader does not know (${required})`);

  const header = {
    versionMinor: view.getUint16(10, true),
    isPacked: (required & PACKED) !== 0,
    hasSheets: (required & SHEETS) !== 0,
    /** Whether packed pages may rest on one above. */
    isChained: (required & CHAINED) !== 0,
    /** Whether pages are in files of their own. */
    hasVolumes: (required & VOLUMES_FLAG) !== 0,
    fileLength: u64(view, 24),
    sectionCount: view.getUint32(32, true),
    pageAlign: view.getUint32(40, true),
    /** Normals as three singles, or as three bytes. */
    hasFloatNormals: (view.getUint32(44, true) & 1) !== 0,
    hasOctahedralNormals: (view.getUint32(44, true) & 4) !== 0,
    hasNormals: (view.getUint32(44, true) & 5) !== 0,
    hasColors: (view.getUint32(44, true) & 2) !== 0,
    /** Words of a vertex's named scalars. */
    scalarWords: (view.getUint32(44, true) >>> 8) & 255,
    sourceVertexCount: u64(view, 48),
    sourceTriangleCount: u64(view, 56),
    clusterCount: view.getUint32(64, true),
    groupCount: view.getUint32(68, true),
    levelCount: view.getUint32(72, true),
    rootCount: view.getUint32(76, true),
    leafCount: view.getUint32(80, true),
    isCertified: view.getUint32(88, true) === 1,
    sharedVertexCount: view.getUint32(92, true),
    origin: [96, 104, 112].map((at) => view.getFloat64(at, true)),
    boxMin: floats(view, 120, 3),
    boxMax: floats(view, 132, 3),
    maxError: view.getFloat32(144, true),
  };
  expect(view.getUint32(12, true) === HEADER_LEN, () => "header_len is not 256");
  expect(view.getUint32(36, true) === HEADER_LEN, () => "section_table_offset is not 256");
  expect(!header.isChained || (header.isPacked && !header.hasSheets), () => `the file has features that do not go together (${required})`);
  const isOctahedral = (required & OCTAHEDRAL) !== 0;
  const hasScalars = (required & SCALARS_FLAG) !== 0;
  const areKnown = (view.getUint32(44, true) & ~0xff07) === 0 && header.scalarWords > 0 === hasScalars && header.hasOctahedralNormals === isOctahedral && !(isOctahedral && header.hasFloatNormals);
  expect(areKnown, () => "the file has attributes that this reader does not know");
  expect(header.sectionCount <= MAX_SECTIONS, () => `${header.sectionCount} sections; at most ${MAX_SECTIONS} are allowed`);
  expect(header.pageAlign >= 4 && header.pageAlign <= 4096, () => `pages aligned to ${header.pageAlign}`);
  expect([...header.origin, ...header.boxMin, ...header.boxMax, header.maxError].every(Number.isFinite), () => "a number of the header is not finite");
  const { clusterCount, groupCount, rootCount } = header;
  expect(clusterCount >= 1 && groupCount >= 1, () => "there are no clusters");
  expect(rootCount >= 1 && rootCount <= clusterCount, () => `${rootCount} roots of ${clusterCount} clusters`);
  return { ...header, sectionTableChecksum: view.getBigUint64(240, true) };
}

/** The sections by kind. `bytes` begin where the file does. */
export function readSections(header, bytes, xxh3) {
  const end = HEADER_LEN + ENTRY_LEN * header.sectionCount;
  const table = bytes.subarray(HEADER_LEN, end);
  expect(table.byteLength === end - HEADER_LEN, () => "the section table is not all there");
  expect(xxh3(table) === header.sectionTableChecksum, () => "the section table is damaged: its checksum is another one");
  const view = viewOf(table);
  const sections = new Map();
  let before = end;
  for (let at = 0; at < table.byteLength; at += ENTRY_LEN) {
    const section = {
      kind: view.getUint32(at, true),
      recordLength: view.getUint32(at + 4, true),
      offset: u64(view, at + 8),
      length: u64(view, at + 16),
      count: u64(view, at + 24),
      checksum: view.getBigUint64(at + 32, true),
    };
    const { kind, recordLength, offset, length, count } = section;
    expect(kind in KINDS || kind >= 0x80000000, () => `section kind ${kind} is not known to this reader`);
    expect(!sections.has(kind), () => `section kind ${kind} occurs twice`);
    expect(offset >= before && length <= header.fileLength - offset, () => `section kind ${kind} lies outside the file, or over another`);
    if (kind in KINDS) expect(recordLength === KINDS[kind], () => `records of section kind ${kind} have ${recordLength} bytes`);
    if (recordLength > 0) expect(length === count * recordLength, () => `section kind ${kind} has ${length} bytes for ${count} records`);
    before = offset + length;
    sections.set(kind, section);
  }
  for (const kind in KINDS) {
    const isOfSheets = Number(kind) === TEXTURES || Number(kind) === TEXELS;
    const isOptional = Number(kind) === VOLUMES ? header.hasVolumes : Number(kind) !== SCALARS || header.scalarWords > 0;
    const isNeeded = isOfSheets ? header.hasSheets : isOptional;
    expect(sections.has(Number(kind)) === isNeeded, () => `section kind ${kind} is ${isNeeded ? "missing" : "there without what it is of"}`);
  }
  const counts = [[CLUSTERS, header.clusterCount], [GROUPS, header.groupCount]];
  for (const [kind, count] of counts) {
    expect(sections.get(kind).count === count, () => `section kind ${kind} has ${sections.get(kind).count} records, the header says ${count}`);
  }
  return sections;
}

/** The named scalars that a section lists: name, type, range, and the place of the words. */
export function readScalars(header, section, bytes) {
  const wrong = "the list of scalars is none";
  const view = viewOf(bytes);
  const scalars = [];
  let [at, word] = [0, 0];
  for (let i = 0; i < section.count; i++) {
    expect(at + 32 <= bytes.byteLength, () => wrong);
    const type = SCALAR_TYPES[view.getUint16(at, true) - 1];
    const length = view.getUint16(at + 2, true);
    expect(type && length > 0 && at + 32 + length <= bytes.byteLength, () => wrong);
    const words = ["int32", "uint32", "float64"].includes(type) ? 2 : 1;
    scalars.push({
      name: new TextDecoder().decode(bytes.subarray(at + 32, at + 32 + length)),
      type,
      low: view.getFloat64(at + 8, true),
      high: view.getFloat64(at + 16, true),
      count: u64(view, at + 24),
      word,
      words,
    });
    word += words;
    at += 32 + 8 * Math.ceil(length / 8);
  }
  expect(at === bytes.byteLength && word === header.scalarWords, () => wrong);
  return scalars;
}

function sphere(view, at, what) {
  const [x, y, z, radius] = floats(view, at, 4);
  expect([x, y, z, radius].every(Number.isFinite) && radius >= 0, () => `${what}: its sphere is none`);
  return { center: [x, y, z], radius };
}

function errors(view, at, what) {
  const [minError, maxError] = floats(view, at, 2);
  const are = minError >= 0 && minError <= maxError && Number.isFinite(maxError);
  expect(are, () => `${what}: errors of ${minError} to ${maxError}`);
  return { minError, maxError };
}

/** Bytes of a page that is not packed. */
export function pageLength(header, cluster) {
  const { vertexCount: v, baseVertexCount: b, triangleCount: t, sharedCount: s } = cluster;
  const attributes = (header.hasFloatNormals ? 12 : 0) + (header.hasOctahedralNormals ? 3 : 0) + (header.hasColors ? 4 : 0) + 4 * header.scalarWords;
  return 64 + (12 + attributes) * v + 4 * s + 6 * t + 4 * (v - b) + Math.ceil(v / 8);
}

export function readCluster(header, pages, view, id) {
  const what = `cluster ${id}`;
  const u32 = (at) => view.getUint32(at, true);
  const cluster = {
    id,
    pageOffset: u64(view, 0),
    pageLength: u32(8),
    level: u32(12),
    vertexCount: u32(16),
    baseVertexCount: u32(20),
    triangleCount: u32(24),
    baseTriangleCount: u32(28),
    sharedCount: u32(32),
    group: u32(36),
    parentGroup: u32(40),
    isPacked: header.isPacked && (u32(44) & 2) !== 0,
    ...errors(view, 48, what),
    boxMin: floats(view, 56, 3),
    boxMax: floats(view, 68, 3),
    sphere: sphere(view, 80, what),
    pageChecksum: view.getBigUint64(96, true),
  };
  const { vertexCount: v, baseVertexCount: b, triangleCount: t, parentGroup } = cluster;
  const box = cluster.boxMin.every((x, axis) => Number.isFinite(x) && x <= cluster.boxMax[axis] && Number.isFinite(cluster.boxMax[axis]));
  expect(box, () => `${what}: its box is none`);
  expect(cluster.level < header.levelCount, () => `${what}: level ${cluster.level} of ${header.levelCount}`);
  expect(v <= 0xffff && b >= 1 && b <= v, () => `${what}: ${v} vertices, ${b} of them in the base mesh`);
  expect(cluster.baseTriangleCount <= t && cluster.sharedCount <= v, () => `${what}: counts are out of range`);
  expect(cluster.group < header.groupCount, () => `${what}: group ${cluster.group} of ${header.groupCount}`);
  expect(parentGroup === NONE || parentGroup < header.groupCount, () => `${what}: parent group ${parentGroup} of ${header.groupCount}`);
  const whole = pageLength(header, cluster);
  const length = cluster.pageLength;
  const fits = cluster.isPacked ? length >= Math.ceil(whole / 64) && length < whole : length === whole;
  expect(fits, () => `${what}: a page of ${length} bytes, not ${whole}`);
  const { offset, length: all } = pages;
  const inside = cluster.pageOffset >= offset && cluster.pageOffset + length <= offset + all;
  expect(inside && cluster.pageOffset % header.pageAlign === 0, () => `${what}: its page is not where pages are`);
  return cluster;
}

export function readGroup(header, members, view, id) {
  const what = `group ${id}`;
  const u32 = (at) => view.getUint32(at, true);
  const group = {
    id,
    coarseFirst: u32(0),
    coarseCount: u32(4),
    fineFirst: u32(8),
    fineCount: u32(12),
    level: u32(16),
    ...errors(view, 24, what),
    sphere: sphere(view, 32, what),
    fineGap: view.getFloat32(48, true),
    baseGap: view.getFloat32(52, true),
    gapError: view.getFloat32(56, true),
  };
  expect(group.level < header.levelCount, () => `${what}: level ${group.level} of ${header.levelCount}`);
  expect(group.coarseCount >= 1, () => `${what}: no coarse clusters`);
  expect((group.level === 0) === (group.fineCount === 0), () => `${what}: ${group.fineCount} fine clusters at level ${group.level}`);
  const ends = [group.coarseFirst + group.coarseCount, group.fineFirst + group.fineCount];
  expect(ends.every((end) => end <= members.count), () => `${what}: its members are out of range`);
  if (header.versionMinor === 0) {
    // Nothing is known of what vanished.
    return Object.assign(group, { fineGap: Infinity, baseGap: Infinity, gapError: 0 });
  }
  const { fineGap, baseGap, gapError } = group;
  const gaps = Number.isFinite(baseGap) && 0 <= fineGap && fineGap <= baseGap && gapError >= 0 && Number.isFinite(gapError);
  expect(gaps, () => `${what}: gaps of ${fineGap} to ${baseGap}`);
  return group;
}
