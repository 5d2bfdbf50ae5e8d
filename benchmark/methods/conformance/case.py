"""A method under test: the shapes that it is given, a look at what it answers, and when two answers are the same."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.spatial.distance import pdist

from benchmark.api.contracts import Descriptor, FloatArray, Mesh, Method, MethodInfo, Shape
from benchmark.api.learning import Learner
from benchmark.errors import BenchmarkError, UnsupportedShape, message, one_line
from benchmark.methods.conformance.shapes import BENDS, figure, view
from benchmark.methods.output_checks import descriptor_of, form_of
from benchmark.methods.registry import MethodSpec

#: Largest difference of two runs on one shape, relative to the largest coordinate: rounding may depend on where an
#: array lies in memory.
REPEAT_TOLERANCE = 1e-9

#: Largest difference of two runs on one surface given in two ways, relative to the diameter of the form: an iteration
#: that stops by a threshold may stop one step earlier. The scorer does not see a thousandth of the diameter.
SYMMETRY_TOLERANCE = 1e-3

_COMPARED_VERTICES = 1000


class Failed(Exception):
    """The check found a fault; the message says which, and the hint."""


class Warned(Exception):
    """The check found what is no fault but may become one; the message says what."""


class Skipped(Exception):
    """The check does not apply; the message says why."""


@dataclass
class ConformanceCase:
    """A method, and the shapes that it is tried on; of a learner that was trained for it, the folder of the model."""

    spec: MethodSpec
    model: Path | None = None

    def create(self) -> Method | Descriptor:
        """A new object of the method, with the model that it was trained to."""
        made = self.spec.create()
        return made.load(self.model) if self.model is not None and isinstance(made, Learner) else made

    @cached_property
    def info(self) -> MethodInfo:
        """Return what the method says about itself."""
        return self.spec.info

    @property
    def reads_images(self) -> bool:
        """Return whether the method is made for depth images alone."""
        return "mesh" not in self.info.inputs

    def shape(
        self,
        bend: float = BENDS[0],
        *,
        mesh: Mesh | None = None,
        scale: float = 1.0,
        name: str = "figure",
        seed: int = 0,
    ) -> Shape:
        """The figure as the method wants it, or another mesh in its place."""
        seen = view(bend) if self.reads_images else None
        # Any area will do that differs between poses: bending keeps the area, and equal areas would compare nothing.
        return Shape(
            identifier=f"{name} {bend}",
            mesh=mesh or (seen.mesh if seen else figure(bend)),
            depth=seen.depth if seen else None,
            source_area=(1 + bend) * scale**2,
            seed=seed,
        )

    def answer(self, shape: Shape) -> FloatArray:
        """Return what a new object of the method answers for a shape."""
        return answer(self.create(), shape)

    @cached_property
    def reference(self) -> FloatArray:
        """The answer for the figure."""
        return self.answer(self.shape())


def answer(method: Method | Descriptor, shape: Shape) -> FloatArray:
    """Run a method, and look at what comes back as a run does.

    Returns
    -------
    numpy.ndarray
        Vertices of the form, shape (n, 3), or the descriptor, shape (k,).

    Raises
    ------
    ShapeError
        If the method refuses the shape, or returns what is no answer.
    """
    return form_of(method, shape)[0].vertices if isinstance(method, Method) else descriptor_of(method, shape)


def explain(error: BaseException) -> str:
    """Say in one line what an exception means to the author of the method."""
    if isinstance(error, ImportError):
        return f"cannot import what it needs ({message(error)}); name packages beyond the core in info.requires"
    if isinstance(error, UnsupportedShape):
        return f"refuses an ordinary surface ({message(error)}); treat it"
    if isinstance(error, ValueError) and "read-only" in message(error):
        return "writes into its input; work on a copy"
    if isinstance(error, (Failed, BenchmarkError)):
        return message(error)
    return f"raises {one_line(error)}; raise UnsupportedShape with the reason, or correct the method"


def same(expected: FloatArray, found: FloatArray, hint: str) -> None:
    """Compare two answers for one shape; ``hint`` says what a difference means."""
    if expected.shape != found.shape:
        raise Failed(f"{found.shape} instead of {expected.shape}: {hint}")
    difference = relative_difference(expected, found)
    if not difference <= REPEAT_TOLERANCE:
        raise Failed(f"relative difference {difference:.1e}: {hint}")


def relative_difference(expected: FloatArray, found: FloatArray) -> float:
    """Largest difference of two answers of one shape, over the largest number of the first."""
    return float(np.abs(found - expected).max() / (np.abs(expected).max() or 1.0))


def close(expected: FloatArray, found: FloatArray, factor: float, hint: str) -> str:
    """Compare two answers up to rigid motions and mirrorings, the second one ``factor`` times as large."""
    if expected.shape != found.shape:
        raise Failed(f"{found.shape} instead of {expected.shape}: {hint}")
    wanted, seen = factor * _invariants(expected), _invariants(found)
    difference = float(np.abs(seen - wanted).max() / (np.abs(wanted).max() or 1.0))
    if not difference <= SYMMETRY_TOLERANCE:
        raise Failed(f"relative difference {difference:.1e}: {hint}")
    return f"relative difference {difference:.1e}"


def is_mirrored(expected: FloatArray, found: FloatArray) -> bool:
    """Return whether one of two congruent forms has to be mirrored to become the other."""
    here, there = (each - each.mean(axis=0) for each in (expected, found))
    return bool(np.linalg.det(here.T @ there) < 0)


def _invariants(found: FloatArray) -> FloatArray:
    """Return what no rigid motion changes: distances between vertices of a form; a descriptor itself."""
    if found.ndim == 1:
        return found
    return np.asarray(pdist(found[:: max(1, len(found) // _COMPARED_VERTICES)]))
