// A reader of .chpm files for browsers and for Node.js: plain modules, nothing to build.

export { Copies } from "./copies.js";
export { Decoder, answerPages } from "./decoder.js";
export { ChpmFile, open } from "./file.js";
export { extract } from "./mesh.js";
export { Page } from "./page.js";
export { piecesSource } from "./pieces.js";
export { prefetched } from "./prefetched.js";
export { Sheet, Sheets } from "./sheets.js";
export { camera, distance, level, select, selectFromMemory, uniform } from "./select.js";
export { Regions } from "./regions.js";
export { ChpmError, blobSource, httpSource, memorySource } from "./source.js";
