// Asks CesiumJS how high the tiles are at places of the earth.

const { Cartesian3, Cartographic, Cesium3DTileset, CesiumWidget, Math: angles } = Cesium;
const results = {};
try {
  const widget = new CesiumWidget("view", { baseLayer: false, globe: false, skyBox: false, skyAtmosphere: false, scene3DOnly: true });
  for (const name of await (await fetch("/names.json")).json()) {
    const { points } = await (await fetch(`/sets/${name}.json`)).json();
    const tileset = await Cesium3DTileset.fromUrl(`/sets/${name}/tileset.json`);
    widget.scene.primitives.add(tileset);
    const [lon, lat, height] = points[points.length >> 1];
    widget.camera.setView({ destination: Cartesian3.fromDegrees(lon, lat, height + 600) });
    const places = points.map(([lon, lat]) => new Cartographic(angles.toRadians(lon), angles.toRadians(lat)));
    const found = await widget.scene.sampleHeightMostDetailed(places);
    results[name] = found.map(({ height }) => height ?? null);
    widget.scene.primitives.remove(tileset);
  }
} catch (error) {
  results.failure = `${error.stack ?? error}`;
}
await fetch("/results", { method: "POST", body: JSON.stringify(results) });
