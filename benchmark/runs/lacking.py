"""Models that the networks of a selection lack, and their trainings before a run."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmark.api.contracts import Input
from benchmark.api.learning import HasRecipe
from benchmark.api.parameters import option_words
from benchmark.errors import TrainingError
from benchmark.protocols.galleries import galleries
from benchmark.protocols.models import folder_of_training
from benchmark.protocols.trainings import find_training, n_pairs
from benchmark.registry import Component, are_named, select
from benchmark.registry.modules import environment


@dataclass(frozen=True)
class LackingModel:
    """A model that a row needs, and that nobody trained yet.

    Parameters
    ----------
    method
        Name of the network, with its parameters.
    plugin
        File of the network; None for one of the suite.
    training
        Name of the training data.
    options
        Options of the training.
    seconds
        About how long one core takes; None if the network does not say.
    """

    method: str
    plugin: Path | None
    training: str
    options: Mapping[str, Any]
    seconds: float | None

    def words(self, results: Path, data_root: Path | None) -> list[str]:
        """Return the words after ``python -m benchmark`` that train it."""
        words = ["train", self.method, "-t", self.training, "--results", str(results)]
        words += option_words(self.options)
        if self.plugin is not None:
            words += ["--plugin", str(self.plugin)]
        if data_root is not None:
            words += ["--data-root", str(data_root)]
        return words


def lacking_models(
    results: Path,
    *,
    methods: Sequence[Any] = (),
    plugins: Sequence[Path] = (),
    input: Input | None = None,
    data_root: Path | None = None,
    **data: Any,
) -> list[LackingModel]:
    """Return the missing models of the selected networks that can be trained here.

    Parameters
    ----------
    results
        The results folder, which may hold models.
    methods
        Names of methods, or objects from Python; all methods by default.
    plugins
        Plugin files that may define them.
    input
        ``"mesh"`` or ``"view"``; both by default.
    data_root
        Folder of the official data sets.
    **data
        Tables and data sets of the selection.
    """
    selected = select(methods, plugins)
    is_named = are_named(methods)
    models: dict[Path, LackingModel] = {}
    for gallery in galleries(input=input, data_root=data_root, **data):
        for input_ in gallery.inputs:
            lacking = gallery.lacking(input_, selected, results / "models", named=is_named)
            for component, training in lacking:
                # Several rows may need one model, which is listed once.
                folder = folder_of_training(component.create(), training.name, results / "models")
                if folder not in models:
                    models[folder] = _lacking_model(component, training.name, data_root)
    return list(models.values())


def _lacking_model(component: Component, training: str, data_root: Path | None) -> LackingModel:
    """Return the model of a network for a training, with the options of its recipe."""
    learner = component.create()
    options: Mapping[str, Any] = {}
    seconds = None
    if isinstance(learner, HasRecipe):
        options = learner.recipe(training)
        seconds = learner.training_seconds(training, n_pairs(find_training(training), data_root))
    return LackingModel(component.name, component.plugin, training, options, seconds)


def train_lacking(
    lacking: Collection[LackingModel],
    results: Path,
    data_root: Path | None,
    say: Callable[[str], object],
) -> None:
    """Train models one after the other, each in a process of its own; what was interrupted goes on.

    Raises
    ------
    TrainingError
        If a training fails.
    """
    for number, model in enumerate(lacking, start=1):
        say(f"training {number} of {len(lacking)}: {model.method}, {model.training}")
        words = model.words(results, data_root)
        command = [sys.executable, "-m", "benchmark", *words]
        done = subprocess.run(command, env=environment(), check=False)
        if done.returncode:
            raise TrainingError(
                f"the training of {model.method} on '{model.training}' failed",
                f"run it alone: {shlex.join(['python', '-m', 'benchmark', *words])}",
            )
