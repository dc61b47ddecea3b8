"""The package as it is installed: one wheel for all Pythons, types, docstrings; threads and Ctrl-C."""

from __future__ import annotations

import ast
import importlib.metadata
import inspect
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import chpm
import numpy as np
from chpm import _chpm

PUBLIC = [_chpm.Camera, _chpm.File, _chpm.Hits, _chpm.Level, _chpm.Page, _chpm.Section, _chpm.Selection]


def test_the_wheel_is_for_all_pythons():
    distribution = importlib.metadata.distribution("chpm")
    assert "Tag: cp310-abi3-" in distribution.read_text("WHEEL")
    names = {str(file) for file in distribution.files}
    assert {"chpm/py.typed", "chpm/_chpm.pyi", "chpm/_chpm.abi3.so"} <= names
    assert distribution.version == chpm.__version__
    assert b"wgpu" not in Path(_chpm.__file__).read_bytes()


def test_types_name_all_there_is_and_nothing_else():
    tree = ast.parse((Path(chpm.__file__).parent / "_chpm.pyi").read_text())
    stubs = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
    assert set(stubs) == {cls.__name__ for cls in PUBLIC}
    for cls in PUBLIC:
        told = {node.name for node in stubs[cls.__name__].body if isinstance(node, ast.FunctionDef)}
        there = {name for name in vars(cls) if not name.startswith("_")}
        assert {name for name in told if not name.startswith("_")} == there, cls
        for name in told - {"__new__"}:
            assert hasattr(cls, name), (cls, name)
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    there = {name for name, member in vars(_chpm).items() if inspect.isbuiltin(member)}
    assert set(functions) == there
    for name, node in functions.items():
        assert [arg.arg for arg in node.args.args] == list(inspect.signature(getattr(_chpm, name)).parameters)
    select = next(node for node in stubs["File"].body if getattr(node, "name", "") == "select")
    assert [arg.arg for arg in select.args.kwonlyargs] == list(inspect.signature(chpm.File.select).parameters)[1:]


def test_everything_has_a_docstring():
    for cls in PUBLIC:
        assert cls.__doc__
        for name, member in vars(cls).items():
            assert name.startswith("_") or member.__doc__, (cls, name)
    for name in chpm.__all__:
        assert getattr(chpm, name).__doc__, name
    for name in ["vertices", "faces", "normals", "colors"]:
        for cls in [_chpm.Selection, _chpm.Page]:
            doc = vars(cls)[name].__doc__
            assert "shape" in doc and ("float32" in doc or "uint" in doc), (cls, name)


def test_threads_select_side_by_side(models):
    with chpm.open(models["packed"]) as file:
        wanted = [300 + 40 * i for i in range(40)]
        alone = [file.select(triangles=n).faces for n in wanted]
        with ThreadPoolExecutor(4) as pool:
            together = list(pool.map(lambda n: file.select(triangles=n).faces, wanted))
    assert all((one == other).all() for one, other in zip(alone, together))


def test_python_goes_on_while_something_is_selected(models):
    """Nobody else runs while one thread holds the interpreter, as long as threads are not made to take turns."""
    counted, seen = [0], 0
    done = threading.Event()

    def select():
        nonlocal seen
        with chpm.open(models["packed"]) as file:
            for _ in range(30):
                before = counted[0]
                file.select(error=0)
                seen += counted[0] - before
        done.set()

    turn = sys.getswitchinterval()
    sys.setswitchinterval(100)
    try:
        thread = threading.Thread(target=select)
        thread.start()
        while not done.is_set():
            counted[0] += 1
            time.sleep(1e-4)
        thread.join()
    finally:
        sys.setswitchinterval(turn)
    assert seen > 0


def test_an_array_outlives_all_it_came_from(models):
    def arrays():
        with chpm.open(models["looks"]) as file:
            for page in file.pages():
                yield page.vertices

    total = sum(np.abs(vertices).sum() for vertices in list(arrays()))
    assert total > 0
