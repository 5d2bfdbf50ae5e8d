"""Interface for authors of scorers, which say how different two canonical forms are.

A *scorer* is a frozen, keyword-only dataclass with a class attribute ``info`` and two methods:
``signature`` describes one form, and ``compare`` compares the signatures of a whole gallery. Its
fields are its parameters, as for methods (see :mod:`benchmark.api.contracts`). The forms of all
methods are compared by the same scorer; descriptors use none.

A scorer may also have ``compare_to(queries, gallery, draw)``, which returns the distances of M
queries to the N forms of a gallery, shape (M, N). The distances of a query may depend on no other
query. Without it, ``compare`` gets the gallery and one query at a time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from benchmark.api.parameters import CheckedParameters, Interval, Name, Title
from benchmark.geometry.mesh import Mesh

__all__ = ["Mesh", "Scorer", "ScorerInfo", "SignatureArrays"]

SignatureArrays = Mapping[str, NDArray[Any]]
"""Signature of one form: named arrays of finite numbers, stored between runs."""


@dataclass(frozen=True, kw_only=True)
class ScorerInfo(CheckedParameters):
    """Facts about a scorer, for the harness and the tables.

    Parameters
    ----------
    name
        Name on the command line: lower case, words joined by hyphens.
    title
        Name in the tables.
    cite
        BibTeX key of the source, or "".
    summary
        One line for ``list scorers``.
    requires
        Import names of packages beyond the core.
    draws
        Number of random draws for which ``compare`` is called; scores are means over them. 1 for a
        scorer without randomness.
    invariant
        Whether the signature is invariant to rotation, translation and scaling of the form, up to
        sampling. False for a scorer that undoes them only if the form has a well-defined pose.
    files
        Other files on which the scores depend; see :class:`benchmark.api.contracts.MethodInfo`.
    comparing
        Names of modules that compare signatures and compute none, in the package of the scorer or
        beside its plugin. After an edit of them, shapes are ranked again by the same signatures.
    """

    name: Name
    title: Title
    cite: str = ""
    summary: str = ""
    requires: tuple[str, ...] = ()
    draws: Annotated[int, Interval(1, 100)] = 1
    invariant: bool = True
    files: tuple[str, ...] = ()
    comparing: tuple[str, ...] = ()


@runtime_checkable
class Scorer(Protocol):
    """Comparison of canonical forms as rigid shapes."""

    info: ClassVar[ScorerInfo]

    def signature(self, form: Mesh) -> SignatureArrays:
        """Return the signature of one form.

        Parameters
        ----------
        form
            Canonical form in any position and of any size; an open surface if the input was a view.

        Raises
        ------
        InvalidMesh
            If the form cannot be compared, for example because it has no extent. The shape then
            counts as refused.
        """
        ...

    def compare(self, signatures: Sequence[SignatureArrays], draw: int) -> NDArray[np.float64]:
        """Return the distances of all pairs of forms, shape (N, N).

        The matrix is symmetric, with zeros on its diagonal.

        Parameters
        ----------
        signatures
            One per form of the gallery, N in all.
        draw
            Index of the random draw, from 0 to ``info.draws - 1``; the same draw gives the same
            distances.
        """
        ...
