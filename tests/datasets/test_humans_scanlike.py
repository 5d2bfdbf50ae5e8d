"""The scan-like humans: one closed skin each, near to the body that was scanned."""

from __future__ import annotations

import igl
import numpy as np
import pytest
import trimesh

from benchmark.datasets.bodies import POSES, SUBJECTS, body_mesh, jittered, named_random
from benchmark.datasets.people import humans_scanlike

pytestmark = pytest.mark.kernels


@pytest.mark.slow
def test_a_scan_is_one_closed_skin_on_the_body_but_for_cavities_and_fingers() -> None:
    data = humans_scanlike()
    scan = data.load(next(entry for entry in data.shapes if entry.identifier == "man-3_waving"))
    assert abs(scan.n_vertices - 15_000) < 1000
    skin = trimesh.Trimesh(scan.vertices, scan.faces, process=False)
    assert skin.is_watertight
    assert skin.is_winding_consistent
    assert skin.body_count == 1
    assert skin.euler_number >= -6  # a few handles where parts touch
    lengths = skin.edges_unique_length
    assert lengths.std() / lengths.mean() < 0.35  # isotropic
    angles = jittered(POSES["waving"], 3.0, named_random("man-3_waving", "pose"))
    body = body_mesh(SUBJECTS["humans-scanlike"]["man-3"], angles)
    gap = np.sqrt(igl.point_mesh_squared_distance(scan.vertices, body.vertices, body.faces)[0])
    assert 0.001 < np.median(gap) < 0.005  # asymmetry, noise and sampling
    assert np.percentile(gap, 99) < 0.015
    assert scan.area < 0.98 * body.area
