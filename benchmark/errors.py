"""Every error that a user can cause, each with the hint in its message."""

from __future__ import annotations

from collections.abc import Iterable, Mapping


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
        # A method may pass anything.
        self.problem = str(problem)
        self.hint = str(hint) if hint else ""
        super().__init__(self.problem, self.hint)

    def __str__(self) -> str:
        return f"{self.problem}; {self.hint}" if self.hint else self.problem


class ConfigurationError(BenchmarkError):
    """The command line or a plugin asks for something that does not exist or does not fit."""


class DatasetError(BenchmarkError):
    """A data set is missing, unreadable, or unfit for retrieval."""


class ShapeError(BenchmarkError):
    """A problem of one shape: it is counted under the table, and the others go on."""


class TrainingError(BenchmarkError):
    """Training cannot go on: a loss that is not a number, no memory, a checkpoint that does not fit."""


class UnreadableMesh(ShapeError):
    """A mesh file is missing, truncated, or not what its extension says."""


class InvalidMesh(ShapeError):
    """A mesh was read but its content cannot be used: NaN, faces out of range, nothing left after cleaning."""


class InvalidForm(ShapeError):
    """A method returned what is no canonical form, no descriptor or no distances: the fault is the method's."""


class InvalidSignature(ShapeError):
    """A scorer returned what is no signature of a form: the fault is the scorer's."""


class UnsupportedShape(ShapeError):
    """A method cannot treat this shape; the message says why."""


def as_facts(error: BenchmarkError) -> dict[str, str]:
    """Return an error as texts, by which another process raises it again; see :func:`from_facts`."""
    kinds = (each for each in type(error).__mro__ if globals().get(each.__name__) is each)
    return {"kind": next(kinds).__name__, "problem": error.problem, "hint": error.hint}


def from_facts(facts: Mapping[str, str]) -> BenchmarkError:
    """Build the error that :func:`as_facts` described; one of a kind that is not of this module is plain."""
    kind = globals().get(str(facts["kind"]))
    if not (isinstance(kind, type) and issubclass(kind, BenchmarkError)):
        kind = BenchmarkError
    return kind(facts["problem"], facts["hint"])


def message(error: BaseException) -> str:
    """Message of an exception, which code of somebody else may have to tell."""
    try:
        return str(error)
    except (Exception, SystemExit, GeneratorExit):
        return "its message cannot be read"


def one_line(error: BaseException) -> str:
    """Class and message of an exception, on one line."""
    said = " ".join(message(error).split())
    return f"{type(error).__name__}: {said}" if said else type(error).__name__


#: Names that an error tells where a verb lists them all, and that verb by what the name stands for.
_FEW = 6
_LISTED_BY = {"method": "list methods", "scorer": "list scorers", "data set": "list datasets", "table": "list tables"}


def did_you_mean(kind: str, name: str, known: Iterable[str]) -> ConfigurationError:
    """Build the error for an unknown name, with the nearest known ones, or some of them and the verb that lists all.

    Parameters
    ----------
    kind
        What the name stands for: ``"method"``, ``"data set"``.
    name
        The name that is not known.
    known
        The names that are.
    """
    import difflib

    names = sorted(known)
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    verb = _LISTED_BY.get(kind)
    if near:
        hint = f"did you mean {' or '.join(near)}?"
    elif verb and len(names) > _FEW:
        hint = f"choose one of {', '.join(names[:_FEW])} ...: '{verb}' names all {len(names)}"
    else:
        hint = f"choose one of {', '.join(names)}"
    return ConfigurationError(f"unknown {kind} '{name}'", hint)
