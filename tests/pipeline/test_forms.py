"""What a method may return: a surface of finite numbers; anything else is told as the method's fault."""

import types

import numpy as np
import pytest

from benchmark.api.contracts import CanonicalForm, MethodInfo, Shape, canonical_form
from benchmark.errors import InvalidForm, ShapeError
from benchmark.pipeline.stages.shapes import canonicalise, describe
from benchmark.plugins.output_checks import distances_of
from tests.toy import rod

ROD = rod(0.1, 0.5)
SHAPE = Shape(identifier="rod", mesh=ROD)


def method(result):
    """A method that returns, or calls, what it is given, without the help of ``Shape.form``."""
    info = MethodInfo(name="odd", title="Odd")
    return types.SimpleNamespace(info=info, canonicalise=lambda shape: result(shape) if callable(result) else result)


def with_vertex(value):
    vertices = ROD.vertices.copy()
    vertices[3, 1] = value
    return vertices


V, F = ROD.vertices, ROD.faces

REFUSED = {
    "NaN": (CanonicalForm(with_vertex(np.nan), F), "1 of 290 vertices are NaN or infinite"),
    "infinite": (CanonicalForm(with_vertex(-np.inf), F), "NaN or infinite"),
    "too large for single precision": (CanonicalForm(with_vertex(1e300), F), "too large for single precision"),
    "complex": (CanonicalForm(V + 0j, F), "vertices are of type complex128"),
    "strings": (CanonicalForm(V.astype(str), F), "vertices are of type <U"),
    "objects": (CanonicalForm(V.astype(object), F), "vertices are of type object"),
    "booleans": (CanonicalForm(V > 0, F), "vertices are of type bool"),
    "flat": (CanonicalForm(V[:, :2], F), r"vertices have shape \(290, 2\)"),
    "transposed": (CanonicalForm(V.T, F), r"vertices have shape \(3, 290\)"),
    "fewer vertices": (CanonicalForm(V[:-5], F), "faces name vertices 0 to 289 of"),
    "indices that would wrap": (
        CanonicalForm(V, F.astype(np.uint64) + np.uint64(2**32)),
        "faces name vertices 4294967296",
    ),
    "indices of floats": (CanonicalForm(V, F.astype(float)), "faces are of type float64, not integers"),
    "indices beyond 32 bits": (CanonicalForm(V, F.astype(np.int64) + 2**32), "name vertices 4294967296 to"),
    "negative indices": (CanonicalForm(V, F - 1), "name vertices -1 to"),
    "no triangles": (CanonicalForm(V, np.empty((0, 3))), "a form without triangles"),
    "nothing": (None, "it is of type NoneType, not CanonicalForm"),
    "an array": (V, "it is of type ndarray, not CanonicalForm"),
    "a ragged list": (lambda shape: shape.form([[1, 2, 3], [1, 2]]), "vertices are no array"),
    "too many positions": (lambda shape: shape.form(np.zeros((300, 3))), "300 positions for 290 vertices"),
    "complex positions": (lambda shape: shape.form(V * 1j), "vertices are of type complex128"),
    "strings as positions": (lambda shape: shape.form(V.astype(str)), "vertices are of type <U"),
    "a note of an array": (CanonicalForm(V, F, {"steps": np.arange(3)}), "returned ndarray as note 'steps'"),
    "a note of a ragged list": (CanonicalForm(V, F, {"steps": [[1], [2, 3]]}), "returned list as note 'steps'"),
    "a ragged list without help": (CanonicalForm([[1, 2, 3], [4]], F), "vertices are no array"),
    "a note of None": (CanonicalForm(V, F, {"steps": None}), "returned NoneType as note 'steps'"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_no_form_is_told_as_the_fault_of_the_method(what):
    result, message = REFUSED[what]
    with pytest.raises(InvalidForm, match=rf"method 'odd' returned .*{message}|method 'odd' {message}") as caught:
        canonicalise(method(result), SHAPE)
    assert isinstance(caught.value, ShapeError)  # it costs the shape
    assert caught.value.hint
    assert "export" not in caught.value.hint


def test_a_function_that_returns_no_numbers_is_told_by_its_name():
    nan = canonical_form(name="not-a-number", title="NaN")(lambda shape: shape.mesh.vertices * np.nan)
    with pytest.raises(InvalidForm, match="method 'not-a-number' returned no canonical form: 290 of 290 vertices"):
        canonicalise(nan(), SHAPE)


@pytest.mark.parametrize(
    ("descriptor", "message"),
    [
        (np.array([1.0, np.nan]), "an array with NaN or infinite numbers"),
        (np.ones((2, 2)), r"an array of shape \(2, 2\) and type float64"),
        (np.array([1j]), r"an array of shape \(1,\) and type complex128"),
        (np.array(["1"]), r"an array of shape \(1,\) and type <U1"),
        (np.array([]), r"an array of shape \(0,\) and type float64"),
        (None, r"an array of shape \(\) and type object"),
        (2.0, r"an array of shape \(\) and type float64"),
        ([[1.0, 2.0], [3.0]], r"no array \(ValueError: "),
    ],
)
def test_what_is_no_descriptor_is_told_as_the_fault_of_the_method(descriptor, message):
    odd = types.SimpleNamespace(info=MethodInfo(name="odd", title="Odd"), describe=lambda shape: descriptor)
    with pytest.raises(InvalidForm, match=f"method 'odd' returned {message}"):
        describe(odd, SHAPE)


@pytest.mark.parametrize(
    ("distances", "message"),
    [
        (np.ones((2, 2)), r"an array of shape \(2, 2\) and type float64"),
        (np.ones((3, 2)), r"an array of shape \(3, 2\) and type float64"),
        (np.ones(3), r"an array of shape \(3,\) and type float64"),
        (np.ones((3, 3)) * 1j, r"an array of shape \(3, 3\) and type complex128"),
        (np.full((3, 3), "1"), r"an array of shape \(3, 3\) and type <U1"),
        (np.full((3, 3), None), r"an array of shape \(3, 3\) and type object"),
        (np.full((3, 3), np.nan), "an array with NaN or infinite numbers"),
        ([[0.0, 1.0], [1.0], []], r"no array \(ValueError: "),
        (None, r"an array of shape \(\) and type object"),
    ],
)
def test_what_are_no_distances_is_told_as_the_fault_of_the_method(distances, message):
    odd = types.SimpleNamespace(info=MethodInfo(name="odd", title="Odd"), distances=lambda descriptors: distances)
    with pytest.raises(InvalidForm, match=f"method 'odd' returned {message}.*; return the distances of all pairs"):
        distances_of(odd, [np.ones(1)] * 3)
