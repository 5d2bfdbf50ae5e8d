"""Which modules make forms, which only train, and which of them a checkpoint tells."""

from __future__ import annotations

from pathlib import Path

import learned
from benchmark.system.fingerprints import fingerprint
from learned.checkpoint import training_code

PACKAGE = Path(learned.__file__).parent

#: What makes forms of a model, and what only trains one.
FORMS = {"card", "configuration", "images", "learner", "methods", "model", "network", "prediction", "weights"}
TRAINING = {"checkpoint", "fitting", "gathering", "machine", "pairs", "pictures", "saving", "schedule", "training"}


def of_package(names: object) -> set[str]:
    return {str(name).partition(".")[2] for name in names if str(name).startswith("learned.")}


def test_forms_need_nothing_that_only_trains() -> None:
    assert of_package(fingerprint("learned.methods", without=("train", "check_options")).code) == FORMS
    assert of_package(fingerprint("learned.methods").code) == FORMS | TRAINING
    assert {path.stem for path in PACKAGE.glob("*.py")} - {"__init__"} == FORMS | TRAINING


def test_a_checkpoint_tells_all_that_the_training_loop_imports_but_what_the_recipe_tells() -> None:
    told = of_package(training_code())
    assert {"checkpoint", "images", "network", "pairs", "schedule", "training"} <= told
    assert not told & {"configuration", "pictures", "saving", "fitting", "methods"}
    assert "benchmark.geometry.depth" in training_code()
