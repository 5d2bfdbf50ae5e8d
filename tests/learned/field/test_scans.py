"""Batches of scans show each body as often as said and tell where it belongs; a training on them goes on as it was."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from benchmark.api.learning import WEIGHTS, read_card
from benchmark.api.streaming import Scan, ScannedData, Scans, StreamedAndScannedData
from benchmark.errors import ConfigurationError
from benchmark.geometry.interpolation import vertex_normals
from benchmark.geometry.mesh import Mesh
from learned.field import configuration, scans, training
from learned.field.fitting import checked_plan, fit
from learned.field.methods import DeformationField
from learned.field.scans import MakesScanBatches, Seen, bodies_made
from learned.frame import centred
from tests.learned.field.toy import OPTIONS, TOY, Paddles
from tests.learned.streamed.toy import settle, toy_stream
from tests.learned.toy import quiet, toy_data

LAG = 5
SCANS = {**OPTIONS, "shapes": "scans", "uses": 2}


@dataclass(frozen=True)
class ScannedPaddles:
    """Paddles whose scans have all of their vertices."""

    seed: int = 0
    stops: int = -1
    made: ClassVar[list[int]] = []

    def __call__(self, number: int, bodies: int) -> Scans:
        if number == self.stops:
            raise KeyboardInterrupt
        self.made.append(number)
        surfaces = Paddles(self.seed).surfaces(number, bodies)
        corners = np.repeat(np.arange(surfaces.canonical.shape[1])[:, None], 3, axis=1)
        weights = np.tile([1.0, 0, 0], (len(corners), 1))
        return Scans(
            identifiers=surfaces.identifiers,
            canonical=surfaces.canonical,
            faces=surfaces.faces,
            scans=tuple(
                tuple(Scan(mesh=Mesh(each, surfaces.faces), corners=corners, weights=weights) for each in of_body)
                for of_body in surfaces.posed
            ),
            drawn_again={"toys": 1},
        )


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    settle(monkeypatch, configuration.FIELDS, TOY, training)
    monkeypatch.setattr(scans, "LAG", LAG)
    scans._KEPT.clear()
    ScannedPaddles.made.clear()
    yield
    scans._KEPT.clear()


def data(make: ScannedPaddles = ScannedPaddles()) -> StreamedAndScannedData:
    scanned = ScannedData(**{**vars(toy_data()), "digest": "scans"}, scans=make, validation=ScannedPaddles(seed=1))
    return StreamedAndScannedData(**vars(toy_stream()), scanned=scanned)


def test_each_body_is_shown_as_often_as_said_and_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scans, "EDGES", 4)
    make = MakesScanBatches(ScannedPaddles(), TOY, bodies=2, uses=2)
    steps = LAG + 6
    shown: dict[str, list[int]] = {}
    for number in range(steps):
        for name in make(number).identifiers:
            shown.setdefault(name, []).append(number)
    assert Counter(ScannedPaddles.made) == dict.fromkeys(range(steps + LAG), 1)
    assert len(shown) == len(ScannedPaddles.made) == bodies_made(steps, 2, 2)
    twice = [numbers for numbers in shown.values() if len(numbers) == 2]
    assert len(twice) == 6
    assert {late - early for early, late in twice} == {LAG}
    assert len(scans._KEPT) <= LAG + 1 + 1, "what no later batch shows is forgotten"
    assert bodies_made(3, 8, 8) == 8 * 3
    assert bodies_made(100, 8, 8) == 100 + 7 * LAG


def test_a_batch_is_a_matter_of_its_number() -> None:
    make = MakesScanBatches(ScannedPaddles(), TOY, bodies=2, uses=2)
    for number in range(3):
        make(number)
    before = make(3)
    scans._KEPT.clear()
    again = make(3)
    for name in ("points", "normals", "positions", "position_normals", "targets", "target_normals", "heights"):
        assert (getattr(before, name) == getattr(again, name)).all()
    assert before.drawn_again == {"toys": 1}
    later = make(3 + LAG)
    assert set(before.identifiers) & set(later.identifiers) == {f"paddle-{3 + LAG}-0"}
    shown = [each.points[each.identifiers.index(f"paddle-{3 + LAG}-0")] for each in (before, later)]
    assert (shown[0] != shown[1]).all(dim=1).all(), "in another frame, as other points"


def test_targets_are_where_the_vertices_belong() -> None:
    surfaces = Paddles(3).surfaces(0, 1)
    made = ScannedPaddles(seed=3)(0, 1)
    still = replace(made.scans[0][0], mesh=Mesh(7 * surfaces.canonical[0] + 1, surfaces.faces))
    body = centred(Mesh(surfaces.canonical[0], surfaces.faces))
    for seen in (Seen.of(still, body), Seen.of(still, body).mirrored()):
        assert seen.target_normals == pytest.approx(seen.normals, abs=1e-5)
        outward = vertex_normals(Mesh(seen.vertices.astype(float), seen.faces))
        assert (np.einsum("nk,nk->n", outward, seen.normals) > 0).all()
        shown = MakesScanBatches(ScannedPaddles(), TOY, 2, perturbed=False)._row(seen, np.random.default_rng(0))
        _, _, positions, normals, targets, target_normals, height = shown
        assert height == pytest.approx(np.ptp(body.vertices[:, 2]))
        # A body that stands as in the canonical pose is there but for a rotation.
        turn = np.linalg.lstsq(positions, targets, rcond=None)[0]
        assert turn.T @ turn == pytest.approx(np.eye(3), abs=1e-4)
        assert np.linalg.det(turn) == pytest.approx(1, abs=1e-4)
        assert normals @ turn == pytest.approx(target_normals, abs=1e-4)
    assert Seen.of(still, body).mirrored().mirrored().vertices.tobytes() == Seen.of(still, body).vertices.tobytes()


def test_a_training_on_scans_goes_on_as_it_was(tmp_path: Path) -> None:
    fit("toy", 0, data(), tmp_path / "whole", SCANS, quiet)
    scans._KEPT.clear()
    with pytest.raises(KeyboardInterrupt):
        fit("toy", 0, data(ScannedPaddles(stops=9 + LAG)), tmp_path / "halves", SCANS, quiet)
    scans._KEPT.clear()
    messages: list[str] = []
    fit("toy", 0, data(), tmp_path / "halves", SCANS, messages.append)
    assert any(line.startswith("going on after step") for line in messages)
    assert (tmp_path / "halves" / WEIGHTS).read_bytes() == (tmp_path / "whole" / WEIGHTS).read_bytes()
    card = read_card(tmp_path / "whole")
    assert card["bodies"] == bodies_made(16, 2, 2) == 21
    assert card["plan"]["shapes"] == "scans"
    assert "scanned bodies, each scan 2 times" in card["schedule_in_words"]
    assert card["data_digest"] == "scans"
    assert "validation position error" in card["final"]


def test_a_training_begins_with_the_shipped_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shipped = tmp_path / DeformationField.default_training / "field-toy-seed0"
    fit("toy", 0, data(), shipped, OPTIONS, quiet)
    monkeypatch.setattr(DeformationField, "shipped_models", tmp_path)
    still = {**SCANS, "steps": 1, "learning_rate": 1e-12, "start": "shipped"}
    fit("toy", 5, data(), tmp_path / "on", still, quiet)
    assert read_card(tmp_path / "on")["started_from"] == read_card(shipped)["digest"]
    assert (tmp_path / "on" / WEIGHTS).read_bytes() == (shipped / WEIGHTS).read_bytes()


def test_what_does_not_fit_is_refused_before_data_is_made(tmp_path: Path) -> None:
    for options in ({"shapes": "scans", "bodies": 8, "uses": 3}, {"uses": 2}):
        with pytest.raises(ConfigurationError, match="cannot be shown"):
            checked_plan("toy", options)
    with pytest.raises(ConfigurationError, match="has no scans"):
        fit("toy", 0, toy_stream(), tmp_path, SCANS, quiet)
    with pytest.raises(ConfigurationError, match="cannot show each body 3 times"):
        MakesScanBatches(ScannedPaddles(), TOY, bodies=8, uses=3)
    assert ScannedPaddles.made == []
