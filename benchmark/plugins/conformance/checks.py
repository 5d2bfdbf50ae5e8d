"""The checks of methods and scorers, each a function that returns praise, or raises what is wrong."""

from __future__ import annotations

import dataclasses
import os
import platform
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmark.api.contracts import FloatArray, Mesh, MethodInfo, Shape
from benchmark.api.learning import CARD, Split
from benchmark.api.parameters import declared_parameters
from benchmark.execution.processes.calls import BrokenCall, Guard, call_apart
from benchmark.pipeline.storage import keys
from benchmark.plugins.conformance.cases import (
    REPEAT_TOLERANCE,
    Failed,
    MethodCase,
    ScorerCase,
    Skipped,
    Warned,
    case_of,
    close,
    explain,
    is_mirrored,
    relative_difference,
    same,
)
from benchmark.plugins.conformance.shapes import BENDS
from benchmark.plugins.output_checks import problems_of
from benchmark.plugins.specs import PluginSpec
from benchmark.text import DATA_VARIABLE

Check = Callable[[Any], str]

KERNEL = "OPENBLAS_CORETYPE"

#: Kernel that every x86-64 processor of today can run, and none would choose.
OLD_KERNEL = "Nehalem"

_SCALE = 2.5

_ROTATION = Rotation.from_euler("xyz", [0.4, -1.1, 2.3]).as_matrix()


def _listed(problems: list[str], praise: str) -> str:
    if problems:
        raise Failed("; ".join(problems))
    return praise


# The class ---------------------------------------------------------------------------------------------------------


def check_requirements(case: Any) -> str:
    """Return whether further packages are installed, and the model of a learner that says where it lies is there.

    A learner that does not say so is trained to be checked.
    """
    missing = case.spec.missing_packages()
    if missing:
        raise Skipped(f"unavailable: install {', '.join(missing)}, then check again")
    if isinstance(case, MethodCase) and case.learns and case.model is None:
        folder = getattr(case.spec.create(), "model_folder", None)
        if isinstance(folder, Path) and not (folder / CARD).is_file():
            hint = (
                f"train one (python -m benchmark train {case.spec.base_name}), put it there, then check again; or "
                "have one trained for the check alone: -o epochs=1"
            )
            raise Skipped(f"unavailable: there is no model in {folder.parent.name}/{folder.name}; {hint}")
    return f"{', '.join(case.info.requires)} installed" if case.info.requires else "nothing beyond the core"


def _check_info(case: Any) -> str:
    info = case.info
    problems = [f"{problem}; {hint}" for problem, hint in problems_of(info)]
    if info.name != case.spec.base_name:
        problems.append(
            f"info.name is '{info.name}' but the entry point is '{case.spec.base_name}'; give both one name"
        )
    is_method = isinstance(info, MethodInfo)
    praise = f"{' and '.join(info.inputs)}, scale {info.scale}" if is_method else f"draws: {info.draws}"
    return _listed(problems, f"'{info.title}', {praise}")


def _check_class(case: Any) -> str:
    made: Any = case.spec.load()
    if not dataclasses.is_dataclass(made):
        raise Failed(f"{made.__name__} is no dataclass; decorate it with @dataclass(frozen=True, kw_only=True)")
    problems = []
    if not getattr(made, "__dataclass_params__").frozen:  # noqa: B009
        problems.append("parameters can be changed after creation; write @dataclass(frozen=True, kw_only=True)")
    if not all(field.kw_only for field in dataclasses.fields(made) if field.init):
        problems.append("parameters can be passed by position; write @dataclass(frozen=True, kw_only=True)")
    bare = [
        name for name, (_, default) in declared_parameters(case.spec.load()).items() if default is dataclasses.MISSING
    ]
    if bare:
        problems.append(f"{', '.join(bare)} without default; give every parameter one")
    return _listed(problems, "frozen, keyword-only, every parameter has a default")


def _check_parameters(case: Any) -> str:
    parameters = case.spec.resolved_parameters()
    try:
        keys.plain(parameters)
    except (TypeError, ValueError) as error:
        raise Failed(f"parameters do not fit into JSON ({error}); use numbers, strings and tuples of them") from error
    if case.spec.load()(**parameters) != case.spec.create():
        raise Failed("made again from its parameters it is another method; keep every setting in a field")
    return ", ".join(f"{name}={value!r}" for name, value in parameters.items()) or "none"


def check_learner(case: MethodCase) -> str:
    """Return what a learner says of its models."""
    learner: Any = case.spec.create()
    problems = []
    if not isinstance(learner.model_name, str) or not re.fullmatch(r"[\w.=-]+", learner.model_name):
        problems.append(f"model_name is {learner.model_name!r}; return a text that can name a folder")
    if learner.split not in get_args(Split):
        problems.append(f"split is {learner.split!r}; choose one of {', '.join(get_args(Split))}")
    if not isinstance(getattr(learner, "shipped_models", None), Path):
        problems.append("shipped_models is no path; name a folder, which need not be there")
    return _listed(problems, f"model {learner.model_name}, split {learner.split}")


# One answer, and the same again ------------------------------------------------------------------------------------


def check_answer(case: Any) -> str:
    """Return what is answered on the reference figure."""
    found = case.reference
    if found.ndim == 1:
        return f"{len(found)} numbers, all finite"
    if not np.ptp(found, axis=0).max() > 0:
        raise Failed("all vertices of the form lie in one point; return positions that differ")
    return f"{len(found)} vertices, all finite"


def check_repeatable(case: Any) -> str:
    """Return whether the same is answered again, at once and after another shape."""
    _require_same_again(case.reference, case.answer(case.subject()))
    used = case.create()
    other = case.answer_by(used, case.subject(BENDS[1]))
    again = case.answer_by(used, case.subject())
    same(case.reference, again, "after another shape the answer is a different one; keep nothing between shapes")
    found = case.answer(case.subject(BENDS[1]))
    same(other, found, "a second object answers differently; keep nothing in the class")
    return "the same whatever was treated before"


def _require_same_again(first: FloatArray, again: FloatArray) -> None:
    """Raise :class:`Failed` with the cure if two runs on one shape differ."""
    if first.shape == again.shape and relative_difference(first, again) <= REPEAT_TOLERANCE:
        return
    if first.shape == again.shape and relative_difference(np.abs(first), np.abs(again)) <= REPEAT_TOLERANCE:
        raise Failed(
            "two runs on one shape differ by signs; make the largest entry of each eigenvector positive, and give "
            "eigsh a fixed start (v0=...)"
        )
    size = f"{relative_difference(first, again):.1e} of the largest number" if first.shape == again.shape else "length"
    raise Failed(
        f"two runs on one shape differ by {size}; draw from shape.random(), give iterative solvers such as eigsh a "
        "fixed start (v0=...), fix the signs of eigenvectors, keep nothing between shapes"
    )


def _check_input_untouched(case: MethodCase) -> str:
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
    attributes = (shape.identifier, id(shape.mesh), id(shape.depth), shape.source_area, shape.seed)
    case.answer(shape)
    changed = [name for name, array in arrays.items() if not np.array_equal(array, before[name])]
    if attributes != (shape.identifier, id(shape.mesh), id(shape.depth), shape.source_area, shape.seed):
        changed.append("attributes")
    if changed:
        raise Failed(f"changes the {', '.join(changed)} of the shape; work on a copy")
    return "mesh, geodesics and Laplacian are as before"


def _check_seed(case: MethodCase) -> str:
    if case.info.deterministic:
        found = case.answer(case.subject(name="another name", seed=1))
        hint = "the answer depends on the name or the seed of the shape; use neither, or declare deterministic=False"
        same(case.reference, found, hint)
        return "neither the seed nor the name of a shape matters"
    found = case.answer(case.subject(seed=1))
    if found.shape == case.reference.shape and np.array_equal(found, case.reference):
        raise Failed("declares deterministic=False but ignores the seed; draw from shape.random(), or drop the flag")
    return "the same under one seed, different under another"


# Other processes ---------------------------------------------------------------------------------------------------


def _check_fresh_process(case: Any) -> str:
    found = _elsewhere(case)
    same(case.reference, found, "another process answers differently; do not depend on hashes, globals or the clock")
    if found.tobytes() == case.reference.tobytes():
        return "made again elsewhere, it answers the same to the last bit"
    # This process has done other work before, so only two fresh ones can be expected to agree in every bit.
    again = _elsewhere(case)
    if found.tobytes() == again.tobytes():
        return "every fresh process answers the same to the last bit"
    raise Warned(
        f"two processes differ by {relative_difference(found, again):.1e} of the largest number; choices that follow "
        "may go another way each time: give iterative solvers a fixed start (v0=...), draw from shape.random()"
    )


def _check_other_processor(case: Any) -> str:
    if platform.machine().lower() not in ("x86_64", "amd64"):
        raise Skipped("the kernel of another processor can be chosen on x86-64 only")
    kernel = "" if os.environ.get(KERNEL) == OLD_KERNEL else OLD_KERNEL
    found = _elsewhere(case, kernel=kernel)
    called = f"the BLAS kernel {kernel}" if kernel else "the processor's own BLAS kernel"
    if found.shape != case.reference.shape:
        raise Warned(f"{called} makes {found.shape} of {case.reference.shape}; a choice hangs on the last bits")
    if found.tobytes() == case.reference.tobytes():
        return f"{called} changes no bit"
    difference = relative_difference(case.reference, found)
    if difference <= REPEAT_TOLERANCE:
        return f"{called} changes {difference:.1e} of the largest number, too little to be seen by the scorer"
    raise Warned(
        f"{called} changes {difference:.1e} of the largest number, so scores will differ between machines; where a "
        "choice hangs on the last bits, break ties by geometry and leave thresholds a margin"
    )


def _elsewhere(case: Any, kernel: str | None = None) -> FloatArray:
    """Answer for the figure in a new process, under another BLAS kernel if one is named; "" is the default one."""
    try:
        with _environment(kernel):
            found = call_apart(_answer, case.spec, case.model, guard=Guard("the method", "find the crash"))
    except BrokenCall as error:
        raise Failed(
            "the process ended before it answered; find the crash, or guard your script by if __name__ == '__main__'"
        ) from error
    if "fault" in found:
        raise Failed(found["fault"])
    return np.array(found["numbers"], dtype=np.float64)


def _answer(spec: PluginSpec[Any, Any], model: Path | None) -> dict[str, Any]:
    """The answer as JSON can carry it, which keeps every bit of a number, or what is wrong with it."""
    hide_data()
    try:
        return {"numbers": case_of(spec, model).reference.tolist()}
    except BaseException as error:  # also what ends a program
        return {"fault": explain(error)}


def hide_data() -> None:
    """Let no file of the data folder be found in this process: what a method needs of a shape, the shape offers."""
    folder = os.environ.pop(DATA_VARIABLE, "")
    if not folder:
        return
    hidden = Path(folder).resolve()

    def refuse(event: str, arguments: tuple[Any, ...]) -> None:
        if event in ("open", "os.listdir", "os.scandir") and isinstance(arguments[0], (str, bytes, os.PathLike)):
            path = Path(os.fsdecode(arguments[0])).resolve()
            if path.is_relative_to(hidden):
                raise FileNotFoundError(f"{path}: the data folder is hidden, for a method gets all it may know")

    sys.addaudithook(refuse)


@contextmanager
def _environment(kernel: str | None) -> Iterator[None]:
    """Name a BLAS kernel to the processes that are started inside; libraries that are loaded here do not notice."""
    before = os.environ.get(KERNEL)
    _name_kernel(before if kernel is None else kernel)
    try:
        yield
    finally:
        _name_kernel(before)


def _name_kernel(kernel: str | None) -> None:
    os.environ.pop(KERNEL, None)
    if kernel:
        os.environ[KERNEL] = kernel


# Two answers that must be the same ---------------------------------------------------------------------------------


def _check_relabelling(case: Any) -> str:
    _require_deterministic(case)
    subject = case.subject()
    _, order = _relabelled(subject.mesh if isinstance(subject, Shape) else subject)
    hint = "depends on the numbering of vertices or faces; break ties by geometry"
    return str(case.unchanged_by(lambda mesh: _relabelled(mesh)[0], hint, order))


def _relabelled(mesh: Mesh) -> tuple[Mesh, NDArray[np.int64]]:
    """Return a mesh with its vertices and faces in another order, and that of the vertices."""
    generator = np.random.default_rng(0)
    order = generator.permutation(mesh.n_vertices)
    faces = np.argsort(order).astype(np.int32)[np.roll(mesh.faces, 1, axis=1)]
    return Mesh(mesh.vertices[order], faces[generator.permutation(mesh.n_faces)]), order


def _check_motion(case: Any) -> str:
    _require_deterministic(case)
    _require_mesh(case)
    factor, hint = 1.0, "depends on the position of the shape in space; use distances, or a frame that turns with it"
    if isinstance(case, ScorerCase):
        factor = _SCALE
        hint = "depends on position or size of the form; measure in a frame of its own, or declare invariant=False"
        if not case.info.invariant:
            raise Skipped("declares that it undoes motions only where a pose is well defined")
    moved = lambda mesh: mesh.with_vertices(factor * mesh.vertices @ _ROTATION.T + [0.7, -1.1, 0.4])  # noqa: E731
    return str(case.unchanged_by(moved, hint))


def _check_mirror(case: MethodCase) -> str:
    _require_deterministic(case)
    _require_mesh(case)
    if case.reference.ndim == 1:
        return "a descriptor may tell a shape from its mirror image, or not"
    if case.learns:
        raise Skipped("a learned form may lean to one side")
    mirrored = []
    for bend in BENDS:
        mesh = case.subject(bend).mesh
        image = Mesh(mesh.vertices * [-1.0, 1.0, 1.0], mesh.faces[:, ::-1])
        before, after = case.answer(case.subject(bend)), case.answer(case.subject(bend, mesh=image))
        told = close(
            before, after, 1.0, "makes another form of a mirrored shape than of the shape; break ties by geometry"
        )
        mirrored.append(is_mirrored(before, after))
    if len(set(mirrored)) > 1:
        raise Failed(
            "keeps the mirror image of some shapes and not of others; let the form decide which of the two it is "
            "(baselines._kernels.handedness), or keep the handedness of the shape"
        )
    return f"{'the mirrored form' if mirrored[0] else 'the same form'}, {told}"


def _check_scale(case: MethodCase) -> str:
    _require_deterministic(case)
    _require_mesh(case)
    equivariant = case.info.scale == "equivariant"
    other = "invariant" if equivariant else "equivariant"
    hint = f"does not keep info.scale = '{case.info.scale}'; measure relative to the shape's size, or declare '{other}'"
    scaled = [
        case.subject(bend, mesh=mesh.with_vertices(_SCALE * mesh.vertices), scale=_SCALE)
        for bend, mesh in ((bend, case.subject(bend).mesh) for bend in BENDS)
    ]
    if case.reference.ndim == 2 or not equivariant:
        return close(case.reference, case.answer(scaled[0]), _SCALE if equivariant else 1.0, hint)
    before, after = case.dissimilarities(case.pairs), case.dissimilarities(scaled)
    if not (before.max() > 0 and after.max() > 0):
        raise Failed("tells no two poses of the figure apart, so scale cannot be checked; declare scale='invariant'")
    return close(before.ravel() / before.max(), after.ravel() / after.max(), 1.0, hint)


def _check_dissimilarities(case: Any) -> str:
    pairs, draws = case.pairs, getattr(case.info, "draws", 1)
    for draw in range(draws):
        found = case.dissimilarities(pairs, draw)
        if found.min() < 0:
            raise Failed(f"dissimilarities of {len(pairs)} {case.compared} are negative; return numbers >= 0")
        if not found.max() > 0:
            raise Failed(f"tells no two of {len(pairs)} {case.compared} apart; compare what differs")
        if np.abs(found - found.T).max() > 1e-9 * found.max() or np.abs(np.diag(found)).max() > 1e-6 * found.max():
            raise Failed("dissimilarities are not symmetric with a zero diagonal; make them so")
    again = case.dissimilarities(pairs, draws - 1)
    same(found, again, "dissimilarities differ when they are asked for again; draw from a generator seeded by 'draw'")
    if draws == 1:
        # Turned round by one, for distances of the places in the order, |i - j|, are the same backwards.
        turned = np.roll(case.dissimilarities([*pairs[1:], pairs[0]]), 1, axis=(0, 1))
        same(found, turned, f"depends on the order of the {case.compared}; treat all pairs alike")
    return f"symmetric, zero diagonal, largest {found.max():.3g}"


def _check_awkward(case: Any) -> str:
    refused, problems = [], []
    for name, subject in case.awkward().items():
        try:
            case.answer(subject)
        except case.refusal as reason:
            refused.append(name)
            if not str(reason):
                problems.append(f"{name} is refused without a reason; say why")
        except Exception as error:
            problems.append(f"{name}: {explain(error)}")
    return _listed(problems, f"refuses {', '.join(refused)}, each with a reason" if refused else "all treated")


def _require_deterministic(case: Any) -> None:
    if not getattr(case.info, "deterministic", True):
        raise Skipped("the answer is drawn at random")


def _require_mesh(case: Any) -> None:
    if isinstance(case, MethodCase) and case.reads_images:
        raise Skipped("the depth image has one camera")


OF_THE_CLASS: dict[str, Check] = {"info": _check_info, "class": _check_class, "parameters": _check_parameters}

#: Checks of what is answered, each of which compares two answers: there is nothing to compare where runs differ.
OF_THE_ANSWER: dict[str, Check] = {
    "repeatable": check_repeatable,
    "input untouched": _check_input_untouched,
    "seed": _check_seed,
    "fresh process": _check_fresh_process,
    "other processor": _check_other_processor,
    "relabelling": _check_relabelling,
    "rigid motion": _check_motion,
    "mirror": _check_mirror,
    "scale": _check_scale,
    "dissimilarities": _check_dissimilarities,
    "awkward shapes": _check_awkward,
}

#: Checks that are none of a scorer, which gets no shape but a form.
OF_METHODS_ALONE = frozenset({"input untouched", "seed", "mirror", "scale"})

#: Names of checks where they are of a scorer.
OF_SCORERS = {"answer": "signature", "rigid motion": "motion", "awkward shapes": "awkward forms"}
