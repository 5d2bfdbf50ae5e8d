"""The fingerprint of the code that trains: it follows what determines the weights, and nothing else."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import learned
from benchmark.storage import keys
from learned.fingerprint import training_code

PACKAGE = Path(learned.__file__).parent

#: What makes forms of a model, and what only trains one.
FORMS = {"configuration", "images", "methods", "model", "network", "prediction"}
TRAINING = {"checkpoint", "fingerprint", "fitting", "pairs", "pictures", "saving", "schedule", "training"}


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """The modules of the package, to be edited."""
    for path in PACKAGE.glob("*.py"):
        shutil.copy(path, tmp_path)
    return tmp_path


def edit(path: Path, before: str, after: str) -> None:
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after, 1))


@pytest.mark.parametrize(
    ("module", "before", "after"),
    [
        ("schedule", "return depth.mean(), mask.mean()", "return depth.mean(), 2 * mask.mean()"),
        ("network", "SLOPE = 0.2", "SLOPE = 0.1"),
        ("training", "optimiser.step()", "optimiser.step() or optimiser.step()"),
        ("images", "COVERED = 0.5", "COVERED = 0.4"),
        ("pairs", "shrink(checked(pair.target), resolution)", "shrink(pair.target, resolution)"),
    ],
)
def test_an_edit_of_what_trains_is_seen(copied: Path, module: str, before: str, after: str) -> None:
    edit(copied / f"{module}.py", before, after)
    own, other = training_code(), training_code(copied)
    assert {name for name in own.keys() | other.keys() if own.get(name) != other.get(name)} == {module}


@pytest.mark.parametrize(
    ("module", "before", "after"),
    [
        ("network", "SLOPE = 0.2", "# as in the paper\n\nSLOPE = 0.2"),
        ("network", "Slope of LeakyReLU below zero.", "How steep LeakyReLU is below zero."),
        ("training", "Time between checkpoints", "Seconds between checkpoints"),
        ("pictures", "COLUMNS = 10", "COLUMNS = 12"),
        ("configuration", 'name="literal"', 'name="printed"'),
    ],
)
def test_words_and_what_does_not_train_do_not_count(copied: Path, module: str, before: str, after: str) -> None:
    edit(copied / f"{module}.py", before, after)
    assert training_code(copied) == training_code()


def test_forms_need_nothing_that_only_trains() -> None:
    """Follow every import but those inside a function called ``train``."""
    reached = {name for name in keys.code_of("learned.fitting") if name.startswith("learned.")}
    assert reached == {f"learned.{name}" for name in FORMS | TRAINING} - {"learned.methods", "learned.prediction"}
    assert {path.stem for path in PACKAGE.glob("*.py")} - {"__init__"} == FORMS | TRAINING
    reached = set()
    for module in ("learned.prediction", "learned.model"):
        reached |= {name.removeprefix("learned.") for name in keys.code_of(module) if name.startswith("learned.")}
    assert reached == FORMS - {"methods"}


def test_only_train_of_a_method_imports_what_trains() -> None:
    import ast

    tree = ast.parse((PACKAGE / "methods.py").read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.name == "train":
            node.body = []
    imported = {
        node.module.removeprefix("learned.")
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("learned.")
    }
    assert imported <= FORMS
    assert imported == {"configuration", "model", "prediction"}
