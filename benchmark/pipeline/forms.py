"""Forms, descriptors and signatures of single shapes, and the stages that methods share."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Descriptor, Method, Shape
from benchmark.api.scoring import Scorer
from benchmark.errors import InvalidForm
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.cache import Arrays
from benchmark.pipeline.shapes import NOTE, SECONDS, SharedFailure, attempt
from benchmark.registry.outputs import compute_descriptor, compute_form, compute_signature

#: Marks the first result of a method in a process, whose time includes loading and compiling.
FIRST = "first"

#: Says that work begins which is charged to no method, such as ``"geodesics"``, and returns its ``with`` block.
Aside = Callable[[str], AbstractContextManager[object]]


@dataclass
class SharedStages:
    """Results that several methods take from a shape, such as geodesics; each is computed once.

    Parameters
    ----------
    aside
        Told about the work, which is not charged to a method.
    """

    aside: Aside = lambda _: nullcontext()
    seconds: dict[str, float] = field(default_factory=dict)
    #: Seconds of computing in the current step, and the stages that it used.
    spent: float = 0.0
    used: set[str] = field(default_factory=set)
    _arrays: dict[tuple[Any, ...], Arrays] = field(default_factory=dict)

    def get_or_compute(self, stage: str, parameters: Mapping[str, Any], compute: Callable[[], Arrays]) -> Arrays:
        """Return the arrays of a stage; compute them if they are missing.

        Raises
        ------
        SharedFailure
            If there is no memory for them; the method is not to blame.
        """
        self.used.add(stage)
        place = (stage, *sorted(parameters.items()))
        if place not in self._arrays:
            start = time.perf_counter()
            try:
                with self.aside(stage):
                    self._arrays[place] = compute()
            except MemoryError as error:
                raise SharedFailure(f"no memory for its {stage}", "simplify the mesh, or use -j 1") from error
            finally:
                took = time.perf_counter() - start
                self.spent += took
            self.seconds[stage] = self.seconds.get(stage, 0.0) + took
        return self._arrays[place]


def shape_of(arrays: Arrays, identifier: str, seed: int = 0, cache: SharedStages | None = None) -> Shape:
    """Return the shape passed to methods, from its prepared arrays."""
    return Shape(
        identifier=identifier,
        mesh=Mesh(arrays["vertices"], arrays["faces"]),
        depth=arrays.get("depth"),
        source_area=float(arrays["source_area"]),
        seed=seed,
        cache=cache,
    )


def compute_answer(method: Method | Descriptor, shape: Shape, shared: SharedStages, *, first: bool) -> Arrays:
    """Compute the form or the descriptor of a shape; for a refused shape, the reason.

    Coordinates are rounded to single precision, an error of 1e-7 that is negligible for all scorers. The scored form is
    therefore the same whether it was just computed or read from the cache.

    Returns
    -------
    dict
        ``vertices``, shape (n, 3), float32, and ``faces`` if they differ from those of the shape; or ``descriptor``,
        shape (k,); ``note:...`` for each note of the method; ``seconds`` of the method, ``seconds:geodesics`` and so
        on of the stages that it shares with others.

    Raises
    ------
    InvalidForm
        If it returns anything other than a form of the shape, or a vector of finite numbers.
    """
    shared.spent, shared.used = 0.0, set()
    start = time.perf_counter()
    arrays = attempt(lambda: _form(method, shape) if isinstance(method, Method) else _descriptor(method, shape))
    seconds = {SECONDS: time.perf_counter() - start - shared.spent}
    seconds |= {f"{SECONDS}:{stage}": shared.seconds[stage] for stage in shared.used & shared.seconds.keys()}
    timed = {name: np.asarray(value) for name, value in seconds.items()}
    return {**arrays, **timed, **({FIRST: np.asarray(True)} if first else {})}


def _form(method: Method, shape: Shape) -> Arrays:
    mesh, notes = compute_form(method, shape)
    with np.errstate(over="ignore"):
        vertices = mesh.vertices.astype(np.float32)
    if not (np.isfinite(vertices).all() and mesh.n_faces):
        what = "coordinates too large for single precision" if mesh.n_faces else "a form without triangles"
        raise InvalidForm(
            f"method '{method.info.name}' returned {what}", "keep the scale and the triangles of the shape"
        )
    arrays: dict[str, NDArray[Any]] = {"vertices": vertices}
    if mesh.faces.shape != shape.mesh.faces.shape or (mesh.faces != shape.mesh.faces).any():
        arrays["faces"] = mesh.faces
    return {**arrays, **{f"{NOTE}{name}": note for name, note in notes.items()}}


def _descriptor(method: Descriptor, shape: Shape) -> Arrays:
    return {"descriptor": compute_descriptor(method, shape)}


def mesh_of(form: Arrays, prepared: Arrays) -> Mesh:
    """Return the form of a shape, from the arrays of :func:`compute_answer` and of the prepared shape."""
    return Mesh(form["vertices"], form.get("faces", prepared["faces"]))


def sign(scorer: Scorer, form: Mesh) -> Arrays:
    """Compute the signature of a form; for a refused form, the reason."""
    start = time.perf_counter()
    arrays = attempt(lambda: compute_signature(scorer, form))
    return {**arrays, SECONDS: np.asarray(time.perf_counter() - start)}
