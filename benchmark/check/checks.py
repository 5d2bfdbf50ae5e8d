"""Checks of methods, scorers and data sets: functions that return what they saw, or raise the fault."""

from __future__ import annotations

import re
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from benchmark.api.contracts import FloatArray, Mesh, Shape
from benchmark.api.datasets import ShapeSet
from benchmark.api.learning import CARD, Learner, Split, checked_weights, read_card
from benchmark.check.shapes import BENDS, TRAINING, awkward, figure, training_data, view
from benchmark.errors import BenchmarkError, ShapeError, UnsupportedShape, locate
from benchmark.geometry.depth import depth_surface, fit_half_width
from benchmark.geometry.preparation import prepare
from benchmark.registry import Component
from benchmark.registry.outputs import (
    compare_signatures,
    compute_descriptor,
    compute_distances,
    compute_form,
    compute_signature,
)

#: Largest accepted difference between two runs on one shape, relative to the largest coordinate: rounding may depend on
#: the position of an array in memory.
REPEAT_TOLERANCE = 1e-9

#: Largest accepted difference between two descriptions of one surface, relative to the diameter of the form: an
#: iteration with a threshold may stop one step earlier. A thousandth of the diameter does not affect the scorer.
SYMMETRY_TOLERANCE = 1e-3

#: Largest accepted dissimilarity between a form and its moved copy, relative to the smallest between different forms.
_SHARE = 0.1

_SCALE = 2.5
_ROTATION = Rotation.from_euler("xyz", [0.4, -1.1, 2.3]).as_matrix()
_COMPARED_VERTICES = 1000


class Failed(Exception):
    """The check failed; with the reason and a hint."""


class Skipped(Exception):
    """The check does not apply; with the reason."""


@dataclass(frozen=True)
class Finding:
    """Result of one check: its name, its outcome, and one line on what was seen, with a hint if it failed.

    ``traceback`` says where an error was raised.
    """

    name: str
    outcome: Literal["ok", "failed", "skipped"]
    explanation: str
    traceback: str = ""

    def __str__(self) -> str:
        return f"{self.outcome:<7}  {self.name:<15}  {self.explanation}"


def run_checks(
    component: Component, options: Mapping[str, str] | None = None, tick: Callable[[], object] = lambda: None
) -> Iterator[str | Finding]:
    """Yield the name of each check of a component before it runs, then its finding.

    If there is no answer, or two answers differ, the remaining checks are left out.

    Parameters
    ----------
    component
        What to check.
    options
        Changes to the schedule of a learner.
    tick
        Called before each shape.
    """
    if missing := component.missing_packages() if component.kind != "data set" else ():
        yield Finding("packages", "skipped", f"install {', '.join(missing)}, then check again")
        return
    with tempfile.TemporaryDirectory(prefix="canonical-forms-") as folder:
        case, checks = _checks_of(component, Path(folder), options or {}, tick)
        for name, run in checks.items():
            yield name
            finding = _find(name, run, case)
            yield finding
            if finding.outcome == "failed" and run in _NECESSARY:
                return


def _find(name: str, run: Callable[[Any], str], case: Any) -> Finding:
    try:
        return Finding(name, "ok", run(case))
    except Skipped as reason:
        return Finding(name, "skipped", str(reason))
    except (Exception, SystemExit) as error:
        trace = "" if isinstance(error, Failed) else "".join(traceback.format_exception(error))
        return Finding(name, "failed", " ".join(explain(error).split()), trace)


def explain(error: BaseException) -> str:
    """Explain an exception to the author in one line, with advice that fits."""
    if isinstance(error, UnsupportedShape):
        return f"refuses an ordinary surface ({error}); treat it"
    if isinstance(error, Failed | BenchmarkError):
        return str(error)
    advice = ""
    if isinstance(error, ImportError):
        advice = "; name packages beyond the core in info.requires"
    elif "read-only" in str(error):
        advice = "; it writes into its input: work on a copy"
    return f"{locate(error)}{advice}"


# Answers -------------------------------------------------------------------------------------------------------------


@dataclass
class Case:
    """A method, descriptor or scorer with its answers: a form, shape (n, 3), or a vector.

    Parameters
    ----------
    component
        What to check.
    folder, options
        Where a learner is trained, and changes to its schedule.
    tick
        Called before each shape.
    model
        The model of a learner, once it is trained.
    """

    component: Component
    folder: Path
    options: Mapping[str, str]
    tick: Callable[[], object]
    model: Path | None = None

    @property
    def info(self) -> Any:
        """Description of the component."""
        return self.component.info

    @property
    def reads_images(self) -> bool:
        """Whether it is a method that needs depth images."""
        return "mesh" not in getattr(self.info, "inputs", ("mesh",))

    @cached_property
    def reference(self) -> FloatArray:
        """The answer for the figure."""
        return self.answer(self.subject())

    def create(self) -> Any:
        """Return a new object, with its trained model."""
        created = self.component.create()
        return created.load(self.model) if self.model else created

    def subject(self, bend: float = BENDS[0], mesh: Mesh | None = None, seed: int = 0, name: str = "figure") -> Shape:
        """Return the figure, or another mesh in its place, as input."""
        seen = view(bend) if self.reads_images else None
        mesh = mesh or (seen.mesh if seen else figure(bend))
        # Bending preserves the area, and equal areas would leave nothing to compare.
        area = (1 + bend) * mesh.area
        depth = seen.depth if seen else None
        return Shape(identifier=f"{name} {bend}", mesh=mesh, depth=depth, source_area=area, seed=seed)

    def answer(self, shape: Shape, by: Any = None) -> FloatArray:
        """Return the answer of an object, by default a new one."""
        self.tick()
        created = self.create() if by is None else by
        if self.component.kind == "scorer":
            arrays = compute_signature(created, shape.mesh)
            return np.concatenate([np.asarray(arrays[name], dtype=np.float64).ravel() for name in sorted(arrays)])
        return (
            compute_descriptor(created, shape) if self.component.describes else compute_form(created, shape)[0].vertices
        )

    def dissimilarities(self, shapes: Sequence[Shape], draw: int = 0) -> FloatArray:
        """Return the dissimilarities of all pairs by a descriptor or a scorer."""
        created, is_scorer = self.create(), self.component.kind == "scorer"
        described: list[Any] = []
        for shape in shapes:
            self.tick()
            described.append(
                compute_signature(created, shape.mesh) if is_scorer else compute_descriptor(created, shape)
            )
        return compare_signatures(created, described, draw) if is_scorer else compute_distances(created, described)

    def unchanged_by(self, change: Callable[[Mesh], Mesh], hint: str, order: NDArray[np.int64] | None = None) -> str:
        """Compare answers for the figure and its changed copy; ``order`` is the vertex order after the change.

        Forms are compared up to rigid motions and reflections. For a scorer, a form and its copy must be much more
        similar than any two forms.
        """
        if self.component.kind == "scorer":
            shapes = [self.subject(bend) for bend in BENDS]
            copies = [self.subject(mesh=change(shape.mesh)) for shape in shapes]
            distances, count = self.dissimilarities([*shapes, *copies]), len(BENDS)
            between = distances[:count, :count][~np.eye(count, dtype=bool)].min()
            itself = np.diag(distances[:count, count:]).max()
            if not itself <= _SHARE * between:
                raise Failed(f"a form differs from itself by {itself:.3g}, from others by {between:.3g}: {hint}")
            return f"{itself / between if between else 0.0:.1e} of the smallest difference between two forms"
        mesh = self.subject().mesh
        answer = self.answer(self.subject(mesh=change(mesh)))
        if order is not None and answer.ndim == 2:
            if len(self.reference) != mesh.n_vertices:
                raise Skipped("the form has its own vertices")
            answer = answer[np.argsort(order)]
        return same(self.reference, answer, hint, factor=1.0)


def difference(expected: FloatArray, answer: FloatArray) -> float:
    """Return the largest difference between two answers, relative to the first; infinite if their shapes differ."""
    if expected.shape != answer.shape:
        return np.inf
    return float(np.abs(answer - expected).max() / (np.abs(expected).max() or 1.0))


def same(expected: FloatArray, answer: FloatArray, hint: str, factor: float | None = None) -> str:
    """Compare two answers; with a factor up to rigid motions and reflections, with the second one scaled by it."""
    if expected.shape != answer.shape:
        raise Failed(f"{answer.shape} instead of {expected.shape}: {hint}")
    tolerance = REPEAT_TOLERANCE
    if factor is not None:
        expected, answer, tolerance = factor * _invariants(expected), _invariants(answer), SYMMETRY_TOLERANCE
    deviation = f"relative difference {difference(expected, answer):.1e}"
    if not difference(expected, answer) <= tolerance:
        raise Failed(f"{deviation}: {hint}")
    return deviation


def _invariants(answer: FloatArray) -> FloatArray:
    """Return invariants under rigid motions: distances between vertices of a form, or a descriptor itself."""
    if answer.ndim == 1:
        return answer
    return np.asarray(pdist(answer[:: max(1, len(answer) // _COMPARED_VERTICES)]))


# Methods and scorers -------------------------------------------------------------------------------------------------


def _training(case: Case) -> str:
    named = getattr(case.component.create(), "model_folder", None)
    if isinstance(named, Path) and not case.options:
        raise Skipped(f"is checked with its model, {named.name}; -o NAME=VALUE trains one for the check")
    case.model = train_on_figure(case.component, case.folder, case.options)
    return "trains a model on three images, keeps a finished one, and loads it"


def train_on_figure(component: Component, folder: Path, options: Mapping[str, str] | None = None) -> Path:
    """Train a learner on :func:`~benchmark.check.shapes.training_data` and return the folder of the model.

    Raises
    ------
    Failed
        If training leaves no usable model, or a finished training is repeated.
    """
    learner = component.create()
    if not isinstance(learner, Learner):
        raise Failed("has 'train' but is not a learner; see 'A learner' in docs/reference/plugins.md")
    if not re.fullmatch(r"[\w.=-]+", str(learner.model_name)):
        raise Failed(f"model_name is {learner.model_name!r}; return a valid folder name")
    if learner.split not in get_args(Split):
        raise Failed(f"split is {learner.split!r}; choose one of {', '.join(get_args(Split))}")
    place, data, cards = folder / TRAINING / learner.model_name, training_data(), []
    for _ in range(2):
        learner.train(data, place, dict(options or {}), lambda _: None)
        if not (place / CARD).is_file():
            raise Failed(f"'train' ends without {CARD}; write it last, to show that the model is finished")
        cards.append(read_card(place))
    if cards[1] != cards[0]:
        raise Failed("trains a finished model again; do nothing if its card exists")
    checked_weights(place)
    if cards[0].data != data.name or cards[0].identifiers != set(data.identifiers):
        raise Failed("the card does not name the training data with all identifiers; copy them from the argument")
    if type(loaded := learner.load(place)) is not type(learner):
        raise Failed(f"'load' returns {type(loaded).__name__}; return the method with its model")
    return place


def _answer(case: Case) -> str:
    answer = case.reference
    if answer.ndim == 1:
        return f"{len(answer)} numbers, all finite"
    if not np.ptp(answer, axis=0).max() > 0:
        raise Failed("all vertices of the form are at one point; return different positions")
    return f"{len(answer)} vertices, all finite"


def _repeatable(case: Case) -> str:
    """Check that an answer is reproducible, immediately and after another shape."""
    first, second = case.reference, case.answer(case.subject())
    start = "give iterative solvers such as eigsh a fixed start (v0=...)"
    if not (size := difference(first, second)) <= REPEAT_TOLERANCE:
        if difference(np.abs(first), np.abs(second)) <= REPEAT_TOLERANCE:
            cure = f"make the largest entry of each eigenvector positive, and {start}"
            raise Failed(f"two runs on one shape differ by signs; {cure}")
        cure = f"draw from shape.random(), {start}, fix the signs of eigenvectors, keep no state between shapes"
        raise Failed(f"two runs on one shape differ by {size:.1e} of the largest number; {cure}")
    used = case.create()
    case.answer(case.subject(BENDS[1]), used)
    again = case.answer(case.subject(), used)
    same(first, again, "the answer differs after another shape; keep no state between shapes")
    return "the same whatever was processed before"


def _input_untouched(case: Case) -> str:
    shape = case.subject()
    laplacian = shape.laplacian()
    arrays = {
        "vertices": shape.mesh.vertices,
        "faces": shape.mesh.faces,
        "depth": np.empty(0) if shape.depth is None else shape.depth,
        "geodesics": shape.geodesics(),
        "Laplacian": laplacian.stiffness.data,
        "vertex areas": laplacian.mass,
    }
    before = {name: array.copy() for name, array in arrays.items()}
    facts = (shape.identifier, id(shape.mesh), id(shape.depth), shape.source_area, shape.seed)
    case.answer(shape)
    changed = [name for name, array in arrays.items() if not np.array_equal(array, before[name])]
    if facts != (shape.identifier, id(shape.mesh), id(shape.depth), shape.source_area, shape.seed):
        changed.append("attributes")
    if changed:
        raise Failed(f"changes the {', '.join(changed)} of the shape; work on a copy")
    return "mesh, geodesics and Laplacian are unchanged"


def _seed(case: Case) -> str:
    if case.info.deterministic:
        answer = case.answer(case.subject(name="another name", seed=1))
        hint = "the answer depends on the name or the seed of the shape; use neither, or declare deterministic=False"
        same(case.reference, answer, hint)
        return "neither the seed nor the name of a shape matters"
    if np.array_equal(case.answer(case.subject(seed=1)), case.reference):
        raise Failed("declares deterministic=False but ignores the seed; draw from shape.random(), or drop the flag")
    return "the same under one seed, different under another"


def _comparable(case: Any) -> None:
    """Raise :class:`Skipped` if other surfaces cannot be compared."""
    if not getattr(case.info, "deterministic", True):
        raise Skipped("the answer is random")
    if case.reads_images:
        raise Skipped("the depth image has one camera")


def _relabelling(case: Any) -> str:
    if not getattr(case.info, "deterministic", True):
        raise Skipped("the answer is random")
    mesh, generator = case.subject().mesh, np.random.default_rng(0)
    order, of_faces = generator.permutation(mesh.n_vertices), generator.permutation(mesh.n_faces)

    def relabelled(mesh: Mesh) -> Mesh:
        faces = np.argsort(order).astype(np.int32)[np.roll(mesh.faces, 1, axis=1)]
        return Mesh(mesh.vertices[order], faces[of_faces])

    hint = "depends on the numbering of vertices or faces; break ties by geometry"
    return str(case.unchanged_by(relabelled, hint, order))


def _motion(case: Any) -> str:
    _comparable(case)
    factor, hint = 1.0, "depends on the position of the shape in space; use distances, or a frame that rotates with it"
    if case.component.kind == "scorer":
        factor = _SCALE
        hint = "depends on position or size of the form; use a frame fixed to the form, or declare invariant=False"
        if not case.info.invariant:
            raise Skipped("declares that it undoes motions only if a pose is well defined")
    moved = lambda mesh: mesh.with_vertices(factor * mesh.vertices @ _ROTATION.T + [0.7, -1.1, 0.4])  # noqa: E731
    return str(case.unchanged_by(moved, hint))


def _mirror(case: Case) -> str:
    _comparable(case)
    if case.reference.ndim == 1 or case.component.learns:
        raise Skipped("a descriptor or a learned form may distinguish mirror images")
    mirrored, hint = set(), "gives a mirrored shape another form; break ties by geometry"
    for bend in BENDS:
        shape = case.subject(bend)
        image = Mesh(shape.mesh.vertices * [-1.0, 1.0, 1.0], shape.mesh.faces[:, ::-1])
        before, after = case.answer(shape), case.answer(case.subject(bend, mesh=image))
        deviation = same(before, after, hint, factor=1.0)
        mirrored.add(_is_mirrored(before, after))
    if len(mirrored) > 1:
        raise Failed("mirrors some shapes and not others; let the form determine its handedness, or keep the shape's")
    return f"{'the mirrored form' if True in mirrored else 'the same form'}, {deviation}"


def _is_mirrored(expected: FloatArray, answer: FloatArray) -> bool:
    first, second = (form - form.mean(axis=0) for form in (expected, answer))
    return bool(np.linalg.det(first.T @ second) < 0)


def _scale(case: Case) -> str:
    _comparable(case)
    is_equivariant = case.info.scale == "equivariant"
    other = "invariant" if is_equivariant else "equivariant"
    hint = f"breaks info.scale = '{case.info.scale}'; measure relative to the shape's size, or declare '{other}'"
    scaled = [case.subject(bend, figure(bend).with_vertices(_SCALE * figure(bend).vertices)) for bend in BENDS]
    if case.reference.ndim == 2 or not is_equivariant:
        return same(case.reference, case.answer(scaled[0]), hint, factor=_SCALE if is_equivariant else 1.0)
    before, after = case.dissimilarities([case.subject(bend) for bend in BENDS]), case.dissimilarities(scaled)
    if not (before.max() > 0 and after.max() > 0):
        raise Failed("does not distinguish poses of the figure, so scale cannot be checked; declare scale='invariant'")
    return same(before.ravel() / before.max(), after.ravel() / after.max(), hint, factor=1.0)


def _dissimilarities(case: Any) -> str:
    several, draws = [case.subject(bend) for bend in BENDS], getattr(case.info, "draws", 1)
    several += [view(bend) for bend in BENDS] if case.component.kind == "scorer" else []
    for draw in range(draws):
        distances = case.dissimilarities(several, draw)
        largest = distances.max()
        if distances.min() < 0:
            raise Failed(f"dissimilarities of {len(several)} shapes are negative; return numbers >= 0")
        if not largest > 0:
            raise Failed(f"does not distinguish any of {len(several)} shapes; compare properties that differ")
        if np.abs(distances - distances.T).max() > 1e-9 * largest or np.abs(np.diag(distances)).max() > 1e-6 * largest:
            raise Failed("dissimilarities are not symmetric with a zero diagonal; make them so")
    repeated = case.dissimilarities(several, draws - 1)
    same(distances, repeated, "dissimilarities differ between calls; seed by 'draw'")
    if draws == 1:
        # Rotated by one, because distances between positions, |i - j|, are the same in reverse order.
        turned = np.roll(case.dissimilarities([*several[1:], several[0]]), 1, axis=(0, 1))
        same(distances, turned, "depends on the order of the shapes; treat all pairs alike")
    return f"symmetric, zero diagonal, largest {largest:.3g}"


def _awkward(case: Any) -> str:
    refused, problems = [], []
    is_scorer = case.component.kind == "scorer"
    refusal: type[ShapeError] = ShapeError if is_scorer else UnsupportedShape
    point = {"a point": Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))} if is_scorer else {}
    for name, mesh in {**awkward(), **point}.items():
        try:
            case.answer(Shape(identifier=name, mesh=mesh, source_area=mesh.area))
        except refusal as reason:
            refused.append(name)
            problems += [] if str(reason) else [f"{name} is refused without a reason; say why"]
        except Exception as error:
            problems.append(f"{name}: {explain(error)}; raise UnsupportedShape with a reason, or treat it")
    if problems:
        raise Failed("; ".join(problems))
    return f"refuses {', '.join(refused)}, each with a reason" if refused else "all treated"


# Data sets -----------------------------------------------------------------------------------------------------------


@dataclass
class SetCase:
    """A data set, and its meshes once they are loaded."""

    component: Component
    tick: Callable[[], object]
    meshes: dict[str, Mesh] = field(default_factory=dict)

    @cached_property
    def shapes(self) -> ShapeSet:
        """The data set."""
        created: ShapeSet = self.component.create()
        return created


def _shapes(case: SetCase) -> str:
    entries = case.shapes.shapes
    names, classes = Counter(e.identifier for e in entries), Counter(entry.subject for entry in entries)
    if twice := [name for name, count in names.items() if count > 1]:
        raise Failed(f"two shapes are called '{twice[0]}'; give each an identifier of its own")
    if len(classes) < 2 or max(classes.values()) < 2:
        raise Failed("retrieval needs at least two classes, one of them with two shapes; list more shapes")
    return f"{len(entries)} shapes, {len(classes)} classes"


def _meshes(case: SetCase) -> str:
    for entry in case.shapes.shapes:
        case.tick()
        case.meshes[entry.identifier] = mesh = case.shapes.load(entry)
        if not isinstance(mesh, Mesh):
            raise Failed(f"'load' returns {type(mesh).__name__} for '{entry.identifier}'; return Mesh(vertices, faces)")
    return f"all {len(case.meshes)} load"


def _repeatable_meshes(case: SetCase) -> str:
    for entry in reversed(case.shapes.shapes):
        case.tick()
        mesh, before = case.shapes.load(entry), case.meshes[entry.identifier]
        if not (np.array_equal(mesh.vertices, before.vertices) and np.array_equal(mesh.faces, before.faces)):
            raise Failed(
                f"the mesh of '{entry.identifier}' changes between calls; seed it, keep no state between shapes"
            )
    return "the same whatever was loaded before"


def _inputs(case: SetCase) -> str:
    for entry in {entry.subject: entry for entry in reversed(case.shapes.shapes)}.values():
        case.tick()
        mesh, camera = case.meshes[entry.identifier], case.shapes.camera(entry)
        try:
            prepare(mesh)
            depth_surface(mesh, camera, case.shapes.half_width or fit_half_width([mesh], camera))
        except BenchmarkError as error:
            raise Failed(f"'{entry.identifier}': {error}") from error
    return "a shape of each class can be prepared, and is seen by its camera"


# The tables ----------------------------------------------------------------------------------------------------------

_SCORER = {
    "answer": _answer,
    "repeatable": _repeatable,
    "relabelling": _relabelling,
    "rigid motion": _motion,
    "dissimilarities": _dissimilarities,
    "awkward shapes": _awkward,
}
_METHOD = {
    "answer": _answer,
    "repeatable": _repeatable,
    "input untouched": _input_untouched,
    "seed": _seed,
    "relabelling": _relabelling,
    "rigid motion": _motion,
    "mirror": _mirror,
    "scale": _scale,
    "awkward shapes": _awkward,
}
_DATA_SET = {"shapes": _shapes, "meshes": _meshes, "repeatable": _repeatable_meshes, "inputs": _inputs}

#: Checks without which the others have nothing to compare.
_NECESSARY = frozenset({_training, _answer, _repeatable, _shapes, _meshes})


def _checks_of(
    component: Component, folder: Path, options: Mapping[str, str], tick: Callable[[], object]
) -> tuple[Any, Mapping[str, Callable[[Any], str]]]:
    if component.kind == "data set":
        return SetCase(component, tick), _DATA_SET
    case = Case(component, folder, options, tick)
    if component.kind == "scorer":
        return case, _SCORER
    learned = {"training": _training} if component.learns else {}
    compared = {"dissimilarities": _dissimilarities} if component.describes else {}
    return case, {**learned, **_METHOD, **compared}
