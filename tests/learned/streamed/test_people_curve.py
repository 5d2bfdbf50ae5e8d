"""The curve over bodies seen at toy size: each snapshot is measured once, a refused form counts nothing."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmark.errors import UnsupportedShape
from learned.streamed import configuration, training
from learned.streamed.fitting import fit
from learned.training import loop
from tests.geometry.surfaces import sphere
from tests.learned.streamed.test_architectures import Many
from tests.learned.streamed.test_training import OPEN
from tests.learned.streamed.toy import TOY, toy_stream
from tests.learned.toy import quiet
from tools.studies import architectures, continued, people

POSES = 4


class Perfect:
    """A scorer that finds the poses of a body, which come in a row, next to each other."""

    info = SimpleNamespace(name="perfect", draws=1)

    def signature(self, form: Any) -> Any:
        return form

    def compare(self, signatures: Any, draw: int) -> np.ndarray:
        bodies = np.arange(len(signatures)) // POSES
        return (bodies[:, None] != bodies).astype(float)


@pytest.fixture
def trained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder of a training that kept its weights three times."""
    monkeypatch.setitem(configuration.STREAMED, TOY.name, TOY)
    monkeypatch.setattr(training, "LOOKED_AT", 2)
    monkeypatch.setattr(loop, "FIRST_SNAPSHOT", 20)
    monkeypatch.setattr(people, "POSES", POSES)
    monkeypatch.setattr(people, "CMBOF", Perfect)
    monkeypatch.setattr(architectures, "form_of", lambda _: (sphere(1), {}))
    fit("toy", 0, toy_stream(), tmp_path, {**OPEN, "steps": 24}, quiet)
    return tmp_path


def test_each_snapshot_is_measured_once_and_drawn(trained: Path) -> None:
    for _ in range(2):
        people.measure_missing(trained, Many(seed=5), shipped=False, bodies=3)
        found = people.rows(trained)
        assert [row["bodies"] for row in found] == [20, 40, 80]
    assert {row[name] for row in found for name in people.PRINTED} == {1.0}
    assert found[0]["mask loss"] > found[-1]["mask loss"] > 0
    lines = people.table(found).splitlines()
    assert len(lines) == 5
    assert lines[2].startswith("|  | 20 | 1.00 |")
    people.draw(found, trained / "curve.png")
    assert (trained / "curve.png").stat().st_size > 1000


def test_a_form_that_cannot_be_made_is_a_query_that_finds_nothing(
    trained: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = iter(range(100))

    def refused(_: Any) -> Any:
        if next(asked) >= 2 * POSES:
            raise UnsupportedShape("nothing is predicted", "train longer")
        return sphere(1), {}

    monkeypatch.setattr(architectures, "form_of", refused)
    weights = people.snapshot(next((trained / "snapshots").iterdir()))
    row = people.measured(weights, Many(seed=5)(0, 3, 500))
    assert row["refused"] == POSES
    assert row["FT"] == pytest.approx(2 / 3)
    assert row["of bodies"]["NN"] == [1.0, 1.0, 0.0]


def test_the_interval_is_that_of_a_mean_over_bodies() -> None:
    low, high = people.interval([0.0, 1.0] * 50)
    assert low == pytest.approx(0.4, abs=0.02)
    assert high == pytest.approx(0.6, abs=0.02)
    assert people.interval([0.3] * 5) == pytest.approx((0.3, 0.3))


def test_an_idea_is_trained_on_from_what_was_kept_and_measured_once(
    trained: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(continued, "FOLDER", trained / "continued")
    monkeypatch.setattr(continued, "FIGURES", trained / "continued.json")
    monkeypatch.setattr(continued, "STREAMED", {TOY.name: TOY})
    gallery = Many(seed=5)(0, 3, people.SIZE)
    for name in (continued.AS_BEFORE, "`one_form` .05", continued.AS_BEFORE):
        continued.compare(name, trained, 6, Many(seed=6), gallery)
    before, plain, idea = continued.found()
    assert [before["weights"], plain["weights"], idea["weights"]] == ["not trained on", "as before", "`one_form` .05"]
    assert (before["bodies"], plain["bodies"], idea["bodies"]) == (80, 104, 104)
    assert before["form loss"] == plain["form loss"] == 0 < idea["form loss"]  # where it weighs nothing
    assert len({row["mask loss"] for row in (before, plain, idea)}) == 3
    assert continued.table([before, plain, idea]).splitlines()[-1].endswith("| 0.000 (0.000 to 0.000) |")
