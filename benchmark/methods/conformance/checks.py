"""The checks, each a function that returns praise, or raises what is wrong."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from benchmark.api.contracts import Descriptor, FloatArray, Mesh, Method, Shape
from benchmark.api.learning import CARD, Split
from benchmark.errors import UnsupportedShape
from benchmark.methods.conformance.case import (
    ConformanceCase,
    Failed,
    Skipped,
    answer,
    close,
    explain,
    is_mirrored,
    same,
)
from benchmark.methods.conformance.processes import check_fresh_process, check_other_processor
from benchmark.methods.conformance.shapes import BENDS, awkward
from benchmark.methods.information import problems_of
from benchmark.methods.output_checks import distances_of
from benchmark.storage import keys

Check = Callable[[ConformanceCase], str]

_SCALE = 2.5


def _listed(problems: list[str], praise: str) -> str:
    if problems:
        raise Failed("; ".join(problems))
    return praise


# The class ---------------------------------------------------------------------------------------------------------


def check_requirements(case: ConformanceCase) -> str:
    """Return whether further packages are installed, and the model of a learner that says where it lies is there.

    A learner that does not say so is trained to be checked.
    """
    missing = case.spec.missing_packages()
    if missing:
        raise Skipped(f"unavailable: install {', '.join(missing)}, then check again")
    if case.spec.learns and case.model is None:
        folder = getattr(case.spec.create(), "model_folder", None)
        if isinstance(folder, Path) and not (folder / CARD).is_file():
            hint = (
                f"train one (python -m benchmark train {case.spec.base_name}), put it there, then check again; or "
                "have one trained for the check alone: -o epochs=1"
            )
            raise Skipped(f"unavailable: there is no model in {folder.parent.name}/{folder.name}; {hint}")
    return f"{', '.join(case.info.requires)} installed" if case.info.requires else "nothing beyond the core"


def _check_info(case: ConformanceCase) -> str:
    info = case.info
    problems = [f"{problem}; {hint}" for problem, hint in problems_of(info)]
    if info.name != case.spec.base_name:
        problems.append(
            f"info.name is '{info.name}' but the entry point is '{case.spec.base_name}'; give both one name"
        )
    return _listed(problems, f"'{info.title}', {' and '.join(info.inputs)}, scale {info.scale}")


def check_class(case: ConformanceCase) -> str:
    """Return whether the class is a frozen, keyword-only dataclass whose fields all have defaults."""
    made: Any = case.spec.load()
    if not dataclasses.is_dataclass(made):
        raise Failed(f"{made.__name__} is no dataclass; decorate it with @dataclass(frozen=True, kw_only=True)")
    fields = [field for field in dataclasses.fields(made) if field.init]
    problems = []
    if not getattr(made, "__dataclass_params__").frozen:  # noqa: B009
        problems.append("parameters can be changed after creation; write @dataclass(frozen=True, kw_only=True)")
    if not all(field.kw_only for field in fields):
        problems.append("parameters can be passed by position; write @dataclass(frozen=True, kw_only=True)")
    bare = [
        field.name
        for field in fields
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    ]
    if bare:
        problems.append(f"{', '.join(bare)} without default; give every parameter one")
    return _listed(problems, "frozen, keyword-only, every parameter has a default")


def check_parameters(case: ConformanceCase) -> str:
    """Return whether parameters fit into JSON, and make the same object again."""
    parameters = case.spec.resolved_parameters()
    try:
        keys.plain(parameters)
    except (TypeError, ValueError) as error:
        raise Failed(f"parameters do not fit into JSON ({error}); use numbers, strings and tuples of them") from error
    if case.spec.load()(**parameters) != case.spec.create():
        raise Failed("made again from its parameters it is another method; keep every setting in a field")
    return ", ".join(f"{name}={value!r}" for name, value in parameters.items()) or "none"


# One answer --------------------------------------------------------------------------------------------------------


def check_answer(case: ConformanceCase) -> str:
    """Return what the method says of the reference figure."""
    found = case.reference
    if found.ndim == 1:
        return f"{len(found)} numbers, all finite"
    if not np.ptp(found, axis=0).max() > 0:
        raise Failed("all vertices of the form lie in one point; return positions that differ")
    return f"{len(found)} vertices, all finite"


def _check_input_untouched(case: ConformanceCase) -> str:
    shape = case.shape()
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


def _check_awkward_shapes(case: ConformanceCase) -> str:
    refused, problems = [], []
    for name, mesh in awkward().items():
        shape = Shape(identifier=name, mesh=mesh, source_area=mesh.area)
        try:
            case.answer(shape)
        except UnsupportedShape as reason:
            refused.append(name)
            if not str(reason):
                problems.append(f"{name} is refused without a reason; say why")
        except Exception as error:
            problems.append(f"{name}: {explain(error)}")
    return _listed(problems, f"refuses {', '.join(refused)}, each with a reason" if refused else "all treated")


# Two answers that must be the same ---------------------------------------------------------------------------------


def _check_repeatable(case: ConformanceCase) -> str:
    used, fresh = case.create(), case.create()
    other = answer(used, case.shape(BENDS[1]))
    again = answer(used, case.shape())
    same(case.reference, again, "after another shape the answer is a different one; keep nothing between shapes")
    same(other, answer(fresh, case.shape(BENDS[1])), "a second object answers differently; keep nothing in the class")
    return "the same whatever was treated before"


def _check_seed(case: ConformanceCase) -> str:
    if case.info.deterministic:
        found = case.answer(case.shape(name="another name", seed=1))
        hint = "the answer depends on the name or the seed of the shape; use neither, or declare deterministic=False"
        same(case.reference, found, hint)
        return "neither the seed nor the name of a shape matters"
    found = case.answer(case.shape(seed=1))
    if found.shape == case.reference.shape and np.array_equal(found, case.reference):
        raise Failed("declares deterministic=False but ignores the seed; draw from shape.random(), or drop the flag")
    return "the same under one seed, different under another"


def _check_relabelling(case: ConformanceCase) -> str:
    _require_deterministic(case)
    mesh = case.shape().mesh
    generator = np.random.default_rng(0)
    order = generator.permutation(mesh.n_vertices)
    rank = np.argsort(order).astype(np.int32)
    faces = rank[np.roll(mesh.faces, 1, axis=1)][generator.permutation(mesh.n_faces)]
    found = case.answer(case.shape(mesh=Mesh(mesh.vertices[order], faces)))
    if found.ndim == 2:
        if len(case.reference) != mesh.n_vertices:
            raise Skipped("the form has vertices of its own")
        restored = np.empty_like(found)
        restored[order] = found
        found = restored
    return close(case.reference, found, 1.0, "depends on the numbering of vertices or faces; break ties by geometry")


def _check_rigid_motion(case: ConformanceCase) -> str:
    _require_deterministic(case)
    _require_mesh(case)
    mesh = case.shape().mesh
    rotation = Rotation.from_euler("xyz", [0.4, -1.1, 2.3]).as_matrix()
    moved = mesh.with_vertices(mesh.vertices @ rotation.T + [0.7, -1.1, 0.4])
    return close(
        case.reference,
        case.answer(case.shape(mesh=moved)),
        1.0,
        "depends on the position of the shape in space; use distances, or a frame that turns with the shape",
    )


def _check_mirror(case: ConformanceCase) -> str:
    _require_deterministic(case)
    _require_mesh(case)
    if case.reference.ndim == 1:
        return "a descriptor may tell a shape from its mirror image, or not"
    if case.spec.learns:
        raise Skipped("a learned form may lean to one side")
    mirrored = []
    for bend in BENDS:
        mesh = case.shape(bend).mesh
        image = Mesh(mesh.vertices * [-1.0, 1.0, 1.0], mesh.faces[:, ::-1])
        before, after = case.answer(case.shape(bend)), case.answer(case.shape(bend, mesh=image))
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


def _check_scale(case: ConformanceCase) -> str:
    _require_deterministic(case)
    _require_mesh(case)
    equivariant = case.info.scale == "equivariant"
    other = "invariant" if equivariant else "equivariant"
    hint = f"does not keep info.scale = '{case.info.scale}'; measure relative to the shape's size, or declare '{other}'"
    if case.reference.ndim == 2 or not equivariant:
        found = case.answer(_scaled(case, BENDS[0]))
        return close(case.reference, found, _SCALE if equivariant else 1.0, hint)
    before, after = _dissimilarities(case, case.shape), _dissimilarities(case, lambda bend: _scaled(case, bend))
    if not (before.max() > 0 and after.max() > 0):
        raise Failed("tells no two poses of the figure apart, so scale cannot be checked; declare scale='invariant'")
    return close(before.ravel() / before.max(), after.ravel() / after.max(), 1.0, hint)


def _check_dissimilarities(case: ConformanceCase) -> str:
    if isinstance(case.spec.create(), Method):
        raise Skipped("forms are compared by the scorer")
    found = _dissimilarities(case, case.shape)
    if found.min() < 0:
        raise Failed(f"'distances' of {len(BENDS)} descriptors came as {found.tolist()}; return numbers >= 0")
    if not np.allclose(found, found.T, atol=1e-12 * found.max()) or np.abs(np.diag(found)).max() > 1e-6 * found.max():
        raise Failed("'distances' is not symmetric with a zero diagonal; make it so")
    # Turned round by one, for distances of the places in the order, |i - j|, are the same backwards.
    turned = np.roll(_dissimilarities(case, case.shape, (*BENDS[1:], BENDS[0])), 1, axis=(0, 1))
    same(found, turned, "'distances' depends on the order of the descriptors; treat all pairs alike")
    return f"symmetric, zero diagonal, largest {found.max():.3g}"


def _dissimilarities(
    case: ConformanceCase, shape: Callable[[float], Shape], bends: tuple[float, ...] = BENDS
) -> FloatArray:
    method = case.create()
    if not isinstance(method, Descriptor):
        raise Skipped("forms are compared by the scorer")
    return distances_of(method, [answer(method, shape(bend)) for bend in bends])


def _scaled(case: ConformanceCase, bend: float) -> Shape:
    mesh = case.shape(bend).mesh
    return case.shape(bend, mesh=mesh.with_vertices(_SCALE * mesh.vertices), scale=_SCALE)


def _require_deterministic(case: ConformanceCase) -> None:
    if not case.info.deterministic:
        raise Skipped("the answer is drawn at random")


def _require_mesh(case: ConformanceCase) -> None:
    if case.reads_images:
        raise Skipped("the depth image has one camera")


def check_learner(case: ConformanceCase) -> str:
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


OF_THE_CLASS: dict[str, Check] = {
    "info": _check_info,
    "class": check_class,
    "parameters": check_parameters,
}

OF_THE_ANSWER: dict[str, Check] = {
    "input untouched": _check_input_untouched,
    "repeatable": _check_repeatable,
    "seed": _check_seed,
    "fresh process": check_fresh_process,
    "other processor": check_other_processor,
    "relabelling": _check_relabelling,
    "rigid motion": _check_rigid_motion,
    "mirror": _check_mirror,
    "scale": _check_scale,
    "dissimilarities": _check_dissimilarities,
    "awkward shapes": _check_awkward_shapes,
}
