// Draws pages by WebGL 2. A page's vertices are uploaded once, and once more when its sheet comes; the corners of its triangles whenever its position changes.

import { Copies } from "../chpm/index.js";
import { Ambient } from "./ambient.js";
import { stops } from "./colors.js";
import { Occlusion } from "./occlusion.js";
import { Textures } from "./texture.js";

const VERTEX = `#version 300 es
uniform mat4 matrix;
uniform bool smoothly;
uniform vec3 stretch;
layout(location = 0) in vec3 position;
layout(location = 1) in vec4 facing;
layout(location = 2) in vec4 color;
layout(location = 3) in float number;
// Where a corner is in the sheet.
layout(location = 4) in vec2 place;
// What is shown by colours: where they begin, and how many there are to a unit; 0 without.
uniform vec2 numbers;
uniform vec3 stops[9];
out vec3 at;
// What becomes of the plane of a face: a symmetric matrix, its diagonal and what is beside it.
out vec3 straight;
out vec3 across;
out vec4 tint;
out vec2 texel;
void main() {
  at = position;
  texel = place;
  straight = vec3(1.0);
  across = vec3(0.0);
  if (smoothly && facing.w != 0.0) {
    // Where heights are stretched, a line goes with them, and a normal the other way.
    vec3 way = normalize(facing.w < 0.0 ? facing.xyz * stretch : facing.xyz / stretch);
    straight = way * way;
    across = way.yzx * way.zxy;
    // On a crease, it loses what it leans along it.
    if (facing.w < 0.0) {
      straight = 1.0 - straight;
      across = -across;
    }
  }
  tint = color;
  if (numbers.y > 0.0) {
    float share = clamp((number - numbers.x) * numbers.y, 0.0, 1.0) * 8.0;
    int low = min(int(share), 7);
    // Grey is what is no number.
    tint = vec4(number == number ? mix(stops[low], stops[low + 1], share - float(low)) : vec3(0.5), 1.0);
  }
  gl_Position = matrix * vec4(position, 1.0);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
uniform vec3 eye;
uniform vec3 light;
uniform vec4 flat_color;
uniform vec4 clip;
uniform vec3 up;
uniform bool studio;
uniform bool painted;
uniform sampler2D sheet;
in vec3 at;
in vec3 straight;
in vec3 across;
in vec4 tint;
in vec2 texel;
out vec4 color;

// Filters add light; colours are those of the file, as those of vertices are.
vec3 encoded(vec3 light) {
  return mix(12.92 * light, 1.055 * pow(max(light, 0.0031308), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, light));
}

// Whether a pixel is among those that are left out where only a share is seen: of 4 x 4, in the order of Bayer.
bool is_left_out(float share) {
  ivec2 place = ivec2(gl_FragCoord.xy);
  int both = place.x ^ place.y;
  int order = ((both & 1) << 3) | ((place.y & 1) << 2) | (both & 2) | ((place.y & 2) >> 1);
  return 16.0 * share < float(order) + 0.5;
}

void main() {
  vec4 shown = painted ? texture(sheet, texel) : vec4(0.0, 0.0, 0.0, 1.0);
  vec3 own = painted ? encoded(shown.rgb) : tint.rgb;
  if (dot(clip.xyz, at) > clip.w || is_left_out(shown.a)) discard;
  vec3 to_eye = normalize(eye - at);
  // Both sides of a surface are lit.
  vec3 plane = normalize(cross(dFdx(at), dFdy(at)));
  if (dot(plane, to_eye) < 0.0) plane = -plane;
  vec3 normal = straight * plane + across.zxy * plane.yzx + across.yzx * plane.zxy;
  float size = length(normal);
  normal = size > 1e-3 ? normal / size : plane;
  // Near a silhouette it may look away from the eye although the triangle does not.
  normal = normalize(mix(normal, plane, smoothstep(-0.15, 0.15, -dot(normal, to_eye))));
  vec3 base = mix(own, flat_color.rgb, flat_color.a);
  float shade = 0.35 + 0.65 * max(dot(normal, light), 0.0);
  if (!studio) {
    color = vec4(base * shade, 1.0);
    return;
  }
  // A lamp beside the camera, a weaker one on the other side, sky above and floor below, and some shine.
  float key = max(dot(normal, light), 0.0);
  float fill = max(dot(normal, normalize(to_eye - 0.9 * light + 0.4 * up)), 0.0);
  float sky = 0.5 + 0.5 * dot(normal, up);
  vec3 lit = vec3(1.0, 0.98, 0.94) * 0.62 * key + vec3(0.85, 0.92, 1.0) * 0.16 * fill + mix(vec3(0.2, 0.19, 0.18), vec3(0.34, 0.36, 0.4), sky);
  float shine = pow(max(dot(normal, normalize(light + to_eye)), 0.0), 36.0);
  color = vec4(base * lit + 0.09 * shine, 1.0);
}`;

/** One triangle all over a picture. */
const WHOLE = `#version 300 es
void main() {
  vec2 corner = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2);
  gl_Position = vec4(2.0 * corner - 1.0, 0.0, 1.0);
}`;

function program(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(program));
  return program;
}

export class Renderer {
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: false, depth: false, alpha: true });
    if (!gl) throw new Error("this browser has no WebGL 2, which the page draws with");
    Object.assign(this, { gl, canvas, blocks: new Map(), bytes: 0, frame: 0, painted: 0 });
    this.program = program(gl, VERTEX, FRAGMENT);
    const allOver = (fragment) => program(gl, WHOLE, fragment);
    this.ambient = new Ambient(gl, allOver);
    this.occlusion = new Occlusion(gl, allOver);
    this.textures = new Textures(gl);
    const names = ["matrix", "eye", "light", "flat_color", "smoothly", "stretch", "clip", "up", "studio", "numbers", "stops", "painted", "sheet"];
    this.places = Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(this.program, name)]));
    gl.enable(gl.DEPTH_TEST);
  }

  has(id) {
    return this.blocks.has(id);
  }

  /** How often the image of a cluster was halved; no number where it has none. */
  halvings(id) {
    const block = this.blocks.get(id);
    return block?.texture ? block.halvings : NaN;
  }

  /**
   * Uploads a page. Positions are stretched and become relative to `center`, in units of `scale`, the same way for all pages, so that shared vertices stay one. The
   * scale is a power of two, which changes no digit: shaders have no numbers for what a very small or large model multiplies.
   */
  add(page, place) {
    this.#keep(page.cluster.id, { page, copies: null, texture: null, ...this.#upload(page, place, null), used: this.frame });
  }

  /** Gives a page that is there its sheet, of which the image is decoded, its sides halved so often. */
  paint(sheet, bitmap, halvings, place) {
    const { id } = sheet.cluster;
    const { page, copies: known, used } = this.blocks.get(id);
    // Where a texture had to go, all else is as it was.
    const copies = known ?? new Copies(page, sheet);
    this.remove(id);
    /** Sheets that have come, all counted. */
    this.painted += 1;
    const { bytes: uploaded, ...parts } = this.#upload(page, place, copies);
    const { texture, bytes } = this.textures.make(bitmap);
    this.#keep(id, { page, copies, texture, halvings, texels: bytes, ...parts, bytes: uploaded + bytes, used });
  }

  #keep(id, block) {
    this.bytes += block.bytes;
    this.blocks.set(id, { ...block, position: -1, turned: 0, corners: 0 });
  }

  /** Buffers of a page, or of the copies of its vertices. */
  #upload(page, { center, stretch, scale }, copies) {
    const { gl } = this;
    const vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    const buffers = [];
    const of = (values, size) => copies?.of(values, size) ?? values;
    const count = copies?.count ?? page.cluster.vertexCount;
    const attribute = (place, data, size, type, normalized) => {
      const buffer = gl.createBuffer();
      buffers.push(buffer);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, type, normalized, 0, 0);
      return data.byteLength;
    };
    const positions = page.positions.map((x, i) => (x * stretch[i % 3] - center[i % 3]) / scale);
    let bytes = attribute(0, of(positions, 3), 3, gl.FLOAT, false);
    const facing = gl.createBuffer();
    buffers.push(facing);
    gl.bindBuffer(gl.ARRAY_BUFFER, facing);
    gl.bufferData(gl.ARRAY_BUFFER, 8 * count, gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 4, gl.SHORT, true, 0, 0);
    bytes += 8 * count;
    if (page.colors) bytes += attribute(2, of(page.colors, 4), 4, gl.UNSIGNED_BYTE, true);
    if (copies) bytes += attribute(4, copies.places, 2, gl.FLOAT, false);
    const index = gl.createBuffer();
    buffers.push(index);
    const isWide = count > 0x10000;
    const corners = (isWide ? 4 : 2) * page.triangles.length;
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, index);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.DYNAMIC_DRAW);
    gl.bindVertexArray(null);
    return { vao, buffers, facing, bytes: bytes + corners, type: isWide ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT };
  }

  #unpaint(block) {
    this.gl.deleteTexture(block.texture);
    block.bytes -= block.texels;
    this.bytes -= block.texels;
    block.texture = null;
  }

  remove(id) {
    const { gl, blocks } = this;
    const block = blocks.get(id);
    if (block.texture) this.#unpaint(block);
    block.buffers.forEach((buffer) => gl.deleteBuffer(buffer));
    gl.deleteVertexArray(block.vao);
    this.bytes -= block.bytes;
    blocks.delete(id);
  }

  clear() {
    [...this.blocks.keys()].forEach((id) => this.remove(id));
  }

  /** The page of a cluster that is there. */
  page(id) {
    return this.blocks.get(id)?.page;
  }

  /** Pixels of the picture. */
  size() {
    const ratio = Math.min(globalThis.devicePixelRatio || 1, 2);
    return [this.canvas.clientWidth, this.canvas.clientHeight].map((x) => Math.max(1, Math.round(x * ratio)));
  }

  /** Asks for the farthest depths of the picture that was drawn last, by a matrix. */
  ask(matrix, then) {
    const { depths, size } = this.ambient;
    this.occlusion.ask(depths, size, matrix, then);
  }

  /**
   * Draws a cut; how many triangles that were, and the largest error.
   * @param look `colorOf` a cluster, the `scalar` that colours show with its range, `borders` or null for each triangle by its own plane, the `clip`
   *   plane as a normal and an offset in the picture's coordinates, whether `sheets` are shown, whether light is that of a `studio`, and whether the picture is at `rest`
   */
  draw(cut, camera, place, { colorOf, scalar = null, borders, sheets = true, clip = null, studio = true, rest = true }) {
    const { gl, canvas, places } = this;
    this.frame += 1;
    const [width, height] = this.size();
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    this.ambient.begin(width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(places.matrix, false, camera.matrix(place, width / height));
    const eye = camera.eye().map((x, axis) => (x - place.center[axis]) / place.scale);
    gl.uniform3fv(places.eye, eye);
    const [right, up, back] = camera.axes();
    const light = [0, 1, 2].map((axis) => back[axis] + 0.5 * up[axis] + 0.4 * right[axis]);
    gl.uniform3fv(places.light, light.map((x) => x / Math.hypot(...light)));

    gl.uniform3fv(places.up, up);
    gl.uniform1i(places.studio, studio ? 1 : 0);
    const [normal, offset] = clip ?? [[0, 0, 0], 0];
    const middle = normal.reduce((sum, x, axis) => sum + x * place.center[axis], 0);
    gl.uniform4f(places.clip, ...normal, (offset - middle) / place.scale);
    gl.uniform2f(places.numbers, scalar?.low ?? 0, scalar ? 1 / (scalar.high - scalar.low || 1) : 0);
    gl.uniform3fv(places.stops, stops());
    gl.uniform1i(places.smoothly, borders ? 1 : 0);
    gl.uniform3fv(places.stretch, place.stretch);

    gl.uniform1i(places.sheet, 0);
    gl.activeTexture(gl.TEXTURE0);

    let [triangles, error, painted] = [0, 0, 0];
    for (const { cluster, bound } of cut) {
      const block = this.blocks.get(cluster);
      const position = block.page.position(bound);
      gl.bindVertexArray(block.vao);
      if (block.position !== position) {
        const corners = (block.copies ?? block.page).indices(position);
        gl.bufferSubData(gl.ELEMENT_ARRAY_BUFFER, 0, corners);
        Object.assign(block, { position, corners: corners.length });
      }
      if (borders && position > block.turned) {
        const { array, turned } = borders.of(block.page);
        gl.bindBuffer(gl.ARRAY_BUFFER, block.facing);
        gl.bufferSubData(gl.ARRAY_BUFFER, 0, block.copies?.of(array, 4) ?? array);
        block.turned = turned;
      }
      if (scalar && block.scalar !== scalar.name) this.#number(block, scalar);
      block.used = this.frame;
      error = Math.max(error, block.page.errorAt(position));
      const color = colorOf(block.page.cluster, block.page.errorAt(position));
      const isPainted = Boolean(sheets && !scalar && block.texture);
      gl.bindTexture(gl.TEXTURE_2D, isPainted ? block.texture : this.textures.none);
      gl.uniform1i(places.painted, isPainted ? 1 : 0);
      // Without colours of its own a page has one all over.
      const isColored = scalar || isPainted || block.page.colors;
      gl.uniform4fv(places.flat_color, color ?? (isColored ? [0, 0, 0, 0] : [0.78, 0.76, 0.72, 1]));
      gl.drawElements(gl.TRIANGLES, block.corners, block.type, 0);
      triangles += block.corners / 3;
      painted += isPainted ? 1 : 0;
    }
    gl.bindVertexArray(null);
    const rise = Math.tan((camera.fov * Math.PI) / 360);
    const range = camera.range().map((x) => x / place.scale);
    this.ambient.end(range, camera.aside(), [(rise * width) / height, rise], studio && rest ? (0.05 * camera.size) / place.scale : 0);
    return { triangles, error, painted };
  }

  /** Uploads the values of a scalar. */
  #number(block, scalar) {
    const { gl } = this;
    const own = Float32Array.from(block.page.scalar(scalar));
    const numbers = block.copies?.of(own, 1) ?? own;
    if (!block.numbers) {
      block.numbers = gl.createBuffer();
      block.buffers.push(block.numbers);
      block.bytes += numbers.byteLength;
      this.bytes += numbers.byteLength;
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, block.numbers);
    gl.bufferData(gl.ARRAY_BUFFER, numbers, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(3);
    gl.vertexAttribPointer(3, 1, gl.FLOAT, false, 0, 0);
    block.scalar = scalar.name;
  }

  /** Lets go of what was not drawn for longest, but not of `kept`, until at most `bytes` are used; then of their textures. */
  shrink(bytes, kept) {
    if (this.bytes <= bytes) return;
    const oldest = [...this.blocks].filter(([, block]) => block.used < this.frame).sort((a, b) => a[1].used - b[1].used);
    for (const [id] of oldest) if (this.bytes > bytes && !kept.has(id)) this.remove(id);
    for (const [, block] of oldest) if (this.bytes > bytes && block.texture) this.#unpaint(block);
  }
}
