"""Identity: the input itself, pose included."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from benchmark.api.contracts import CanonicalForm, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class Identity:
    """The prepared surface, unchanged.

    A control: a canonical form is worth its cost only if it retrieves better than this row. On a
    gallery in which every subject takes the same poses, this row tends to rank other subjects in
    the same pose first.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="identity",
        title="Identity (no canonical form)",
        family="control",
        summary="Keeps the shape as it is: two poses of one body stay as different as they are.",
    )

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the vertices of the shape."""
        return shape.form(shape.mesh.vertices)
