"""The comparison of architectures at toy size: it trains, ranks, goes on, and tells."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from torch import nn

from benchmark.api.streaming import Fresh
from benchmark.errors import UnsupportedShape
from retrieval.measures import PRINTED
from tests.geometry.surfaces import sphere
from tests.learned.streamed.toy import Ellipsoids, toy
from tests.learned.toy import quiet
from tools.studies import architectures

CHOSEN = [toy(name="toy"), toy(name="toy-two-sided", sides=2)]


class Many(Ellipsoids):
    """The same in five poses, of which the scorer wants two at least; they repeat."""

    def __call__(self, number: int, bodies: int, size: int) -> Fresh:
        made = super().__call__(number, bodies, size)
        return Fresh(**{**vars(made), "images": np.repeat(made.images, 2, axis=1)})


def test_each_configuration_gets_its_share_and_is_not_trained_twice(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(architectures, "FOLDER", tmp_path / "work")
    monkeypatch.setattr(architectures, "FIGURES", tmp_path / "results" / "architectures.json")
    monkeypatch.setattr(architectures, "TRIAL_STEPS", 2)
    monkeypatch.setattr(architectures, "say", quiet)
    monkeypatch.setattr(architectures, "step_seconds", lambda *_: 0.01)
    ranked: list[Any] = []

    def scored(forms: Any, subjects: Any) -> dict[str, float]:
        ranked.append((len(forms), tuple(subjects)))
        return dict.fromkeys(("NN", "FT", "ST", "DCG"), 0.5) | {f"chance {n}": 0.2 for n in ("NN", "FT", "ST", "DCG")}

    monkeypatch.setattr(architectures, "ranked", scored)
    monkeypatch.setattr(architectures, "form_of", lambda _: (sphere(1), {}))
    architectures.compare(CHOSEN[:1], 0.06, Ellipsoids(), Many(seed=5), 3, 0)
    architectures.compare(CHOSEN, 0.06, Ellipsoids(), Many(seed=5), 3, 0)
    found = json.loads((tmp_path / "results" / "architectures.json").read_text())
    assert [row["configuration"] for row in found] == ["toy", "toy-two-sided"]
    assert [row["steps"] for row in found] == [6, 6]
    assert all(row["processor seconds"] > 0 for row in found)
    assert ranked == [(12, tuple(f"toy-0-{body}" for body in range(3) for _ in range(4)))] * 2
    lines = architectures.table(found).splitlines()
    assert lines[2].startswith("| `toy` | ")
    assert lines[-1] == "| *chance* |  |  |  |  | 0.20 | 0.20 | 0.20 | 0.20 |  |"


def test_a_batch_is_made_once_and_read_as_it_was_made(tmp_path: Path) -> None:
    made: list[int] = []

    class Counted(Ellipsoids):
        def __call__(self, number: int, bodies: int, size: int) -> Fresh:
            made.append(number)
            return super().__call__(number, bodies, size)

    artefacts = architectures.ArtefactReader(Counted(), tmp_path)
    first, again, other = artefacts(0, 3, 32), artefacts(0, 3, 32), artefacts(1, 3, 32)
    assert made == [0, 1]
    assert again.identifiers == first.identifiers != other.identifiers
    assert again.drawn_again == first.drawn_again
    for name in ("images", "fronts", "backs"):
        read = getattr(again, name)
        assert read.dtype == np.float32
        assert read.any()
        np.testing.assert_array_equal(read, getattr(first, name), name)


def test_a_form_that_cannot_be_made_is_a_query_that_finds_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = iter(range(4))

    def refused_once(_: Any) -> Any:
        if next(asked) == 1:
            raise UnsupportedShape("nothing is predicted", "train longer")
        return sphere(1), {}

    monkeypatch.setattr(architectures, "predicted", lambda *_: None)
    monkeypatch.setattr(architectures, "form_of", refused_once)
    monkeypatch.setattr(architectures, "ranked", lambda forms, subjects: dict.fromkeys(PRINTED, len(forms) / 3))
    found = architectures.measure(nn.Identity(), toy(), np.zeros((2, 2, 8, 8)), ["a", "b"])  # type: ignore[arg-type]
    assert found == {**dict.fromkeys(PRINTED, 0.75), "refused": 1}
