"""What Nearest View promises."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmark.plugins.conformance import check_target
from benchmark.plugins.conformance.cases import BENDS, view
from benchmark.plugins.conformance.checks import trained
from benchmark.plugins.registry import plugin_methods

PLUGIN = Path(__file__).with_name("nearest_view.py")


def test_it_keeps_the_contract() -> None:
    report = check_target(str(PLUGIN))
    assert report, f"\n{report}"


def test_every_pose_of_the_training_gets_the_canonical_one(tmp_path: Path) -> None:
    (spec,) = plugin_methods(PLUGIN)
    learner = trained(spec, tmp_path)
    forms = [learner.canonicalise(view(bend)) for bend in BENDS]
    assert [form.notes["neighbour"] for form in forms] == list(range(len(BENDS)))
    for form in forms[1:]:
        np.testing.assert_array_equal(form.vertices, forms[0].vertices)
