// XXH3, 64 bits, seed 0: the checksum of the file format. Written from the algorithm's description
// (https://github.com/Cyan4973/xxHash/blob/dev/doc/xxhash_spec.md).
//
// Up to 240 bytes it is a handful of 64-bit multiplications, done with BigInt. Longer input goes through eight sums of 64 bits, kept as
// halves of 32, because BigInt would take a hundred times as long there.

const SECRET = Uint8Array.from(
  (
    "b8fe6c3923a44bbe7c01812cf721ad1cded46de9839097db7240a4a4b7b3671fcb79e64eccc0e578825ad07dccff7221" +
    "b8084674f743248ee03590e6813a264c3c2852bb91c300cb88d0658b1b532ea371644897a20df94e3819ef46a9deacd8" +
    "a8fa763fe39c343ff9dcbbc7c70b4f1d8a51e04bcdb45931c89f7ec9d9787364eac5ac8334d3ebc3c581a0fffa1363eb" +
    "170ddd51b7f0da49d316552629d4689e2b16be587d47a1fc8ff8b8d17ad031ce45cb3a8f95160428afd7fbcabb4b407e"
  ).match(/../g),
  (hex) => parseInt(hex, 16),
);
const SECRET_VIEW = new DataView(SECRET.buffer);

const PRIME32 = [0x9e3779b1n, 0x85ebca77n, 0xc2b2ae3dn];
const PRIME64 = [
  0x9e3779b185ebca87n,
  0xc2b2ae3d27d4eb4fn,
  0x165667b19e3779f9n,
  0x85ebca77c2b2ae63n,
  0x27d4eb2f165667c5n,
];
const MIX = [0x165667919e3779f9n, 0x9fb21c651e98df25n];

const low = (x) => BigInt.asUintN(64, x);
const secret = (at) => SECRET_VIEW.getBigUint64(at, true);
const rotate = (x, bits) => low(x << bits) | (x >> (64n - bits));

function fold(a, b) {
  const product = a * b;
  return low(product) ^ (product >> 64n);
}

function avalanche(h) {
  h = low((h ^ (h >> 37n)) * MIX[0]);
  return h ^ (h >> 32n);
}

function avalanche64(h) {
  h = low((h ^ (h >> 33n)) * PRIME64[1]);
  h = low((h ^ (h >> 29n)) * PRIME64[2]);
  return h ^ (h >> 32n);
}

function swapped(x) {
  const view = new DataView(new ArrayBuffer(8));
  view.setBigUint64(0, x, true);
  return view.getBigUint64(0, false);
}

function upTo16(view, len) {
  if (len > 8) {
    const a = view.getBigUint64(0, true) ^ secret(24) ^ secret(32);
    const b = view.getBigUint64(len - 8, true) ^ secret(40) ^ secret(48);
    return avalanche(low(BigInt(len) + swapped(a) + b + fold(a, b)));
  }
  if (len >= 4) {
    const first = BigInt(view.getUint32(0, true));
    const last = BigInt(view.getUint32(len - 4, true));
    let h = low(last + (first << 32n)) ^ secret(8) ^ secret(16);
    h ^= rotate(h, 49n) ^ rotate(h, 24n);
    h = low(h * MIX[1]);
    h ^= (h >> 35n) + BigInt(len);
    h = low(h * MIX[1]);
    return h ^ (h >> 28n);
  }
  if (len > 0) {
    const bytes = [view.getUint8(0), view.getUint8(len >> 1), view.getUint8(len - 1)].map(BigInt);
    const all = (bytes[0] << 16n) | (bytes[1] << 24n) | bytes[2] | (BigInt(len) << 8n);
    const flip = BigInt((SECRET_VIEW.getUint32(0, true) ^ SECRET_VIEW.getUint32(4, true)) >>> 0);
    return avalanche64(all ^ flip);
  }
  return avalanche64(secret(56) ^ secret(64));
}

function upTo240(view, len) {
  const mix = (at, key) =>
    fold(view.getBigUint64(at, true) ^ secret(key), view.getBigUint64(at + 8, true) ^ secret(key + 8));
  let h = low(BigInt(len) * PRIME64[0]);
  if (len <= 128) {
    for (let i = (len - 1) >> 5; i >= 0; i--) {
      h += mix(16 * i, 32 * i) + mix(len - 16 * (i + 1), 32 * i + 16);
    }
    return avalanche(low(h));
  }
  for (let i = 0; i < 8; i++) h += mix(16 * i, 16 * i);
  h = avalanche(low(h));
  for (let i = 8; i < len >> 4; i++) h += mix(16 * i, 16 * (i - 8) + 3);
  return avalanche(low(h + mix(len - 16, 136 - 17)));
}

// The high half of a product of two numbers of 32 bits.
function high(a, b) {
  const [a0, a1, b0, b1] = [a & 0xffff, a >>> 16, b & 0xffff, b >>> 16];
  const middle = a1 * b0 + ((a0 * b0) >>> 16);
  return a1 * b1 + (middle >>> 16) + ((a0 * b1 + (middle & 0xffff)) >>> 16);
}

const LANES = 8;
const STRIPE = 64;
const STRIPES_OF_A_BLOCK = (SECRET.length - STRIPE) / 8;

function add(sums, lane, lo, hi) {
  const sum = sums[2 * lane] + lo;
  sums[2 * lane + 1] += hi + (sum > 0xffffffff ? 1 : 0);
  sums[2 * lane] = sum;
}

function accumulate(sums, view, at, key) {
  for (let lane = 0; lane < LANES; lane++) {
    const [lo, hi] = [view.getUint32(at + 8 * lane, true), view.getUint32(at + 8 * lane + 4, true)];
    const a = (lo ^ SECRET_VIEW.getUint32(key + 8 * lane, true)) >>> 0;
    const b = (hi ^ SECRET_VIEW.getUint32(key + 8 * lane + 4, true)) >>> 0;
    add(sums, lane ^ 1, lo, hi);
    add(sums, lane, Math.imul(a, b) >>> 0, high(a, b));
  }
}

function scramble(sums) {
  const prime = Number(PRIME32[0]);
  const key = SECRET.length - STRIPE;
  for (let lane = 0; lane < LANES; lane++) {
    const hi = sums[2 * lane + 1];
    const a = (sums[2 * lane] ^ (hi >>> 15) ^ SECRET_VIEW.getUint32(key + 8 * lane, true)) >>> 0;
    const b = (hi ^ SECRET_VIEW.getUint32(key + 8 * lane + 4, true)) >>> 0;
    sums[2 * lane] = Math.imul(a, prime);
    sums[2 * lane + 1] = Math.imul(b, prime) + high(a, prime);
  }
}

function long(view, len) {
  const start = [PRIME32[2], ...PRIME64.slice(0, 4), PRIME32[1], PRIME64[4], PRIME32[0]];
  const sums = new Uint32Array(2 * LANES);
  start.forEach((x, lane) => {
    sums[2 * lane] = Number(x & 0xffffffffn);
    sums[2 * lane + 1] = Number(x >> 32n);
  });

  const stripes = Math.floor((len - 1) / STRIPE);
  for (let stripe = 0; stripe < stripes; stripe++) {
    const within = stripe % STRIPES_OF_A_BLOCK;
    accumulate(sums, view, STRIPE * stripe, 8 * within);
    // A block that ends where the input does is scrambled only if something follows.
    if (within === STRIPES_OF_A_BLOCK - 1) scramble(sums);
  }
  accumulate(sums, view, len - STRIPE, SECRET.length - STRIPE - 7);

  let h = low(BigInt(len) * PRIME64[0]);
  const of = (lane) => BigInt(sums[2 * lane]) | (BigInt(sums[2 * lane + 1]) << 32n);
  for (let lane = 0; lane < LANES; lane += 2) {
    h += fold(of(lane) ^ secret(11 + 8 * lane), of(lane + 1) ^ secret(19 + 8 * lane));
  }
  return avalanche(low(h));
}

/**
 * The checksum of some bytes.
 * @param {Uint8Array} bytes
 * @returns {bigint}
 */
export function xxh3(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const len = bytes.byteLength;
  if (len <= 16) return upTo16(view, len);
  return len <= 240 ? upTo240(view, len) : long(view, len);
}
