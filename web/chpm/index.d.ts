/** What is wrong with a file or with the way to it, in words for people. */
export class ChpmError extends Error {
  /** Whether it is the way to the file that failed: the same may succeed later. */
  readonly isLost: boolean;
}

/** Where bytes come from. */
export interface Source {
  /** The file of a volume, by its number from 1, where pages may be in some. */
  volume?(number: number): Source;
  /** How messages call it. */
  readonly name: string;
  /** Bytes of the whole file, if they are known. */
  size(): Promise<number | undefined>;
  /** Bytes from `offset` on; fewer only where the file ends. With `isFresh` not from a cache: what that has is damaged. */
  read(offset: number, length: number, signal?: AbortSignal, isFresh?: boolean): Promise<Uint8Array>;
}

export interface HttpSource extends Source {
  readonly statistics: { requests: number; bytes: number };
}

export interface HttpOptions {
  fetch?: typeof fetch;
  headers?: Record<string, string>;
  /** Waits before a lost request is made again, milliseconds; as often as there are any. */
  waits?: number[];
  /** So long without a byte, and a request is lost; milliseconds. */
  patience?: number;
  /** Whether it is always read in full: no range is asked for. */
  isWhole?: boolean;
}

/** A file on a host that answers range requests. What the browser's cache has of it, in the version that the host has, is not fetched again. */
export function httpSource(url: string | URL, options?: HttpOptions): HttpSource;
/** A file that somebody picked or dropped. */
/** @param files that came with it, where its volumes may be among them */
export function blobSource(blob: Blob, files?: Iterable<File>): Source;
/** A file that `chpm share --split` cut into pieces, in a folder of a host that sends whole files only. */
export function piecesSource(folder: string | URL, pieces: { length: number; size: number }, options?: HttpOptions): HttpSource;
/** A source of which some ranges (offset, length) are asked for at once. */
export function prefetched<S extends Source>(source: S, ranges: [number, number][]): S;
/** @param volumes bytes of its volumes, if it has any */
export function memorySource(bytes: ArrayBuffer | ArrayBufferView, volumes?: (ArrayBuffer | ArrayBufferView)[]): Source;

/** Lengths are in units of the model; positions, boxes and spheres are relative to `origin`. */
export interface Header {
  readonly versionMinor: number;
  readonly isPacked: boolean;
  /** Whether packed pages may rest on one above, which then comes with them. */
  readonly isChained: boolean;
  /** Whether clusters have sheets: images of their surfaces. */
  readonly hasSheets: boolean;
  readonly fileLength: number;
  readonly hasNormals: boolean;
  readonly hasColors: boolean;
  readonly sourceVertexCount: number;
  readonly sourceTriangleCount: number;
  readonly clusterCount: number;
  readonly groupCount: number;
  readonly levelCount: number;
  readonly rootCount: number;
  readonly leafCount: number;
  /** Whether errors are proven bounds. */
  readonly isCertified: boolean;
  readonly origin: number[];
  readonly boxMin: number[];
  readonly boxMax: number[];
  readonly maxError: number;
}

export interface Sphere {
  readonly center: number[];
  readonly radius: number;
}

/** A cluster: the vertices and triangles of its finest mesh, and those of its base mesh. */
export interface Cluster {
  readonly id: number;
  /** Height above the leaves. */
  readonly level: number;
  readonly vertexCount: number;
  readonly baseVertexCount: number;
  readonly triangleCount: number;
  readonly baseTriangleCount: number;
  readonly sharedCount: number;
  readonly group: number;
  readonly parentGroup: number;
  readonly minError: number;
  readonly maxError: number;
  readonly boxMin: number[];
  readonly boxMax: number[];
  readonly sphere: Sphere;
}

/** Clusters that are replaced, all together, by finer ones. */
export interface Group {
  readonly id: number;
  readonly level: number;
  readonly coarseCount: number;
  readonly fineCount: number;
  readonly minError: number;
  readonly maxError: number;
  /** Holds the coarse clusters and all below them. */
  readonly sphere: Sphere;
  readonly fineGap: number;
  readonly baseGap: number;
  readonly gapError: number;
}

/** A cluster's progressive mesh. Arrays are views of the bytes that came. */
export class Page {
  readonly cluster: Cluster;
  /** Three singles a vertex, relative to the file's origin. */
  readonly positions: Float32Array;
  readonly normals: Float32Array | null;
  /** Red, green, blue, alpha. */
  readonly colors: Uint8Array | null;
  /** Three corners a triangle, of the finest mesh. */
  readonly triangles: Uint16Array;
  /** The error of the mesh of the first `n` vertices. */
  errorAt(n: number): number;
  /** The fewest vertices with an error of at most `bound`. */
  position(bound: number): number;
  /** Three corners for each triangle of the mesh of the first `n` vertices. */
  indices(n: number): Uint16Array;
  /** Ids of shared vertices by vertex, and -1 for the others. */
  ids(): Float64Array;
}

/** A cluster's image, of which its triangles show parts. */
export class Sheet {
  readonly cluster: Cluster;
  /** Width and height, texels. */
  readonly size: [number, number];
  /** Side of the largest texels, in units of the model. */
  readonly texel: number;
  /** Media type of the image, and the image as it is stored. */
  readonly type: "image/jpeg" | "image/png";
  readonly image: Uint8Array;
  /** By triangle of the finest mesh, the chart that it is in at all positions. */
  readonly chartOf: Uint16Array;
  /** Puts where a vertex is in a chart to `to`, from `at` on: shares of width and height, from the upper left corner. */
  place(chart: number, positions: Float32Array, vertex: number, to: Float32Array, at: number): void;
  /** The image, its sides halved so often. Browsers only. */
  decode(halvings?: number): Promise<ImageBitmap>;
}

export interface SheetRecord {
  readonly id: number;
  readonly size: [number, number];
  readonly texel: number;
  readonly chartCount: number;
  readonly type: "image/jpeg" | "image/png";
}

export class Sheets {
  /** Fetches what is missing of these clusters' records. */
  need(ids: Iterable<number>, signal?: AbortSignal): Promise<void>;
  /** Null if it has not been fetched. */
  record(id: number): SheetRecord | null;
  /** Clusters whose sheets come in one request, and those of the next. */
  runs(ids: Iterable<number>, longest?: number, near?: number): number[][];
  /** Sheets of clusters whose records are there; neighbours come in one request. */
  each(clusters: Cluster[], take: (sheet: Sheet) => void | Promise<void>, signal?: AbortSignal): Promise<void>;
}

/** The vertices of a page, one for each chart that a vertex is drawn in. */
export class Copies {
  constructor(page: Page, sheet: Sheet);
  readonly count: number;
  readonly vertexOf: Uint16Array;
  /** Two shares of the sheet's width and height for each. */
  readonly places: Float32Array;
  /** What vertices have, `size` values each, for their copies. */
  of<A extends Float32Array | Uint8Array | Int16Array>(values: A, size: number): A;
  /** Three copies for each triangle of the mesh of the first `n` vertices. */
  indices(n: number): Uint16Array | Uint32Array;
}

export class ChpmFile {
  readonly header: Header;
  /** Null where clusters have none. */
  readonly sheets: Sheets | null;
  readonly source: Source;
  needClusters(ids: Iterable<number>, signal?: AbortSignal): Promise<void>;
  needGroups(ids: Iterable<number>, signal?: AbortSignal): Promise<void>;
  needMembers(groups: Iterable<Group>, signal?: AbortSignal): Promise<void>;
  /** A record, checked; null if it has not been fetched. */
  cluster(id: number): Cluster | null;
  group(id: number): Group | null;
  hasMembers(group: Group): boolean;
  /** Bytes of all tables. */
  readonly tablesLength: number;
  /** Fetches what is missing of all tables. */
  needTables(signal?: AbortSignal): Promise<void>;
  /** Clusters whose pages come in one request, and those of the next. */
  runs(ids: Iterable<number>, longest?: number, near?: number): number[][];
  /** The largest texels of the sheets of a group's coarse clusters; 0 where they are not known. */
  texel(group: Group): number;
  coarse(group: Group): number[];
  fine(group: Group): number[];
  roots(signal?: AbortSignal): Promise<number[]>;
  /** Pages of clusters whose records are there; neighbours come in one request. */
  eachPage(ids: Iterable<number>, take: (page: Page) => void, signal?: AbortSignal): Promise<void>;
  pages(ids: Iterable<number>, signal?: AbortSignal): Promise<Map<number, Page>>;
}

/** Expands a frame of zstd; what comes out is at most `most` bytes long, or the frame is damaged. */
export type Zstd = (frame: Uint8Array, most: number) => Uint8Array;

/** Has pages expanded and checked by a worker that runs {@link answerPages}. Until that has answered, and where it fails, it is done without. */
export class Decoder {
  constructor(worker: Worker);
  /** Whether the worker is there. */
  readonly isReady: boolean;
  /** How many pages it has sent. */
  readonly come: number;
}
/** What a worker runs, with its global scope. `prepare` may put more on each page. */
export function answerPages(scope: unknown, prepare?: (page: Page) => void): void;

/**
 * Opens a file. `first` bytes are fetched at once, 32 KiB if not told otherwise. `zstd` is for packed pages; the reader has one of its own. With a `decoder` what `source.read`
 * gives is given away: it must not be read again.
 */
export function open(source: Source, options?: { signal?: AbortSignal; first?: number; zstd?: Zstd; decoder?: Decoder | null }): Promise<ChpmFile>;

/** Spheres and boxes of groups with all that is below; of a file with all of its tables. */
export class Regions {
  constructor(file: ChpmFile);
}

/** Which groups are split, and the error that the clusters of the others are drawn with. */
export interface Rule {
  wants(group: Group): boolean;
  bound(group: Group): number;
}

/** A cluster of a cut, and the error that it is drawn with; infinite for its base mesh. */
export interface Member {
  cluster: number;
  bound: number;
}

/** The same error everywhere; components that lie apart may have vanished. */
export function uniform(error: number): Rule;
/** No point of the source is farther from what is drawn, nor the other way round; nothing is exempt. */
export function distance(most: number): Rule;
/** The clusters of a level at their finest; 0 is the source. */
export function level(number: number): Rule;
/**
 * At most `pixels` of error in an image of `height` rows; `eye` in the model's coordinates, less `origin`; `fov` in degrees, vertical. Beyond one of
 * the `planes` (inner normal of length 1, offset; for points relative to the eye), and in groups that something `hides` with all that is below, any error is allowed. With `regions` boxes count, as in the viewer.
 * A group with a larger `texel` than the error that is allowed is split for its sheets.
 */
export function camera(view: { eye: number[]; fov: number; near?: number; height: number; pixels: number; origin?: number[]; planes?: number[][]; regions?: Regions | null; texel?: ((group: Group) => number) | null; hides?: ((group: Group) => boolean) | null }): Rule;

/** The cut that a rule gives; tables are fetched as far as it goes. */
export function select(file: ChpmFile, rule: Rule, options?: { signal?: AbortSignal }): Promise<Member[]>;
/** The cut from what is in memory. Where a cluster cannot be drawn yet, coarser ones stay; no cut has cracks. */
export function selectFromMemory(
  file: ChpmFile,
  roots: number[],
  rule: Rule,
  mayDraw?: (cluster: number) => boolean,
): { cut: Member[]; waiting: { group: Group | { id: number }; fine: number[] | null }[]; met: Set<number> };

/** A cut as one mesh: vertices that clusters share are one. */
export function extract(
  file: ChpmFile,
  cut: Member[],
  options?: { signal?: AbortSignal },
): Promise<{
  /** Three doubles a vertex, in the model's coordinates. */
  positions: Float64Array;
  triangles: Uint32Array;
  normals: Float32Array | null;
  colors: Uint8Array | null;
  /** The largest error of a part. */
  error: number;
}>;
