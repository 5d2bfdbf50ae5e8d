"""Shapes and cases for the checks of plugins, and comparison of answers."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from benchmark.api.contracts import Descriptor, FloatArray, Mesh, Method, Shape
from benchmark.api.learning import Learner, TrainingData, TrainingPair
from benchmark.api.scoring import Scorer
from benchmark.datasets.base import Entry
from benchmark.datasets.own import OwnDataset, open_own
from benchmark.errors import BenchmarkError, ShapeError, UnsupportedShape, message, one_line
from benchmark.geometry.camera import Camera
from benchmark.geometry.depth import back_project, fit_half_width, render_depth
from benchmark.plugins.output_checks import descriptor_of, distances_of, form_distances, form_of, signature_of
from benchmark.plugins.specs import DatasetSpec, MethodSpec, PluginSpec

#: Angles in radians by which the limbs of the figure bend, one for each pose.
BENDS = (0.7, 0.2, 1.1)

#: Name of the training on images of the figure, and of the folder of its models.
TRAINING = "case"

_PIXEL_STRIDE = 9
_CAMERA = Camera((0.35, 1.0, -0.2))


#: Valid meshes, in addition to the open surface of a view, that a method may refuse as unsupported but must not crash
#: on.
_AWKWARD = ("a triangle", "a tetrahedron", "a flat sheet", "two pieces")


@cache
def _mesh(name: str) -> Mesh:
    with np.load(Path(__file__).with_name("shapes.npz"), allow_pickle=False) as arrays:
        return Mesh(arrays[f"{name} vertices"], arrays[f"{name} faces"])


def figure(bend: float = BENDS[0]) -> Mesh:
    """Return the closed surface of a body with a head, an arm, a leg and a tail, of unit area, with 500 vertices.

    All limbs differ in length, thickness and direction, so no symmetry leaves an axis or the order of two eigenvalues
    undetermined.

    Parameters
    ----------
    bend
        Angle of :data:`BENDS` by which the arm, the leg and the tail bend at every joint.
    """
    return _mesh(f"figure {bend}")


@cache
def view(bend: float = BENDS[0]) -> Shape:
    """Return the figure as seen by one depth camera: open, in bridged pieces, with its depth image."""
    mesh = figure(bend)
    half_width = fit_half_width([mesh], _CAMERA)
    depth = render_depth(mesh, _CAMERA, half_width)
    depth.flags.writeable = False
    surface, _ = back_project(depth, half_width, _PIXEL_STRIDE)
    area = surface.area
    return Shape(
        identifier=f"view of the figure bent by {bend}",
        mesh=surface.with_vertices(surface.vertices / np.sqrt(area)),
        depth=depth,
        source_area=area,
    )


def awkward() -> dict[str, Mesh]:
    """Return difficult meshes by name."""
    return {name: _mesh(name) for name in _AWKWARD} | {"an open surface": view().mesh}


def training_data() -> TrainingData:
    """Return training data: depth images of the figure in its poses, of which the first is canonical."""
    names = tuple(f"figure {bend}" for bend in BENDS)

    def pairs(start: int = 0) -> Iterator[TrainingPair]:
        images = [image for bend in BENDS if (image := view(bend).depth) is not None]
        for name, image in list(zip(names, images, strict=True))[start:]:
            yield TrainingPair(
                identifier=name, subject="figure", target_identifier=names[0], image=image, target=images[0]
            )

    return TrainingData(
        name=TRAINING,
        title="the reference figure",
        digest=hashlib.sha256(" ".join(names).encode()).hexdigest(),
        subjects=("figure",),
        identifiers=names,
        n_pairs=len(BENDS),
        pairs=pairs,
        unseen=pairs,
    )


#: Largest accepted difference between two runs on one shape, relative to the largest coordinate: rounding may depend on
#: the position of an array in memory.
REPEAT_TOLERANCE = 1e-9

#: Largest accepted difference between two runs on two descriptions of one surface, relative to the diameter of the
#: form: an iteration with a threshold may stop one step earlier. A thousandth of the diameter does not affect the
#: scorer.
SYMMETRY_TOLERANCE = 1e-3

#: Largest accepted dissimilarity between a form and its moved copy, relative to the smallest between different forms.
_SHARE = 0.1

_COMPARED_VERTICES = 1000

#: Change of a surface that should not affect the answer.
Change = Callable[[Mesh], Mesh]


class Failed(Exception):
    """The check failed; with the reason and a hint."""


class Warned(Exception):
    """The check found a potential fault; with the reason."""


class Skipped(Exception):
    """The check does not apply; with the reason."""


@dataclass
class _Case:
    """A method or a scorer; for a learner, with the folder of its model, or a folder and options to train one."""

    spec: PluginSpec[Any, Any]
    model: Path | None = None
    models: Path = Path()
    options: Mapping[str, str] = field(default_factory=dict)

    #: The figure as input, and the answer of an object for it or for another subject.
    subject: ClassVar[Callable[..., Any]]
    _answer: ClassVar[Callable[..., FloatArray]]

    @property
    def info(self) -> Any:
        """Description of the plugin."""
        return self.spec.info

    def create(self) -> Any:
        """Return a new object, with its trained model."""
        created = self.spec.create()
        return created.load(self.model) if self.model is not None and isinstance(created, Learner) else created

    def answer(self, subject: Any = None, by: Any = None) -> FloatArray:
        """Return the answer of an object, by default a new one, for a subject, by default the figure."""
        return self._answer(self.create() if by is None else by, self.subject() if subject is None else subject)

    @cached_property
    def reference(self) -> FloatArray:
        """The answer for the figure."""
        return self.answer()


class MethodCase(_Case):
    """A method or a descriptor, with the shapes used to check it."""

    spec: MethodSpec
    #: Kind of the items passed to ``distances`` or ``compare``.
    compared = "descriptors"
    #: Error allowed for refusing difficult surfaces.
    refusal: type[ShapeError] = UnsupportedShape

    @property
    def reads_images(self) -> bool:
        """Whether the method accepts only depth images."""
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
        """Return the figure, or another mesh, as input of the method."""
        seen = view(bend) if self.reads_images else None
        # Any area that differs between poses will do: bending preserves the area, and equal areas leave nothing to
        # compare.
        return Shape(
            identifier=f"{name} {bend}",
            mesh=mesh or (seen.mesh if seen else figure(bend)),
            depth=seen.depth if seen else None,
            source_area=(1 + bend) * scale**2,
            seed=seed,
        )

    def _answer(self, created: Method | Descriptor, subject: Shape) -> FloatArray:
        """Return the vertices of a form, shape (n, 3), or a vector, after the checks of a run."""
        return form_of(created, subject)[0].vertices if isinstance(created, Method) else descriptor_of(created, subject)

    def unchanged_by(self, change: Change, hint: str, order: NDArray[np.int64] | None = None) -> str:
        """Compare two answers up to rigid motions and reflections; ``order`` is the vertex order after the change."""
        mesh = self.subject().mesh
        answer = self.answer(self.subject(mesh=change(mesh)))
        if order is not None and answer.ndim == 2:
            if len(self.reference) != mesh.n_vertices:
                raise Skipped("the form has its own vertices")
            answer = answer[np.argsort(order)]
        return same(self.reference, answer, hint, factor=1.0)

    @property
    def pairs(self) -> list[Shape]:
        """The figure in its poses."""
        return [self.subject(bend) for bend in BENDS]

    def dissimilarities(self, subjects: Sequence[Shape], draw: int = 0) -> FloatArray:
        """Return the dissimilarities of all pairs; raise :class:`Skipped` if the plugin compares nothing."""
        method = self.create()
        if not isinstance(method, Descriptor):
            raise Skipped("forms are compared by the scorer")
        return distances_of(method, [descriptor_of(method, subject) for subject in subjects])

    def awkward(self) -> Mapping[str, Shape]:
        """Return inputs that may be refused but must not cause a crash, by name."""
        return {name: Shape(identifier=name, mesh=mesh, source_area=mesh.area) for name, mesh in awkward().items()}


class ScorerCase(_Case):
    """A scorer, with the forms used to check it; see :class:`MethodCase`."""

    compared = "signatures"
    refusal = ShapeError

    def subject(self, bend: float = BENDS[0]) -> Mesh:
        """Return the figure."""
        return figure(bend)

    def _answer(self, created: Scorer, subject: Mesh) -> FloatArray:
        signature = signature_of(created, subject)
        return np.concatenate([np.asarray(signature[name], dtype=np.float64).ravel() for name in sorted(signature)])

    def unchanged_by(self, change: Change, hint: str, order: NDArray[np.int64] | None = None) -> str:
        """Check that a form and its changed copy are much more similar than any two different forms."""
        forms = [figure(bend) for bend in BENDS]
        distances = self.dissimilarities([*forms, *map(change, forms)])
        count = len(forms)
        between = distances[:count, :count][~np.eye(count, dtype=bool)].min()
        itself = np.diag(distances[:count, count:]).max()
        if not itself <= _SHARE * between:
            raise Failed(f"a form differs from itself by {itself:.3g}, from others by {between:.3g}: {hint}")
        return f"{itself / between if between else 0.0:.1e} of the smallest difference between two forms"

    @property
    def pairs(self) -> list[Mesh]:
        """The figure in its poses, complete and as seen by a camera."""
        return [*map(figure, BENDS), *(view(bend).mesh for bend in BENDS)]

    def dissimilarities(self, subjects: Sequence[Mesh], draw: int = 0) -> FloatArray:
        """Return the dissimilarities of all pairs."""
        scorer = self.create()
        return form_distances(scorer, [signature_of(scorer, form) for form in subjects], draw)

    def awkward(self) -> Mapping[str, Mesh]:
        """Return inputs that may be refused but must not cause a crash, by name."""
        return {**awkward(), "a point": Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))}


@dataclass
class DatasetCase:
    """A data set of a plugin file."""

    spec: DatasetSpec

    @cached_property
    def dataset(self) -> OwnDataset:
        """The data set."""
        return open_own(self.spec.target)

    @property
    def first_of_each(self) -> list[Entry]:
        """The first shape of each class."""
        return list({entry.subject: entry for entry in reversed(self.dataset.entries)}.values())[::-1]

    def digests(self, *, backwards: bool = False) -> dict[str, str]:
        """Return the digest of the mesh of the first shape of each class, by identifier."""
        meshes = {e.identifier: self.dataset.load(e) for e in self.first_of_each[:: -1 if backwards else 1]}
        contents = {name: mesh.vertices.tobytes() + mesh.faces.tobytes() for name, mesh in meshes.items()}
        return {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}

    def description(self) -> list[list[str]]:
        """Return the recipe of the data set as plain values."""
        dataset = self.dataset
        return [
            [e.identifier, e.subject, e.pose, dataset.recipe(e), repr(dataset.camera(e))] for e in dataset.entries
        ] + [[*self.digests().values()]]


Case = MethodCase | ScorerCase | DatasetCase


def explain(error: BaseException) -> str:
    """Explain an exception to the author of the method in one line."""
    if isinstance(error, ImportError):
        return f"cannot import what it needs ({message(error)}); name packages beyond the core in info.requires"
    if isinstance(error, UnsupportedShape):
        return f"refuses an ordinary surface ({message(error)}); treat it"
    if isinstance(error, ValueError) and "read-only" in message(error):
        return "writes into its input; work on a copy"
    if isinstance(error, (Failed, BenchmarkError)):
        return message(error)
    return f"raises {one_line(error)}; raise UnsupportedShape with the reason, or correct the method"


def difference(expected: FloatArray, answer: FloatArray) -> float:
    """Return the largest difference between two answers, relative to the first; infinite if their shapes differ."""
    if expected.shape != answer.shape:
        return np.inf
    return float(np.abs(answer - expected).max() / (np.abs(expected).max() or 1.0))


def same(expected: FloatArray, answer: FloatArray, hint: str, factor: float | None = None) -> str:
    """Compare two answers; ``hint`` explains a difference.

    With a factor, they are compared up to rigid motions and reflections, with the second one scaled by the factor.
    """
    if expected.shape != answer.shape:
        raise Failed(f"{answer.shape} instead of {expected.shape}: {hint}")
    tolerance = REPEAT_TOLERANCE
    if factor is not None:
        expected, answer, tolerance = factor * _invariants(expected), _invariants(answer), SYMMETRY_TOLERANCE
    deviation = f"relative difference {difference(expected, answer):.1e}"
    if not difference(expected, answer) <= tolerance:
        raise Failed(f"{deviation}: {hint}")
    return deviation


def is_mirrored(expected: FloatArray, answer: FloatArray) -> bool:
    """Return whether two congruent forms are mirror images."""
    first, second = (form - form.mean(axis=0) for form in (expected, answer))
    return bool(np.linalg.det(first.T @ second) < 0)


def _invariants(answer: FloatArray) -> FloatArray:
    """Return invariants under rigid motions: distances between vertices of a form, or a descriptor itself."""
    if answer.ndim == 1:
        return answer
    return np.asarray(pdist(answer[:: max(1, len(answer) // _COMPARED_VERTICES)]))
