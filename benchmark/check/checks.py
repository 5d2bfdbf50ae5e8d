"""Checks of methods and scorers: functions that return what they saw, or raise the fault."""

from __future__ import annotations

import re
from collections.abc import Callable
from inspect import signature
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from benchmark.api.contracts import FloatArray, Mesh, Shape
from benchmark.api.learning import CARD, Learner, Split, checked_weights, read_card
from benchmark.api.parameters import declared_parameters
from benchmark.check.case import Case, Failed, Skipped, explained
from benchmark.check.shapes import BENDS, TRAINING, awkward, figure, training_data, view
from benchmark.errors import ShapeError, UnsupportedShape
from benchmark.reference.paper import entry_of
from benchmark.registry import Component
from retrieval.measures import check_distances

#: Largest accepted difference between two runs on one shape, relative to the largest coordinate:
#: rounding may depend on the position of an array in memory.
REPEAT_TOLERANCE = 1e-9

#: Largest accepted difference between two descriptions of one surface, relative to the diameter of
#: the form: an iteration with a threshold may stop one step earlier. A thousandth of the diameter
#: does not affect the scorer.
SYMMETRY_TOLERANCE = 1e-3

#: Largest accepted dissimilarity between a form and its moved copy, relative to the smallest
#: between different forms.
_SHARE = 0.1

#: A power of two, by which single precision rounds alike.
_SCALE = 4.0
_ROTATION = Rotation.from_euler("xyz", [0.4, -1.1, 2.3]).as_matrix()
_COMPARED_VERTICES = 1000

#: Orders of vertices that are tried: a sign that rounding chooses is the same in half of them.
_ORDERS = 6


# Differences
# ------------------------------------------------------------------------------------------------


def _difference(expected: FloatArray, answer: FloatArray) -> float:
    """Return the largest difference between two answers, relative to the first; infinite if their shapes differ."""
    if expected.shape != answer.shape:
        return np.inf
    return float(np.abs(answer - expected).max() / (np.abs(expected).max() or 1.0))


def _same(
    expected: FloatArray, answer: FloatArray, hint: str, tolerance: float = REPEAT_TOLERANCE
) -> str:
    """Compare two answers to one description of a surface."""
    if not (difference := _difference(expected, answer)) <= tolerance:
        raise Failed(f"relative difference {difference:.1e}: {hint}")
    return f"relative difference {difference:.1e}"


def _same_form(expected: FloatArray, answer: FloatArray, hint: str, factor: float = 1.0) -> str:
    """Compare two answers up to rigid motions; the second is scaled by a factor."""
    if expected.shape != answer.shape:
        raise Failed(f"{answer.shape} instead of {expected.shape}: {hint}")
    if _is_mirror_image(expected, answer):
        raise Failed(
            f"gives the mirror image of the form: {hint}; choose its side by benchmark.api.oriented"
        )
    return _same(factor * _invariants(expected), _invariants(answer), hint, SYMMETRY_TOLERANCE)


def _is_mirror_image(expected: FloatArray, answer: FloatArray) -> bool:
    """Return whether a form fits another one better as its mirror image; one of a flat form is a turned form."""
    if answer.ndim == 1:
        return False
    first, second = (form - form.mean(axis=0) for form in (expected, answer))
    product = first.T @ second
    thinnest, *_, widest = np.linalg.svd(product, compute_uv=False)[::-1]
    return bool(np.linalg.det(product) < 0 and thinnest > SYMMETRY_TOLERANCE**2 * widest)


def _invariants(answer: FloatArray) -> FloatArray:
    """Return distances between vertices of a form, which no rigid motion changes, or a descriptor itself."""
    return (
        answer
        if answer.ndim == 1
        else np.asarray(pdist(answer[:: max(1, len(answer) // _COMPARED_VERTICES)]))
    )


def _unchanged(
    case: Case, change: Callable[[Mesh], Mesh], hint: str, order: NDArray[np.int64] | None = None
) -> str:
    """Compare answers for the figure and its changed copy; ``order`` is the order of vertices after the change.

    For a scorer, a form and its copy must be much more similar than any two forms.
    """
    if case.is_scorer:
        shapes, count = [case.shape(bend) for bend in BENDS], len(BENDS)
        distances = case.dissimilarities(
            [*shapes, *(case.shape(mesh=change(shape.mesh)) for shape in shapes)]
        )
        between = distances[:count, :count][~np.eye(count, dtype=bool)].min()
        itself = np.diag(distances[:count, count:]).max()
        if not itself <= _SHARE * between:
            raise Failed(
                f"a form differs from itself by {itself:.3g}, from others by {between:.3g}: {hint}"
            )
        return f"{itself / between if between else 0.0:.1e} of the smallest difference between two forms"
    answer = case.answer(case.shape(mesh=change(case.shape().mesh)))
    if order is not None and answer.ndim == 2:
        if len(case.reference) != len(order):
            raise Skipped("the form has its own vertices")
        answer = answer[np.argsort(order)]
    return _same_form(case.reference, answer, hint)


def _require_comparable(case: Case) -> None:
    """Raise :class:`Skipped` if other surfaces cannot be compared."""
    if case.is_random:
        raise Skipped("the answer is random")
    if case.reads_images:
        raise Skipped("the depth image has one camera")


# Methods and scorers
# ------------------------------------------------------------------------------------------------


def _training(case: Case) -> str:
    learner = case.component.create()
    named = getattr(learner, "model_folder", None)
    if isinstance(named, Path):
        raise Skipped(f"is checked with its model, {named.name}")
    if not isinstance(learner, Learner):
        raise Failed(
            "has 'train' but is not a learner; see 'A learner' in docs/reference/plugins.md"
        )
    if not re.fullmatch(r"[\w.=-]+", str(learner.model_name)):
        raise Failed(f"model_name is {learner.model_name!r}; return a valid folder name")
    if learner.split not in get_args(Split):
        raise Failed(f"split is {learner.split!r}; choose one of {', '.join(get_args(Split))}")
    model, data, cards = case.folder / TRAINING / learner.model_name, training_data(), []
    for _ in range(2):
        learner.train(data, model, {}, lambda _: None)
        if not (model / CARD).is_file():
            raise Failed(
                f"'train' ends without {CARD}; write it last, to show that the model is finished"
            )
        cards.append(read_card(model))
    if cards[1] != cards[0]:
        raise Failed("trains a finished model again; do nothing if its card exists")
    checked_weights(model)
    if cards[0].data != data.name or cards[0].identifiers != set(data.identifiers):
        raise Failed(
            "the card does not name the training data with all identifiers; copy them from the argument"
        )
    if type(loaded := learner.load(model)) is not type(learner):
        raise Failed(f"'load' returns {type(loaded).__name__}; return the method with its model")
    case.model = model
    return "trains a model on three images, keeps a finished one, and loads it"


def _arguments_that_are_no_parameters(component: Component) -> list[str]:
    """Return the arguments of a class that are no fields of a dataclass, so that no name can choose them."""
    cls = component.load()
    return [name for name in signature(cls).parameters if name not in declared_parameters(cls)]


def _parameters(case: Case) -> str:
    names = _arguments_that_are_no_parameters(case.component)
    listed = ", ".join(names)
    raise Failed(
        f"{listed} of __init__ cannot be chosen, and no record says the value: parameters are the"
        f" fields of a dataclass; drop __init__, decorate the class with @dataclass(frozen=True) and"
        f" write '{names[0]}: float = 0.02' in it"
    )


def _citation(case: Case) -> str:
    key, _ = entry_of(case.component.info.cite)
    if not key:
        known = "a key of the suite's bibliography nor one whole BibTeX entry, @article{key, ...}"
        raise Failed(f"info.cite is neither {known}; correct it, or leave it out")
    return f"cites {key}"


def _answer(case: Case) -> str:
    answer = case.reference
    if answer.ndim == 1:
        return f"{len(answer)} numbers, all finite"
    if not np.ptp(answer, axis=0).max() > 0:
        raise Failed("all vertices of the form are at one point; return different positions")
    return f"{len(answer)} vertices, all finite"


def _repeatable(case: Case) -> str:
    """Check that an answer is reproducible, immediately and after another shape."""
    first, second = case.reference, case.answer(case.shape())
    cause = (
        "differ by signs"
        if _difference(np.abs(first), np.abs(second)) <= REPEAT_TOLERANCE
        else "differ"
    )
    cure = "draw from shape.random(), choose the signs of eigenvectors by benchmark.api.oriented, keep no state"
    _same(first, second, f"two runs on one shape {cause}; {cure}")
    hint = "the answer differs if another shape comes first; keep no state between shapes"
    for expected, answer in zip(
        [first, *case.compared()], case.answers_after_another(), strict=True
    ):
        _same(expected, answer, hint)
    return "the same whatever was processed before"


def _seed(case: Case) -> str:
    if not case.is_random:
        hint = "the answer depends on the name or the seed of the shape; use neither, or declare deterministic=False"
        _same(case.reference, case.answer(case.shape(name="another name", seed=1)), hint)
        return "neither the seed nor the name of a shape matters"
    if np.array_equal(case.answer(case.shape(seed=1)), case.reference):
        raise Failed(
            "declares deterministic=False but ignores the seed; draw from shape.random(), or drop the flag"
        )
    return "the same under one seed, different under another"


def _relabelling(case: Case) -> str:
    if case.is_random:
        raise Skipped("the answer is random")
    mesh, generator = case.shape().mesh, np.random.default_rng(0)
    for _ in range(1 if case.compares else _ORDERS):
        order, of_faces = (
            generator.permutation(mesh.n_vertices),
            generator.permutation(mesh.n_faces),
        )

        def relabelled(
            mesh: Mesh, order: NDArray[np.int64] = order, of_faces: NDArray[np.int64] = of_faces
        ) -> Mesh:
            faces = np.argsort(order).astype(np.int32)[np.roll(mesh.faces, 1, axis=1)]
            return Mesh(mesh.vertices[order], faces[of_faces])

        hint = "depends on the numbering of vertices or faces; break ties by geometry"
        seen = _unchanged(case, relabelled, hint, order)
    return seen


def _motion(case: Case) -> str:
    _require_comparable(case)
    factor, hint = (
        1.0,
        "depends on the position of the shape in space; use distances, or a frame that rotates with it",
    )
    if case.is_scorer:
        factor = _SCALE
        hint = "depends on position or size of the form; use a frame fixed to the form, or declare invariant=False"
        if not case.component.info.invariant:
            raise Skipped("declares that it undoes motions only if a pose is well defined")

    def motion(mesh: Mesh) -> Mesh:
        return mesh.with_vertices(factor * mesh.vertices @ _ROTATION.T + [0.7, -1.1, 0.4])

    return _unchanged(case, motion, hint)


def _scale(case: Case) -> str:
    _require_comparable(case)
    declared = case.component.info.scale
    is_equivariant = declared == "equivariant"
    other = "invariant" if is_equivariant else "equivariant"
    remedy = f"multiply lengths by np.sqrt(shape.mesh.area), or declare '{other}'"
    hint = f"breaks info.scale = '{declared}'; {remedy}"
    scaled = [
        case.shape(bend, figure(bend).with_vertices(_SCALE * figure(bend).vertices))
        for bend in BENDS
    ]
    if case.reference.ndim == 2 or not is_equivariant:
        return _same_form(
            case.reference, case.answer(scaled[0]), hint, _SCALE if is_equivariant else 1.0
        )
    before, after = (
        case.dissimilarities([case.shape(bend) for bend in BENDS]),
        case.dissimilarities(scaled),
    )
    if not (before.max() > 0 and after.max() > 0):
        raise Failed(
            "does not distinguish poses of the figure, so scale cannot be checked; declare scale='invariant'"
        )
    return _same_form(before.ravel() / before.max(), after.ravel() / after.max(), hint)


def _dissimilarities(case: Case) -> str:
    several, draws = [case.shape(bend) for bend in BENDS], getattr(case.component.info, "draws", 1)
    several += [view(bend) for bend in BENDS] if case.is_scorer else []
    for draw in range(draws):
        distances = case.dissimilarities(several, draw)
        largest = check_distances(distances, distances.shape, is_square=True).max()
        if not largest > 0:
            raise Failed(
                f"does not distinguish any of {len(several)} shapes; compare properties that differ"
            )
    _same(
        distances,
        case.dissimilarities(several, draws - 1),
        "dissimilarities differ between calls; seed by 'draw'",
    )
    if draws == 1:
        # Rotated by one, because distances between positions, |i - j|, are the same in reverse
        # order.
        turned = np.roll(case.dissimilarities([*several[1:], several[0]]), 1, axis=(0, 1))
        _same_form(
            distances.ravel(),
            turned.ravel(),
            "depends on the order of the shapes; treat all pairs alike",
        )
    if not case.dissimilarities([*several, several[0]])[0, -1] <= _SHARE * largest:
        raise Failed("a shape is far from its copy; return distances, not similarities")
    return f"symmetric, zero diagonal, largest {largest:.3g}"


def _awkward(case: Case) -> str:
    refused, problems = [], []
    refusal: type[ShapeError] = ShapeError if case.is_scorer else UnsupportedShape
    point = {"a point": Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))} if case.is_scorer else {}
    for name, mesh in {**awkward(), **point}.items():
        try:
            case.answer(Shape(identifier=name, mesh=mesh, source_area=mesh.area))
        except refusal as reason:
            refused.append(name)
            problems += [] if str(reason) else [f"{name} is refused without a reason; say why"]
        except Exception as error:
            problems.append(
                f"{name}: {explained(error)}; raise UnsupportedShape with a reason, or treat it"
            )
    if problems:
        raise Failed("; ".join(problems))
    return f"refuses, with a reason: {', '.join(refused)}" if refused else "all treated"


# What is checked
# ------------------------------------------------------------------------------------------------

#: Checks without which the others have nothing to compare.
NECESSARY = frozenset({_training, _answer, _repeatable})


def checks_of(component: Component) -> dict[str, Callable[[Case], str]]:
    """Return the checks of a component by name, in their order."""
    cited = {"citation": _citation} if component.info.cite else {}
    undeclared = _arguments_that_are_no_parameters(component)
    parameters = {"parameters": _parameters} if undeclared else {}
    answers = parameters | cited | {"answer": _answer, "repeatable": _repeatable}
    surfaces = {"relabelling": _relabelling, "rigid motion": _motion}
    if component.kind == "scorer":
        return {
            **answers,
            **surfaces,
            "dissimilarities": _dissimilarities,
            "awkward shapes": _awkward,
        }
    learned = {"training": _training} if component.learns else {}
    changed = {"seed": _seed, **surfaces, "scale": _scale, "awkward shapes": _awkward}
    compared = {"dissimilarities": _dissimilarities} if component.describes else {}
    return {**learned, **answers, **changed, **compared}
