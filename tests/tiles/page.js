// Shows a tileset to six cameras that see everything around one eye, waits until nothing loads any more, and tells what is drawn.
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { MeshoptDecoder } from "three/addons/libs/meshopt_decoder.module.js";
import { TilesRenderer } from "/node_modules/3d-tiles-renderer/build/index.three.js";

const ROWS = 1000;
const SIDES = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];

function cameras() {
  return SIDES.map(([x, y, z]) => {
    const camera = new THREE.PerspectiveCamera(90, 1, 1e-6, 1e9);
    camera.up.set(z, x, y);
    camera.userData.way = new THREE.Vector3(x, y, z);
    return camera;
  });
}

function open(url) {
  const tiles = new TilesRenderer(url);
  const loader = new GLTFLoader(tiles.manager);
  loader.setMeshoptDecoder(MeshoptDecoder);
  tiles.manager.addHandler(/\.glb$/, loader);
  return tiles;
}

/// Edges of what is drawn that an odd number of triangles has, by the positions of their ends; and the names of the tiles.
function drawn(tiles) {
  const edges = new Map();
  const names = [];
  let triangles = 0;
  tiles.forEachLoadedModel((scene, tile) => {
    if (!tiles.visibleTiles.has(tile)) return;
    names.push(tile.content.uri.replace(/^.*tiles\//, ""));
    scene.traverse((object) => {
      if (!object.isMesh) return;
      const { index, attributes: { position } } = object.geometry;
      const key = (v) => `${position.getX(v)} ${position.getY(v)} ${position.getZ(v)}`;
      triangles += index.count / 3;
      for (let at = 0; at < index.count; at += 3) {
        const corners = [0, 1, 2].map((i) => key(index.getX(at + i)));
        for (let i = 0; i < 3; i++) {
          const edge = [corners[i], corners[(i + 1) % 3]].sort().join(" - ");
          edges.set(edge, (edges.get(edge) ?? 0) + 1);
        }
      }
    });
  });
  const open = [...edges].filter(([, count]) => count % 2 === 1).map(([edge]) => edge);
  return { names: names.sort(), triangles, open };
}

/// Goes on until nothing loads and nothing changes for some frames; requests begin a frame or two after they are wanted.
async function settle(tiles) {
  let before = "";
  for (let calm = 0; calm < 20; ) {
    tiles.update();
    await new Promise(requestAnimationFrame);
    const { downloading, parsing, queued = 0 } = tiles.stats;
    const now = [...tiles.visibleTiles].map((tile) => tile.content.uri).sort().join();
    const idle = tiles.root !== null && downloading + parsing + queued === 0 && now !== "";
    calm = idle && now === before ? calm + 1 : 0;
    before = now;
  }
}

const { sets, views } = await (await fetch("/views.json")).json();
const results = [];
try {
  for (const set of sets) {
    const tiles = open(`/sets/${set.name}/tileset.json`);
    const failures = [];
    tiles.addEventListener("load-error", ({ error }) => failures.push(String(error)));
    const eyes = cameras();
    for (const camera of eyes) {
      tiles.setCamera(camera);
      tiles.setResolution(camera, ROWS, ROWS);
    }
    for (const { eye, pixels } of views[set.name]) {
      for (const camera of eyes) {
        camera.position.fromArray(eye);
        camera.lookAt(camera.position.clone().add(camera.userData.way));
        camera.updateMatrixWorld(true);
      }
      tiles.errorTarget = pixels;
      await settle(tiles);
      results.push({ set: set.name, eye, pixels, failures: [...failures], ...drawn(tiles) });
    }
    tiles.dispose();
  }
} catch (error) {
  results.push({ failure: `${error.stack}` });
}
await fetch("/results", { method: "POST", body: JSON.stringify(results) });
