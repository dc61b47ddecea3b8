// Light that comes from all around reaches less of what lies in a hollow: found from the depths of the picture, for a picture at rest.

const DARKEN = `#version 300 es
precision highp float;
uniform sampler2D picture;
uniform highp sampler2D depths;
// Of the projection: what turns a depth into a distance, and pixels into slopes.
uniform vec2 depth;
uniform vec2 slope;
// By how much the middle of the picture is aside.
uniform float aside;
// How far a hollow reaches, in units of the picture; 0 without.
uniform float reach;
out vec4 color;

float away(ivec2 pixel) {
  float z = 2.0 * texelFetch(depths, pixel, 0).r - 1.0;
  return depth.y / (z + depth.x);
}

vec3 place(ivec2 pixel, ivec2 size) {
  float z = away(pixel);
  vec2 at = 2.0 * (vec2(pixel) + 0.5) / vec2(size) - 1.0 - vec2(aside, 0.0);
  return vec3(at * slope * z, z);
}

void main() {
  ivec2 size = textureSize(depths, 0);
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  color = texelFetch(picture, pixel, 0);
  if (reach <= 0.0 || texelFetch(depths, pixel, 0).r >= 1.0) return;
  vec3 here = place(pixel, size);
  // Of the two neighbours the nearer one, so that edges have a normal too.
  ivec2 right = ivec2(pixel.x + 1 < size.x ? 1 : -1, 0);
  ivec2 up = ivec2(0, pixel.y + 1 < size.y ? 1 : -1);
  vec3 a = place(pixel + right, size) - here, b = place(pixel - right, size) - here;
  vec3 c = place(pixel + up, size) - here, d = place(pixel - up, size) - here;
  vec3 across = abs(a.z) < abs(b.z) ? a : -b;
  vec3 along = abs(c.z) < abs(d.z) ? c : -d;
  vec3 normal = normalize(cross(across, along));
  if (dot(normal, here) > 0.0) normal = -normal;
  float pixels = clamp(reach / (slope.y * here.z) * 0.5 * float(size.y), 2.0, 0.12 * float(size.y));
  float turn = fract(52.9829189 * fract(dot(vec2(pixel), vec2(0.06711056, 0.00583715)))) * 6.2831853;
  float dark = 0.0;
  const int COUNT = 14;
  for (int i = 0; i < COUNT; i++) {
    float share = (float(i) + 0.5) / float(COUNT);
    float angle = turn + 2.3999632 * float(i);
    ivec2 other = pixel + ivec2(round(pixels * sqrt(share) * vec2(cos(angle), sin(angle))));
    other = clamp(other, ivec2(0), size - 1);
    if (texelFetch(depths, other, 0).r >= 1.0) continue;
    vec3 way = place(other, size) - here;
    float far = length(way);
    float high = max(dot(normal, way) / max(far, 1e-9) - 0.12, 0.0);
    dark += high * clamp(1.5 - far / reach, 0.0, 1.0);
  }
  color.rgb *= 1.0 - min(1.25 * dark / float(COUNT), 0.75);
}`;

/** A picture with depths, drawn into with all samples, and put on the canvas from there. */
export class Ambient {
  /** @param make compiles a program that is drawn all over a picture */
  constructor(gl, make) {
    this.gl = gl;
    this.program = make(DARKEN);
    this.places = Object.fromEntries(["picture", "depths", "depth", "slope", "aside", "reach"].map((name) => [name, gl.getUniformLocation(this.program, name)]));
    this.nothing = gl.createVertexArray();
    this.size = [0, 0];
  }

  /** Begins a picture of a size. */
  begin(width, height) {
    const { gl } = this;
    if (this.size[0] !== width || this.size[1] !== height) this.#resize(width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.drawn);
    gl.viewport(0, 0, width, height);
  }

  #resize(width, height) {
    const { gl } = this;
    this.parts?.forEach(([remove, part]) => gl[remove](part));
    this.parts = [];
    const keep = (remove, part) => (this.parts.push([remove, part]), part);
    const samples = Math.min(4, gl.getParameter(gl.MAX_SAMPLES));
    const buffer = (format, place) => {
      gl.bindRenderbuffer(gl.RENDERBUFFER, keep("deleteRenderbuffer", gl.createRenderbuffer()));
      gl.renderbufferStorageMultisample(gl.RENDERBUFFER, samples, format, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, this.parts.at(-1)[1]);
    };
    const texture = (format, place) => {
      const made = keep("deleteTexture", gl.createTexture());
      gl.bindTexture(gl.TEXTURE_2D, made);
      gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, place, gl.TEXTURE_2D, made, 0);
      return made;
    };
    this.drawn = keep("deleteFramebuffer", gl.createFramebuffer());
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.drawn);
    buffer(gl.RGBA8, gl.COLOR_ATTACHMENT0);
    buffer(gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT);
    this.flat = keep("deleteFramebuffer", gl.createFramebuffer());
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.flat);
    this.picture = texture(gl.RGBA8, gl.COLOR_ATTACHMENT0);
    this.depths = texture(gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT);
    this.size = [width, height];
  }

  /**
   * Puts the picture on the canvas.
   * @param range nearest and farthest distance of the projection
   * @param aside by how much the middle is to the right, in halves of the picture
   * @param slope of the rays through the right and the upper border
   * @param reach how far a hollow reaches, in the same unit; 0 without
   */
  end([near, far], aside, slope, reach) {
    const { gl, places, size: [width, height] } = this;
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, this.drawn);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, this.flat);
    gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.DEPTH_TEST);
    gl.useProgram(this.program);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.depths);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.picture);
    gl.uniform1i(places.picture, 0);
    gl.uniform1i(places.depths, 1);
    // A depth of z is at b / (z + a).
    gl.uniform2f(places.depth, (far + near) / (near - far), (2 * far * near) / (near - far));
    gl.uniform2f(places.slope, ...slope);
    gl.uniform1f(places.aside, aside);
    gl.uniform1f(places.reach, reach);
    gl.bindVertexArray(this.nothing);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindVertexArray(null);
    gl.enable(gl.DEPTH_TEST);
  }
}
