"""Each package that the suite is built on does real work at run time: without a function of it, the
work ends.
"""

import importlib
from pathlib import Path
from typing import Any

import pytest

import benchmark
from benchmark.api import Shape
from benchmark.geometry.camera import FRONT
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import prepare
from benchmark.pipeline.forms import shape_of
from benchmark.pipeline.views import fit_frame, prepare_view
from benchmark.registry import select_one
from benchmark.report import sheets
from benchmark.report.results import Results
from tests.geometry.surfaces import limbed_body
from tests.report.records import record
from tests.toy import rod

ROD = rod(0.1, 0.5)


def method(name: str) -> Any:
    return select_one(name).create()


def large_shape() -> Shape:
    return Shape(identifier="body", mesh=prepare(limbed_body(4)).mesh)


def predicted() -> Any:
    network = method("learned-streamed")
    loaded = network.load(network.shipped_models / network.default_training / network.model_name)
    return loaded.canonicalise(shape_of(prepare_view(ROD, FRONT, fit_frame(ROD, FRONT)), "rod"))


def words() -> Any:
    descriptor = method("si-hks")
    return descriptor.distances([descriptor.describe(large_shape())] * 2)


def partly_reversed() -> Mesh:
    """A rod of which every other triangle is the other way round."""
    faces = ROD.faces.copy()
    faces[::2] = faces[::2, ::-1]
    return Mesh(ROD.vertices, faces)


#: By package: one of its functions, and work of the suite that calls it.
WORK = {
    "numpy": ("numpy:cross", lambda: Mesh(ROD.vertices, ROD.faces).area),
    "scipy": ("scipy.sparse.linalg:eigsh", lambda: method("gps").canonicalise(large_shape())),
    "scikit-learn": ("sklearn.cluster:KMeans", words),
    "trimesh": ("trimesh:Trimesh", lambda: benchmark.canonicalise(ROD, method="gps").to_trimesh()),
    "libigl": ("igl:bfs_orient", lambda: prepare(partly_reversed())),
    "pymeshlab": ("pymeshlab:MeshSet", lambda: prepare(limbed_body(4), 500)),
    "torch": ("torch.nn.functional:conv2d", predicted),
    "pandas": ("pandas:DataFrame", lambda: Results(Path(), (record("gps"),)).jobs),
    "matplotlib": ("matplotlib.figure:Figure.subplots", lambda: sheets.mesh_picture(ROD, ROD)),
}


class Stopped(Exception):
    """Work got as far as the package."""


@pytest.mark.parametrize("package", WORK)
def test_without_the_function_of_a_package_the_work_ends_at_it(package, monkeypatch):
    place, work = WORK[package]
    module, _, names = place.partition(":")
    owner: Any = importlib.import_module(module)
    *outer, name = names.split(".")
    for of in outer:
        owner = getattr(owner, of)
    assert work() is not None

    def stop(*_: object, **__: object) -> None:
        raise Stopped

    monkeypatch.setattr(owner, name, stop)
    with pytest.raises(Stopped):
        work()


def test_the_project_requires_these_packages():
    text = (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    assert all(f'"{package}>=' in text for package in WORK)
