"""Contract of a scorer: canonical forms come in, dissimilarities of all pairs go out.

A *scorer* is a frozen, keyword-only dataclass with a class attribute ``info`` and two methods: ``signature`` looks at
one form and ``compare`` at the signatures of a whole gallery. Its fields are its parameters, as those of a method are
(see :mod:`benchmark.api.contracts`). The forms of all methods go through the same scorer; a descriptor has none.

The contract has a module of its own, so that it is no part of what determines a canonical form.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from benchmark.geometry.mesh import Mesh

__all__ = ["Mesh", "Scorer", "ScorerInfo", "SignatureArrays"]

SignatureArrays = Mapping[str, NDArray[Any]]
"""Signature of one form: named arrays of finite numbers, which are kept between runs."""


@dataclass(frozen=True, kw_only=True)
class ScorerInfo:
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
        Random draws that ``compare`` is asked for, numbered from 0; scores are the mean over them. 1 for a scorer
        without randomness.
    invariant
        Whether a rotation, a translation and a scaling of the form leave its signature as it is, but for what its
        sampling adds. False for a scorer that undoes them only where a pose of its own is well defined.
    files
        Paths of the files that a plugin works by, relative to its own; see :class:`benchmark.api.contracts.MethodInfo`.
    """

    name: str
    title: str
    cite: str = ""
    summary: str = ""
    requires: tuple[str, ...] = ()
    draws: int = 1
    invariant: bool = True
    files: tuple[str, ...] = ()


@runtime_checkable
class Scorer(Protocol):
    """Compares canonical forms as rigid shapes."""

    info: ClassVar[ScorerInfo]

    def signature(self, form: Mesh) -> SignatureArrays:
        """Return the signature of one form.

        Parameters
        ----------
        form
            The canonical form, in any position and of any size; an open surface where the input was a view.

        Raises
        ------
        InvalidMesh
            If the form cannot be compared, for example because it has no extent; it then counts as unsupported.
        """
        ...

    def compare(self, signatures: Sequence[SignatureArrays], draw: int) -> NDArray[np.float64]:
        """Return the dissimilarities of all pairs of forms, shape (N, N), symmetric with zero diagonal.

        Parameters
        ----------
        signatures
            One per form of the gallery; N in all.
        draw
            Number of the random draw, below ``info.draws``; the same draw gives the same dissimilarities.
        """
        ...
