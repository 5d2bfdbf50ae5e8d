"""Time to make the meshes that methods see: preparation of a scanned-size mesh, and a scan-like body."""

from __future__ import annotations

from functools import partial
from typing import Any
from unittest.mock import patch

from benchmark.datasets import scanning
from benchmark.datasets.decimated import DECIMATIONS, decimated, is_installed
from benchmark.datasets.humans import Humans
from benchmark.datasets.humans_scanlike import HumansScanlike
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import prepare
from tools.speed._timing import alternately, row

REPEATS = 3
VERTICES = 2000
MOST_OF_THE_COLLAPSE = 1.5
MOST_TO_PREPARE = 0.1
MOST_OF_THE_REMESHING = 2.0
"""Times of the one call of pymeshlab in it that a preparation, and a scan, may take."""


def measure() -> list[dict[str, Any]]:
    """Time each against the one call of pymeshlab in it, which published results hold fast."""
    humans, scanlike = Humans(), HumansScanlike()
    mesh = humans.load(humans.entries[7])
    with patch.object(scanning, "_remeshed", wraps=scanning._remeshed) as call:
        scanlike.load(scanlike.entries[0])
    remesh = partial(scanning._remeshed, *call.call_args.args)
    ours, peer = alternately(partial(prepare, mesh, VERTICES), partial(collapsed, mesh, 2 * VERTICES), REPEATS)
    scan, remeshing = alternately(partial(scanlike.load, scanlike.entries[0]), remesh, REPEATS)
    return [
        row(
            "preparation of one mesh",
            ours,
            peer="pymeshlab quadric edge collapse alone",
            peer_seconds=peer,
            target=f"at most {MOST_OF_THE_COLLAPSE:g} times the collapse alone",
            met=ours <= MOST_OF_THE_COLLAPSE * peer,
            detail=f"from {mesh.n_vertices} to {prepare(mesh, VERTICES).mesh.n_vertices} vertices",
        ),
        *(decimated_first(mesh, program) for program in DECIMATIONS if is_installed(program)),
        row(
            "scan-like body, generated",
            scan,
            peer="pymeshlab isotropic re-meshing alone",
            peer_seconds=remeshing,
            target=f"at most {MOST_OF_THE_REMESHING:g} times the re-meshing alone",
            met=scan <= MOST_OF_THE_REMESHING * remeshing,
            detail="about 15000 vertices, body and scan",
        ),
    ]


def decimated_first(mesh: Mesh, program: str) -> dict[str, Any]:
    """The same preparation with another program that decimates."""
    ours, peer = alternately(lambda: prepare(decimated(mesh, program)), partial(prepare, mesh, VERTICES), REPEATS)
    goal = f"at most {MOST_TO_PREPARE} s" if program == "fast-simplification" else "no slower"
    return row(
        f"preparation of one mesh, [decimation={program}]",
        ours,
        peer="preparation with pymeshlab",
        peer_seconds=peer,
        target=goal,
        met=ours <= (MOST_TO_PREPARE if program == "fast-simplification" else peer),
        detail="surfaces and triangles are compared under Decimation",
    )


def collapsed(mesh: Mesh, n_faces: int) -> None:
    """Collapse edges until so many faces remain."""
    import pymeshlab

    work = pymeshlab.MeshSet(verbose=False)
    work.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    work.meshing_decimation_quadric_edge_collapse(targetfacenum=n_faces)
