"""Errors that users can cause; each message ends with a hint."""

from __future__ import annotations

from collections.abc import Iterable

from benchmark.text import LONGEST_MESSAGE, brief, clean


class BenchmarkError(Exception):
    """A problem that the user can correct.

    Parameters
    ----------
    problem
        What is wrong, naming the file, shape or option.
    hint
        What to do about it, as an imperative.
    """

    def __init__(self, problem: str, hint: str = "") -> None:
        self.problem, self.hint = (
            brief(problem, LONGEST_MESSAGE),
            brief(hint or "", LONGEST_MESSAGE),
        )
        super().__init__(self.problem, self.hint)

    def __str__(self) -> str:
        return f"{self.problem}; {self.hint}" if self.hint else self.problem


class ConfigurationError(BenchmarkError):
    """An option, name or plugin is invalid."""


class DatasetError(BenchmarkError):
    """A data set is missing, unreadable, or unfit for retrieval."""


class ShapeError(BenchmarkError):
    """One shape cannot be used; it is counted below the table, and the other shapes are processed."""


class TrainingError(BenchmarkError):
    """Training cannot continue: the loss is not finite, memory is exhausted, or a checkpoint does not fit."""


class DepthError(ShapeError):
    """A depth image, its mask or its intrinsics are unreadable or invalid, or it shows no object."""


class UnreadableMesh(ShapeError):
    """A mesh file is missing, truncated, or not what its extension says."""


class InvalidMesh(ShapeError):
    """The content of a mesh cannot be used: NaN, faces out of range, nothing left after cleaning."""


class InvalidForm(ShapeError):
    """A method returned something that is not a canonical form, descriptor or distance matrix."""


class InvalidSignature(ShapeError):
    """A scorer returned something that is not a signature."""


class UnsupportedShape(ShapeError):
    """A method cannot process a shape; the message says why."""


def one_line(error: BaseException) -> str:
    """Return class and message of an exception on one line; the message alone of an error that users can cause."""
    text = brief(error.msg if isinstance(error, SyntaxError) else error, LONGEST_MESSAGE).strip()
    if isinstance(error, BenchmarkError):
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def locate(error: BaseException) -> str:
    """Return an exception on one line, with the file and line of the code of the user, or of the suite, that raised it.

    Examples
    --------
    ``smooth.py:14: NameError: name 'topp' is not defined``
    """
    import sysconfig
    import traceback
    from pathlib import Path

    if isinstance(error, SyntaxError) and error.filename:
        return clean(f"{Path(error.filename).name}:{error.lineno}: {one_line(error)}")
    libraries = tuple(
        {sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib", "scripts")}
    )
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if not frame.filename.startswith((*libraries, "<"))]
    outside = [
        frame for frame in ours if not Path(frame.filename).is_relative_to(Path(__file__).parent)
    ]
    for frame in (outside or ours)[-1:]:
        return clean(f"{Path(frame.filename).name}:{frame.lineno}: {one_line(error)}")
    return one_line(error)


def did_you_mean(kind: str, name: str, known: Iterable[str]) -> ConfigurationError:
    """Return the error for an unknown name; its hint suggests similar names, or names all.

    Parameters
    ----------
    kind
        Kind of name: ``"method"``, ``"data set"``.
    name
        The unknown name.
    known
        Known names.
    """
    import difflib

    names = sorted(known)
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    every = f"choose one of {', '.join(names)}" if names else "leave it out: there is none"
    hint = f"did you mean {' or '.join(near)}?" if near else every
    return ConfigurationError(f"unknown {kind} '{name}'", hint)


def check_known(kind: str, names: Iterable[str], known: Iterable[str]) -> None:
    """Raise ``ConfigurationError`` at the first name that is unknown."""
    for name in names:
        if name not in known:
            raise did_you_mean(kind, name, known)


def surface_command(name: str) -> str:
    """Return a command for a hint: it makes a surface of the points in a file."""
    return (
        f"python -c \"import pymeshlab; m = pymeshlab.MeshSet(); m.load_new_mesh('{name}'); "
        "m.compute_normal_for_point_clouds(); m.generate_surface_reconstruction_screened_poisson(); "
        "m.save_current_mesh('surface.ply')\""
    )
