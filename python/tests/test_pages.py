"""Pages: arrays that look into the file, and what they add up to."""

from __future__ import annotations

import chpm
import numpy as np
import pytest
from conftest import MODELS


@pytest.mark.parametrize("name", MODELS)
def test_pages_are_the_models(models, name):
    with chpm.open(models[name]) as file:
        pages = list(file.pages())
        assert [page.cluster for page in pages] == list(range(len(file)))
        for level in file.levels:
            of_level = list(file.pages(level=level.level))
            assert len(of_level) == level.cluster_count
            assert sum(len(page.faces) for page in of_level) == level.triangle_count
            assert {page.level for page in of_level} == {level.level}
        carried = (file.has_normals, file.has_colors)
        # All leaves at their finest are the source.
        leaves = [page for page in pages if page.level == 0]
        whole = file.select(level=0)
        corners = np.concatenate([page.vertices[page.faces].reshape(-1, 9) for page in leaves])
        theirs = whole.vertices[whole.faces].reshape(-1, 9)
        assert sorted(map(bytes, corners)) == sorted(map(bytes, theirs))
    for page in pages:
        v, b, t = page.vertex_count, page.base_vertex_count, page.triangle_count
        assert page.vertices.shape == (v, 3) and page.vertices.dtype == np.float32
        assert page.faces.shape == (t, 3) and page.faces.dtype == np.uint16 and (t == 0 or page.faces.max() < v)
        assert page.targets.shape == (v - b,) and page.targets.dtype == np.uint16
        assert (page.targets < np.arange(b, v)).all()
        assert page.errors.shape == (v - b + 1,) and page.errors.dtype == np.float32
        assert (np.diff(page.errors) <= 0).all()
        assert (page.errors[0], page.errors[-1]) == (np.float32(page.max_error), np.float32(page.min_error))
        assert (page.normals is not None, page.colors is not None) == carried
        if page.normals is not None:
            assert page.normals.shape == (v, 3) and page.normals.dtype == np.float32
            assert np.allclose(np.linalg.norm(page.normals, axis=1), 1, atol=1e-5)
        if page.colors is not None:
            assert page.colors.shape == (v, 4) and page.colors.dtype == np.uint8
        assert page.shared_vertices.dtype == np.uint16 and page.shared_ids.dtype == np.uint32
        assert page.shared_vertices.shape == page.shared_ids.shape
        assert (np.diff(page.shared_vertices.astype(int)) > 0).all()
        assert (page.faces_at(v) == page.faces).all()
        base = page.faces_at(b)
        assert base.shape == (page.base_triangle_count, 3) and (len(base) == 0 or base.max() < b)


def test_clusters_share_vertices_by_their_ids(models):
    with chpm.open(models["plain"]) as file:
        at = {}
        for page in file.pages(level=0):
            for vertex, id in zip(page.shared_vertices, page.shared_ids):
                at.setdefault(int(id), set()).add(page.vertices[vertex].tobytes())
        assert len(at) > 100 and all(len(places) == 1 for places in at.values())


def test_playing_a_page_is_what_its_targets_say(models):
    with chpm.open(models["plain"]) as file:
        page = file.page(3)
        n = (page.base_vertex_count + page.vertex_count) // 2
        faces = page.faces.astype(int)
        for vertex in range(page.vertex_count - 1, n - 1, -1):
            faces[faces == vertex] = page.targets[vertex - page.base_vertex_count]
        alive = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
        assert (page.faces_at(n) == faces[alive]).all()
        for n in [page.base_vertex_count - 1, page.vertex_count + 1]:
            with pytest.raises(chpm.SelectionError, match="has meshes of"):
                page.faces_at(n)


def test_raw_pages_are_not_copied(models):
    with chpm.open(models["looks"]) as file:
        page, again = file.page(2), file.page(2)
        for name in ["vertices", "faces", "normals", "colors", "targets", "shared_ids"]:
            mine, theirs = getattr(page, name), getattr(again, name)
            assert np.shares_memory(mine, theirs) and not mine.flags.owndata, name
            assert not mine.flags.writeable
            with pytest.raises(ValueError):
                mine[0] = 0
        # They lie in the file one behind the other.
        assert page.vertices.ctypes.data + page.vertices.nbytes == page.normals.ctypes.data
    with chpm.open(models["packed"]) as file:
        assert not np.shares_memory(file.page(2).vertices, file.page(2).vertices)
        assert not file.page(2).vertices.flags.writeable


def test_packed_pages_are_the_raw_ones(models):
    with chpm.open(models["looks"]) as raw, chpm.open(models["packed"]) as packed:
        for one, other in zip(raw.pages(), packed.pages(), strict=True):
            for name in ["vertices", "faces", "normals", "colors", "targets", "errors", "shared_ids"]:
                assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
        assert not any(page.is_packed for page in raw.pages()) and any(page.is_packed for page in packed.pages())


def test_pages_that_are_not_there_are_told(models):
    with chpm.open(models["plain"]) as file:
        count = len(file)
        assert file.page(-1).cluster == count - 1
        for bad in [count, -count - 1, 2**40]:
            with pytest.raises(IndexError, match=f"has no cluster {bad}: there are {count}"):
                file.page(bad)
        with pytest.raises(chpm.SelectionError, match="no level 77"):
            file.pages(level=77)
