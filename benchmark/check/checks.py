"""Checks of methods and scorers: functions that return what they saw, or raise the fault."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from inspect import Parameter, signature
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from benchmark.api.contracts import FloatArray, Mesh, Shape
from benchmark.api.learning import (
    CARD,
    Card,
    Learner,
    Split,
    TrainingData,
    checked_weights,
    read_card,
)
from benchmark.api.parameters import declared_parameters
from benchmark.check.case import Case, FailedCheck, SkippedCheck, explained
from benchmark.check.shapes import BENDS, TRAINING, awkward, figure, training_on_figure, view
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

#: A rotation and a translation about and along all axes.
_ROTATION = Rotation.from_euler("xyz", [0.4, -1.1, 2.3]).as_matrix()
_TRANSLATION = [0.7, -1.1, 0.4]
#: About so many vertices of a form are compared by all their distances.
_COMPARED_VERTICES = 1000

#: Orders of vertices that are tried: a sign that rounding chooses is the same in half of them.
_ORDERS = 6


# Differences
# ------------------------------------------------------------------------------------------------


def _difference(expected: FloatArray, answer: FloatArray) -> float:
    """Return the largest difference between two answers, relative to the first.

    Infinite if their shapes differ.
    """
    if expected.shape != answer.shape:
        return np.inf
    return float(np.abs(answer - expected).max() / (np.abs(expected).max() or 1.0))


def _require_same(
    expected: FloatArray, answer: FloatArray, hint: str, tolerance: float = REPEAT_TOLERANCE
) -> str:
    """Raise :class:`FailedCheck` unless two answers to one description of a surface are the same.

    Returns their difference in words.
    """
    difference = _difference(expected, answer)
    if not difference <= tolerance:
        raise FailedCheck(f"relative difference {difference:.1e}: {hint}")
    return f"relative difference {difference:.1e}"


def _require_same_form(
    expected: FloatArray, answer: FloatArray, hint: str, factor: float = 1.0
) -> str:
    """Raise :class:`FailedCheck` unless two answers are the same up to rigid motions.

    The second is scaled by a factor. Returns their difference in words.
    """
    if expected.shape != answer.shape:
        raise FailedCheck(f"{answer.shape} instead of {expected.shape}: {hint}")
    if _is_mirror_image(expected, answer):
        problem = f"gives the mirror image of the form: {hint}"
        raise FailedCheck(f"{problem}; choose its side by benchmark.api.oriented")
    return _require_same(
        factor * _invariants(expected), _invariants(answer), hint, SYMMETRY_TOLERANCE
    )


def _is_mirror_image(expected: FloatArray, answer: FloatArray) -> bool:
    """Return whether a form fits another one better as its mirror image.

    The mirror image of a flat form is a turned form.
    """
    if answer.ndim == 1:
        return False
    first = expected - expected.mean(axis=0)
    second = answer - answer.mean(axis=0)
    product = first.T @ second
    widest, *_, thinnest = np.linalg.svd(product, compute_uv=False)
    return bool(np.linalg.det(product) < 0 and thinnest > SYMMETRY_TOLERANCE**2 * widest)


def _invariants(answer: FloatArray) -> FloatArray:
    """Return what no rigid motion changes: distances between vertices, or a descriptor."""
    if answer.ndim == 1:
        return answer
    step = max(1, len(answer) // _COMPARED_VERTICES)
    return np.asarray(pdist(answer[::step]))


def _require_unchanged(
    case: Case, change: Callable[[Mesh], Mesh], hint: str, order: NDArray[np.int64] | None = None
) -> str:
    """Raise :class:`FailedCheck` if a change of the figure changes the answer.

    Returns what was seen in words.

    Parameters
    ----------
    case
        The component.
    change
        What makes another description of the same surface.
    hint
        What the author may do.
    order
        Order of the vertices after the change; None if it stays.
    """
    if case.is_scorer:
        return _require_similar(case, change, hint)
    answer = case.answer(case.shape(mesh=change(case.shape().mesh)))
    if order is not None and answer.ndim == 2:
        if len(case.reference) != len(order):
            raise SkippedCheck("the form has its own vertices")
        answer = answer[np.argsort(order)]
    return _require_same_form(case.reference, answer, hint)


def _require_similar(case: Case, change: Callable[[Mesh], Mesh], hint: str) -> str:
    """Check that a scorer finds each form nearly equal to a changed copy of it.

    Parameters
    ----------
    case
        The scorer, with shapes to try it on.
    change
        A change that should not matter, such as a motion.
    hint
        What to do if it does.

    Returns
    -------
    str
        In words, how much a form differs from its copy, relative to the two most similar forms.

    Raises
    ------
    FailedCheck
        If a form differs from its copy by more than a small share of that.
    """
    shapes = [case.shape(bend) for bend in BENDS]
    copies = [case.shape(mesh=change(shape.mesh)) for shape in shapes]
    n = len(shapes)
    distances = case.dissimilarities([*shapes, *copies])
    # The first n rows are of the forms; the first n columns of the forms, the others of the copies.
    to_others = distances[:n, :n][~np.eye(n, dtype=bool)].min()
    to_copy = np.diag(distances[:n, n:]).max()
    if not to_copy <= _SHARE * to_others:  # also if one of both is NaN
        problem = f"a form differs from itself by {to_copy:.3g}, from others by {to_others:.3g}"
        raise FailedCheck(f"{problem}: {hint}")
    ratio = to_copy / to_others if to_others else 0.0
    return f"{ratio:.1e} of the smallest difference between two forms"


def _require_comparable(case: Case) -> None:
    """Raise :class:`SkippedCheck` if other surfaces cannot be compared."""
    if case.is_random:
        raise SkippedCheck("the answer is random")
    if case.reads_images:
        raise SkippedCheck("the depth image has one camera")


# Methods and scorers
# ------------------------------------------------------------------------------------------------


def _learner_to_train(case: Case) -> Learner:
    """Return the learner of a case, after checks of what it declares.

    Raises
    ------
    SkippedCheck
        If it has a trained model already.
    FailedCheck
        If it lacks something that a learner has, or the name of its model cannot be that of a
        folder, or its split is unknown.
    """
    learner = case.component.create()
    trained_model = getattr(learner, "model_folder", None)
    if isinstance(trained_model, Path):
        raise SkippedCheck(f"is checked with its model, {trained_model.name}")
    if not isinstance(learner, Learner):
        problem = "has 'train' but is not a learner"
        raise FailedCheck(f"{problem}; see 'A learner' in docs/reference/plugins.md")
    if not re.fullmatch(r"[\w.=-]+", str(learner.model_name)):
        raise FailedCheck(f"model_name is {learner.model_name!r}; return a valid folder name")
    if learner.split not in get_args(Split):
        raise FailedCheck(f"split is {learner.split!r}; choose one of {', '.join(get_args(Split))}")
    return learner


def _training(case: Case) -> str:
    """Check that a learner trains a model, keeps a finished one, and can load it.

    Returns
    -------
    str
        What was found, in words.

    Raises
    ------
    FailedCheck
        If the model is trained anew, its card is wrong, or it cannot be loaded.
    """
    learner = _learner_to_train(case)
    model = case.folder / TRAINING / learner.model_name
    data = training_on_figure()
    card = _card_after_training(learner, data, model)
    if _card_after_training(learner, data, model) != card:
        raise FailedCheck("trains a finished model again; do nothing if its card exists")
    checked_weights(model)
    if card.data != data.name or card.identifiers != set(data.identifiers):
        problem = "the card does not name the training data with all identifiers"
        raise FailedCheck(f"{problem}; copy them from the argument")
    loaded = learner.load(model)
    if type(loaded) is not type(learner):
        problem = f"'load' returns {type(loaded).__name__}"
        raise FailedCheck(f"{problem}; return the method with its model")
    case.model = model
    return "trains a model on three images, keeps a finished one, and loads it"


def _card_after_training(learner: Learner, data: TrainingData, model: Path) -> Card:
    """Let a learner train a model, and return its card."""
    learner.train(data, model, {}, lambda _: None)
    if not (model / CARD).is_file():
        problem = f"'train' ends without {CARD}"
        raise FailedCheck(f"{problem}; write it last, to show that the model is finished")
    return read_card(model)


def _arguments_that_are_no_parameters(component: Component) -> list[str]:
    """Return the arguments of a class that no name can choose: those that are no fields.

    Arguments without a name, ``*args`` and ``**kwargs``, are inherited from protocols and from
    modules of PyTorch. A run passes none.
    """
    cls = component.load()
    fields = declared_parameters(cls)
    try:
        arguments = signature(cls).parameters.values()
    except ValueError:  # of a class that inherits from one of Python, such as dict
        return []
    unnamed = (Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD)
    return [
        argument.name
        for argument in arguments
        if argument.kind not in unnamed and argument.name not in fields
    ]


def _parameters(case: Case) -> str:
    """Raise :class:`FailedCheck`, because arguments of the class are no parameters."""
    names = _arguments_that_are_no_parameters(case.component)
    listed = ", ".join(names)
    raise FailedCheck(
        f"{listed} of __init__ cannot be chosen, and no record says the value: parameters are the"
        " fields of a dataclass; drop __init__, decorate the class with @dataclass(frozen=True) and"
        f" write '{names[0]}: float = 0.02' in it"
    )


def _citation(case: Case) -> str:
    """Check that the source is a key of the bibliography or an entry."""
    key, _ = entry_of(case.component.info.cite)
    if not key:
        accepted = (
            "a key of the suite's bibliography nor one whole BibTeX entry, @article{key, ...}"
        )
        raise FailedCheck(f"info.cite is neither {accepted}; correct it, or leave it out")
    return f"cites {key}"


def _answer(case: Case) -> str:
    """Check that there is an answer, and that a form has an extent."""
    answer = case.reference
    if answer.ndim == 1:
        return f"{len(answer)} numbers, all finite"
    if not np.ptp(answer, axis=0).max() > 0:
        raise FailedCheck("all vertices of the form are at one point; return different positions")
    return f"{len(answer)} vertices, all finite"


def _repeatable(case: Case) -> str:
    """Check that a second answer for a shape is the same, at once and after other shapes.

    Returns
    -------
    str
        What was found, in words.
    """
    # At once.
    first = case.reference
    second = case.answer(case.shape())
    differ_by_signs = _difference(np.abs(first), np.abs(second)) <= REPEAT_TOLERANCE
    verb = "differ by signs" if differ_by_signs else "differ"
    cure = (
        "draw from shape.random(), choose the signs of eigenvectors by benchmark.api.oriented, "
        "keep no state"
    )
    _require_same(first, second, f"two runs on one shape {verb}; {cure}")

    # In another process, after other shapes.
    hint = "the answer differs if another shape comes first; keep no state between shapes"
    expected_answers = [first, *case.compared()]
    for expected, answer in zip(expected_answers, case.answers_after_another(), strict=True):
        _require_same(expected, answer, hint)
    return "the same whatever was processed before"


def _seed(case: Case) -> str:
    """Check that the seed of a shape matters as declared, and its name never."""
    if case.is_random:
        if np.array_equal(case.answer(case.shape(seed=1)), case.reference):
            problem = "declares deterministic=False but ignores the seed"
            raise FailedCheck(f"{problem}; draw from shape.random(), or drop the flag")
        hint = "the answer depends on the name of the shape; draw from shape.random()"
        _require_same(case.reference, case.answer(case.shape(name="another name")), hint)
        finding = "the same under one seed, different under another"
    else:
        hint = (
            "the answer depends on the name or the seed of the shape; "
            "use neither, or declare deterministic=False"
        )
        renamed = case.shape(name="another name", seed=1)
        _require_same(case.reference, case.answer(renamed), hint)
        finding = "neither the seed nor the name of a shape matters"
    # Another shape of the same name, as the view of a shape, or a shape of another data set.
    other = case.shape(BENDS[1])
    namesake = replace(other, identifier=case.shape().identifier)
    hint = "the answer is that for an earlier shape of the same name; keep no results by name"
    _require_same(case.answer(other), case.answer(namesake), hint)
    return finding


def _relabelling(case: Case) -> str:
    """Check that the numbering of vertices and faces does not matter.

    Random orders are tried: several, or one if shapes have to be compared, which takes longer.
    """
    if case.is_random:
        raise SkippedCheck("the answer is random")
    mesh = case.shape().mesh
    generator = np.random.default_rng(0)
    hint = "depends on the numbering of vertices or faces; break ties by geometry"
    finding = ""
    n_orders = 1 if case.compares else _ORDERS
    for _ in range(n_orders):
        order = generator.permutation(mesh.n_vertices)
        order_of_faces = generator.permutation(mesh.n_faces)
        relabelled = partial(_relabelled, order=order, of_faces=order_of_faces)
        finding = _require_unchanged(case, relabelled, hint, order)
    return finding


def _relabelled(mesh: Mesh, order: NDArray[np.int64], of_faces: NDArray[np.int64]) -> Mesh:
    """Return a mesh with its vertices and faces in another order, each face from another corner."""
    faces = np.argsort(order).astype(np.int32)[np.roll(mesh.faces, 1, axis=1)]
    return Mesh(mesh.vertices[order], faces[of_faces])


def _motion(case: Case) -> str:
    """Check that the position of a shape in space does not matter; for a scorer, nor its size."""
    _require_comparable(case)
    factor = 1.0
    hint = (
        "depends on the position of the shape in space; "
        "use distances, or a frame that rotates with it"
    )
    if case.is_scorer:
        factor = _SCALE
        hint = (
            "depends on position or size of the form; "
            "use a frame fixed to the form, or declare invariant=False"
        )
        if not case.component.info.invariant:
            raise SkippedCheck("declares that it undoes motions only if a pose is well defined")

    def motion(mesh: Mesh) -> Mesh:
        """Return a mesh after a rotation and a translation; for a scorer, also scaled."""
        return mesh.with_vertices(factor * mesh.vertices @ _ROTATION.T + _TRANSLATION)

    return _require_unchanged(case, motion, hint)


def _scale(case: Case) -> str:
    """Check that the answer for a scaled shape is what the method declares.

    An ``"invariant"`` form or descriptor must not change. An ``"equivariant"`` form must be scaled
    as the shape. An equivariant descriptor may change, but the ratios of dissimilarities must not.
    """
    _require_comparable(case)
    declared = case.component.info.scale
    is_equivariant = declared == "equivariant"
    other = "invariant" if is_equivariant else "equivariant"
    remedy = f"multiply lengths by np.sqrt(shape.mesh.area), or declare '{other}'"
    hint = f"breaks info.scale = '{declared}'; {remedy}"
    scaled = []
    for bend in BENDS:
        mesh = figure(bend)
        scaled.append(case.shape(bend, mesh.with_vertices(_SCALE * mesh.vertices)))

    is_form = case.reference.ndim == 2  # positions of vertices; else a vector
    if is_form or not is_equivariant:
        factor = _SCALE if is_equivariant else 1.0
        return _require_same_form(case.reference, case.answer(scaled[0]), hint, factor)

    # Of an equivariant descriptor, dissimilarities are compared, in units of the largest.
    before = case.dissimilarities([case.shape(bend) for bend in BENDS])
    after = case.dissimilarities(scaled)
    if not (before.max() > 0 and after.max() > 0):
        problem = "does not distinguish poses of the figure, so scale cannot be checked"
        raise FailedCheck(f"{problem}; declare scale='invariant'")
    return _require_same_form(before.ravel() / before.max(), after.ravel() / after.max(), hint)


def _dissimilarities(case: Case) -> str:
    """Check that dissimilarities are symmetric, reproducible, and tell shapes apart.

    Unless the scorer draws at random, they must not depend on the order of the shapes either.
    """
    shapes = [case.shape(bend) for bend in BENDS]
    if case.is_scorer:
        shapes += [view(bend) for bend in BENDS]
    draws = getattr(case.component.info, "draws", 1)
    for draw in range(draws):
        distances = case.dissimilarities(shapes, draw)
        largest = check_distances(distances, distances.shape, is_square=True).max()
        if not largest > 0:
            problem = f"does not distinguish any of {len(shapes)} shapes"
            raise FailedCheck(f"{problem}; compare properties that differ")
    again = case.dissimilarities(shapes, draws - 1)  # those of the last draw
    _require_same(distances, again, "dissimilarities differ between calls; seed by 'draw'")
    if draws == 1:
        _require_any_order(case, shapes, distances)
    to_copy = case.dissimilarities([*shapes, shapes[0]])[0, -1]
    if not to_copy <= _SHARE * largest:
        raise FailedCheck("a shape is far from its copy; return distances, not similarities")
    return f"symmetric, zero diagonal, largest {largest:.3g}"


def _require_any_order(case: Case, shapes: Sequence[Shape], distances: FloatArray) -> None:
    """Check that dissimilarities do not depend on the order of the shapes.

    Parameters
    ----------
    case
        The component that compares shapes.
    shapes
        The shapes.
    distances
        Their dissimilarities, in this order.

    Raises
    ------
    FailedCheck
        If they differ in another order.
    """
    # The order is rotated, not reversed: a scorer that returns the differences of positions,
    # |i - j|, would return the same ones in reverse order.
    rotated = case.dissimilarities([*shapes[1:], shapes[0]])
    turned = np.roll(rotated, 1, axis=(0, 1))
    hint = "depends on the order of the shapes; treat all pairs alike"
    _require_same_form(distances.ravel(), turned.ravel(), hint)


def _queries(case: Case) -> str:
    """Check that ``compare_to`` compares each query by itself, and finds its copy.

    A run calls it if the queries are not shapes of the gallery.
    """
    gallery = [case.shape(bend) for bend in BENDS]
    queries = gallery[:-1]  # so that rows and columns differ in number
    together = case.dissimilarities(gallery, queries=queries)
    check_distances(together, together.shape, is_square=False)
    alone = [case.dissimilarities(gallery, queries=[query]) for query in queries]
    hint = "'compare_to' depends on other queries; compare each with the gallery alone"
    _require_same(together, np.concatenate(alone), hint, SYMMETRY_TOLERANCE)
    to_copy = np.diag(together).max()
    if not to_copy <= _SHARE * together.max():
        problem = "'compare_to' finds a query far from its copy in the gallery"
        raise FailedCheck(f"{problem}; return a row for each query, and a column for each shape")
    return "each query is compared by itself"


def _awkward(case: Case) -> str:
    """Check that awkward meshes are treated, or refused with a reason."""
    refusal: type[ShapeError] = ShapeError if case.is_scorer else UnsupportedShape
    meshes = awkward()
    if case.is_scorer:
        meshes["a point"] = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))

    refused = []
    problems = []
    for name, mesh in meshes.items():
        try:
            case.answer(Shape(identifier=name, mesh=mesh, source_area=mesh.area))
        except refusal as reason:
            refused.append(name)
            if not str(reason):
                problems.append(f"{name} is refused without a reason; say why")
        except Exception as error:
            cure = "raise UnsupportedShape with a reason, or treat it"
            problems.append(f"{name}: {explained(error)}; {cure}")
    if problems:
        raise FailedCheck("; ".join(problems))
    return f"refuses, with a reason: {', '.join(refused)}" if refused else "all treated"


# What is checked
# ------------------------------------------------------------------------------------------------

#: Checks without which the others have nothing to compare.
NECESSARY = frozenset({_training, _answer, _repeatable})


def checks_of(component: Component) -> dict[str, Callable[[Case], str]]:
    """Return the checks that a method or scorer has to pass, by name, in their order."""
    checks: dict[str, Callable[[Case], str]] = {}
    is_scorer = component.kind == "scorer"
    if not is_scorer and component.learns:
        checks["training"] = _training
    if _arguments_that_are_no_parameters(component):
        checks["parameters"] = _parameters
    if component.info.cite:
        checks["citation"] = _citation
    checks["answer"] = _answer
    checks["repeatable"] = _repeatable
    if not is_scorer:
        checks["seed"] = _seed
    checks["relabelling"] = _relabelling
    checks["rigid motion"] = _motion
    if is_scorer:
        checks["dissimilarities"] = _dissimilarities
    else:
        checks["scale"] = _scale
    checks["awkward shapes"] = _awkward
    if not is_scorer and component.describes:
        checks["dissimilarities"] = _dissimilarities
    if hasattr(component.load(), "compare_to"):
        checks["queries"] = _queries
    return checks
