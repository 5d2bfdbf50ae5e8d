"""The study of scans at toy size: each shape is scanned once, each method ranked once, a refusal finds nothing."""

from __future__ import annotations

import json
from pathlib import Path

import igl
import numpy as np
import pytest
from safetensors import safe_open

from baselines.surface_area import SurfaceArea
from benchmark.api.contracts import MethodInfo, Shape, UnsupportedShape
from benchmark.geometry.mesh import Mesh
from learned.field import configuration, training
from learned.field.fitting import fit
from learned.field.methods import DeformationField
from learned.field.model import load_field
from learned.training import loop
from learned.training.checkpoint import CHECKPOINT
from tests.geometry.surfaces import limbed_body, sphere
from tests.learned.field.toy import OPTIONS, TOY, Paddles
from tests.learned.streamed.toy import Ellipsoids, toy_stream
from tests.learned.toy import quiet
from tools.studies import field_scans
from tools.studies.range_scanning import RANGE_NOISE, STEP, range_scan


@pytest.mark.slow
def test_a_range_scan_is_one_surface_near_the_body_of_other_triangles() -> None:
    body = limbed_body(4)
    body = body.with_vertices(body.vertices / np.ptp(body.vertices[:, 2]) * 1.7)
    made, again, other = (range_scan(body, np.random.default_rng(seed)) for seed in (0, 0, 1))
    assert made.vertices.tobytes() == again.vertices.tobytes() != other.vertices.tobytes()
    nearest = igl.point_mesh_squared_distance(made.vertices, body.vertices, body.faces.astype(np.int64))[0]
    assert np.quantile(np.sqrt(nearest), 0.75) < 2 * (RANGE_NOISE + STEP)
    a, b, c = (made.vertices[made.faces[:, k]] for k in range(3))
    assert np.einsum("mk,mk->", a, np.cross(b, c)) > 0, "it looks outward"
    assert made.area == pytest.approx(body.area, rel=0.15)


class Stopped(Ellipsoids):
    """Ellipsoids of which Ctrl-C stops the sixth batch."""

    def surfaces(self, number, bodies):
        if number == 6:
            raise KeyboardInterrupt
        return super().surfaces(number, bodies)


def test_a_training_that_runs_has_a_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(configuration.FIELDS, TOY.name, TOY)
    monkeypatch.setattr(training, "LOOKED_AT", 2)
    monkeypatch.setattr(loop, "ROW", 4)
    monkeypatch.setattr(loop, "CHECKPOINT_SECONDS", -1.0)
    with pytest.raises(KeyboardInterrupt):
        fit("toy", 0, toy_stream(Stopped()), tmp_path / "training", OPTIONS, quiet)
    folder = field_scans.unfinished(tmp_path / "training", tmp_path)
    assert folder.name == f"{4 * OPTIONS['bodies']:010}"
    made = DeformationField(configuration="toy").load(folder).canonicalise(Shape(identifier="x", mesh=limbed_body(3)))
    assert made.mesh.area == pytest.approx(1)
    with safe_open(str(tmp_path / "training" / CHECKPOINT), framework="pt") as file:
        weights = file.get_tensor("weights.gathered.weight").half().float()
    assert (load_field(folder).gathered.weight == weights).all()


class Named:
    """A descriptor that knows whose scan it sees, and refuses one."""

    info = MethodInfo(name="named", title="Named")

    def describe(self, shape: Shape) -> np.ndarray:
        if shape.identifier == "1-2":
            raise UnsupportedShape("not this one", "take another")
        return np.array([float(shape.identifier.partition("-")[0])])

    distances = SurfaceArea.distances


class Forms:
    """A method whose forms are all the same."""

    info = MethodInfo(name="forms", title="Forms")

    def canonicalise(self, shape: Shape):
        return shape.form(shape.mesh.vertices * 0.5)


def test_each_scan_and_each_method_is_measured_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scanned: list[Mesh] = []

    def plain(mesh: Mesh, _: np.random.Generator) -> Mesh:
        scanned.append(mesh)
        return mesh

    monkeypatch.setattr(field_scans, "range_scan", plain)
    monkeypatch.setattr(field_scans, "POSES", 2)
    shapes, subjects = field_scans.gallery(Paddles(2).surfaces, 3, tmp_path)
    again, _ = field_scans.gallery(Paddles(2).surfaces, 3, tmp_path)
    assert subjects == ["0", "0", "1", "1", "2", "2"]
    assert len(scanned) == 6
    assert [each.mesh.vertices.tobytes() for each in shapes] == [each.mesh.vertices.tobytes() for each in again]
    assert all(each.mesh.area == pytest.approx(1) for each in shapes)

    monkeypatch.setattr(field_scans, "POSES", 3)
    shapes = [Shape(identifier=f"{k // 3}-{k % 3}", mesh=sphere(1)) for k in range(9)]
    subjects = [each.identifier[0] for each in shapes]
    figures = tmp_path / "results" / "field-scans.json"
    for _ in range(2):
        field_scans.compare((Named(), Forms()), shapes, subjects, tmp_path, figures)
        found = json.loads(figures.read_text())
        assert [row["method"] for row in found] == ["named", "forms"]
    named = found[0]
    assert (named["shapes"], named["refused"]) == (9, 1)
    # Two bodies have 1 in all poses; of the third, two poses find each other, and the one that is refused nothing.
    assert named["NN"] == pytest.approx(8 / 9, abs=1e-4)
    assert named["FT"] == pytest.approx((3 + 3 + 0.5 + 0.5) / 9, abs=1e-4)
    low, high = named["NN interval"]
    assert 0.6 < low < named["NN"] < high <= 1
    lines = field_scans.table(found).splitlines()
    assert lines[2].startswith("| `named` | 0.89 | 0.78 |")
    assert lines[-1].startswith("| *chance* |")
