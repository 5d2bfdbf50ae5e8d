"""Train the models of a learner."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmark.api.learning import Learner
from benchmark.commands.selection import RESULTS, as_paths, data_folder
from benchmark.errors import ConfigurationError
from benchmark.protocols.pairs import data_of_training, trainings_of
from benchmark.protocols.trainings import own_training
from benchmark.registry import select_one
from benchmark.text import say


def train(
    method: str,
    target: str = "I",
    *,
    options: Mapping[str, Any] | None = None,
    data: str | Path | None = None,
    hold_out: Sequence[str] = (),
    plugins: str | Path | Iterable[str | Path] = (),
    results: str | Path = RESULTS,
    data_root: str | Path | None = None,
    tell: Callable[[str], None] = say,
) -> list[Path]:
    """Train the models of a method that learns.

    An interrupted training goes on where it stopped, and finished models are skipped.

    Parameters
    ----------
    method
        Name of the learner.
    target
        Table of the models, or the name of a training.
    options
        Options of the training.
    data, hold_out
        Folder of your own training data, and its subjects to leave out for tests.
    plugins
        Plugin files that may define the learner.
    results, data_root
        The results folder, which gets the models; the folder of the official data sets, by default
        ``CANONICAL_FORMS_DATA``.
    tell
        Called with lines of progress.

    Returns
    -------
    list of Path
        Folders of the models.

    Raises
    ------
    ConfigurationError
        If the method does not learn, or an option is unknown.
    """
    component = select_one(method, as_paths(plugins))
    # A method that can be trained may still lack something else that a learner needs.
    learner: Any = component.create() if component.learns else None
    if not isinstance(learner, Learner):
        raise ConfigurationError(
            f"method '{method}' is not a learner", "choose one, such as 'learned'"
        )
    root = data_folder(data_root)
    if data is None:
        trainings = trainings_of(learner, target, root)
    else:
        trainings = [own_training(Path(data), tuple(filter(None, hold_out)))]
    folders = []
    for training in trainings:
        tell(f"{component.name}, {training.name}")
        folder = Path(results) / "models" / training.name / learner.model_name
        learner.train(data_of_training(training, root, tell), folder, options or {}, tell)
        tell(f"the model is in {folder}")
        folders.append(folder)
    return folders
