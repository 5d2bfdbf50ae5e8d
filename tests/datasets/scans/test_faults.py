"""Each fault of a scan does what it says, on shapes whose answer is known; a scan tells where its vertices belong."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import igl
import numpy as np
import pytest

from benchmark.datasets.scans import sampler
from benchmark.datasets.scans.holes import blind, patched
from benchmark.datasets.scans.noise import misaligned, noisy
from benchmark.datasets.scans.sampler import ScanSampler, scan
from benchmark.datasets.scans.triangles import clustered, collapsed, subdivided
from benchmark.datasets.scans.wrapping import wrapped
from benchmark.datasets.varied.wide import WideSampler
from benchmark.geometry.cleaning import connected_components
from benchmark.geometry.edges import edges_of
from benchmark.geometry.interpolation import vertex_normals
from benchmark.geometry.mesh import Mesh
from benchmark.protocols.pairs import stream
from benchmark.protocols.pairs.stream import varied_data
from benchmark.protocols.trainings import TRAININGS
from tests.geometry.surfaces import joined, limbed_body, sphere


def random() -> np.random.Generator:
    return np.random.default_rng(0)


def test_a_skin_spans_what_its_ball_does_not_enter() -> None:
    ball = sphere(3)
    balls, apart = (joined(ball, ball.with_vertices(ball.vertices + np.array([x, 0, 0]))) for x in (2.04, 3.0))
    skin = wrapped(balls, 0.06, 0.005)
    assert len(edges_of(skin.faces).boundary) == 0
    assert connected_components(skin).max() == 0
    distances = np.sqrt(igl.point_mesh_squared_distance(skin.vertices, balls.vertices, balls.faces.astype(np.int64))[0])
    assert np.median(distances) < 1e-9, "it lies on the body elsewhere"
    beyond = skin.vertices[skin.faces][:, :, 0] > 1.02
    assert (beyond.any(axis=1) & ~beyond.all(axis=1)).any(), "it spans the gap"
    assert connected_components(wrapped(apart, 0.06, 0.005)).max() == 1


def test_other_triangulations_are_of_the_same_surface() -> None:
    ball = sphere(4)
    assert subdivided(ball, 1).n_faces == 4 * ball.n_faces
    for coarse in (clustered(ball, 1000), collapsed(ball, 1000)):
        assert 700 < coarse.n_vertices < 1400
        assert coarse.area == pytest.approx(ball.area, rel=0.03)
    kept = {tuple(vertex) for vertex in np.round(collapsed(ball, 1000).vertices, 6)}
    assert kept <= {tuple(vertex) for vertex in np.round(ball.vertices, 6)}


def test_noise_and_slips_are_as_large_as_said() -> None:
    ball = sphere(4)
    moved = noisy(ball, 0.01, random()).vertices - ball.vertices
    assert np.quantile(np.abs(moved), 0.683) == pytest.approx(0.01, rel=0.03)
    slip = misaligned(ball, 1, 0.1, random()).vertices - ball.vertices
    assert np.ptp(slip, axis=0).max() < 1e-12, "one view slips as a whole"
    assert np.ptp(misaligned(ball, 5, 0.1, random()).vertices - ball.vertices, axis=0).min() > 0.05


def test_holes_are_where_they_are_said_to_be() -> None:
    ball = sphere(4)
    one = patched(ball, np.array([0.5]), random())
    # A cap of radius r on a unit sphere, measured along its chord, has the area pi r^2.
    assert ball.area - one.area == pytest.approx(np.pi * 0.25, rel=0.05)
    flat = Mesh(ball.vertices * [1, 1, 0.01], ball.faces)
    assert flat.area - patched(flat, np.array([0.3]), random()).area < 1.2 * np.pi * 0.09, "one side alone"
    below = blind(ball, np.array([0, 0, -1.0]), 0.1)
    assert below.vertices[:, 2].min() == pytest.approx(-0.9, abs=0.05)
    assert below.vertices[:, 2].max() == ball.vertices[:, 2].max()
    assert patched(ball, np.full(20, 1.5), random()) is ball, "too little would be left"


@pytest.fixture(scope="module")
def body() -> Mesh:
    return limbed_body(4)


def test_a_scan_tells_where_its_vertices_belong(body: Mesh) -> None:
    height = float(np.ptp(body.vertices[:, 2]))
    for seed in range(6):
        made = scan(body, height, np.random.default_rng(seed))
        again = scan(body, height, np.random.default_rng(seed))
        assert made.mesh.vertices.tobytes() == again.mesh.vertices.tobytes()
        assert made.mesh.n_vertices <= sampler.SMALL
        assert made.weights.sum(axis=1) == pytest.approx(1)
        places = np.einsum("nc,nck->nk", made.weights, body.vertices[made.corners])
        distances = np.linalg.norm(places - made.mesh.vertices, axis=1)
        assert np.quantile(distances, 0.9) < 0.02 * height
        normals = vertex_normals(body)[made.corners].sum(axis=1)
        agree = np.einsum("nk,nk->n", normals, vertex_normals(made.mesh)) > 0
        assert agree.mean() > 0.9


# None of it is what methods are tested on -------------------------------------------------------------------------


def test_the_stream_of_scans_is_that_of_this_sampler_and_known_by_its_version(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: Any = SimpleNamespace(training=TRAININGS["humans-varied"])
    data = varied_data(asked, iter)
    assert data.scanned.scans == ScanSampler(seed=0)
    assert data.scanned.validation == ScanSampler(seed=1)
    assert len({data.digest, data.wide.digest, data.scanned.digest}) == 3
    monkeypatch.setattr(stream, "versions_of", lambda _: {"sampler/scans": "other"})
    assert varied_data(asked, iter).scanned.digest != data.scanned.digest


@pytest.mark.exhaustive
def test_no_subject_of_a_set_and_no_body_of_another_stream_is_scanned(monkeypatch: pytest.MonkeyPatch) -> None:
    from benchmark.datasets.human_subjects import CLEARANCE, clearance
    from benchmark.datasets.varied import sampler as bodies
    from benchmark.datasets.varied.bodies import AWAY_FROM, varied_body

    drawn = []

    def noted(source: np.random.Generator):
        drawn.append(varied_body(source))
        return drawn[-1]

    monkeypatch.setattr(bodies, "varied_body", noted)
    made = ScanSampler(seed=0)(5, 4)
    assert min(clearance(each.subject, AWAY_FROM) for each in drawn) >= CLEARANCE
    ours = set(drawn)
    drawn.clear()
    WideSampler(seed=0)(5, 4, 32)
    ScanSampler(seed=1)(5, 4)
    assert not ours & set(drawn)
    again = ScanSampler(seed=0)(5, 4)
    assert [each.mesh.vertices.tobytes() for of in made.scans for each in of] == [
        each.mesh.vertices.tobytes() for of in again.scans for each in of
    ]
    for of_body in made.scans:
        for each in of_body:
            assert 600 < each.mesh.n_vertices <= sampler.SMALL
