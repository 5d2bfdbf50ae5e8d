"""Interface for authors of methods, which compute the canonical form of a shape.

A *method* is a frozen, keyword-only dataclass with a class attribute ``info`` and a method
``canonicalise``. Its fields are its parameters, which may declare the values that they accept (see
:mod:`benchmark.api.parameters`). A *descriptor* has no canonical form: it describes each shape by a
vector and compares the vectors itself. The decorator :func:`canonical_form` turns a plain function
into a method.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.api.parameters import (
    CheckedParameters,
    Interval,
    Matches,
    Name,
    Title,
    parameter_values,
)
from benchmark.errors import InvalidMesh, UnsupportedShape
from benchmark.geometry.mesh import FloatArray, Mesh, read_only

if TYPE_CHECKING:
    from benchmark.geometry.laplacian import Laplacian

__all__ = [
    "CanonicalForm",
    "CheckedParameters",
    "Descriptor",
    "FloatArray",
    "Input",
    "Interval",
    "InvalidMesh",
    "Matches",
    "Mesh",
    "Method",
    "MethodInfo",
    "Shape",
    "UnsupportedShape",
    "canonical_form",
]

#: What a method gets: a complete surface, or what one depth camera sees.
Input = Literal["mesh", "view"]


@dataclass(frozen=True, kw_only=True)
class MethodInfo(CheckedParameters):
    """Facts about a method, for the harness and the tables.

    Parameters
    ----------
    name
        Name on the command line: lower case, words joined by hyphens.
    title
        Name in the tables.
    cite
        What LaTeX tables cite: a key of the suite's bibliography, or a BibTeX entry,
        ``"@article{key, ...}"``.
    family
        ``"paper"`` for a row of the paper, ``"control"`` for a baseline, ``"external"`` for forms
        made by another program, ``"extended"`` for any other method.
    summary
        What the method does, in a sentence for readers who do not know it. ``list methods`` and the
        page ``play.html`` show it.
    departs
        How the method departs from its source, in one or two sentences; "" if it does not. Shown by
        ``describe``.
    requires
        Import names of packages beyond the core. Without them the method is *unavailable*; it never
        uses another algorithm instead.
    inputs
        Accepted inputs.
    scale
        ``"equivariant"`` if the form scales with the shape, ``"invariant"`` if it does not change.
    deterministic
        False if the form depends on the seed.
    needs
        Requirements that are checked before the method is called. ``"connected"``: the surface is
        in one piece and has at least four vertices. ``"pairs"``: it also has at most 20 000
        vertices, because the distances between all pairs are kept in memory.
    files
        Other files on which the results depend, such as a table that the method reads or a program
        that it calls. Paths are relative to its module. If a file changes, the results of the
        method are computed again.

    Raises
    ------
    ConfigurationError
        If a value does not have the declared type.
    """

    name: Name
    title: Title
    cite: str = ""
    family: Literal["paper", "control", "extended", "external"] = "extended"
    summary: str = ""
    departs: str = ""
    requires: tuple[str, ...] = ()
    inputs: tuple[Input, ...] = ("mesh", "view")
    scale: Literal["equivariant", "invariant"] = "equivariant"
    deterministic: bool = True
    needs: tuple[Literal["connected", "pairs"], ...] = ()
    files: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if isinstance(self.cite, str):  # an entry may have several lines, all other texts have one
            object.__setattr__(self, "cite", " ".join(self.cite.split()))
        super().__post_init__()


@dataclass(frozen=True, eq=False)
class CanonicalForm:
    """Surface returned by a method.

    Parameters
    ----------
    vertices
        Positions, shape (n, 3); one per vertex of the input, unless ``faces`` are other triangles.
    faces
        Triangles of the form, shape (m, 3); usually those of the input.
    notes
        Facts for the record: iterations, stress, edge strain, number of bridges.
    vertex_map
        Set by :func:`benchmark.canonicalise`; methods leave it out.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    notes: Mapping[str, float | str] = field(default_factory=dict)
    vertex_map: NDArray[np.int64] | None = None

    @property
    def mesh(self) -> Mesh:
        """The form as a mesh.

        Raises
        ------
        InvalidMesh
            If the form is not a surface, for example because a coordinate is NaN.
        """
        return Mesh(self.vertices, self.faces)


@dataclass(frozen=True)
class AllPairs:
    """Key of the geodesic distances in a :data:`ResultCache`.

    It equals no key that a method chooses.
    """


def identify_result(key: Hashable, owner: Hashable) -> Hashable:
    """Return what tells a shared result apart.

    That of a method is known by its class and parameters, any other also by its owner.

    Parameters
    ----------
    key
        The key that a method chose.
    owner
        Who asks. A method that holds more than its parameters, such as a model, shares nothing.
    """
    if isinstance(key, AllPairs):
        return key
    if isinstance(key, Method):
        values = parameter_values(key)
        if getattr(key, "__dict__", None) == values:
            return type(key), repr(values), key  # 1, 1.0 and True are equal
    return owner, key


ResultCache = Callable[[Hashable, Callable[[], Any]], Any]
"""Returns the result under a key; calls the function, which computes it, if it is missing."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Shape:
    """Mesh of one subject in one pose, prepared identically for every method.

    Methods share it, so it is read-only.

    Parameters
    ----------
    identifier
        Name of the shape in its data set.
    mesh
        Prepared surface: one component, about 2000 vertices, unit area. With the view input, the
        open 2.5-D surface seen by the camera.
    depth
        Depth image, shape (500, 500), float32 in (0, 1], with 0 as background; None if no camera is
        known.
    source_area
        Surface area before decimation and scaling, in squared file units; None if unknown.
    seed
        Seed of all random choices for this shape.
    cache
        Cache for results that methods share, by key: geodesic distances by :class:`AllPairs`, a
        form by its method; None caches them in this object.
    """

    identifier: str
    mesh: Mesh
    depth: NDArray[np.float32] | None = None
    source_area: float | None = None
    seed: int = 0
    cache: ResultCache | None = None
    _results: dict[Hashable, Any] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        if self.depth is not None:
            object.__setattr__(self, "depth", read_only(np.asarray(self.depth)))

    @classmethod
    def from_arrays(cls, vertices: ArrayLike, faces: ArrayLike, name: str = "shape") -> Shape:
        """Return a shape with the given surface, without preparing it.

        :func:`benchmark.canonicalise` prepares a surface as a run does.

        Parameters
        ----------
        vertices
            Coordinates, shape (n, 3).
        faces
            Vertex indices of the triangles, shape (m, 3).
        name
            Identifier of the shape.

        Raises
        ------
        InvalidMesh
            If the arrays are not a triangle mesh.

        Examples
        --------
        >>> from baselines.gps import GPS
        >>> form = GPS().canonicalise(Shape.from_arrays(vertices, faces))   # doctest: +SKIP
        """
        mesh = Mesh(vertices, faces)  # type: ignore[arg-type]
        return cls(identifier=name, mesh=mesh, source_area=mesh.area)

    def __repr__(self) -> str:
        counts = f"{self.mesh.n_vertices} vertices, {self.mesh.n_faces} faces"
        return f"Shape({self.identifier!r}, {counts})"

    def geodesics(self) -> FloatArray:
        """Return geodesic distances between all pairs of vertices.

        They are shortest paths along straight geodesics between nearby vertices.

        Returns
        -------
        numpy.ndarray
            Shape (n, n), symmetric, zero diagonal, in units of the prepared mesh; read-only.

        Raises
        ------
        UnsupportedShape
            If two vertices are not connected.
        """
        from benchmark.geometry import geodesics

        def compute() -> FloatArray:
            return read_only(geodesics.rounded(geodesics.all_pairs(self.mesh)))

        matrix: FloatArray = self.compute_once(AllPairs(), compute)
        return matrix

    def compute_once(self, key: Hashable, compute: Callable[[], Any]) -> Any:
        """Return a result that several methods use, such as a form that other methods deform.

        The result is computed when it is first needed.

        Parameters
        ----------
        key
            The method that makes the result, with its parameters. Any other key, such as a text,
            is private to the method that asks: no other method gets its result, and outside of a
            run, the result is computed each time. A run adds the seconds of a shared result to the
            time of each method that uses it.
        compute
            Computes the result, which must be read-only.
        """
        if self.cache is not None:
            return self.cache(key, compute)
        if not isinstance(key, AllPairs | Method):
            return compute()
        identity = identify_result(key, None)
        if identity not in self._results:
            self._results[identity] = compute()
        return self._results[identity]

    def geodesics_from(self, sources: ArrayLike) -> FloatArray:
        """Return geodesic distances from a few vertices to all vertices.

        This is much faster than the distances between all pairs.

        Parameters
        ----------
        sources
            Vertex indices, shape (k,).

        Returns
        -------
        numpy.ndarray
            Shape (k, n), in units of the prepared mesh; read-only.

        Raises
        ------
        UnsupportedShape
            If a vertex cannot be reached.
        """
        from benchmark.geometry.geodesics import from_sources

        return read_only(from_sources(self.mesh, np.asarray(sources, dtype=np.int64)))

    def laplacian(self) -> Laplacian:
        """Return the cotangent Laplacian and lumped mass, read-only.

        See :mod:`benchmark.geometry.laplacian`.
        """
        return self._laplacian.shared()

    @cached_property
    def _laplacian(self) -> Laplacian:
        from benchmark.geometry.laplacian import cotangent_laplacian

        return cotangent_laplacian(self.mesh)

    def random(self, purpose: str = "") -> np.random.Generator:
        """Return a random generator, seeded by the seed, the purpose and measurements of the mesh.

        Names do not count. Shapes that differ only by a rigid motion, a scale or the order of their
        vertices draw the same numbers.
        """
        import hashlib

        from benchmark.geometry.mesh import measurements

        text = f"{self.seed}|{measurements(self.mesh)}|{purpose}"
        digest = hashlib.sha256(text.encode()).digest()
        return np.random.default_rng(int.from_bytes(digest[:8], "big"))

    def form(self, vertices: ArrayLike, **notes: float | str) -> CanonicalForm:
        """Wrap new positions of this shape's vertices, shape (n, 3), as a canonical form.

        Raises
        ------
        InvalidMesh
            If the positions are not finite real numbers, one for each vertex.
        """
        count = len(np.atleast_1d(vertices))
        if count != self.mesh.n_vertices:
            problem = f"there are {count} positions for {self.mesh.n_vertices} vertices"
            raise InvalidMesh(problem, "return one for each")
        return CanonicalForm(self.mesh.with_vertices(vertices).vertices, self.mesh.faces, notes)


@runtime_checkable
class Method(Protocol):
    """Method that computes the canonical form of a shape."""

    info: ClassVar[MethodInfo]

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the canonical form, or raise ``UnsupportedShape`` with the reason."""
        ...


@runtime_checkable
class Descriptor(Protocol):
    """Method that compares shapes without canonical forms.

    It may have ``compare_to`` like a scorer.
    """

    info: ClassVar[MethodInfo]

    def describe(self, shape: Shape) -> FloatArray:
        """Return the descriptor of one shape, shape (k,).

        Raise ``UnsupportedShape`` with the reason if there is none.
        """
        ...

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """Return the distances of all pairs, shape (N, N), symmetric, with a zero diagonal."""
        ...


def canonical_form(**info: Any) -> Callable[[Callable[[Shape], Any]], type]:
    """Turn a function that maps a shape to vertex positions (or a form) into a method.

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
        return _method_of(function, MethodInfo(**info))

    return decorate


def _method_of(function: Callable[[Shape], Any], info: MethodInfo) -> type:
    """Make the class of a method without parameters whose forms a function computes.

    The class has the name, the docstring and the module of the function, so that both can be found
    and imported alike.

    Parameters
    ----------
    function
        Maps a shape to a :class:`CanonicalForm`, or to vertex positions of shape (n, 3).
    info
        Name, title and other facts that the benchmark shows of the method.
    """

    def canonicalise(self: object, shape: Shape) -> CanonicalForm:
        """Return the result of the function; positions become a canonical form."""
        result = function(shape)
        return result if isinstance(result, CanonicalForm) else shape.form(result)

    members = {
        "info": info,
        "canonicalise": canonicalise,
        "__doc__": function.__doc__,
        "__module__": function.__module__,
        "__qualname__": function.__qualname__,
    }
    method = type(function.__name__, (), members)
    return dataclass(frozen=True, kw_only=True)(method)
