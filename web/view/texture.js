// Images on the graphics card: sRGB, with mips as far as the texels around charts reach.

/** Mips: a sheet has 4 texels around what a chart shows. */
const LEVELS = 3;
/** Samples along the longer way across a pixel. */
const SAMPLES = 8;

/** Bytes of a texture of so many texels. */
export const bytesOf = ([width, height]) => 4 * width * height * (1 + 1 / 4 + 1 / 16);

/** Makes textures, and has an empty one for what has none. */
export class Textures {
  constructor(gl) {
    this.gl = gl;
    this.most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    this.anisotropy = gl.getExtension("EXT_texture_filter_anisotropic");
    this.none = this.#empty(1, 1, 1);
  }

  #empty(levels, width, height) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, levels, gl.SRGB8_ALPHA8, width, height);
    return texture;
  }

  /** A texture of an image, and its bytes. */
  make(bitmap) {
    const { gl, anisotropy } = this;
    const { width, height } = bitmap;
    const levels = Math.min(LEVELS, 1 + Math.floor(Math.log2(Math.min(width, height))));
    const texture = this.#empty(levels, width, height);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, gl.RGBA, gl.UNSIGNED_BYTE, bitmap);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
    for (const way of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, way, gl.CLAMP_TO_EDGE);
    if (anisotropy) {
      const most = gl.getParameter(anisotropy.MAX_TEXTURE_MAX_ANISOTROPY_EXT);
      gl.texParameterf(gl.TEXTURE_2D, anisotropy.TEXTURE_MAX_ANISOTROPY_EXT, Math.min(SAMPLES, most));
    }
    gl.bindTexture(gl.TEXTURE_2D, null);
    return { texture, bytes: bytesOf([width, height]) };
  }
}
