"""trimesh, PyVista and meshio read what the command extracts."""

from __future__ import annotations

import os
import stat
import subprocess
import sys

import chpm
import meshes
import numpy as np
import pytest
from conftest import run


@pytest.fixture
def extracted(models, tmp_path):
    def of(name: str, *words: object) -> meshes.Ply:
        run("extract", models[name], *words, "-o", tmp_path / "out.ply", "-q")
        return meshes.read(tmp_path / "out.ply")

    return of


@pytest.mark.parametrize("name", ["looks", "packed", "far", "octahedral"])
def test_trimesh(models, extracted, name):
    trimesh = pytest.importorskip("trimesh")
    mesh = chpm.read_trimesh(models[name], triangles=3000)
    ply = extracted(name, "--triangles", 3000)
    assert isinstance(mesh, trimesh.Trimesh)
    assert (mesh.vertices == ply.points).all() and (mesh.faces == ply.faces).all()
    assert np.float32(mesh.metadata["distance"]) == np.float32(ply.distance)
    assert np.float32(mesh.metadata["error"]) == np.float32(ply.error)
    if ply.normals is not None:
        assert np.allclose(mesh.vertex_normals, ply.normals, atol=1e-5)
    if ply.colors is not None:
        assert (mesh.visual.vertex_colors == ply.colors).all()
    # The source's boundary, at its poles, is all there is: no cracks.
    odd = []
    for shown in [mesh, chpm.read_trimesh(models[name], level=0)]:
        _, count = np.unique(shown.edges_sorted, axis=0, return_counts=True)
        odd.append((count % 2 == 1).sum())
    assert 0 < odd[0] <= odd[1] == 240


@pytest.mark.parametrize("name", ["looks", "far"])
def test_pyvista(models, extracted, name):
    pytest.importorskip("pyvista")
    import chpm.pyvista
    import pyvista

    mesh = pyvista.read(models[name], triangles=3000)
    ply = extracted(name, "--triangles", 3000)
    assert isinstance(mesh, pyvista.PolyData) and mesh.is_all_triangles
    assert mesh.points.dtype == ply.points.dtype and (mesh.points == ply.points).all()
    assert (mesh.regular_faces == ply.faces).all()
    assert np.float32(mesh.field_data["error"][0]) == np.float32(ply.error)
    if ply.normals is not None:
        assert (mesh.point_data["Normals"] == ply.normals).all()
        assert (mesh.point_data["RGBA"] == ply.colors).all()
    assert mesh.volume > 0
    with pytest.raises(chpm.SelectionError):
        pyvista.read(models[name], triangles=1)
    assert chpm.pyvista.read(models[name], error="2%").n_cells < mesh.n_cells


def test_pyvista_finds_the_reader_without_an_import(models):
    pytest.importorskip("pyvista")
    script = "import pyvista, sys; print(pyvista.read(sys.argv[1]).n_cells)"
    done = subprocess.run([sys.executable, "-c", script, models["one"]], capture_output=True, text=True)
    assert done.stdout.strip() == "1", done.stderr


@pytest.mark.parametrize("name", ["looks", "far"])
def test_meshio(models, extracted, name):
    meshio = pytest.importorskip("meshio")
    import chpm.meshio

    ply = extracted(name, "--level", 0)
    mesh = meshio.read(models[name])
    assert (mesh.points == ply.points).all() and mesh.points.dtype == ply.points.dtype
    assert (mesh.cells_dict["triangle"] == ply.faces).all()
    if ply.normals is not None:
        assert (mesh.point_data["normals"] == ply.normals).all()
        assert (mesh.point_data["rgba"] == ply.colors).all()
    fewer = chpm.meshio.read(models[name], triangles=2000)
    assert len(fewer.cells_dict["triangle"]) <= 2000 and fewer.info["error"] > 0


def test_readers_take_what_memory_can_hold(models, monkeypatch):
    assert chpm.read(models["plain"]).triangle_count == chpm.open(models["plain"]).triangle_count
    monkeypatch.setattr("chpm._read.DEFAULT_TRIANGLES", 1500)
    assert 1000 < chpm.read(models["plain"]).triangle_count <= 1500
    assert chpm.read(models["plain"], level=0).triangle_count > 1500
