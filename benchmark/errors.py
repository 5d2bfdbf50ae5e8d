"""Errors that users can cause; each message ends with a hint."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from numbers import Integral
from pathlib import Path

from benchmark.text import LONGEST_MESSAGE, brief, clean_text

#: What a message calls the file that it is about, where it is kept.
FILE = "<file>"

#: The folders in an absolute path, up to the name of the file.
_FOLDERS = re.compile(r"(?<![\w./])/(?:[^/\s]+/)+(?=[^/\s])")

#: A name of a file that stands in a command as it is.
_PLAIN_NAME = re.compile(r"[\w.+ -]+")

#: What stands between a problem and its hint in a message.
_BEFORE_HINT = "; "

#: The largest seed: records hold numbers of 64 bits.
LARGEST_SEED = 2**63 - 1

#: Similar names that a hint suggests at most, and how similar they must be (0 to 1).
_MOST_SUGGESTED = 3
_LEAST_SIMILARITY = 0.5


def with_file(message: str, file: Path | None) -> str:
    """Return a message that names the file that it is about; without a file, the message."""
    if file is None:
        return message
    return clean_text(f"{file}: {message.replace(FILE, file.name)}")


def without_file(message: str, file: Path) -> str:
    """Return a message that calls a file :data:`FILE`."""
    for name in (str(file.absolute()), str(file), file.name):
        message = message.replace(name, FILE)
    return message


def with_hint(problem: str, hint: str) -> str:
    """Return a message that says what is wrong, then what to do, if anything."""
    return f"{problem}{_BEFORE_HINT}{hint}" if hint else problem


def without_hint(message: str) -> str:
    """Return what is wrong, of a message of :func:`with_hint`."""
    return message.partition(_BEFORE_HINT)[0]


def short_reason(message: str) -> str:
    """Return what is wrong, for print: without remedies, and without the folders of files."""
    return _FOLDERS.sub("", without_hint(message))


class BenchmarkError(Exception):
    """A problem that the user can correct.

    Parameters
    ----------
    problem
        What is wrong, naming the shape or option.
    hint
        What to do about it, as an imperative.
    file
        The file that it is about, which ``problem`` and ``hint`` call :data:`FILE`: they may be
        kept for its content, which other files have, too.
    """

    def __init__(self, problem: str, hint: str = "", file: Path | None = None) -> None:
        self.problem = brief(problem, LONGEST_MESSAGE)
        self.hint = brief(hint or "", LONGEST_MESSAGE)
        self.file = file
        super().__init__(self.problem, self.hint)

    def __str__(self) -> str:
        return with_file(with_hint(self.problem, self.hint), self.file)

    @property
    def located(self) -> str:
        """The problem with the file that it is about."""
        return with_file(self.problem, self.file)


class ConfigurationError(BenchmarkError):
    """An option, name or plugin is invalid."""


class DatasetError(BenchmarkError):
    """A data set is missing, unreadable, or unfit for retrieval."""


class ShapeError(BenchmarkError):
    """One shape cannot be used; it is counted below the table, and the others are processed."""


class TrainingError(BenchmarkError):
    """Training cannot continue.

    The loss is not finite, memory is exhausted, or a checkpoint does not fit.
    """


class DepthError(ShapeError):
    """A depth image, its mask or its intrinsics are unreadable or invalid, or it is empty."""


class UnreadableMesh(ShapeError):
    """A mesh file is missing, truncated, or not what its extension says."""


class InvalidMesh(ShapeError):
    """The content of a mesh cannot be used.

    It has NaN, or faces out of range, or nothing is left after cleaning.
    """


class InvalidForm(ShapeError):
    """A method returned something that is not a canonical form, descriptor or distance matrix."""


class InvalidSignature(ShapeError):
    """A scorer returned something that is not a signature."""


class UnsupportedShape(ShapeError):
    """A method cannot process a shape; the message says why."""


@contextmanager
def naming_file(file: Path) -> Iterator[None]:
    """Name a file in the errors of a shape that name none."""
    try:
        yield
    except ShapeError as error:
        raise ShapeError(error.problem, error.hint, error.file or file) from error


def one_line(error: BaseException) -> str:
    """Return class and message of an exception on one line.

    Of an error that users can cause, that is the message alone.
    """
    message: object = error.msg if isinstance(error, SyntaxError) else error
    text = brief(message, LONGEST_MESSAGE).strip()
    if isinstance(error, BenchmarkError):
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def locate(error: BaseException) -> str:
    """Return an exception on one line, with the file and line of the code that raised it.

    Of the calls in the traceback, the innermost one in code of the user is named; if there is none,
    the innermost one of the suite. Calls in libraries are passed over.

    Examples
    --------
    ``smooth.py:14: NameError: name 'topp' is not defined``
    """
    import sysconfig
    import traceback

    if isinstance(error, SyntaxError) and error.filename:
        return clean_text(f"{Path(error.filename).name}:{error.lineno}: {one_line(error)}")
    libraries = {sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib", "scripts")}
    suite = Path(__file__).parent
    last_of_user = None
    last_of_suite = None
    for frame in traceback.extract_tb(error.__traceback__):
        if frame.filename.startswith((*libraries, "<")):
            continue
        if Path(frame.filename).is_relative_to(suite):
            last_of_suite = frame
        else:
            last_of_user = frame
    raised_in = last_of_user or last_of_suite
    if raised_in is None:
        return one_line(error)
    return clean_text(f"{Path(raised_in.filename).name}:{raised_in.lineno}: {one_line(error)}")


def did_you_mean(kind: str, name: str, known: Iterable[str]) -> ConfigurationError:
    """Return the error for an unknown name, whose hint suggests similar names or lists all.

    Parameters
    ----------
    kind
        Kind of name: ``"method"``, ``"data set"``.
    name
        The unknown name.
    known
        The names that would be valid.
    """
    import difflib

    names = sorted(set(known))
    similar = difflib.get_close_matches(name, names, n=_MOST_SUGGESTED, cutoff=_LEAST_SIMILARITY)
    if similar:
        hint = f"did you mean {' or '.join(similar)}?"
    elif names:
        hint = f"choose one of {', '.join(names)}"
    else:
        hint = "leave it out: there is none"
    return ConfigurationError(f"unknown {kind} '{name}'", hint)


def check_known(kind: str, names: Iterable[str], known: Iterable[str]) -> None:
    """Raise ``ConfigurationError`` at the first name that is unknown."""
    for name in names:
        if name not in known:
            raise did_you_mean(kind, name, known)


def check_whole(name: str, value: object, least: int, most: float = math.inf) -> None:
    """Raise ``ConfigurationError`` unless an argument is a whole number in a range.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    value
        Its value.
    least, most
        The smallest and the largest valid number.
    """
    is_whole = isinstance(value, Integral) and not isinstance(value, bool)
    if is_whole and least <= value <= most:  # type: ignore[operator]
        return
    limits = f"of at least {least}" if most == math.inf else f"from {least} to {most}"
    problem = f"{name}={value!r:.40} is not valid"
    raise ConfigurationError(problem, f"pass a whole number {limits}")


def check_seed(seed: object) -> None:
    """Raise ``ConfigurationError`` unless a seed is a whole number that records can hold."""
    check_whole("seed", seed, 0, LARGEST_SEED)


def surface_command(name: str) -> str:
    """Return a command for a hint: it makes a surface of the points in a file.

    A name that a shell or Python would take apart, by a quote or a dollar sign, is called FILE.
    """
    if not _PLAIN_NAME.fullmatch(name):
        name = "FILE"
    return (
        f"python -c \"import pymeshlab; m = pymeshlab.MeshSet(); m.load_new_mesh('{name}'); "
        "m.compute_normal_for_point_clouds(); "
        "m.generate_surface_reconstruction_screened_poisson(); "
        "m.save_current_mesh('surface.ply')\""
    )
