"""Principal Axes: call a program in Octave, ``principal_axes.m``, as Graph Stress calls one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from graph_stress import GraphStress

from benchmark.api import MethodInfo


@dataclass(frozen=True, kw_only=True)
class PrincipalAxes(GraphStress):
    """Form that a program in Octave writes."""

    info: ClassVar[MethodInfo] = MethodInfo(
        name="principal-axes",
        title="Principal Axes",
        family="control",
        summary="the mesh along its principal axes, in Octave",
        files=("principal_axes.m",),
    )
    command: ClassVar[tuple[str, ...]] = ("octave-cli", "--quiet", "--norc", "principal_axes.m")
