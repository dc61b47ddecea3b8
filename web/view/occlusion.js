// What is hidden behind what was drawn: the farthest depths of squares of a picture, read back without waiting, and boxes compared with them.

/** Side of a square, pixels. */
const SIDE = 4;
/** By how much a depth has to be nearer than a box: some steps of 24 bits, for all that was rounded. */
const SLACK = 2 ** -20;
/** By how much a box is widened on every side, relative to the sum of its sides. */
const WIDER = 1e-3;
/** Squares a side that a box is compared with at most. */
const MOST = 4;
/** Time from one look whether an answer is there to the next, and after which none is waited for, ms. */
const [LOOK, LONGEST] = [4, 30000];

const FARTHEST = `#version 300 es
precision highp float;
precision highp int;
uniform highp sampler2D depths;
out vec4 bytes;
void main() {
  ivec2 last = textureSize(depths, 0) - 1;
  ivec2 first = ${SIDE} * ivec2(gl_FragCoord.xy);
  float far = 0.0;
  for (int y = 0; y < ${SIDE}; y++) for (int x = 0; x < ${SIDE}; x++) far = max(far, texelFetch(depths, min(first + ivec2(x, y), last), 0).r);
  int steps = int(ceil(far * 16777215.0));
  bytes = vec4(ivec4(steps & 255, (steps >> 8) & 255, (steps >> 16) & 255, 255)) / 255.0;
}`;

/** Farthest depths of a picture that was drawn by a `matrix`, by level; each has half the squares a side of the one before. */
export class Pyramid {
  /** @param bytes of each square, row by row, what the shader gave */
  constructor(bytes, [width, height], matrix) {
    Object.assign(this, { width, height, matrix });
    let [columns, rows] = [Math.ceil(width / SIDE), Math.ceil(height / SIDE)];
    let depths = Float32Array.from({ length: columns * rows }, (_, i) => (bytes[4 * i] + 256 * bytes[4 * i + 1] + 65536 * bytes[4 * i + 2]) / 16777215);
    this.levels = [{ columns, rows, depths }];
    while (columns > 1 || rows > 1) {
      const below = this.levels.at(-1);
      [columns, rows] = [Math.ceil(columns / 2), Math.ceil(rows / 2)];
      depths = new Float32Array(columns * rows);
      for (let y = 0; y < below.rows; y++) {
        for (let x = 0; x < below.columns; x++) {
          const at = (y >> 1) * columns + (x >> 1);
          depths[at] = Math.max(depths[at], below.depths[y * below.columns + x]);
        }
      }
      this.levels.push({ columns, rows, depths });
    }
  }

  /**
   * Whether all that is in a box was hidden for sure. What the near plane cuts was not.
   * @param low smallest corner, and `high` the largest one, in the coordinates that the matrix takes
   * @param isWhole whether what is beside the picture counts as hidden; if not, nobody knows of it
   */
  hides(low, high, isWhole) {
    const margin = WIDER * (high[0] - low[0] + high[1] - low[1] + high[2] - low[2]);
    const m = this.matrix;
    let [left, right, bottom, top, near] = [Infinity, -Infinity, Infinity, -Infinity, Infinity];
    for (let corner = 0; corner < 8; corner++) {
      const x = corner & 1 ? high[0] + margin : low[0] - margin;
      const y = corner & 2 ? high[1] + margin : low[1] - margin;
      const z = corner & 4 ? high[2] + margin : low[2] - margin;
      const w = m[3] * x + m[7] * y + m[11] * z + m[15];
      const depth = (m[2] * x + m[6] * y + m[10] * z + m[14]) / w;
      if (!(w > 0 && depth > -1)) return false;
      const across = (m[0] * x + m[4] * y + m[8] * z + m[12]) / w;
      const along = (m[1] * x + m[5] * y + m[9] * z + m[13]) / w;
      [left, right] = [Math.min(left, across), Math.max(right, across)];
      [bottom, top] = [Math.min(bottom, along), Math.max(top, along)];
      near = Math.min(near, depth);
    }
    if (!isWhole && !(left >= -1 && right <= 1 && bottom >= -1 && top <= 1)) return false;
    // A pixel more on every side.
    const square = (share, size, more, count) => Math.min(Math.max(Math.floor(((0.5 + 0.5 * share) * size + more) / SIDE), 0), count - 1);
    const { columns, rows } = this.levels[0];
    let [x0, x1] = [square(left, this.width, -1, columns), square(right, this.width, 1, columns)];
    let [y0, y1] = [square(bottom, this.height, -1, rows), square(top, this.height, 1, rows)];
    let level = 0;
    while (x1 - x0 >= MOST || y1 - y0 >= MOST) [x0, x1, y0, y1, level] = [x0 >> 1, x1 >> 1, y0 >> 1, y1 >> 1, level + 1];
    const squares = this.levels[level];
    const depth = 0.5 * near + 0.5 - SLACK;
    for (let y = y0; y <= y1; y++) for (let x = x0; x <= x1; x++) if (squares.depths[y * squares.columns + x] >= depth) return false;
    return true;
  }
}

/** Asks a graphics card for farthest depths; one question is under way at most. */
export class Occlusion {
  /** @param make compiles a program that is drawn all over a picture */
  constructor(gl, make) {
    this.gl = gl;
    this.program = make(FARTHEST);
    this.depths = gl.getUniformLocation(this.program, "depths");
    this.nothing = gl.createVertexArray();
    this.target = gl.createFramebuffer();
    this.isAsking = false;
  }

  /**
   * Asks for the depths of a picture, a texture of a size.
   * @param matrix that it was drawn by
   * @param then is told the {@link Pyramid}, or null where none comes; nothing where the graphics card was lost
   */
  ask(depths, [width, height], matrix, then) {
    const { gl } = this;
    const size = [Math.ceil(width / SIDE), Math.ceil(height / SIDE)];
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    if (this.size?.[0] !== size[0] || this.size[1] !== size[1]) this.#resize(size);
    gl.viewport(0, 0, ...size);
    gl.disable(gl.DEPTH_TEST);
    gl.useProgram(this.program);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, depths);
    gl.uniform1i(this.depths, 0);
    gl.bindVertexArray(this.nothing);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindVertexArray(null);
    gl.enable(gl.DEPTH_TEST);
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
    gl.bufferData(gl.PIXEL_PACK_BUFFER, 4 * size[0] * size[1], gl.STREAM_READ);
    gl.readPixels(0, 0, ...size, gl.RGBA, gl.UNSIGNED_BYTE, 0);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    this.isAsking = true;
    const asked = performance.now();
    const look = () => {
      if (gl.isContextLost()) return;
      const state = gl.clientWaitSync(fence, 0, 0);
      if (state === gl.TIMEOUT_EXPIRED && performance.now() - asked < LONGEST) return void setTimeout(look, LOOK);
      gl.deleteSync(fence);
      this.isAsking = false;
      if (state === gl.TIMEOUT_EXPIRED || state === gl.WAIT_FAILED) return void (gl.deleteBuffer(buffer), then(null));
      const bytes = new Uint8Array(4 * size[0] * size[1]);
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
      gl.getBufferSubData(gl.PIXEL_PACK_BUFFER, 0, bytes);
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
      gl.deleteBuffer(buffer);
      then(new Pyramid(bytes, [width, height], matrix));
    };
    setTimeout(look, LOOK);
  }

  /** Room for so many squares; the target is bound. */
  #resize(size) {
    const { gl } = this;
    gl.deleteTexture(this.squares);
    this.squares = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.squares);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, ...size);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.squares, 0);
    this.size = size;
  }
}
