// Checks sums: each line of standard input is a length and the sum of bytes that follow from it, `node sums.mjs`.
import { createInterface } from "node:readline";
import { xxh3 } from "../chpm/xxh3.js";

let wrong = 0;
for await (const line of createInterface({ input: process.stdin })) {
  const [length, sum] = line.split(" ");
  const bytes = Uint8Array.from({ length: Number(length) }, (_, i) => (i * 167 + (i >> 8) * 13 + 5) & 255);
  if (xxh3(bytes) !== BigInt(`0x${sum}`)) {
    wrong += 1;
    console.error(`${length} bytes: ${xxh3(bytes).toString(16)}, not ${sum}`);
  }
}
process.exitCode = wrong > 0 ? 1 : 0;
