// For three.js: pages as geometries, and whole models that refine themselves. The library is handed in, so that this module depends on none.

import { Copies } from "./copies.js";
import { open } from "./file.js";
import { Regions } from "./regions.js";
import { camera as cameraRule, selectFromMemory } from "./select.js";
import { httpSource } from "./source.js";

/**
 * The mesh of `n` vertices of a page. Attributes are views of the page; only the index is made anew. With `copies` for its sheet it has places in that.
 * Positions are relative to the file's origin: place the object at `file.header.origin`.
 * @param THREE the module, as `import * as THREE from "three"` gives it
 */
export function geometry(THREE, page, n, copies = null) {
  const geometry = new THREE.BufferGeometry();
  const set = (name, values, size, ...more) => geometry.setAttribute(name, new THREE.BufferAttribute(copies?.of(values, size) ?? values, size, ...more));
  set("position", page.positions, 3);
  if (page.normals) set("normal", page.normals, 3);
  if (page.colors) set("color", page.colors, 4, true);
  if (copies) geometry.setAttribute("uv", new THREE.BufferAttribute(copies.places, 2));
  geometry.setIndex(new THREE.BufferAttribute((copies ?? page).indices(n), 1));
  const { center, radius } = page.cluster.sphere;
  geometry.boundingSphere = new THREE.Sphere(new THREE.Vector3(...center), radius);
  return geometry;
}

/** Shows another position of the same page, or of its copies. */
export function setPosition(THREE, geometry, page, n) {
  geometry.setIndex(new THREE.BufferAttribute(page.indices(n), 1));
}

/** A texture of a sheet, for {@link Copies.places}: as many mips as the texels around its charts are for. */
async function textureOf(THREE, sheet) {
  const mipmaps = await Promise.all([0, 1, 2].map((halvings) => sheet.decode(halvings)));
  const texture = new THREE.Texture(mipmaps[0]);
  return Object.assign(texture, { mipmaps, flipY: false, colorSpace: THREE.SRGBColorSpace, generateMipmaps: false, anisotropy: 8, needsUpdate: true });
}

/** Requests of a model at once, and tables that are fetched whole, bytes. */
const AT_ONCE = 3;
const TABLES = 4 << 20;
/** Bytes that pages of all models of a cache take, if nobody says otherwise. */
const BYTES = 512 << 20;

/** What models of a scene share: so many bytes for their pages; what was not drawn for longest goes first. */
export class ChpmCache {
  constructor(bytes = BYTES) {
    Object.assign(this, { limit: bytes, bytes: 0, frame: 0, parts: new Set() });
  }

  add(part) {
    this.parts.add(part);
    this.bytes += part.bytes;
  }

  remove(part) {
    if (this.parts.delete(part)) this.bytes -= part.bytes;
  }

  /** Lets go of what has not been used since the frame before, until the rest fits. */
  shrink() {
    if (this.bytes <= this.limit) return;
    const old = [...this.parts].filter((part) => !part.stays && part.used < this.frame - 1).sort((a, b) => a.used - b.used);
    for (const part of old) {
      if (this.bytes <= this.limit) return;
      part.free();
    }
  }
}

/**
 * The classes for a scene of three.js.
 * @param THREE the module, as `import * as THREE from "three"` gives it
 */
export function withThree(THREE) {
  /**
   * A model in a scene, refined for whatever camera it is drawn with: `scene.add(await new ChpmLoader().loadAsync(url))`. It is at the file's origin; its
   * children are meshes of clusters, whose `userData.error` is the bound of what is drawn, so a ray meets them as it meets any mesh. Says `change` when
   * another picture is there to be drawn, and `lost` when something could not be had.
   */
  class ChpmMesh extends THREE.Group {
    /** Use {@link ChpmLoader}. */
    constructor(file, roots, { pixels = 1, cache = new ChpmCache(), material } = {}) {
      super();
      const { hasNormals, hasColors, origin } = file.header;
      Object.assign(this, { file, roots, pixels, cache, regions: null, isChpmMesh: true });
      this.material = material ?? new THREE.MeshStandardMaterial({ flatShading: !hasNormals, vertexColors: hasColors, side: THREE.DoubleSide });
      this.hasSheets = Boolean(file.sheets && "map" in this.material && globalThis.createImageBitmap);
      this.shown = new Map();
      Object.assign(this, { coming: new Set(), failed: new Set(), plain: new Set(), requests: 0, stopped: new AbortController() });
      this.position.set(...origin);
      // Only what is drawn is told of a frame: so something without a triangle is.
      const pulse = new THREE.Mesh(new THREE.BufferGeometry().setAttribute("position", new THREE.BufferAttribute(new Float32Array(9), 3)), this.material);
      pulse.frustumCulled = false;
      pulse.raycast = () => {};
      pulse.onBeforeRender = (renderer, _, camera) => this.update(camera, renderer.getSize(new THREE.Vector2()).y);
      this.add(pulse);
    }

    /** Opens a file. */
    static async open(source, options) {
      const file = await open(source);
      const roots = await file.roots();
      const mesh = new ChpmMesh(file, roots, options);
      await file.eachPage(roots, (page) => mesh.#take(page, true));
      mesh.#needTables();
      return mesh;
    }

    async #needTables() {
      const { signal } = this.stopped;
      this.hasTables = this.file.tablesLength > TABLES;
      if (this.hasTables) return;
      try {
        const clusters = Array.from({ length: this.file.header.clusterCount }, (_, id) => id);
        // Without its sheets a model has the colours of vertices.
        await Promise.all([this.file.needTables(signal), this.hasSheets && this.file.sheets.need(clusters, signal).catch((error) => this.#lack(error))]);
        this.regions = new Regions(this.file);
        this.hasTables = true;
        this.dispatchEvent({ type: "change" });
      } catch (error) {
        if (!signal.aborted) this.dispatchEvent({ type: "lost", error });
      }
    }

    #lack(error) {
      if (this.stopped.signal.aborted) return;
      this.hasSheets = false;
      this.dispatchEvent({ type: "lost", error });
    }

    #take(page, stays = false) {
      const { id } = page.cluster;
      if (this.shown.has(id) || this.stopped.signal.aborted) return;
      const n = page.cluster.baseVertexCount;
      const mesh = new THREE.Mesh(geometry(THREE, page, n), this.material);
      mesh.visible = false;
      const bytes = 2 * (page.positions.byteLength + page.triangles.byteLength);
      const part = { page, mesh, n, bytes, stays, used: this.cache.frame, free: () => this.#free(id) };
      this.shown.set(id, part);
      this.cache.add(part);
      this.add(mesh);
    }

    #free(id) {
      const part = this.shown.get(id);
      this.shown.delete(id);
      this.cache.remove(part);
      this.remove(part.mesh);
      part.mesh.geometry.dispose();
      if (!part.texture) return;
      part.texture.dispose();
      part.texture.mipmaps.forEach((bitmap) => bitmap.close());
      part.mesh.material.dispose();
    }

    /** Refines for a camera and an image of so many rows, and asks for what that needs: before each frame, by itself. */
    update(camera, height) {
      const { file, cache } = this;
      cache.frame += 1;
      this.updateWorldMatrix(true, false);
      const toLocal = new THREE.Matrix4().copy(this.matrixWorld).invert();
      const eye = new THREE.Vector3().setFromMatrixPosition(camera.matrixWorld).applyMatrix4(toLocal);
      const all = new THREE.Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse).multiply(this.matrixWorld);
      const { planes } = new THREE.Frustum().setFromProjectionMatrix(all);
      const sides = planes.map(({ normal, constant }) => [normal.x, normal.y, normal.z, constant + normal.dot(eye)]);
      const fov = camera.getEffectiveFOV?.() ?? camera.fov ?? 45;
      const rule = cameraRule({ eye: [eye.x, eye.y, eye.z], fov, near: 0, height: Math.max(height, 1), pixels: this.pixels, planes: sides, regions: this.regions, texel: this.hasSheets ? (group) => file.texel(group) : null });
      const { cut, waiting, met } = selectFromMemory(file, this.roots, rule, (id) => this.shown.has(id));
      // What lies above the cut is needed to come down to it.
      for (const id of met) this.shown.get(id).used = cache.frame;
      const isDrawn = new Set(cut.map(({ cluster }) => cluster));
      for (const [id, { mesh }] of this.shown) mesh.visible = isDrawn.has(id);
      for (const { cluster, bound } of cut) {
        const part = this.shown.get(cluster);
        const n = part.page.position(bound);
        if (n !== part.n) setPosition(THREE, part.mesh.geometry, part.copies ?? part.page, (part.n = n));
        part.mesh.userData.error = part.page.errorAt(n);
      }
      // A full cache keeps what it has, and the picture is coarser.
      cache.shrink();
      const isFull = cache.bytes >= cache.limit;
      this.isWaiting = !isFull && waiting.some(({ group }) => !this.failed.has(group.id));
      for (const { group } of waiting) {
        if (isFull || this.requests >= AT_ONCE) break;
        if (!this.coming.has(group.id) && !this.failed.has(group.id)) this.#bring(group.id);
      }
      if (this.hasSheets && this.hasTables && !isFull && !this.isWaiting && this.requests === 0) this.#paint(cut.map(({ cluster }) => cluster));
    }

    /** Fetches the sheets that drawn clusters lack; those that are damaged stay without. */
    async #paint(ids) {
      const absent = ids.filter((id) => !this.shown.get(id).texture && !this.plain.has(id));
      if (absent.length === 0) return;
      const { file, stopped: { signal } } = this;
      this.requests += 1;
      for (const part of [absent, ...(absent.length > 1 ? absent.map((id) => [id]) : [])]) {
        try {
          await file.sheets.need(part, signal);
          const clusters = part.filter((id) => !this.shown.get(id)?.texture).map((id) => file.cluster(id));
          await file.sheets.each(clusters, (sheet) => this.#dress(sheet), signal);
          if (part === absent) break;
        } catch (error) {
          if (signal.aborted) return;
          const isLast = part.length === 1 || error.isLost;
          if (part.length === 1 && !error.isLost) this.plain.add(part[0]);
          if (isLast) this.dispatchEvent({ type: "lost", error });
          if (error.isLost) break;
        }
      }
      this.requests -= 1;
      this.dispatchEvent({ type: "change" });
    }

    async #dress(sheet) {
      const texture = await textureOf(THREE, sheet);
      const part = this.shown.get(sheet.cluster.id);
      if (!part || part.texture) return texture.mipmaps.forEach((bitmap) => bitmap.close());
      const copies = new Copies(part.page, sheet);
      const material = Object.assign(this.material.clone(), { map: texture, vertexColors: false });
      // Only what is not opaque is a PNG.
      if (sheet.type === "image/png" && !material.alphaTest) material.alphaTest = 0.5;
      this.cache.remove(part);
      part.mesh.geometry.dispose();
      Object.assign(part.mesh, { geometry: geometry(THREE, part.page, part.n, copies), material });
      Object.assign(part, { copies, texture, bytes: part.bytes + 24 * copies.count + 5.25 * sheet.size[0] * sheet.size[1] });
      this.cache.add(part);
      this.dispatchEvent({ type: "change" });
    }

    async #bring(id) {
      const { signal } = this.stopped;
      this.requests += 1;
      this.coming.add(id);
      try {
        const { file } = this;
        await file.needGroups([id], signal);
        const group = file.group(id);
        await file.needMembers([group], signal);
        const fine = file.fine(group);
        await file.needClusters(fine, signal);
        await file.needGroups(fine.map((cluster) => file.cluster(cluster).group), signal);
        await file.eachPage(fine.filter((cluster) => !this.shown.has(cluster)), (page) => this.#take(page), signal);
      } catch (error) {
        if (signal.aborted) return;
        if (!error.isLost) this.failed.add(id);
        this.dispatchEvent({ type: "lost", error });
      }
      this.coming.delete(id);
      this.requests -= 1;
      this.dispatchEvent({ type: "change" });
    }

    /** Whether the last frame had all that its camera wants. */
    get isSettled() {
      return this.isWaiting === false && this.requests === 0;
    }

    dispose() {
      this.stopped.abort();
      for (const id of [...this.shown.keys()]) this.#free(id);
    }
  }

  /** Loads models, as loaders of three.js do. Those of one loader share its cache. */
  class ChpmLoader extends THREE.Loader {
    constructor(manager, options = {}) {
      super(manager);
      this.options = { cache: new ChpmCache(), ...options };
    }

    load(url, onLoad, _, onError = (error) => console.error(error)) {
      const at = new URL(this.path + url, globalThis.location?.href);
      const { requestHeader: headers } = this;
      ChpmMesh.open(httpSource(at, { headers }), this.options).then(onLoad, onError);
    }
  }

  return { ChpmCache, ChpmLoader, ChpmMesh };
}
