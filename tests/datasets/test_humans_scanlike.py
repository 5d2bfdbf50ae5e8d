"""The scan-like humans: one closed skin each, near to the body that was scanned, and no two alike."""

from __future__ import annotations

import igl
import numpy as np
import pytest
import trimesh

from benchmark.datasets.bodies import POSES, SUBJECTS, body_mesh, jittered, named_random
from benchmark.datasets.people import humans_scanlike
from benchmark.geometry.mesh import Mesh

pytestmark = pytest.mark.kernels


def solid(mesh: Mesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


@pytest.fixture(scope="module")
def pair() -> tuple[Mesh, Mesh]:
    data = humans_scanlike()
    first, second = (entry for entry in data.shapes if entry.identifier in ("man-3_waving", "woman-5_waving"))
    return data.load(first), data.load(second)


def test_a_scan_is_one_closed_skin_of_the_body(pair: tuple[Mesh, Mesh]) -> None:
    for mesh in pair:
        assert abs(mesh.n_vertices - 15_000) < 1000
        skin = solid(mesh)
        assert skin.is_watertight
        assert skin.is_winding_consistent
        assert skin.body_count == 1
        assert 0.03 < skin.volume < 0.15
        assert skin.euler_number >= -6  # a few handles where parts touch
        lengths = skin.edges_unique_length
        assert lengths.std() / lengths.mean() < 0.35  # isotropic


def test_a_scan_lies_on_the_body_but_for_cavities_and_fingers(pair: tuple[Mesh, Mesh]) -> None:
    angles = jittered(POSES["waving"], 3.0, named_random("man-3_waving", "pose"))
    body = body_mesh(SUBJECTS["humans-scanlike"]["man-3"], angles)
    gap = np.sqrt(igl.point_mesh_squared_distance(pair[0].vertices, body.vertices, body.faces)[0])
    assert 0.001 < np.median(gap) < 0.005  # asymmetry, noise and sampling
    assert np.percentile(gap, 99) < 0.015
    assert pair[0].area < 0.98 * body.area
