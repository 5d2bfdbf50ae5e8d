"""A method or a scorer under test: what it is tried on, what it answers, and when two answers are the same."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from benchmark.api.contracts import Descriptor, FloatArray, Mesh, Method, Shape
from benchmark.api.learning import Learner
from benchmark.api.scoring import Scorer
from benchmark.errors import BenchmarkError, ShapeError, UnsupportedShape, message, one_line
from benchmark.plugins.conformance.shapes import BENDS, awkward, figure, view
from benchmark.plugins.output_checks import descriptor_of, distances_of, form_distances, form_of, signature_of
from benchmark.plugins.specs import MethodSpec, PluginSpec

#: Largest difference of two runs on one shape, relative to the largest coordinate: rounding may depend on where an
#: array lies in memory.
REPEAT_TOLERANCE = 1e-9

#: Largest difference of two runs on one surface given in two ways, relative to the diameter of the form: an iteration
#: that stops by a threshold may stop one step earlier. The scorer does not see a thousandth of the diameter.
SYMMETRY_TOLERANCE = 1e-3

#: Largest dissimilarity of a form and the same form moved, as a share of the smallest one of two different forms.
_SHARE = 0.1

_COMPARED_VERTICES = 1000

#: A change of a surface that should not matter.
Change = Callable[[Mesh], Mesh]


class Failed(Exception):
    """The check found a fault; the message says which, and the hint."""


class Warned(Exception):
    """The check found what is no fault but may become one; the message says what."""


class Skipped(Exception):
    """The check does not apply; the message says why."""


@dataclass
class _Case:
    """A plugin and what it is tried on; of a learner that was trained for it, the folder of the model."""

    spec: PluginSpec[Any, Any]
    model: Path | None = None

    #: Work out the answer of an object for a subject.
    answer_by: ClassVar[Callable[..., FloatArray]]
    #: The figure as it is given.
    subject: ClassVar[Callable[..., Any]]

    @property
    def info(self) -> Any:
        """Return what it says about itself."""
        return self.spec.info

    def create(self) -> Any:
        """A new object, with the model that it was trained to."""
        made = self.spec.create()
        return made.load(self.model) if self.model is not None and isinstance(made, Learner) else made

    def answer(self, subject: Shape | Mesh) -> FloatArray:
        """Return what a new object answers."""
        return self.answer_by(self.create(), subject)

    @cached_property
    def reference(self) -> FloatArray:
        """The answer for the figure."""
        return self.answer(self.subject())


@dataclass
class MethodCase(_Case):
    """A method or a descriptor, and the shapes that it is tried on."""

    spec: MethodSpec

    #: What ``distances`` or ``compare`` gets several of.
    compared = "descriptors"
    #: What awkward surfaces may be refused with.
    refusal: ClassVar[type[ShapeError]] = UnsupportedShape

    @property
    def learns(self) -> bool:
        """Return whether it is a learner."""
        return self.spec.learns

    @property
    def reads_images(self) -> bool:
        """Return whether the method is made for depth images alone."""
        return "mesh" not in self.info.inputs

    def subject(
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

    def answer_by(self, made: Method | Descriptor, subject: Shape) -> FloatArray:
        """What an object answers, looked at as a run does: vertices of a form, shape (n, 3), or any vector."""
        return form_of(made, subject)[0].vertices if isinstance(made, Method) else descriptor_of(made, subject)

    def unchanged_by(self, change: Change, hint: str, order: NDArray[np.int64] | None = None) -> str:
        """Compare two answers up to rigid motions and mirrorings; ``order`` says where the change has put vertices."""
        mesh = self.subject().mesh
        found = self.answer(self.subject(mesh=change(mesh)))
        if order is not None and found.ndim == 2:
            if len(self.reference) != mesh.n_vertices:
                raise Skipped("the form has vertices of its own")
            found = found[np.argsort(order)]
        return close(self.reference, found, 1.0, hint)

    @property
    def pairs(self) -> list[Shape]:
        """The figure in its poses."""
        return [self.subject(bend) for bend in BENDS]

    def dissimilarities(self, subjects: Sequence[Shape], draw: int = 0) -> FloatArray:
        """Dissimilarities of all pairs; raises :class:`Skipped` where nothing is compared."""
        method = self.create()
        if not isinstance(method, Descriptor):
            raise Skipped("forms are compared by the scorer")
        return distances_of(method, [self.answer_by(method, subject) for subject in subjects])

    def awkward(self) -> Mapping[str, Shape]:
        """What may be refused, but not stumbled over, by name."""
        return {name: Shape(identifier=name, mesh=mesh, source_area=mesh.area) for name, mesh in awkward().items()}


@dataclass
class ScorerCase(_Case):
    """A scorer, and the forms that it is tried on."""

    compared = "signatures"
    refusal: ClassVar[type[ShapeError]] = ShapeError

    def subject(self, bend: float = BENDS[0]) -> Mesh:
        """See :class:`MethodCase`."""
        return figure(bend)

    def answer_by(self, made: Scorer, subject: Mesh) -> FloatArray:
        """All numbers of a signature."""
        signature = signature_of(made, subject)
        return np.concatenate([np.asarray(signature[name], dtype=np.float64).ravel() for name in sorted(signature)])

    def unchanged_by(self, change: Change, hint: str, order: NDArray[np.int64] | None = None) -> str:
        """Return whether a form is much more like itself after a change than like any other one."""
        forms = [self.subject(bend) for bend in BENDS]
        found = self.dissimilarities([*forms, *map(change, forms)])
        count = len(forms)
        between = found[:count, :count][~np.eye(count, dtype=bool)].min()
        itself = np.diag(found[:count, count:]).max()
        if not itself <= _SHARE * between:
            raise Failed(f"a form differs from itself by {itself:.3g}, from others by {between:.3g}: {hint}")
        return f"{itself / between if between else 0.0:.1e} of the least difference of two forms"

    @property
    def pairs(self) -> list[Mesh]:
        """The figure in its poses, whole and as a camera sees it."""
        return [*map(figure, BENDS), *(view(bend).mesh for bend in BENDS)]

    def dissimilarities(self, subjects: Sequence[Mesh], draw: int = 0) -> FloatArray:
        """See :class:`MethodCase`."""
        scorer = self.create()
        return form_distances(scorer, [signature_of(scorer, form) for form in subjects], draw)

    def awkward(self) -> Mapping[str, Mesh]:
        """See :class:`MethodCase`."""
        return {**awkward(), "a point": Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))}


Case = MethodCase | ScorerCase


def case_of(spec: PluginSpec[Any, Any], model: Path | None = None) -> Case:
    """Return a method or a scorer as it is tried."""
    return MethodCase(spec, model) if isinstance(spec, MethodSpec) else ScorerCase(spec)


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
    here, there = (form - form.mean(axis=0) for form in (expected, found))
    return bool(np.linalg.det(here.T @ there) < 0)


def _invariants(found: FloatArray) -> FloatArray:
    """Return what no rigid motion changes: distances between vertices of a form; a descriptor itself."""
    if found.ndim == 1:
        return found
    return np.asarray(pdist(found[:: max(1, len(found) // _COMPARED_VERTICES)]))
