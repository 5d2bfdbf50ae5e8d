"""Fetch published models, which an installed suite lacks, from a folder or a web server."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from http.client import HTTPException, HTTPResponse
from pathlib import Path
from typing import BinaryIO
from urllib.error import HTTPError, URLError
from urllib.parse import quote, urlsplit
from urllib.request import Request, urlopen

from benchmark.api.learning import CARD, WEIGHTS
from benchmark.commands.selection import as_texts
from benchmark.errors import ConfigurationError, UnreadableMesh, check_known, with_hint
from benchmark.files import file_digest, read_file, write_atomically
from benchmark.protocols.models import MODELS_VARIABLE
from benchmark.protocols.published_models import SHIPPED, published_files, published_models
from benchmark.text import counted

#: Largest file of a model that is read, in bytes: four times the largest published one.
LARGEST_MODEL_FILE = 2**25

#: Seconds without an answer, and seconds for a whole file, after which a server is given up.
SILENCE = 30.0
LONGEST_DOWNLOAD = 600.0

#: Bytes that are read at once.
_PIECE = 2**16

WatchedModels = Callable[[Sequence[str]], Iterable[str]]
"""Wrapper that yields the names of models one at a time, on demand, to show progress."""


@dataclass(frozen=True)
class FetchedModels:
    """What :func:`fetch_models` did.

    Parameters
    ----------
    folder
        The folder of the models.
    fetched, present
        Names ``TRAINING/MODEL`` of the models that were fetched, and of those that were there.
    problems
        By name, why a model could not be fetched.
    """

    folder: Path
    fetched: tuple[str, ...]
    present: tuple[str, ...]
    problems: dict[str, str]


class _NotFetched(Exception):
    """A file of a model cannot be had, or is not the published one."""


def fetch_models(
    source: str | Path, names: str | Iterable[str] = (), *, watched: WatchedModels = iter
) -> FetchedModels:
    """Copy published models into the folder where methods look for them.

    A file is kept only if its SHA-256 is the published one. The folder is that of
    ``CANONICAL_FORMS_MODELS``, by default the one beside the code.

    Parameters
    ----------
    source
        A folder, such as ``learned/models`` of a checkout, or the address of one on a web server.
    names
        ``"TRAINING"`` or ``"TRAINING/MODEL"``, such as ``"people-fold-0"``; all by default.
    watched
        Wraps the list of models while they are fetched, to show progress, as ``tqdm`` does.

    Returns
    -------
    FetchedModels
        The folder, the names of new models and of those that were there, and for each model that
        could not be fetched the reason.

    Raises
    ------
    ConfigurationError
        If a name is unknown, the source is neither a folder nor an address, or the target cannot be
        written.
    """
    read = _reader(source)
    folder = Path(os.environ.get(MODELS_VARIABLE) or SHIPPED)
    if folder.exists() and not folder.is_dir():
        raise ConfigurationError(
            f"{folder} is not a folder", f"name a folder of yours in {MODELS_VARIABLE}"
        )
    fetched: list[str] = []
    present: list[str] = []
    problems: dict[str, str] = {}  # why a model could not be fetched
    for model in watched(_chosen_models(as_texts(names))):
        try:
            is_new = _fetch_model(model, read, folder)
        except _NotFetched as error:
            problems[model] = str(error)
        except UnreadableMesh as error:
            problems[model] = with_hint(error.located, "remove it first")
        except (FileExistsError, IsADirectoryError, NotADirectoryError) as error:
            problem = f"{folder / model}: {error.strerror}"
            problems[model] = with_hint(problem, "remove what stands there first")
        except OSError as error:
            problem = f"cannot write to {folder}: {error.strerror}"
            raise ConfigurationError(
                problem, f"name a folder of yours in {MODELS_VARIABLE}"
            ) from error
        else:
            if is_new:
                fetched.append(model)
            else:
                present.append(model)
    return FetchedModels(
        folder=folder, fetched=tuple(fetched), present=tuple(present), problems=problems
    )


def _chosen_models(names: Sequence[str]) -> list[str]:
    """Return the models that are named, by themselves or by their training; all without names."""
    every = published_models()
    trainings = [model.partition("/")[0] for model in every]
    check_known("model", names, [*every, *trainings])
    return [
        model
        for model, training in zip(every, trainings, strict=True)
        if not names or model in names or training in names
    ]


def _reader(source: str | Path) -> Callable[[str], bytes]:
    """Return a function that reads a file of a source by its path there."""
    text = str(source)
    if "://" in text:
        if urlsplit(text).scheme not in ("http", "https"):
            raise ConfigurationError(f"{text} is no address of the web", "use http:// or https://")
        return lambda path: _downloaded(f"{text.rstrip('/')}/{quote(path)}")
    if not Path(text).is_dir():
        hint = "name learned/models of a checkout, or its address: https://..."
        raise ConfigurationError(f"{text} is not a folder", hint)
    return lambda path: _read_from_disk(Path(text) / path)


def _fetch_model(model: str, read: Callable[[str], bytes], folder: Path) -> bool:
    """Copy the files of one model that are missing.

    Parameters
    ----------
    model
        Name of its folder.
    read
        Returns the content of a file of the source.
    folder
        Folder of all models.

    Returns
    -------
    bool
        Whether a file was missing.

    Raises
    ------
    _NotFetched
        If a file of the source is not the published one, or the target is another file, which
        stays.
    """
    is_new = False
    for name in (WEIGHTS, CARD):  # the card comes last: a model with a card is complete
        path = f"{model}/{name}"
        expected = published_files()[path]
        target = folder / path
        if target.exists():
            if file_digest(target) != expected:
                raise _NotFetched(f"{target} is another file, which stays; remove it first")
            continue
        content = read(path)
        _check_digest(content, expected, name)
        write_atomically(target, partial(_write, content))
        is_new = True
    return is_new


def _write(content: bytes, file: BinaryIO) -> None:
    """Write bytes to a file."""
    file.write(content)


def _check_digest(content: bytes, expected: str, name: str) -> None:
    """Raise ``_NotFetched`` unless bytes are those that were published."""
    actual = hashlib.sha256(content).hexdigest()
    if actual != expected:
        problem = f"{name} has SHA-256 {actual[:12]}..., and the published one {expected[:12]}..."
        raise _NotFetched(f"{problem}; it is of another release, or damaged")


def _read_from_disk(path: Path) -> bytes:
    """Return a file of a folder; raise ``_NotFetched`` if it cannot be read."""
    try:
        return read_file(path, LARGEST_MODEL_FILE)
    except OSError as error:
        raise _NotFetched(f"{path}: {error.strerror}") from error


def _downloaded(address: str) -> bytes:
    """Return the content of a file on a web server.

    Raises
    ------
    _NotFetched
        If the server does not answer or has no such file, or the connection breaks.
    """
    request = Request(address, headers={"User-Agent": "canonical-forms-benchmark"})  # noqa: S310
    try:
        with urlopen(request, timeout=SILENCE) as response:  # noqa: S310  # http or https alone
            announced = response.headers.get("Content-Length")
            content = _read_within_bounds(response, address)
    except HTTPError as error:
        raise _NotFetched(f"{address}: the server answers {error.code} {error.reason}") from error
    except (URLError, HTTPException, OSError, ValueError) as error:
        reason = getattr(error, "reason", error)
        raise _NotFetched(f"{address}: {reason}") from error
    if announced is not None and announced != str(len(content)):
        problem = f"{address}: it ended after {len(content):,} of {announced} bytes"
        raise _NotFetched(f"{problem}; fetch again")
    return content


def _read_within_bounds(response: HTTPResponse, address: str) -> bytes:
    """Read the body of a web server's response.

    Raises
    ------
    _NotFetched
        If it is longer than any model, or takes too long; the message names the address.
    """
    start = time.monotonic()
    content = bytearray()
    while piece := response.read1(_PIECE):
        content += piece
        if len(content) > LARGEST_MODEL_FILE:
            problem = f"it holds more than {LARGEST_MODEL_FILE:,} bytes, and no model does"
            raise _NotFetched(f"{address}: {problem}")
        if time.monotonic() - start > LONGEST_DOWNLOAD:
            raise _NotFetched(f"{address}: it takes more than {LONGEST_DOWNLOAD:.0f} s")
    return bytes(content)


def in_words(fetched: FetchedModels) -> str:
    """Return on one line what was fetched."""
    counts = [f"{counted(len(fetched.fetched), 'model')} fetched into {fetched.folder}"]
    if fetched.present:
        counts.append(f"{len(fetched.present)} there before")
    if fetched.problems:
        counts.append(f"{len(fetched.problems)} not fetched")
    return ", ".join(counts)
