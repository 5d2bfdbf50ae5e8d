"""All that the author of a method imports: a shape comes in, a canonical form goes out.

A *method* is a frozen, keyword-only dataclass with a class attribute ``info`` and one method ``canonicalise``; its
fields are its parameters, which may declare what they take (see :mod:`benchmark.api.parameters`). A
*descriptor* has no canonical form: it describes each shape by a vector and compares the vectors itself. A plain
function becomes a method through :func:`canonical_form`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.api.parameters import CheckedParameters, Interval, Matches, OneOf
from benchmark.errors import InvalidMesh, UnsupportedShape
from benchmark.geometry.mesh import Mesh

if TYPE_CHECKING:
    from benchmark.geometry.laplacian import Laplacian

__all__ = [
    "ArtefactCache",
    "CanonicalForm",
    "CheckedParameters",
    "Descriptor",
    "FloatArray",
    "GeodesicSolver",
    "Input",
    "Interval",
    "Matches",
    "Mesh",
    "Method",
    "MethodInfo",
    "OneOf",
    "Shape",
    "UnsupportedShape",
    "canonical_form",
]

Input = Literal["mesh", "view"]
FloatArray = NDArray[np.float64]


def _geodesic_solvers() -> dict[str, str]:
    from benchmark.geometry.geodesics import DEFAULT_SOLVER, SOLVERS

    return {"default": DEFAULT_SOLVER} | {name: name for name in SOLVERS}


GeodesicSolver = Annotated[str, OneOf(_geodesic_solvers)]
"""Type of a parameter that names a solver for :meth:`Shape.geodesics`."""


@dataclass(frozen=True, kw_only=True)
class MethodInfo:
    """Facts about a method, for the harness and the tables.

    Parameters
    ----------
    name
        Name on the command line: lower case, words joined by hyphens.
    title
        Name in the tables.
    cite
        BibTeX key of the source, or "" for a control without one.
    family
        ``"paper"`` for a row of the paper, ``"control"`` for a yardstick, ``"extended"`` for anything else.
    summary
        One line for ``list methods``.
    departs
        How the method departs from its source, in one or two sentences; "" where it does not. ``describe`` prints it,
        and tables number it below the rows of the suite.
    requires
        Import names of packages beyond the core; a missing one makes the method *unavailable*, never another algorithm.
    inputs
        The inputs that the method accepts.
    scale
        ``"equivariant"`` if scaling the shape scales the form, ``"invariant"`` if the form does not change.
    deterministic
        False if the form depends on the seed.
    files
        Paths of the files that a plugin works by, such as a program that it calls, relative to its own; results count
        while these stay as they are. Files that it opens in Python are noted without being named.
    """

    name: str
    title: str
    cite: str = ""
    family: Literal["paper", "control", "extended"] = "extended"
    summary: str = ""
    departs: str = ""
    requires: tuple[str, ...] = ()
    inputs: tuple[Input, ...] = ("mesh", "view")
    scale: Literal["equivariant", "invariant"] = "equivariant"
    deterministic: bool = True
    files: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class CanonicalForm:
    """The surface that a method returns.

    Parameters
    ----------
    vertices
        Positions, shape (n, 3); one per vertex of the input unless ``faces`` says otherwise.
    faces
        Triangles of the form, shape (m, 3); usually those of the input.
    notes
        Facts worth keeping in the record: iterations, stress, edge strain, number of bridges.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    notes: Mapping[str, float | str] = field(default_factory=dict)

    @property
    def mesh(self) -> Mesh:
        """The form as a mesh; raises ``InvalidMesh`` for what is no surface, such as coordinates with NaN."""
        return Mesh(self.vertices, self.faces)


class ArtefactCache(Protocol):
    """Cache of a shape for expensive arrays that several methods use; tests pass nothing."""

    def get_or_compute(
        self, stage: str, parameters: Mapping[str, Any], compute: Callable[[], Mapping[str, NDArray[Any]]]
    ) -> Mapping[str, NDArray[Any]]:
        """Return the arrays of this stage of this shape, computing them when missing."""
        ...


class Shape:
    """One mesh of one subject in one pose, prepared in the same way for every method.

    Parameters
    ----------
    identifier
        Name of the shape inside its data set.
    mesh
        The prepared surface: one component, about 2000 vertices, unit area. With the view input, the open 2.5-D surface
        seen by the camera.
    depth
        Depth image, shape (500, 500), float32 in (0, 1], 0 where nothing was seen; None if no camera is known.
    source_area
        Surface area before decimation and scaling, in squared file units; None if unknown.
    seed
        Seed of every random choice made for this shape.
    cache
        Where geodesics are kept; None computes them once per object.
    """

    def __init__(
        self,
        *,
        identifier: str,
        mesh: Mesh,
        depth: NDArray[np.float32] | None = None,
        source_area: float | None = None,
        seed: int = 0,
        cache: ArtefactCache | None = None,
    ) -> None:
        self.identifier = identifier
        self.mesh = mesh
        self.depth = depth
        self.source_area = source_area
        self.seed = seed
        self._cache = cache
        self._geodesics: dict[str, FloatArray] = {}
        self._laplacian: Laplacian | None = None

    def __repr__(self) -> str:
        return f"Shape({self.identifier!r}, {self.mesh.n_vertices} vertices, {self.mesh.n_faces} faces)"

    def geodesics(self, solver: str = "default") -> FloatArray:
        """Geodesic distances between all pairs of vertices.

        Parameters
        ----------
        solver
            A name from :data:`benchmark.geometry.geodesics.SOLVERS`, or ``"default"``.

        Returns
        -------
        numpy.ndarray
            Shape (n, n), symmetric, zero diagonal, in units of the prepared mesh; read-only.

        Raises
        ------
        UnsupportedShape
            If some pair of vertices is not connected.
        """
        from benchmark.geometry import geodesics

        name = geodesics.resolve_solver(solver)
        if self._cache is not None:
            return self._cache.get_or_compute("geodesics", {"solver": name}, lambda: self._all_pairs(name))["distances"]
        if name not in self._geodesics:
            self._geodesics[name] = self._all_pairs(name)["distances"]
        return self._geodesics[name]

    def _all_pairs(self, solver: str) -> dict[str, FloatArray]:
        from benchmark.geometry import geodesics

        matrix = geodesics.rounded(geodesics.all_pairs(self.mesh, solver))
        matrix.flags.writeable = False
        return {"distances": matrix}

    def geodesics_from(self, sources: ArrayLike, solver: str = "default") -> FloatArray:
        """Geodesic distances from a few vertices to all, without computing all pairs.

        Parameters
        ----------
        sources
            Vertex indices, shape (k,).
        solver
            As in :meth:`geodesics`.

        Returns
        -------
        numpy.ndarray
            Shape (k, n), in units of the prepared mesh.

        Raises
        ------
        UnsupportedShape
            If some vertex cannot be reached.
        """
        from benchmark.geometry import geodesics

        return geodesics.from_sources(self.mesh, np.asarray(sources, dtype=np.int64), geodesics.resolve_solver(solver))

    def laplacian(self) -> Laplacian:
        """Cotangent Laplacian and lumped mass of the mesh; see :mod:`benchmark.geometry.laplacian`."""
        if self._laplacian is None:
            from benchmark.geometry.laplacian import cotangent_laplacian

            self._laplacian = cotangent_laplacian(self.mesh)
        return self._laplacian

    def random(self, purpose: str = "") -> np.random.Generator:
        """Random generator that depends on the seed, the purpose and a few measurements of the mesh, on no name.

        Shapes that differ by a rigid motion, a scale or the numbering of their vertices draw the same numbers.
        """
        import hashlib

        from benchmark.geometry.mesh import measurements

        digest = hashlib.sha256(f"{self.seed}|{measurements(self.mesh)}|{purpose}".encode()).digest()
        return np.random.default_rng(int.from_bytes(digest[:8], "big"))

    def form(self, vertices: ArrayLike, **notes: float | str) -> CanonicalForm:
        """Wrap new positions of this shape's vertices, shape (n, 3), as a canonical form.

        Raises
        ------
        InvalidMesh
            If the positions are not real numbers, finite, and as many as the shape has vertices.
        """
        positions = self.mesh.with_vertices(vertices).vertices
        if len(positions) != self.mesh.n_vertices:
            raise InvalidMesh(
                f"there are {len(positions)} positions for {self.mesh.n_vertices} vertices", "return one for each"
            )
        return CanonicalForm(positions, self.mesh.faces, notes)


@runtime_checkable
class Method(Protocol):
    """Turns a shape into its canonical form."""

    info: ClassVar[MethodInfo]

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the canonical form, or raise ``UnsupportedShape`` with the reason."""
        ...


@runtime_checkable
class Descriptor(Protocol):
    """Compares shapes without a canonical form."""

    info: ClassVar[MethodInfo]

    def describe(self, shape: Shape) -> FloatArray:
        """Return the descriptor of one shape, shape (k,), or raise ``UnsupportedShape`` with the reason."""
        ...

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """Return the dissimilarities of all pairs, shape (N, N), symmetric with zero diagonal."""
        ...


def canonical_form(**info: Any) -> Callable[[Callable[[Shape], Any]], type]:
    """Turn a function from a shape to vertex positions (or a form) into a method.

    Parameters
    ----------
    **info
        Fields of :class:`MethodInfo`.

    Examples
    --------
    >>> @canonical_form(name="flatten", title="Flattened")
    ... def flatten(shape):
    ...     return shape.mesh.vertices * [1, 1, 0]
    >>> flatten.info.name
    'flatten'
    """

    def decorate(function: Callable[[Shape], Any]) -> type:
        def canonicalise(self: object, shape: Shape) -> CanonicalForm:
            result = function(shape)
            return result if isinstance(result, CanonicalForm) else shape.form(result)

        namespace = {
            "info": MethodInfo(**info),
            "canonicalise": canonicalise,
            "__doc__": function.__doc__,
            "__module__": function.__module__,
            "__qualname__": function.__qualname__,
        }
        return dataclass(frozen=True, kw_only=True)(type(function.__name__, (), namespace))

    return decorate
