import type * as Three from "three";
import type { ChpmFile, Copies, Page, Source } from "./index.js";

type ThreeModule = typeof Three;

/** The mesh of the first `n` vertices of a page, relative to the file's origin; with `copies` it has places in the page's sheet. */
export function geometry(THREE: ThreeModule, page: Page, n: number, copies?: Copies | null): Three.BufferGeometry;
/** Shows another position of the same page, or of its copies. */
export function setPosition(THREE: ThreeModule, geometry: Three.BufferGeometry, page: Page | Copies, n: number): void;

/** What models of a scene share: so many bytes for their pages. */
export class ChpmCache {
  constructor(bytes?: number);
  readonly bytes: number;
}

export interface ChpmMeshOptions {
  /** Pixels of error that are allowed; 1 if not told otherwise. */
  pixels?: number;
  cache?: ChpmCache;
  /** Cloned for each cluster with a sheet, if it has a `map`. */
  material?: Three.Material;
}

/** A model in a scene, refined for whatever camera it is drawn with. Says `change` when another picture is there to be drawn, and `lost`. */
export interface ChpmMesh extends Three.Group {
  readonly file: ChpmFile;
  readonly isChpmMesh: true;
  /** Pixels of error that are allowed. */
  pixels: number;
  readonly isSettled: boolean;
  /** Refines for a camera and an image of so many rows; each frame does it by itself. */
  update(camera: Three.Camera, height: number): void;
  dispose(): void;
}

/** The classes for a scene of three.js. Models of one loader share its cache. */
export function withThree(THREE: ThreeModule): {
  ChpmCache: typeof ChpmCache;
  ChpmMesh: { open(source: Source, options?: ChpmMeshOptions): Promise<ChpmMesh> };
  ChpmLoader: {
    new (manager?: Three.LoadingManager, options?: ChpmMeshOptions): Three.Loader<ChpmMesh>;
  };
};
