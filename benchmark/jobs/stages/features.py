"""Local features of the 66 views of a canonical form."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from benchmark.geometry.mesh import Mesh
from retrieval.cmbof import CMBOF


def extract(scorer: CMBOF, form: Mesh) -> Mapping[str, NDArray[Any]]:
    """Arrays of :class:`retrieval.cmbof.Features`; raises ``InvalidMesh`` if the form has no extent."""
    return scorer.extract(form).to_arrays()
