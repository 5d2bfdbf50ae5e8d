"""Which modules make forms, which only train, and which of them a checkpoint tells."""

from __future__ import annotations

from pathlib import Path

import learned
from benchmark.system.fingerprints import fingerprint
from learned.training.checkpoint import training_code

PACKAGE = Path(learned.__file__).parent
PACKAGES = {"field", "paired", "streamed", "template", "training"}
LOOP = "learned.paired.training"

#: What makes forms of a model, and what only trains one.
SHARED = {"images", "learner", "surface", "weights"}
SHARED_IN_TRAINING = {
    f"training.{name}" for name in ("average", "checkpoint", "fitting", "loop", "machine", "measures", "stream")
}
PAIRED = {f"paired.{name}" for name in ("card", "configuration", "methods", "model", "network")}
PAIRED_IN_TRAINING = {
    f"paired.{name}" for name in ("fitting", "gathering", "pairs", "pictures", "schedule", "training")
}
FORMS, TRAINING = SHARED | PAIRED, SHARED_IN_TRAINING | PAIRED_IN_TRAINING
#: What makes forms with networks that are given surfaces, or of streamed configurations.
OTHERS = {"described", "frame"}


def of_package(names: object) -> set[str]:
    """Modules below the package, without the packages themselves."""
    found = {str(name).partition(".")[2] for name in names if str(name).startswith("learned.")}
    return found - PACKAGES


def below(package: str) -> set[str]:
    """Modules that lie in a package."""
    prefix = f"{package}." if package else ""
    return {f"{prefix}{path.stem}" for path in (PACKAGE / package).glob("*.py")} - {f"{prefix}__init__"}


def test_forms_need_nothing_that_only_trains() -> None:
    assert of_package(fingerprint("learned.paired.methods", without=("train", "check_options")).code) == FORMS
    assert of_package(fingerprint("learned.paired.methods").code) == FORMS | TRAINING
    assert below("") | below("training") == SHARED | SHARED_IN_TRAINING | OTHERS
    assert below("paired") == PAIRED | PAIRED_IN_TRAINING


def test_a_checkpoint_tells_all_that_the_training_loop_imports_but_what_the_recipe_tells() -> None:
    told = of_package(training_code(LOOP))
    expected = {"training.checkpoint", "training.loop", "images"} | {
        f"paired.{name}" for name in ("network", "pairs", "schedule", "training")
    }
    assert expected <= told
    assert not told & {f"paired.{name}" for name in ("configuration", "pictures", "fitting", "methods")}
    assert "benchmark.geometry.depth" in training_code(LOOP)
