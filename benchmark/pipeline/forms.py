"""Forms and descriptors of prepared shapes, as arrays.

The code of this module and of all that it imports is in the key of each form; it imports no check
of outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import (
    AllPairs,
    CanonicalForm,
    FloatArray,
    Mesh,
    Shape,
    identify_result,
)
from benchmark.geometry.mesh import read_only
from benchmark.machine import describe_machine
from benchmark.pipeline.stages import (
    GEODESICS,
    MACHINE,
    NOTE,
    SECONDS,
    Arrays,
    Incomplete,
    clock,
    timed,
)

#: Returns the context of work whose time is not charged to a method, such as ``"geodesics"``.
Uncharged = Callable[[str], AbstractContextManager[object]]


class NoGeodesics(Incomplete):
    """There is no memory for the geodesics of a shape, which no method is to blame for."""


class SharedResults:
    """What methods share of a shape, each computed once: geodesics, and forms that others deform.

    Parameters
    ----------
    uncharged
        Context of work that is not charged to a method: geodesics. A form is charged to each method
        that uses it.
    """

    def __init__(self, uncharged: Uncharged = lambda _: nullcontext()) -> None:
        self._uncharged = uncharged
        self._results: dict[Hashable, tuple[Any, FloatArray]] = {}
        #: Who asks now: the component with its parameters and its model.
        self.owner: Hashable = None
        #: Seconds of the geodesics that the current method used, by clock.
        self.seconds_of_geodesics = np.zeros(2)
        #: Seconds that passed while the method computed and are not its own, by clock. They are
        #: negative for a form that was known, which is charged to each method that uses it.
        self.seconds_of_others = np.zeros(2)

    def get_or_compute(self, key: Hashable, compute: Callable[[], Any]) -> Any:
        """Return a result that several methods need of a shape; compute it if it is missing.

        The time of geodesic distances is charged to no method. That of a form from which other
        methods begin is charged to each of them, whoever computed it. Both are added to the
        accounts of this object, whose seconds are pairs: by the clock on the wall, and of the
        processor.

        Parameters
        ----------
        key
            Identifies the result.
        compute
            Computes it.

        Returns
        -------
        object
            The result, whose arrays cannot be changed.

        Raises
        ------
        NoGeodesics
            If there is no memory for distances.
        """
        start = clock()
        is_geodesics = isinstance(key, AllPairs)
        identity = identify_result(key, self.owner)
        is_known = identity in self._results
        if not is_known:
            result = self._compute_geodesics(compute) if is_geodesics else compute()
            self._results[identity] = _read_only(result), clock() - start
        result, seconds = self._results[identity]
        if is_geodesics:
            self.seconds_of_geodesics = seconds
            if not is_known:  # they were just computed within the time of the method: subtract them
                self.seconds_of_others = self.seconds_of_others + seconds
        elif is_known:  # the form was computed earlier: the method owes its time
            self.seconds_of_others = self.seconds_of_others - seconds
        if isinstance(result, CanonicalForm):
            return replace(result, notes=dict(result.notes))
        return result

    def _compute_geodesics(self, compute: Callable[[], Any]) -> Any:
        """Return distances; raise ``NoGeodesics`` if there is no memory for them."""
        try:
            with self._uncharged("geodesics"):
                return compute()
        except MemoryError as error:
            raise NoGeodesics("has no geodesics: out of memory") from error


def _read_only(result: Any) -> Any:
    """Return a shared result whose arrays no method that gets it can change."""
    if isinstance(result, np.ndarray) and not result.dtype.hasobject:
        return read_only(result)
    if isinstance(result, tuple) and type(result) is tuple:
        return tuple(_read_only(part) for part in result)
    if isinstance(result, CanonicalForm):
        vertices, faces = _read_only((result.vertices, result.faces))
        return replace(result, vertices=vertices, faces=faces)
    return result


def shape_of(
    arrays: Arrays, identifier: str, seed: int = 0, shared: SharedResults | None = None
) -> Shape:
    """Return the shape passed to methods, from its prepared arrays."""
    cache = shared.get_or_compute if shared else None
    return Shape(
        identifier=identifier,
        mesh=Mesh(arrays["vertices"], arrays["faces"]),
        depth=arrays.get("depth"),
        source_area=float(arrays["source_area"]),
        seed=seed,
        cache=cache,
    )


def output_arrays(
    compute: Callable[[], CanonicalForm | FloatArray], shape: Shape, shared: SharedResults
) -> Arrays:
    """Compute the form or the descriptor of a shape, as arrays for the cache.

    Coordinates are rounded to single precision here, so that a form is scored alike whether it was
    just computed or read from the cache. The error of 1e-7 is negligible.

    Parameters
    ----------
    compute
        Computes the form or descriptor.
    shape
        The shape.
    shared
        Results that methods share, such as geodesics. Its accounts of their time are set to 0
        before the computation, and read after it.

    Returns
    -------
    dict
        Of a form, ``vertices``, shape (n, 3), float32, ``faces`` if they differ from those of the
        shape, and ``note:...`` for each note of the method. Of a descriptor, ``descriptor``, shape
        (k,). Of a refused shape, reason and hint, as :func:`~benchmark.pipeline.stages.timed`
        returns them. In any case the seconds of the method and those of geodesics that it used,
        both by the clock on the wall and of the processor, and a description of the machine.
    """

    def arrays_of() -> Arrays:
        """Compute the output, and return it as arrays."""
        output = compute()
        if not isinstance(output, CanonicalForm):
            return {"descriptor": np.asarray(output, dtype=np.float64)}
        form: dict[str, NDArray[Any]] = {"vertices": output.mesh.vertices.astype(np.float32)}
        if not np.array_equal(output.mesh.faces, shape.mesh.faces):
            form["faces"] = output.mesh.faces
        for name, value in output.notes.items():
            form[f"{NOTE}{name}"] = np.asarray(value)
        return form

    shared.seconds_of_geodesics = np.zeros(2)
    shared.seconds_of_others = np.zeros(2)
    arrays = {**timed(arrays_of)}
    if shared.seconds_of_geodesics.any():
        arrays[SECONDS + GEODESICS] = shared.seconds_of_geodesics
    # Subtract the geodesics that were computed meanwhile; add the forms of other methods that were
    # known before (their seconds count as negative).
    arrays[SECONDS] = arrays[SECONDS] - shared.seconds_of_others
    arrays[MACHINE] = np.asarray(describe_machine())
    return arrays


def mesh_of(form: Arrays, prepared: Arrays) -> Mesh:
    """Return the form of a shape.

    Parameters
    ----------
    form
        Arrays of :func:`output_arrays`. They lack faces that are those of the shape.
    prepared
        Arrays of the prepared shape.
    """
    arrays = form if "faces" in form else prepared
    return Mesh(form["vertices"], arrays["faces"])
