// A host of static files that can be told to misbehave.

import { createReadStream, promises as fs } from "node:fs";
import { createServer } from "node:http";
import path from "node:path";

const TYPES = { ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".chpm": "application/octet-stream" };

/**
 * Serves folders: a path is looked up in each in turn.
 * @param {string[]} folders
 */
export async function serve(folders) {
  const state = { ranges: true, gone: new Set(), requests: [], hold: null, lose: () => false };
  const server = createServer(async (request, response) => {
    const name = decodeURIComponent(new URL(request.url, "http://localhost").pathname);
    const candidates = folders.map((folder) => path.join(folder, path.normalize(name)));
    for (const file of candidates) {
      const found = await fs.stat(file).catch(() => null);
      if (!found?.isFile() || state.gone.has(path.basename(file))) continue;
      const headers = { "Content-Type": TYPES[path.extname(file)] ?? "application/octet-stream", ETag: `"${found.mtimeMs}-${found.size}"` };
      const range = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range ?? "");
      if (range && state.ranges) {
        const [first, last] = [Number(range[1]), Math.min(Number(range[2]), found.size - 1)];
        // Ranges from there on wait.
        if (state.hold && first >= state.hold.from) await state.hold.until;
        if (state.lose(path.basename(file), first)) return request.socket.destroy();
        if (request.headers["if-none-match"] === headers.ETag) {
          state.requests.push({ file: path.basename(file), first, length: 0 });
          return response.writeHead(304, headers).end();
        }
        state.requests.push({ file: path.basename(file), first, length: last - first + 1 });
        response.writeHead(206, { ...headers, "Content-Range": `bytes ${first}-${last}/${found.size}`, "Content-Length": last - first + 1 });
        createReadStream(file, { start: first, end: last }).pipe(response);
      } else {
        response.writeHead(200, { ...headers, "Content-Length": found.size });
        createReadStream(file).pipe(response);
      }
      return;
    }
    response.writeHead(404).end();
  });
  await new Promise((ready) => server.listen(0, "127.0.0.1", ready));
  return { ...state, state, url: `http://127.0.0.1:${server.address().port}`, close: () => server.close() };
}
