// For three.js: a page as a BufferGeometry. The library is handed in, so that this module depends on none.

/**
 * The mesh of `n` vertices of a page. Attributes are views of the page; only the index is made anew.
 * Positions are relative to the file's origin: place the object at `file.header.origin`.
 * @param THREE the module, as `import * as THREE from "three"` gives it
 */
export function geometry(THREE, page, n) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(page.positions, 3));
  if (page.normals) geometry.setAttribute("normal", new THREE.BufferAttribute(page.normals, 3));
  if (page.colors) geometry.setAttribute("color", new THREE.BufferAttribute(page.colors, 4, true));
  geometry.setIndex(new THREE.BufferAttribute(page.indices(n), 1));
  const { center, radius } = page.cluster.sphere;
  geometry.boundingSphere = new THREE.Sphere(new THREE.Vector3(...center), radius);
  return geometry;
}

/** Shows another position of the same page. */
export function setPosition(THREE, geometry, page, n) {
  geometry.setIndex(new THREE.BufferAttribute(page.indices(n), 1));
}
