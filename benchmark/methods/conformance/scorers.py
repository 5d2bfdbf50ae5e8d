"""The checks of a scorer, each a function that returns praise, or raises what is wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmark.api.contracts import FloatArray
from benchmark.api.scoring import SignatureArrays
from benchmark.errors import ShapeError
from benchmark.geometry.mesh import Mesh
from benchmark.methods.conformance.case import REPEAT_TOLERANCE, Failed, Skipped, explain, relative_difference
from benchmark.methods.conformance.shapes import BENDS, awkward, figure, view
from benchmark.methods.scorers import ScorerSpec
from benchmark.system.calls import BrokenCall, Guard, call_apart

__all__ = ["OF_REQUIREMENTS", "OF_SCORERS", "OF_SIGNATURES", "ScorerCase", "ScorerCheck"]

#: Largest dissimilarity of a form and the same form moved, as a share of the smallest one of two different forms.
_SHARE = 0.1


@dataclass
class ScorerCase:
    """A scorer, and the forms that it is tried on."""

    spec: ScorerSpec

    @property
    def forms(self) -> list[Mesh]:
        """The reference figure in its poses, whole and as a camera sees it."""
        return [*map(figure, BENDS), *(view(bend).mesh for bend in BENDS)]

    def signatures(self, forms: Sequence[Mesh]) -> list[SignatureArrays]:
        """Signatures of a new object of the scorer, each looked at."""
        scorer = self.spec.create()
        return [_looked_at(scorer.signature(form)) for form in forms]

    def distances(self, forms: Sequence[Mesh], draw: int = 0) -> FloatArray:
        """Dissimilarities of forms, looked at."""
        found: Any = self.spec.create().compare(self.signatures(forms), draw)
        wanted = (len(forms), len(forms))
        if not isinstance(found, np.ndarray) or found.shape != wanted or found.dtype.kind != "f":
            seen = f"{found.shape} of {found.dtype}" if isinstance(found, np.ndarray) else type(found).__name__
            raise Failed(f"'compare' of {len(forms)} signatures returns {seen}; return (N, N) floats")
        if not np.isfinite(found).all() or found.min() < 0:
            raise Failed("'compare' returns NaN, infinite or negative numbers; return finite ones of at least 0")
        return found.astype(np.float64)


ScorerCheck = Callable[[ScorerCase], str]


def _looked_at(signature: Any) -> SignatureArrays:
    if not isinstance(signature, dict) or not signature:
        raise Failed(f"'signature' returns {type(signature).__name__}; return a dict of named arrays")
    for name, array in signature.items():
        if not isinstance(name, str) or not name.isidentifier():
            raise Failed(f"array {name!r} of the signature has no name that a file can keep; use letters and digits")
        if not isinstance(array, np.ndarray) or array.dtype.kind not in "biuf" or not np.isfinite(array).all():
            raise Failed(f"'{name}' of the signature is no array of finite numbers")
    return signature


def _check_requirements(case: ScorerCase) -> str:
    if missing := case.spec.missing_packages():
        raise Skipped(f"unavailable: install {', '.join(missing)}, then check again")
    return f"{', '.join(case.spec.info.requires)} installed" if case.spec.info.requires else "nothing beyond the core"


def _check_signature(case: ScorerCase) -> str:
    found = case.signatures(case.forms)
    size = sum(array.nbytes for array in found[0].values()) / 1024
    return f"{', '.join(found[0])}: {size:.0f} KiB a form"


def _check_dissimilarities(case: ScorerCase) -> str:
    for draw in range(case.spec.info.draws):
        found = case.distances(case.forms, draw)
        if not found.max() > 0:
            raise Failed("tells no two forms of six apart; compare what differs")
        if np.abs(found - found.T).max() > 1e-9 * found.max() or np.abs(np.diag(found)).max() > 1e-6 * found.max():
            raise Failed("'compare' is not symmetric with a zero diagonal; make it so")
        # Turned round by one, for distances of the places in the order, |i - j|, are the same backwards.
        turned = np.roll(case.distances([*case.forms[1:], case.forms[0]], draw), 1, axis=(0, 1))
        if case.spec.info.draws == 1 and relative_difference(found, turned) > REPEAT_TOLERANCE:
            raise Failed("'compare' depends on the order of the signatures; treat all pairs alike")
    return f"symmetric, zero diagonal, largest {found.max():.3g}"


def _check_repeatable(case: ScorerCase) -> str:
    forms = case.forms
    _require_same(case.signatures(forms), case.signatures(forms[::-1])[::-1], "depends on what was seen before")
    first, again = (case.distances(forms, case.spec.info.draws - 1) for _ in range(2))
    if relative_difference(first, again) > REPEAT_TOLERANCE:
        raise Failed("'compare' answers differently when it is asked again; draw from a generator seeded by 'draw'")
    return "the same whatever was seen before"


def _check_fresh_process(case: ScorerCase) -> str:
    try:
        found = call_apart(_answer, case.spec, guard=Guard("the scorer", "find the crash"))
    except BrokenCall as error:
        raise Failed(str(error)) from error
    if relative_difference(_flat(case.signatures(case.forms[:1])[0]), np.array(found)) > REPEAT_TOLERANCE:
        raise Failed("another process answers differently; do not depend on hashes, globals or the clock")
    return "made again elsewhere, it answers the same"


def _answer(spec: ScorerSpec) -> list[float]:
    case = ScorerCase(spec)
    values: list[float] = _flat(case.signatures(case.forms[:1])[0]).tolist()
    return values


def _check_relabelling(case: ScorerCase) -> str:
    def relabelled(form: Mesh) -> Mesh:
        order = np.random.default_rng(0).permutation(form.n_vertices)
        return Mesh(form.vertices[order], np.argsort(order).astype(np.int32)[form.faces[::-1]])

    return _alike(case, relabelled, "depends on the numbering of vertices or faces")


def _check_motion(case: ScorerCase) -> str:
    if not case.spec.info.invariant:
        raise Skipped("declares that it undoes motions only where a pose is well defined")
    rotation = 2.5 * Rotation.from_euler("xyz", [0.4, -1.1, 2.3]).as_matrix()
    hint = "depends on position or size of the form; measure in a frame of its own, or declare invariant=False"
    return _alike(case, lambda form: form.with_vertices(form.vertices @ rotation.T + [0.7, -1.1, 0.4]), hint)


def _alike(case: ScorerCase, change: Callable[[Mesh], Mesh], hint: str) -> str:
    """Return whether a form is much more like itself after a change that should not matter than like any other one."""
    forms = case.forms[: len(BENDS)]
    found = case.distances([*forms, *map(change, forms)])
    count = len(forms)
    between = found[:count, :count][~np.eye(count, dtype=bool)].min()
    itself = np.diag(found[:count, count:]).max()
    if not itself <= _SHARE * between:
        raise Failed(f"a form differs from itself by {itself:.3g}, from others by {between:.3g}: {hint}")
    return f"{itself / between if between else 0.0:.1e} of the least difference of two forms"


def _check_awkward_forms(case: ScorerCase) -> str:
    refused, problems = [], []
    forms = {**awkward(), "a point": Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))}
    for name, form in forms.items():
        try:
            case.signatures([form])
        except ShapeError as reason:
            refused.append(name)
            if not str(reason):
                problems.append(f"{name} is refused without a reason; say why")
        except Exception as error:
            problems.append(f"{name}: {explain(error)}")
    if problems:
        raise Failed("; ".join(problems))
    return f"refuses {', '.join(refused)}, each with a reason" if refused else "all compared"


def _require_same(first: Sequence[SignatureArrays], second: Sequence[SignatureArrays], hint: str) -> None:
    for one, other in zip(first, second, strict=True):
        if one.keys() != other.keys() or relative_difference(_flat(one), _flat(other)) > REPEAT_TOLERANCE:
            raise Failed(f"'signature' {hint}; keep nothing between forms")


def _flat(signature: SignatureArrays) -> FloatArray:
    return np.concatenate([np.asarray(signature[name], dtype=np.float64).ravel() for name in sorted(signature)])


OF_REQUIREMENTS: dict[str, ScorerCheck] = {"requirements": _check_requirements}

OF_SIGNATURES: dict[str, ScorerCheck] = {"signature": _check_signature}

OF_SCORERS: dict[str, ScorerCheck] = {
    "dissimilarities": _check_dissimilarities,
    "repeatable": _check_repeatable,
    "fresh process": _check_fresh_process,
    "relabelling": _check_relabelling,
    "motion": _check_motion,
    "awkward forms": _check_awkward_forms,
}
