// Shows tilesets to cameras that see all of them, waits until nothing loads any more, and tells which tiles are drawn, with a picture of each set.

const { Cartesian3, Cesium3DTileset, CesiumWidget, Color, JulianDate, Matrix4 } = Cesium;

const widget = new CesiumWidget("view", {
  baseLayer: false,
  globe: false,
  skyBox: false,
  skyAtmosphere: false,
  scene3DOnly: true,
  useDefaultRenderLoop: false,
  contextOptions: { webgl: { preserveDrawingBuffer: true } },
});
const { scene, camera } = widget;
scene.backgroundColor = Color.fromCssColorString("#203040");
widget.resize();

/// A point of the tileset's own frame, in that of the earth.
const world = (tileset, point) => Matrix4.multiplyByPoint(tileset.root.computedTransform, Cartesian3.fromArray(point), new Cartesian3());
const way = (tileset, vector) => {
  const turned = Matrix4.multiplyByPointAsVector(tileset.root.computedTransform, Cartesian3.fromArray(vector), new Cartesian3());
  return Cartesian3.normalize(turned, turned);
};

/// Draws frames until the same tiles were drawn in many, and none are wanted.
async function settle(tileset) {
  let names = [];
  const note = (tile) => names.push(tile.content.url.replace(/^.*tiles\//, "").replace(/\?.*$/, ""));
  tileset.tileVisible.addEventListener(note);
  let before = "";
  for (let calm = 0; calm < 12; ) {
    names = [];
    scene.render(JulianDate.now());
    await new Promise(requestAnimationFrame);
    const now = names.sort().join();
    calm = tileset.tilesLoaded && now === before && now !== "" ? calm + 1 : 0;
    before = now;
  }
  tileset.tileVisible.removeEventListener(note);
  return names;
}

const post = (body) => fetch("/results", { method: "POST", body: JSON.stringify(body) });
const results = [];
try {
  const { sets, views } = await (await fetch("/views.json")).json();
  for (const { name, options } of sets) {
    const tileset = await Cesium3DTileset.fromUrl(`/sets/${name}/tileset.json`, options);
    const failures = [];
    tileset.tileFailed.addEventListener(({ url, message }) => failures.push(`${url}: ${message}`));
    scene.primitives.add(tileset);
    for (const { eye, forth, up, pixels } of views[name]) {
      camera.frustum.fov = (2 * Math.PI) / 3;
      camera.frustum.near = 1e-4;
      camera.setView({ destination: world(tileset, eye), orientation: { direction: way(tileset, forth), up: way(tileset, up) } });
      tileset.maximumScreenSpaceError = pixels;
      const names = await settle(tileset);
      const size = [scene.drawingBufferWidth, scene.drawingBufferHeight];
      results.push({ set: name, eye, pixels, names, size, failures: [...failures], picture: null });
    }
    results.at(-1).picture = scene.canvas.toDataURL("image/png");
    scene.primitives.remove(tileset);
  }
} catch (error) {
  results.push({ failure: `${error.stack ?? error}` });
}
await post({ results, said });
