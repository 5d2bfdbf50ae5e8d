"""What Nearest View promises."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from nearest_view import NearestView

from benchmark.check import failures
from benchmark.check.shapes import BENDS, training_on_figure, view


def test_it_keeps_the_contract() -> None:
    assert not failures(NearestView)


def test_every_pose_of_the_training_gets_the_canonical_one(tmp_path: Path) -> None:
    NearestView().train(training_on_figure(), tmp_path, {}, print)
    learner = NearestView().load(tmp_path)
    forms = [learner.canonicalise(view(bend)) for bend in BENDS]
    assert [form.notes["neighbour"] for form in forms] == list(range(len(BENDS)))
    for form in forms[1:]:
        np.testing.assert_array_equal(form.vertices, forms[0].vertices)
