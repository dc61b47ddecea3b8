"""Rays meet what ``chpm rays`` says they do, and what NumPy finds by trying all triangles."""

from __future__ import annotations

import os
import signal
import threading
import warnings

import chpm
import numpy as np
import pytest
from conftest import MODELS, tell


def some(scan: chpm.File, count: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Rays from about a model to somewhere in it, and a few past it."""
    random = np.random.default_rng(seed)
    low, high = scan.bounds
    middle, size = (low + high) / 2, np.linalg.norm(high - low)
    way = random.normal(size=(count, 3))
    origins = middle + size * way / np.linalg.norm(way, axis=1, keepdims=True)
    targets = low + random.uniform(-0.2, 1.2, size=(count, 3)) * (high - low)
    return origins, targets - origins


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("error", [None, "2%"])
@pytest.mark.parametrize("any", [False, True])
def test_hits_are_what_the_command_writes(models, tmp_path, name, error, any):
    with chpm.open(models[name]) as scan:
        origins, directions = some(scan, 300)
        hits = scan.cast(origins, directions, error=error, any=any)
    np.save(tmp_path / "in.npy", np.hstack([origins, directions]))
    words = ["-o", tmp_path / "out.npy", "-q", *(["--error", error] if error else []), *(["--any"] if any else [])]
    done = tell("rays", models[name], tmp_path / "in.npy", *words)
    assert done.returncode == 0, done.stderr
    theirs = np.load(tmp_path / "out.npy")
    told = lambda numbers: np.where(numbers < 0, np.nan, numbers)  # noqa: E731
    columns = [hits.hit, hits.distance, *hits.points.T, *hits.normals.T, told(hits.clusters), told(hits.triangles)]
    if error:
        columns.append(hits.least)
    assert np.array_equal(theirs, np.column_stack(columns), equal_nan=True)
    assert (hits.least is None) == (error is None) and len(hits) == 300
    assert name == "one" or 0 < hits.hit.sum() < 300


def brute(vertices, faces, origins, directions):
    """The nearest distance of each ray, by trying all triangles; infinite for a miss."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    nearest = np.full(len(origins), np.inf)
    for at, (origin, way) in enumerate(zip(origins, directions / np.linalg.norm(directions, axis=1)[:, None])):
        u, v = b - a, c - a
        side = np.cross(way, v)
        scale = (u * side).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            away = origin - a
            first = (away * side).sum(axis=1) / scale
            turned = np.cross(away, u)
            second = (way * turned).sum(axis=1) / scale
            along = (v * turned).sum(axis=1) / scale
            is_met = (first >= 0) & (second >= 0) & (first + second <= 1) & (along >= 0)
        nearest[at] = along[is_met].min(initial=np.inf)
    return nearest


@pytest.mark.parametrize("name", ["plain", "far", "dust"])
def test_hits_are_those_of_all_triangles(models, name):
    with chpm.open(models[name]) as scan:
        origins, directions = some(scan, 200, seed=8)
        hits = scan.cast(origins, directions)
        source = scan.select(level=0)
        coarse = scan.cast(origins, directions, error="3%")
    nearest = brute(source.absolute(), source.faces, origins, directions)
    assert np.array_equal(hits.hit, np.isfinite(nearest))
    size = np.abs(nearest[hits.hit]).max()
    assert np.abs(hits.distance[hits.hit] - nearest[hits.hit]).max() <= 1e-7 * size
    along = origins + directions / np.linalg.norm(directions, axis=1)[:, None] * hits.distance[:, None]
    assert np.abs(along - hits.points)[hits.hit].max() <= 1e-6 * size
    # What is told of the source by a coarse mesh is true.
    assert (coarse.least <= nearest + 1e-7 * size).all() and coarse.within > 0
    assert np.isfinite(coarse.least).sum() < 200


def test_any_and_reach_agree_with_the_nearest(models):
    with chpm.open(models["plain"]) as scan:
        origins, directions = some(scan, 500)
        nearest = scan.cast(origins, directions)
        assert np.array_equal(scan.cast(origins, directions, any=True).hit, nearest.hit)
        reach = float(np.median(nearest.distance[nearest.hit]))
        within = scan.cast(origins, directions, reach=reach)
        assert np.array_equal(within.hit, nearest.hit & (nearest.distance <= reach))
        # Lists and whole numbers will do, and nothing at all.
        assert scan.cast([[5, 0, 0]], [[-1, 0, 0]]).hit.tolist() == [True]
        none = scan.cast(np.empty((0, 3)), np.empty((0, 3)))
        assert len(none) == 0 and none.points.shape == (0, 3)
        assert repr(nearest) == f"<chpm.Hits: 500 rays, {nearest.hit.sum()} hit>"


@pytest.mark.parametrize(
    ("origins", "directions", "told"),
    [
        ([[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]], "ray 0: .*a direction of some length"),
        ([[0, 0, 0], [np.nan, 0, 0]], [[0, 0, 1], [0, 0, 1]], "ray 1: finite numbers"),
        ([[0, 0, 0]], [[0, np.nan, 1]], "ray 0: finite numbers"),
        ([0, 0, 0], [[0, 0, 1]], "origins: an array of the shape"),
        ([[0, 0, 0]], [[0, 1]], "directions: an array of the shape"),
        ([[0, 0, 0]], [[0, 0, 1], [0, 0, 1]], "as many directions as origins"),
        (np.ma.masked_equal([[7.0, 0, 0]], 7), [[0, 0, 1]], "origins: an array without masked values"),
    ],
)
def test_what_is_no_ray_is_refused(models, origins, directions, told):
    with chpm.open(models["plain"]) as scan:
        with pytest.raises(chpm.SelectionError, match=told):
            scan.cast(origins, directions)
        with pytest.raises(chpm.SelectionError, match="a reach of at least 0"):
            scan.cast([[0, 0, 0]], [[0, 0, 1]], reach=-1)


def test_other_threads_run_meanwhile(models):
    with chpm.open(models["plain"]) as scan:
        origins, directions = some(scan, 400_000)
        counted, ended = 0, threading.Event()

        def work() -> None:
            scan.cast(origins, directions)
            ended.set()

        worker = threading.Thread(target=work)
        worker.start()
        while not ended.wait(0.001):
            counted += 1
        worker.join()
    assert counted > 3


@pytest.mark.skipif(not hasattr(os, "fork"), reason="nothing forks here")
def test_a_forked_child_casts_and_cuts(models):
    with chpm.open(models["plain"]) as scan:
        origins, directions = some(scan, 100)
        plane = [0, 0, 1, scan.bounds[:, 2].mean()]
        ask = lambda: (scan.cast(origins, directions).hit.tolist(), scan.section(plane).length)  # noqa: E731
        before = ask()
        with warnings.catch_warnings():
            # That this process has threads, of which a child has none: this is what is tested.
            warnings.simplefilter("ignore", DeprecationWarning)
            child = os.fork()
        if child == 0:
            # One that hangs would be waited for without end.
            signal.alarm(120)
            try:
                os._exit(0 if ask() == before else 1)
            finally:
                os._exit(2)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
