"""Train the models of a learner."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from benchmark.api.learning import CARD, Learner, TrainingData, checked_weights
from benchmark.commands.selection import RESULTS, as_paths, as_texts, data_folder
from benchmark.errors import BenchmarkError, ConfigurationError, TrainingError, locate
from benchmark.locks import take_lock
from benchmark.pipeline.cache import StorageError, storing, taken
from benchmark.protocols.models import folder_of_training, model_in
from benchmark.protocols.pairs import data_of_training, trainings_of
from benchmark.protocols.trainings import own_training
from benchmark.registry import Component, select_one
from benchmark.text import say


def train(
    method: str,
    target: str = "",
    *,
    options: Mapping[str, Any] | None = None,
    data: str | Path | None = None,
    hold_out: str | Iterable[str] = (),
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
        Table of the models, or the name of a training; by default Table I, without ``data``.
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
        If the method does not learn, an option is unknown, or the data are named twice.
    TrainingError
        If the training fails, or leaves no model of its data.
    StorageError
        If the folder of a model cannot be written, or another process trains into it.
    """
    component = select_one(method, as_paths(plugins))
    # A method that can be trained may still lack something else that a learner needs.
    learner: Any = component.create() if component.learns else None
    if not isinstance(learner, Learner):
        raise ConfigurationError(
            f"method '{method}' is not a learner", "choose one, such as 'learned'"
        )
    root = data_folder(data_root)
    subjects = tuple(filter(None, as_texts(hold_out)))
    if data is None:
        if subjects:
            raise ConfigurationError(
                "subjects are held out of your own data", "name them, too, with --data FOLDER"
            )
        trainings = trainings_of(learner, target or "I", root)
    else:
        if target:
            problem = f"{data} are your own data, and '{target}' names others"
            raise ConfigurationError(problem, "omit --table or --data")
        trainings = [own_training(Path(data), subjects)]
    folders = []
    for training in trainings:
        tell(f"{component.name}, {training.name}")
        folder = folder_of_training(learner, training.name, Path(results) / "models")
        with _only_training_of(folder):
            data_of_this = data_of_training(training, root, tell)
            is_finished = (folder / CARD).exists()
            if is_finished:  # a learner keeps a finished model
                _check_model(folder, data_of_this, "delete the folder to train anew")
            with _training_of(component):
                learner.train(data_of_this, folder, options or {}, tell)
            _check_model(folder, data_of_this, _advice(component))
        if is_finished:
            tell(f"the model in {folder} was finished before; delete the folder to train anew")
        else:
            tell(f"the model is in {folder}")
        folders.append(folder)
    return folders


@contextmanager
def _only_training_of(folder: Path) -> Iterator[None]:
    """Return a context in which no other process trains the model of a folder.

    The lock lies beside the folder, which is for the learner to make. Where nothing was trained,
    no new folder stays.

    Raises
    ------
    StorageError
        If another process trains the model, or nothing can be written there.
    """
    lock = folder.with_name(f".{folder.name}.lock")
    new_folders = [path for path in lock.parents if not path.exists()]
    try:
        with storing(folder):
            lock.parent.mkdir(parents=True, exist_ok=True)
            file = lock.open("a")
        with file:
            refusal = taken(f"another training is writing to {folder}")
            take_lock(file.fileno(), refusal=refusal)
            if not _has_path(file, lock):
                problem = f"another training into {folder} has just ended"
                raise StorageError(problem, "train again")
            try:
                yield
            finally:
                lock.unlink(missing_ok=True)
    finally:
        for new_folder in new_folders:
            with suppress(OSError):  # it is not empty
                new_folder.rmdir()


def _has_path(file: IO[str], path: Path) -> bool:
    """Return whether an open file still has its path.

    If not, the one who had locked it has removed it, and a lock of it keeps nobody out.
    """
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


@contextmanager
def _training_of(component: Component) -> Iterator[None]:
    """Turn what a learner raises while it trains into a :class:`TrainingError`.

    A learner may be the plugin of a user, which may raise anything.
    """
    try:
        yield
    except BenchmarkError:
        raise
    except (Exception, SystemExit) as error:
        problem = f"the training of '{component.name}' failed: {locate(error)}"
        raise TrainingError(problem, _advice(component)) from error


def _check_model(folder: Path, data: TrainingData, hint: str) -> None:
    """Raise ``TrainingError`` unless a folder holds a finished model of these training data."""
    try:
        model = model_in(folder, data.name)
        checked_weights(folder)
        model.check_held_out(data.tested)
    except ConfigurationError as error:
        problem = f"there is no model of '{data.name}': {error.located}"
        raise TrainingError(problem, hint) from error


def _advice(component: Component) -> str:
    """Return what to do about a training that failed."""
    if component.plugin is None:
        return "correct that, and train again"
    return f"'python -m benchmark check {component.plugin}' tests what a learner has to do"
