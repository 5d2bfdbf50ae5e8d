"""The fingerprint of the code that trains: it follows what determines the weights, and nothing else."""

from __future__ import annotations

import ast
import shutil
from pathlib import Path

import pytest

import learned
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
        ("pairs", "shrink(checked_image(pair.target), resolution)", "shrink(pair.target, resolution)"),
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


def reached(first: str, *, training: bool) -> set[str]:
    """Modules of the package that one imports, directly or not; in functions called ``train`` only if asked for."""
    found: set[str] = set()
    pending = [first]
    while pending:
        name = pending.pop()
        if name in found:
            continue
        found.add(name)
        tree = ast.parse((PACKAGE / f"{name}.py").read_text())
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and node.name == "train" and not training:
                node.body = []
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "learned":
                named = [node.module.partition(".")[2]] if "." in node.module else [alias.name for alias in node.names]
                pending += named
    return found


def test_forms_need_nothing_that_only_trains() -> None:
    assert reached("methods", training=False) == FORMS
    assert reached("methods", training=True) == FORMS | TRAINING
    assert {path.stem for path in PACKAGE.glob("*.py")} - {"__init__"} == FORMS | TRAINING


def test_the_fingerprint_is_of_all_that_the_training_loop_imports_but_what_the_recipe_tells() -> None:
    assert set(training_code()) == reached("training", training=True) - {"configuration"}
