// Expands one frame of zstd, which no browser does for a page. Written from RFC 8878, with its names.

const BLOCK_MOST = 1 << 17;
const MAGIC = 0xfd2fb528;
/** Bytes in front of the input, so that bits may be looked at before its beginning. */
const FRONT = 8;

const LITERALS_LENGTH = {
  what: "lengths of literals",
  most: 9,
  base: [...Array(16).keys(), 16, 18, 20, 22, 24, 28, 32, 40, 48, 64, ...Array.from({ length: 10 }, (_, i) => 128 << i)],
  bits: [...Array(16).fill(0), 1, 1, 1, 1, 2, 2, 3, 3, 4, ...Array.from({ length: 11 }, (_, i) => 6 + i)],
  usual: table([4, 3, ...Array(11).fill(2), 1, 1, 1, ...Array(9).fill(2), 3, 2, 1, 1, 1, 1, 1, -1, -1, -1, -1], 6),
};
const MATCH_LENGTH = {
  what: "lengths of matches",
  most: 9,
  base: [...Array(32).keys()].map((i) => i + 3).concat([35, 37, 39, 41, 43, 47, 51, 59, 67, 83, 99], Array.from({ length: 10 }, (_, i) => 3 + (128 << i))),
  bits: [...Array(32).fill(0), 1, 1, 1, 1, 2, 2, 3, 3, 4, 4, 5, ...Array.from({ length: 10 }, (_, i) => 7 + i)],
  usual: table([1, 4, 3, 2, 2, 2, 2, 2, 2, ...Array(37).fill(1), ...Array(7).fill(-1)], 6),
};
const OFFSET = {
  what: "offsets",
  most: 8,
  base: Array.from({ length: 32 }, (_, i) => 2 ** i),
  bits: [...Array(32).keys()],
  usual: table([1, 1, 1, 1, 1, 1, 2, 2, 2, ...Array(15).fill(1), ...Array(5).fill(-1)], 5),
};

function expect(is, problem) {
  if (!is) throw new Error(`the zstd frame is damaged: ${problem}`);
}

function viewOf(bytes) {
  return new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
}

function log2(x) {
  return 31 - Math.clz32(x);
}

/** Bits from the lowest of the first byte on. */
class Forward {
  constructor(bytes, start, end) {
    Object.assign(this, { bytes, at: 8 * start, end: 8 * end });
  }

  take(count) {
    const { bytes } = this;
    const first = this.at >>> 3;
    const all = bytes[first] | (bytes[first + 1] << 8) | (bytes[first + 2] << 16);
    const value = (all >>> (this.at & 7)) & ((1 << count) - 1);
    this.at += count;
    expect(this.at <= this.end, "a table ends early");
    return value;
  }

  /** The next whole byte. */
  get place() {
    return (this.at + 7) >>> 3;
  }
}

/** Bits from the end of a stream to its beginning; what ends it is a one that is not counted. */
class Backward {
  constructor(bytes, start, end) {
    expect(start < end && bytes[end - 1] !== 0, "a stream without its end");
    this.view = viewOf(bytes);
    this.start = 8 * start;
    this.at = 8 * (end - 1) + log2(bytes[end - 1]);
  }

  /** The `count` bits, at most 25, below a place. */
  below(place, count) {
    const first = place - count;
    return (this.view.getInt32(first >> 3, true) >>> (first & 7)) & ((1 << count) - 1);
  }

  take(count) {
    if (count > 16) {
      const high = this.take(count - 16);
      return high * 65536 + this.take(16);
    }
    expect(this.at - count >= this.start, "a stream ends early");
    const value = this.below(this.at, count);
    this.at -= count;
    return value;
  }
}

/** States of a finite state entropy code: the symbol of each, and what comes after it. */
function table(shares, log) {
  const size = 1 << log;
  const made = { log, symbols: new Uint8Array(size), bits: new Uint8Array(size), next: new Uint16Array(size) };
  const turns = new Uint16Array(shares.length);
  let high = size;
  shares.forEach((share, symbol) => {
    turns[symbol] = Math.abs(share);
    if (share < 0) made.symbols[--high] = symbol;
  });
  let place = 0;
  shares.forEach((share, symbol) => {
    for (let i = 0; i < share; i++) {
      made.symbols[place] = symbol;
      do place = (place + (size >> 1) + (size >> 3) + 3) & (size - 1);
      while (place >= high);
    }
  });
  for (let state = 0; state < size; state++) {
    const turn = turns[made.symbols[state]]++;
    made.bits[state] = log - log2(turn);
    made.next[state] = (turn << made.bits[state]) - size;
  }
  return made;
}

/** The shares of symbols, and the table of them. */
function readTable(bits, most, symbols) {
  const log = bits.take(4) + 5;
  expect(log <= most, `a table of 2^${log} states`);
  const shares = [];
  let left = 1 << log;
  while (left > 0) {
    expect(shares.length < symbols, "a table of too many symbols");
    const count = log2(left + 1);
    const short = 2 ** (count + 1) - 2 - left;
    let value = bits.take(count);
    if (value >= short && bits.take(1) === 1) value += 2 ** count - short;
    const share = value - 1;
    shares.push(share);
    left -= Math.abs(share);
    if (share !== 0) continue;
    for (let more = 3; more === 3; ) {
      more = bits.take(2);
      for (let i = 0; i < more; i++) shares.push(0);
    }
  }
  expect(left === 0 && shares.length <= symbols, "a table whose shares are not one");
  return table(shares, log);
}

/** Weights of literals, which a code of two states tells. */
function readWeights(bytes, start, end) {
  const head = new Forward(bytes, start, end);
  const { log, symbols, bits, next } = readTable(head, 6, 13);
  const stream = new Backward(bytes, head.place, end);
  const weights = [];
  const states = [stream.take(log), stream.take(log)];
  for (let turn = 0; ; turn ^= 1) {
    expect(weights.length < 254, "more literals than there are");
    weights.push(symbols[states[turn]]);
    const count = bits[states[turn]];
    if (stream.at - count < stream.start) {
      weights.push(symbols[states[turn ^ 1]]);
      return weights;
    }
    states[turn] = next[states[turn]] + stream.take(count);
  }
}

/** The prefix code of literals: by the next bits the literal, and above it how many of the bits are its own. */
function prefixCode(weights) {
  const sum = weights.reduce((sum, weight) => sum + (weight > 0 ? 1 << (weight - 1) : 0), 0);
  expect(sum > 0, "no literals in a code");
  const most = log2(sum) + 1;
  const rest = (1 << most) - sum;
  expect(most <= 11 && (rest & (rest - 1)) === 0, "a code of literals that is none");
  weights.push(log2(rest) + 1);
  const code = { most, entries: new Uint16Array(1 << most) };
  let place = 0;
  for (let weight = 1; weight <= most; weight++) {
    weights.forEach((own, symbol) => {
      if (own !== weight) return;
      const end = place + (1 << (weight - 1));
      code.entries.fill(symbol | ((most + 1 - weight) << 8), place, end);
      place = end;
    });
  }
  return code;
}

/** What blocks keep for those after them, and what is expanded so far. */
class Frame {
  constructor(bytes, out) {
    Object.assign(this, { bytes, out, length: 0, literals: null, code: null, offsets: [1, 4, 8] });
    this.tables = new Map();
  }

  room(count) {
    expect(this.length + count <= this.out.length, "more is in it than should be");
  }

  /** Literals, where they come from, and where what follows begins. */
  readLiterals(start, end) {
    const { bytes } = this;
    const kind = bytes[start] & 3;
    const form = (bytes[start] >> 2) & 3;
    const head = new Forward(bytes, start, end);
    head.take(form % 2 === 0 && kind < 2 ? 3 : 4);
    const field = (count) => head.take(Math.min(count, 9)) + (count > 9 ? head.take(count - 9) * 512 : 0);
    if (kind < 2) {
      const count = field([5, 12, 5, 20][form]);
      expect(count <= BLOCK_MOST, "too many literals");
      const place = head.place;
      const length = kind === 0 ? count : 1;
      expect(place + length <= end, "literals end early");
      this.literals = kind === 0 ? bytes.subarray(place, place + count) : new Uint8Array(count).fill(bytes[place]);
      return place + length;
    }
    const width = [10, 10, 14, 18][form];
    const [count, length] = [field(width), field(width)];
    let place = head.place;
    const after = place + length;
    expect(count <= BLOCK_MOST && after <= end && length > 0, "literals end early");
    if (kind === 2) {
      const told = bytes[place++];
      const size = told < 128 ? told : (told - 126) >> 1;
      expect(place + size <= after, "a code of literals ends early");
      const direct = () => Array.from({ length: told - 127 }, (_, i) => (i % 2 === 0 ? bytes[place + (i >> 1)] >> 4 : bytes[place + (i >> 1)] & 15));
      this.code = prefixCode(told < 128 ? readWeights(bytes, place, place + size) : direct());
      place += size;
    }
    expect(this.code, "literals without a code");
    this.literals = new Uint8Array(count);
    if (form === 0) {
      this.#decode(place, after, 0, count);
      return after;
    }
    expect(place + 6 <= after, "literals end early");
    const lengths = [0, 2, 4].map((at) => bytes[place + at] | (bytes[place + at + 1] << 8));
    const each = (count + 3) >> 2;
    expect(3 * each <= count, "fewer literals than streams of them");
    place += 6;
    [...lengths, after - place - lengths[0] - lengths[1] - lengths[2]].forEach((length, i) => {
      expect(length > 0 && place + length <= after, "literals end early");
      this.#decode(place, place + length, i * each, i < 3 ? (i + 1) * each : count);
      place += length;
    });
    return after;
  }

  #decode(start, end, first, last) {
    const { most, entries } = this.code;
    const { literals } = this;
    const stream = new Backward(this.bytes, start, end);
    const { view } = stream;
    const mask = (1 << most) - 1;
    let at = stream.at;
    // Two literals at a time: they have 22 bits at most.
    for (let i = first; i < last; i += 2) {
      const from = at - 25;
      expect(from >= 0, "literals of another length");
      const word = view.getInt32(from >> 3, true) >>> (from & 7);
      const one = entries[(word >>> (25 - most)) & mask];
      const bits = one >> 8;
      literals[i] = one;
      at -= bits;
      if (i + 1 === last) break;
      const two = entries[(word >>> (25 - most - bits)) & mask];
      literals[i + 1] = two;
      at -= two >> 8;
    }
    expect(at === stream.start, "literals of another length");
  }

  /** The codes of lengths and offsets. */
  #readTables(modes, head, end) {
    let place = head;
    const tables = [LITERALS_LENGTH, OFFSET, MATCH_LENGTH].map((kind, i) => {
      const mode = (modes >> (6 - 2 * i)) & 3;
      if (mode === 0) return kind.usual;
      if (mode === 1) {
        expect(place < end, "tables end early");
        return { log: 0, symbols: this.bytes.subarray(place, ++place), bits: [0], next: [0] };
      }
      if (mode === 3) {
        expect(this.tables.has(kind), `no table for ${kind.what} to repeat`);
        return this.tables.get(kind);
      }
      const bits = new Forward(this.bytes, place, end);
      const made = readTable(bits, kind.most, kind.base.length);
      place = bits.place;
      return made;
    });
    [LITERALS_LENGTH, OFFSET, MATCH_LENGTH].forEach((kind, i) => {
      this.tables.set(kind, tables[i]);
      expect(tables[i].symbols.every((symbol) => symbol < kind.base.length), `an unknown code of ${kind.what}`);
    });
    return [place, tables];
  }

  block(start, end) {
    const { bytes } = this;
    let place = this.readLiterals(start, end);
    let used = 0;
    expect(place < end, "no count of sequences");
    let count = bytes[place++];
    if (count > 0) {
      const more = count === 255 ? 2 : count > 127 ? 1 : 0;
      expect(place + more < end, "sequences end early");
      if (more === 1) count = ((count - 128) << 8) + bytes[place];
      if (more === 2) count = bytes[place] + (bytes[place + 1] << 8) + 0x7f00;
      place += more;
      const modes = bytes[place++];
      expect((modes & 3) === 0, "reserved bits are set");
      const [first, tables] = this.#readTables(modes, place, end);
      used = this.#sequences(new Backward(bytes, first, end), count, tables);
    } else expect(place === end, "something follows the literals");
    const rest = this.literals.subarray(used);
    this.room(rest.length);
    this.out.set(rest, this.length);
    this.length += rest.length;
  }

  /** Literals and copies of what was there before; how many literals that were. */
  #sequences(stream, count, [lengths, offsets, matches]) {
    const { out, literals } = this;
    let [l, o, m] = [stream.take(lengths.log), stream.take(offsets.log), stream.take(matches.log)];
    let used = 0;
    let to = this.length;
    for (let i = 0; i < count; i++) {
      const lengthCode = lengths.symbols[l];
      const offsetCode = offsets.symbols[o];
      const matchCode = matches.symbols[m];
      const offsetValue = OFFSET.base[offsetCode] + stream.take(offsetCode);
      const match = MATCH_LENGTH.base[matchCode] + stream.take(MATCH_LENGTH.bits[matchCode]);
      const length = LITERALS_LENGTH.base[lengthCode] + stream.take(LITERALS_LENGTH.bits[lengthCode]);
      const offset = this.#offset(offsetValue, length);
      if (to + length + match > out.length) expect(false, "more is in it than should be");
      if (used + length > literals.length) expect(false, "more literals than there are");
      for (let k = 0; k < length; k++) out[to++] = literals[used++];
      if (offset <= 0 || offset > to) expect(false, "a match in front of the beginning");
      for (let k = 0; k < match; k++, to++) out[to] = out[to - offset];
      if (i === count - 1) break;
      l = lengths.next[l] + stream.take(lengths.bits[l]);
      m = matches.next[m] + stream.take(matches.bits[m]);
      o = offsets.next[o] + stream.take(offsets.bits[o]);
    }
    this.length = to;
    expect(stream.at === stream.start, "sequences of another length");
    return used;
  }

  /** The first three offsets are those that were used last. */
  #offset(value, length) {
    const { offsets } = this;
    const which = value > 3 ? 3 : value - 1 + (length === 0 ? 1 : 0);
    const offset = value > 3 ? value - 3 : which === 3 ? offsets[0] - 1 : offsets[which];
    if (which > 1) offsets[2] = offsets[1];
    if (which > 0) offsets[1] = offsets[0];
    offsets[0] = offset;
    return offset;
  }
}

/**
 * Expands a frame without a dictionary. Its checksum, if it has one, is passed over: pages have their own.
 * @param {Uint8Array} frame
 * @param {number} most bytes that may come out
 */
export function expand(frame, most) {
  const bytes = new Uint8Array(FRONT + frame.byteLength + 8);
  bytes.set(frame, FRONT);
  const end = FRONT + frame.byteLength;
  const view = new DataView(bytes.buffer);
  const told = view.getUint8(FRONT + 4);
  const [isSingle, hasSum, dictionary] = [(told >> 5) & 1, (told >> 2) & 1, told & 3];
  expect(frame.byteLength >= 9 && view.getUint32(FRONT, true) === MAGIC, "another beginning");
  expect((told & 8) === 0 && dictionary === 0, "a feature that pages do not use");
  let place = FRONT + 6 - isSingle;
  const kind = told >> 6;
  let size = most;
  if (kind === 3) size = Number(view.getBigUint64(place, true));
  else if (kind === 2) size = view.getUint32(place, true);
  else if (kind === 1) size = view.getUint16(place, true) + 256;
  else if (isSingle) size = view.getUint8(place);
  place += kind === 0 ? isSingle : 1 << kind;
  expect(size <= most, "more is in it than should be");
  const known = kind > 0 || isSingle === 1;

  const state = new Frame(bytes, new Uint8Array(size));
  for (let isLast = false; !isLast; ) {
    expect(place + 3 <= end, "it ends early");
    const head = bytes[place] | (bytes[place + 1] << 8) | (bytes[place + 2] << 16);
    isLast = (head & 1) === 1;
    const [kind, length] = [(head >> 1) & 3, head >> 3];
    place += 3;
    const taken = kind === 1 ? 1 : length;
    expect(kind < 3 && length <= BLOCK_MOST && place + taken <= end, "it ends early");
    if (kind === 2) {
      state.block(place, place + length);
    } else {
      state.room(length);
      if (kind === 0) state.out.set(bytes.subarray(place, place + length), state.length);
      else state.out.fill(bytes[place], state.length, state.length + length);
      state.length += length;
    }
    place += taken;
  }
  expect(place + 4 * hasSum === end && (!known || state.length === size), "its length is another one");
  return state.out.subarray(0, state.length);
}
