"""What authors import, and a function as a method."""

import subprocess
import sys
from dataclasses import FrozenInstanceError, dataclass, field
from typing import ClassVar

import numpy as np
import pytest

from baselines.smacof import LeastSquaresMDS
from benchmark.api import CanonicalForm, Mesh, MethodInfo, ScorerInfo, Shape, canonical_form
from benchmark.errors import ConfigurationError

VERTICES, FACES = np.eye(4)[:, :3], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]


def test_what_authors_import_needs_no_harness():
    code = "import sys; from benchmark.api import *; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    heavy = {
        "benchmark.registry",
        "benchmark.pipeline",
        "benchmark.datasets",
        "torch",
        "numba",
        "pandas",
    }
    assert "benchmark.api.learning" in loaded
    assert not heavy & set(loaded)


def test_a_function_is_a_method_and_used_on_arrays():
    @canonical_form(name="flatten", title="Flatten")
    def flatten(shape):
        """Flat."""
        return shape.mesh.vertices * [1, 1, 0]

    form = flatten().canonicalise(Shape.from_arrays(VERTICES, FACES))
    assert isinstance(form, CanonicalForm)
    np.testing.assert_array_equal(form.vertices, VERTICES * [1, 1, 0])
    np.testing.assert_array_equal(form.faces, FACES)
    assert (flatten.info.name, flatten.__doc__, flatten.__module__) == (
        "flatten",
        "Flat.",
        __name__,
    )


def test_the_draws_of_a_scorer_are_limited():
    with pytest.raises(ConfigurationError, match="'0' does not fit draws of ScorerInfo"):
        ScorerInfo(name="mine", title="Mine", draws=0)


def arrays_in(value, seen):
    """Yield each array that can be reached from a value."""
    if id(value) in seen or isinstance(value, type | str):
        return
    seen.add(id(value))
    if isinstance(value, np.ndarray):
        yield value
    values = (
        value.values()
        if isinstance(value, dict)
        else value
        if isinstance(value, list | tuple)
        else ()
    )
    for part in (*values, *getattr(value, "__dict__", {}).values()):
        yield from arrays_in(part, seen)


def bases_of(array):
    while isinstance(array.base, np.ndarray):
        array = array.base
        yield array


def test_what_methods_share_is_read_only():
    depth = np.ones((4, 4), np.float32)
    shape = Shape(identifier="corner", mesh=Mesh(VERTICES, FACES), depth=depth)
    assert shape.geodesics() is shape.geodesics()
    given = [
        shape.mesh.vertex_areas,
        shape.laplacian(),
        shape.geodesics_from([0]),
        shape.form(VERTICES),
        shape.geodesics(),
        shape.mesh.edge_lengths,
        [vars(shape.laplacian().stiffness)],
    ]
    LeastSquaresMDS().canonicalise(shape)
    for name in dir(Mesh):
        getattr(shape.mesh, name)
    shape.laplacian().stiffness.data = np.ones(16)  # of a matrix of its own
    arrays = [*arrays_in([shape, *given, shape.laplacian()], set())]
    assert len(arrays) >= 12
    for array in arrays:
        for part in (array, *bases_of(array)):
            with pytest.raises(ValueError, match="cannot set WRITEABLE flag"):
                part.setflags(write=True)
    np.testing.assert_allclose(shape.laplacian().stiffness.sum(axis=1), np.zeros(4), atol=1e-12)
    with pytest.raises(FrozenInstanceError):
        shape.seed = 7
    depth[:] = 2  # that of the caller
    assert shape.depth.max() == 1


def shared_by_class(strength, shape):
    @dataclass(frozen=True)
    class Shares:
        """A method whose parameters do not all count in its equality."""

        info: ClassVar[MethodInfo] = MethodInfo(name="shares", title="Shares")
        strength: float = field(compare=False)

        def canonicalise(self, shape):
            return shape.form(shape.mesh.vertices)

    return [
        shape.compute_once(Shares(strength=value), lambda value=value: value) for value in strength
    ]


def test_a_shared_result_is_of_a_method_with_its_parameters():
    shape = Shape.from_arrays(VERTICES, FACES)
    assert shared_by_class([2.0, 3.0, 1, True, 1.0, 2.0], shape) == [2.0, 3.0, 1, True, 1.0, 2.0]
    first = shape.compute_once(LeastSquaresMDS(), lambda: "first")
    assert shape.compute_once(LeastSquaresMDS(rtol=1e-6), lambda: "second") == first
    assert shape.compute_once(LeastSquaresMDS(rtol=1e-3), lambda: "third") == "third"
    # Outside of a run nobody knows whose text it is.
    assert [shape.compute_once("text", lambda of=of: of) for of in "ab"] == ["a", "b"]
