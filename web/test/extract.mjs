// Prints the triangles of a cut, sorted, as hexadecimal bits: `node extract.mjs FILE error|distance|level NUMBER`.
import { openAsBlob } from "node:fs";
import { blobSource, distance, extract, level, open, select, uniform } from "../chpm/index.js";

const [name, kind, number] = process.argv.slice(2);
const rules = { error: uniform, distance, level };
try {
  const file = await open(blobSource(await openAsBlob(name)));
  const cut = await select(file, rules[kind](Number(number)));
  const { positions, triangles, error } = await extract(file, cut);
  console.log(cut.length, triangles.length / 3, positions.length / 3, error);
} catch (error) {
  console.error(`${error.name}: ${error.message}`);
  process.exitCode = 1;
}
