"""Checks of plugins: a table of functions that return a description of success or raise the fault."""

from __future__ import annotations

import dataclasses
import os
import platform
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.spatial.transform import Rotation

from benchmark.api.contracts import FloatArray, Mesh, Method, MethodInfo, Shape
from benchmark.api.learning import CARD, Learner, checked_weights, read_card
from benchmark.api.parameters import declared_parameters
from benchmark.datasets import checking
from benchmark.datasets.base import check_retrievable
from benchmark.errors import BenchmarkError
from benchmark.execution.processes.calls import BrokenCall, call_apart
from benchmark.geometry.depth import common_half_width, depth_surface, fit_half_width
from benchmark.geometry.preparation import prepare
from benchmark.pipeline.storage import keys
from benchmark.plugins.conformance.cases import (
    BENDS,
    REPEAT_TOLERANCE,
    TRAINING,
    Case,
    DatasetCase,
    Failed,
    MethodCase,
    ScorerCase,
    Skipped,
    Warned,
    difference,
    explain,
    is_mirrored,
    same,
    training_data,
)
from benchmark.plugins.output_checks import problems_of, problems_of_learner
from benchmark.plugins.specs import DatasetSpec, MethodSpec, PluginSpec
from benchmark.text import DATA_VARIABLE

KERNEL = "OPENBLAS_CORETYPE"

#: BLAS kernel that every current x86-64 processor can run, but that none selects by default.
OLD_KERNEL = "Nehalem"

_SCALE = 2.5
_ROTATION = Rotation.from_euler("xyz", [0.4, -1.1, 2.3]).as_matrix()
_MOST_ANOMALIES = 3


def _listed(problems: list[str], praise: str) -> str:
    if problems:
        raise Failed("; ".join(problems))
    return praise


# The class -----------------------------------------------------------------------------------------------------------


def _requirements(case: Any) -> str:
    """Check that packages and the model of a learner are available; a learner without a model is trained here."""
    missing = case.spec.missing_packages()
    if missing:
        raise Skipped(f"unavailable: install {', '.join(missing)}, then check again")
    if _learns(case) and case.model is None and not case.options:
        folder = getattr(case.spec.create(), "model_folder", None)
        if isinstance(folder, Path) and not (folder / CARD).is_file():
            missing = f"there is no model in {folder.parent.name}/{folder.name}"
            cure = f"'train {case.spec.base_name}', copy one there, or train one only for the check: -o epochs=1"
            raise Skipped(f"unavailable: {missing}; {cure}")
    return f"{', '.join(case.info.requires)} installed" if case.info.requires else "nothing beyond the core"


def _info(case: Any) -> str:
    info, name = case.info, case.spec.base_name
    problems = [f"{problem}; {hint}" for problem, hint in problems_of(info)]
    if info.name != name:
        problems.append(f"info.name is '{info.name}' but the entry point is '{name}'; use one name for both")
    is_method = isinstance(info, MethodInfo)
    praise = f"{' and '.join(info.inputs)}, scale {info.scale}" if is_method else f"draws: {info.draws}"
    return _listed(problems, f"'{info.title}', {praise}")


def _class(case: Any) -> str:
    cls: type[Any] = case.spec.load()
    cure = "@dataclass(frozen=True, kw_only=True)"
    if not dataclasses.is_dataclass(cls):
        raise Failed(f"{cls.__name__} is not a dataclass; decorate it with {cure}")
    problems = []
    if not getattr(cls, "__dataclass_params__").frozen:  # noqa: B009
        problems.append(f"parameters can be changed after creation; write {cure}")
    if not all(field.kw_only for field in dataclasses.fields(cls) if field.init):
        problems.append(f"parameters can be passed by position; write {cure}")
    for name, (_, default) in declared_parameters(cls).items():
        problems += [f"{name} without default; every parameter needs one"] if default is dataclasses.MISSING else []
    return _listed(problems, "frozen, keyword-only, every parameter has a default")


def _parameters(case: Any) -> str:
    parameters = case.spec.all_parameters
    try:
        keys.plain(parameters)
    except (TypeError, ValueError) as error:
        raise Failed(f"parameters do not fit into JSON ({error}); use numbers, strings and tuples of them") from error
    if case.spec.load()(**parameters) != case.spec.create():
        raise Failed("created again from its parameters, it is another method; store every setting in a field")
    return ", ".join(f"{name}={value!r}" for name, value in parameters.items()) or "none"


def _learner(case: MethodCase) -> str:
    learner: Any = case.spec.create()
    problems = [f"{problem}; {hint}" for problem, hint in problems_of_learner(learner)]
    return _listed(problems, f"model {learner.model_name}, split {learner.split}")


def _training(case: MethodCase) -> str:
    models = Path(tempfile.mkdtemp(dir=case.models))
    trained(case.spec, models, case.options)
    case.model = models / TRAINING / getattr(case.spec.create(), "model_name")  # noqa: B009
    return "trains a model on a few images, keeps a finished one, and loads it"


def trained(spec: MethodSpec, folder: Path, options: Any = ()) -> Method:
    """Train a learner on :func:`~benchmark.plugins.conformance.cases.training_data` and load the model.

    Parameters
    ----------
    spec
        The learner.
    folder
        Folder for its models.
    options
        Changes to its own schedule.

    Raises
    ------
    Failed
        If training leaves no usable model, or a finished training is repeated.
    """
    learner = spec.create()
    if not isinstance(learner, Learner):
        raise Failed("has 'train' but is not a learner; see 'A learner' in docs/reference/plugins.md")
    place, data, cards = folder / TRAINING / learner.model_name, training_data(), []
    for _ in range(2):
        learner.train(data, place, dict(options), lambda _: None)
        if not (place / CARD).is_file():
            raise Failed(f"'train' ends without {CARD}; write it last, to show that the model is finished")
        cards.append(read_card(place))
    card = cards[0]
    if cards[1] != card:
        raise Failed("trains a finished model again; do nothing if its card exists")
    checked_weights(place)
    if card["data"] != data.name or set(card["identifiers"]) != set(data.identifiers):
        raise Failed("the card does not name the training data with all identifiers; copy them from the argument")
    if hasattr(learner, "check_card"):
        learner.check_card(card, place)
    loaded: Method = learner.load(place)
    if type(loaded) is not type(learner):
        raise Failed(f"'load' returns {type(loaded).__name__}; return the method with its model")
    return loaded


# Repeated answers ----------------------------------------------------------------------------------------------------


def _answer(case: Any) -> str:
    answer = case.reference
    if answer.ndim == 1:
        return f"{len(answer)} numbers, all finite"
    if not np.ptp(answer, axis=0).max() > 0:
        raise Failed("all vertices of the form are at one point; return different positions")
    return f"{len(answer)} vertices, all finite"


def _repeatable(case: Any) -> str:
    """Check that an answer is reproducible, immediately and after another shape."""
    first, second = case.reference, case.answer()
    start = "give iterative solvers such as eigsh a fixed start (v0=...)"
    if not (size := difference(first, second)) <= REPEAT_TOLERANCE:
        if difference(np.abs(first), np.abs(second)) <= REPEAT_TOLERANCE:
            cure = f"make the largest entry of each eigenvector positive, and {start}"
            raise Failed(f"two runs on one shape differ by signs; {cure}")
        cure = f"draw from shape.random(), {start}, fix the signs of eigenvectors, keep no state between shapes"
        raise Failed(f"two runs on one shape differ by {size:.1e} of the largest number; {cure}")
    used, other = case.create(), case.subject(BENDS[1])
    before = case.answer(other, used)
    same(first, case.answer(by=used), "the answer differs after another shape; keep no state between shapes")
    same(before, case.answer(other), "a second object answers differently; keep no state in the class")
    return "the same whatever was processed before"


def _input_untouched(case: MethodCase) -> str:
    shape = case.subject()
    laplacian = shape.laplacian()
    arrays = {
        "vertices": shape.mesh.vertices,
        "faces": shape.mesh.faces,
        "depth": shape.depth if shape.depth is not None else np.empty(0),
        "geodesics": shape.geodesics(),
        "Laplacian": laplacian.stiffness.data,
        "vertex areas": laplacian.mass,
    }
    before = {name: array.copy() for name, array in arrays.items()}

    def attributes() -> tuple[object, ...]:
        return shape.identifier, id(shape.mesh), id(shape.depth), shape.source_area, shape.seed

    attributes_before = attributes()
    case.answer(shape)
    changed = [name for name, array in arrays.items() if not np.array_equal(array, before[name])]
    changed += ["attributes"] if attributes() != attributes_before else []
    if changed:
        raise Failed(f"changes the {', '.join(changed)} of the shape; work on a copy")
    return "mesh, geodesics and Laplacian are unchanged"


def _seed(case: MethodCase) -> str:
    if case.info.deterministic:
        answer = case.answer(case.subject(name="another name", seed=1))
        hint = "the answer depends on the name or the seed of the shape; use neither, or declare deterministic=False"
        same(case.reference, answer, hint)
        return "neither the seed nor the name of a shape matters"
    if np.array_equal(case.answer(case.subject(seed=1)), case.reference):
        raise Failed("declares deterministic=False but ignores the seed; draw from shape.random(), or drop the flag")
    return "the same under one seed, different under another"


# Other processes -----------------------------------------------------------------------------------------------------


def _fresh_process(case: Any) -> str:
    answer = _elsewhere(case)
    same(case.reference, answer, "another process answers differently; do not depend on hashes, globals or the clock")
    # This process has done other work before, so only two fresh processes can be expected to agree in every bit.
    second = case.reference if np.array_equal(answer, case.reference) else _elsewhere(case)
    if np.array_equal(answer, second):
        return "every new process gives the same answer, bit by bit"
    cure = "give iterative solvers a fixed start (v0=...), draw from shape.random()"
    raise Warned(f"two processes differ by {difference(answer, second):.1e} of the largest number; {cure}")


def _other_processor(case: Any) -> str:
    if platform.machine().lower() not in ("x86_64", "amd64"):
        raise Skipped("the kernel of another processor can be selected only on x86-64")
    kernel = "" if os.environ.get(KERNEL) == OLD_KERNEL else OLD_KERNEL
    size = difference(case.reference, _elsewhere(case, kernel=kernel))
    changes = f"the BLAS kernel {kernel or 'of the processor'} changes"
    if size > REPEAT_TOLERANCE:
        cure = "break ties by geometry, and give thresholds a margin"
        raise Warned(f"{changes} {size:.1e} of the largest number, so scores will differ between machines; {cure}")
    return f"{changes} {size:.1e} of the largest number, too little to matter" if size else f"{changes} no bit"


def _elsewhere(case: Any, kernel: str | None = None) -> FloatArray:
    """Return the answer for the figure in a new process, with a given BLAS kernel; "" for the default."""
    with patch.dict(os.environ):  # does not affect the libraries loaded here
        if kernel is not None:
            os.environ.pop(KERNEL, None)
            os.environ |= {KERNEL: kernel} if kernel else {}
        try:
            numbers = call_apart(_answer_here, case.spec, case.model, what="the method", hint="find the crash")
        except BrokenCall as error:
            cure = "find the crash, or guard your script by if __name__ == '__main__'"
            raise Failed(f"the process ended without an answer; {cure}") from error
    return np.array(numbers, dtype=np.float64)


def _answer_here(spec: PluginSpec[Any, Any], model: Path | None) -> list[Any]:
    """Return the answer for JSON, which preserves every bit of a number; raise ``BenchmarkError`` with the fault."""
    hide_data()
    try:
        case: Any = case_of(spec, model)
        return list(case.reference.tolist())
    except BaseException as error:  # including SystemExit
        raise BenchmarkError(explain(error)) from error


def hide_data() -> None:
    """Hide the data folder from this process, because methods may use only the shape."""
    folder = os.environ.pop(DATA_VARIABLE, "")
    if not folder:
        return
    hidden = Path(folder).resolve()

    def refuse(event: str, arguments: tuple[Any, ...]) -> None:
        if event in ("open", "os.listdir", "os.scandir") and isinstance(arguments[0], (str, bytes, os.PathLike)):
            path = Path(os.fsdecode(arguments[0])).resolve()
            if path.is_relative_to(hidden):
                raise FileNotFoundError(f"{path}: the data folder is hidden, since methods get all they may use")

    sys.addaudithook(refuse)


# Invariance and distances --------------------------------------------------------------------------------------------


def _relabelling(case: Any) -> str:
    subject, generator = case.subject(), np.random.default_rng(0)
    mesh = subject.mesh if isinstance(subject, Shape) else subject
    order, of_faces = generator.permutation(mesh.n_vertices), generator.permutation(mesh.n_faces)

    def relabelled(mesh: Mesh) -> Mesh:
        faces = np.argsort(order).astype(np.int32)[np.roll(mesh.faces, 1, axis=1)]
        return Mesh(mesh.vertices[order], faces[of_faces])

    hint = "depends on the numbering of vertices or faces; break ties by geometry"
    return str(case.unchanged_by(relabelled, hint, order))


def _motion(case: Any) -> str:
    factor, hint = 1.0, "depends on the position of the shape in space; use distances, or a frame that rotates with it"
    if isinstance(case, ScorerCase):
        factor = _SCALE
        hint = "depends on position or size of the form; use a frame fixed to the form, or declare invariant=False"
        if not case.info.invariant:
            raise Skipped("declares that it undoes motions only if a pose is well defined")
    moved = lambda mesh: mesh.with_vertices(factor * mesh.vertices @ _ROTATION.T + [0.7, -1.1, 0.4])  # noqa: E731
    return str(case.unchanged_by(moved, hint))


def _mirror(case: MethodCase) -> str:
    if case.reference.ndim == 1:
        return "a descriptor may or may not distinguish mirror images"
    if case.spec.learns:
        raise Skipped("a learned form may lean to one side")
    mirrored, hint = set(), "gives a mirrored shape another form; break ties by geometry"
    for bend in BENDS:
        shape = case.subject(bend)
        image = Mesh(shape.mesh.vertices * [-1.0, 1.0, 1.0], shape.mesh.faces[:, ::-1])
        before, after = case.answer(shape), case.answer(case.subject(bend, mesh=image))
        deviation = same(before, after, hint, factor=1.0)
        mirrored.add(is_mirrored(before, after))
    if len(mirrored) > 1:
        cure = "let the form determine its handedness (baselines._kernels.orientation), or keep that of the shape"
        raise Failed(f"mirrors some shapes and not others; {cure}")
    return f"{'the mirrored form' if True in mirrored else 'the same form'}, {deviation}"


def _scale(case: MethodCase) -> str:
    is_equivariant = case.info.scale == "equivariant"
    other = "invariant" if is_equivariant else "equivariant"
    hint = f"breaks info.scale = '{case.info.scale}'; measure relative to the shape's size, or declare '{other}'"
    meshes = {bend: case.subject(bend).mesh for bend in BENDS}
    large = {bend: mesh.with_vertices(_SCALE * mesh.vertices) for bend, mesh in meshes.items()}
    scaled = [case.subject(bend, mesh=mesh, scale=_SCALE) for bend, mesh in large.items()]
    if case.reference.ndim == 2 or not is_equivariant:
        return same(case.reference, case.answer(scaled[0]), hint, factor=_SCALE if is_equivariant else 1.0)
    before, after = case.dissimilarities(case.pairs), case.dissimilarities(scaled)
    if not (before.max() > 0 and after.max() > 0):
        raise Failed("does not distinguish poses of the figure, so scale cannot be checked; declare scale='invariant'")
    return same(before.ravel() / before.max(), after.ravel() / after.max(), hint, factor=1.0)


def _dissimilarities(case: Any) -> str:
    pairs, draws = case.pairs, getattr(case.info, "draws", 1)
    for draw in range(draws):
        distances = case.dissimilarities(pairs, draw)
        largest = distances.max()
        if distances.min() < 0:
            raise Failed(f"dissimilarities of {len(pairs)} {case.compared} are negative; return numbers >= 0")
        if not largest > 0:
            raise Failed(f"does not distinguish any of {len(pairs)} {case.compared}; compare properties that differ")
        if np.abs(distances - distances.T).max() > 1e-9 * largest or np.abs(np.diag(distances)).max() > 1e-6 * largest:
            raise Failed("dissimilarities are not symmetric with a zero diagonal; make them so")
    repeated, hint = case.dissimilarities(pairs, draws - 1), "dissimilarities differ between calls; seed by 'draw'"
    same(distances, repeated, hint)
    if draws == 1:
        # Rotated by one, because distances between positions, |i - j|, are the same in reverse order.
        turned = np.roll(case.dissimilarities([*pairs[1:], pairs[0]]), 1, axis=(0, 1))
        same(distances, turned, f"depends on the order of the {case.compared}; treat all pairs alike")
    return f"symmetric, zero diagonal, largest {largest:.3g}"


def _awkward(case: Any) -> str:
    refused, problems = [], []
    for name, subject in case.awkward().items():
        try:
            case.answer(subject)
        except case.refusal as reason:
            refused.append(name)
            problems += [] if str(reason) else [f"{name} is refused without a reason; say why"]
        except Exception as error:
            problems.append(f"{name}: {explain(error)}")
    return _listed(problems, f"refuses {', '.join(refused)}, each with a reason" if refused else "all treated")


# Data sets -----------------------------------------------------------------------------------------------------------


def _entries(case: DatasetCase) -> str:
    entries = case.dataset.entries
    check_retrievable(case.dataset)
    if DatasetCase(case.spec).dataset.entries != entries:
        raise Failed("'entries' lists other shapes the second time; always list the same ones in the same order")
    return f"{len(entries)} shapes, {len({entry.subject for entry in entries})} classes, always the same"


def _meshes(case: DatasetCase) -> str:
    report = checking.check(case.dataset)
    anomalies = [str(anomaly) for anomaly in report.anomalies]
    further = f" and {len(anomalies) - _MOST_ANOMALIES} more" if len(anomalies) > _MOST_ANOMALIES else ""
    if anomalies:
        raise (Warned if report.usable else Failed)(" | ".join(anomalies[:_MOST_ANOMALIES]) + further)
    return "every mesh can be generated and is valid"


def _same_meshes(case: DatasetCase) -> str:
    repeated = DatasetCase(case.spec).digests(backwards=True)
    for name, digest in case.digests().items():
        if repeated[name] != digest:
            raise Failed(f"the mesh of '{name}' changes between calls; keep no state between shapes")
    return "the same whatever was loaded before"


def _same_elsewhere(case: DatasetCase) -> str:
    try:
        elsewhere = call_apart(_description, case.spec.target, what="the data set", hint="find the crash")
    except BrokenCall as error:
        raise Failed(str(error)) from error
    if elsewhere != _description(case.spec.target):
        raise Failed("another process gets other shapes; do not depend on hashes, globals, the clock or the folder")
    return "another process gets the same shapes, recipes, cameras and meshes"


def _description(target: str) -> list[list[str]]:
    return DatasetCase(DatasetSpec(target.rpartition(":")[2], target)).description()


def _inputs(case: DatasetCase) -> str:
    dataset, problems = case.dataset, []
    loaded = [(entry, dataset.load(entry)) for entry in case.first_of_each]
    widths = [fit_half_width([mesh], dataset.camera(entry)) for entry, mesh in loaded]
    half_width = dataset.half_width or common_half_width(widths)
    for entry, mesh in loaded:
        try:
            prepare(mesh)
            depth_surface(mesh, dataset.camera(entry), half_width)
        except BenchmarkError as error:
            problems.append(f"{entry.identifier}: {error}")
    return _listed(problems, "a shape of each class can be prepared, and is seen by its camera")


# The table -----------------------------------------------------------------------------------------------------------


def _is_method(case: Case) -> bool:
    return isinstance(case, MethodCase)


def _learns(case: Case) -> bool:
    return isinstance(case, MethodCase) and case.spec.learns


def _is_trained_here(case: Any) -> bool:
    return _learns(case) and bool(case.options or not hasattr(case.spec.load(), "model_folder"))


def _drawn(case: Any) -> str:
    return "" if getattr(case.info, "deterministic", True) else "the answer is random"


def _seen(case: Any) -> str:
    return "the depth image has one camera" if isinstance(case, MethodCase) and case.reads_images else ""


@dataclass(frozen=True)
class Check:
    """One check.

    Parameters
    ----------
    run
        Function that returns a description of success, or raises the fault.
    applies
        Whether it applies to a plugin; if not, it is not listed.
    unless
        Functions that return the reason for skipping the check; "" if there is none.
    gate
        Reason for skipping the remaining checks unless the outcome is ``"ok"``; "" to omit them, None to run them.
    """

    run: Callable[[Any], str]
    applies: Callable[[Any], bool] = lambda case: True
    unless: tuple[Callable[[Any], str], ...] = ()
    gate: str | None = None


OF_METHODS_AND_SCORERS = {
    "requirements": Check(_requirements, gate=""),
    "info": Check(_info),
    "class": Check(_class),
    "parameters": Check(_parameters),
    "learner": Check(_learner, _learns),
    "training": Check(_training, _is_trained_here, gate="there is no model"),
    "answer": Check(_answer, gate="there is no answer to compare"),
    "repeatable": Check(_repeatable, gate="two runs differ, so nothing can be compared"),
    "input untouched": Check(_input_untouched, _is_method),
    "seed": Check(_seed, _is_method),
    "fresh process": Check(_fresh_process),
    "other processor": Check(_other_processor),
    "relabelling": Check(_relabelling, unless=(_drawn,)),
    "rigid motion": Check(_motion, unless=(_drawn, _seen)),
    "mirror": Check(_mirror, _is_method, unless=(_drawn, _seen)),
    "scale": Check(_scale, _is_method, unless=(_drawn, _seen)),
    "dissimilarities": Check(_dissimilarities),
    "awkward shapes": Check(_awkward),
}

#: Names of checks that differ for scorers.
NAMES_OF_SCORERS = {"answer": "signature", "rigid motion": "motion", "awkward shapes": "awkward forms"}

OF_DATA_SETS = {
    "entries": Check(_entries),
    "meshes": Check(_meshes),
    "repeatable": Check(_same_meshes),
    "fresh process": Check(_same_elsewhere),
    "inputs": Check(_inputs),
}


def case_of(spec: PluginSpec[Any, Any], model: Path | None = None, models: Path = Path(), options: Any = ()) -> Case:
    """Return the case of a plugin, with the model of a learner, or the folder and options to train one."""
    if isinstance(spec, DatasetSpec):
        return DatasetCase(spec)
    return (MethodCase if isinstance(spec, MethodSpec) else ScorerCase)(spec, model, models, dict(options))
