"""Graph Stress: call a program in another language, which reads a mesh and writes a mesh.

The program is ``graph_stress.cpp``. Build it first: ``g++ -O2 -o graph_stress graph_stress.cpp``.
"""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar

import trimesh

from benchmark.api import CanonicalForm, MethodInfo, Shape, UnsupportedShape

#: Exit code by which the program refuses a mesh; any other one except 0 is an error.
REFUSED = 2


@dataclass(frozen=True, kw_only=True)
class GraphStress:
    """Form that a program writes; its arguments are the file to read and the file to write."""

    info: ClassVar[MethodInfo] = MethodInfo(
        name="graph-stress",
        title="Graph Stress",
        summary="least-squares MDS of distances along edges, in C++",
        files=("graph_stress",),
    )
    command: ClassVar[tuple[str, ...]] = ("./graph_stress",)

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the mesh that the program writes; it may have any number of vertices."""
        with TemporaryDirectory() as folder:
            mesh, form = f"{folder}/mesh.off", f"{folder}/form.off"
            trimesh.Trimesh(shape.mesh.vertices, shape.mesh.faces, process=False).export(
                mesh, digits=17
            )
            words = [*self.command, mesh, form]
            try:
                done = subprocess.run(
                    words, cwd=Path(__file__).parent, capture_output=True, text=True, check=False
                )
            except FileNotFoundError as error:
                raise RuntimeError(
                    f"{words[0]} cannot be started: build or install it first"
                ) from error
            reason = " ".join(done.stderr.split())
            if done.returncode == REFUSED:
                raise UnsupportedShape(reason, "see the program")
            if done.returncode:
                raise RuntimeError(
                    f"{self.info.name} ended with exit code {done.returncode}: {reason}"
                )
            made = trimesh.load_mesh(form, process=False)
        return CanonicalForm(made.vertices, made.faces)
