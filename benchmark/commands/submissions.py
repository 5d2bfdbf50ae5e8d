"""Rows of others: folders with distances or forms and a ``submission.toml``, which are scored here.

Nothing in a submission is run: its files are data.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec

from benchmark.api.contracts import Input
from benchmark.commands.external_rows import record_beside, record_of_distances
from benchmark.commands.plan import plan
from benchmark.commands.run import records_after, run_plan
from benchmark.commands.score import score
from benchmark.commands.selection import check_input
from benchmark.datasets.mesh_files import files_beside
from benchmark.datasets.settings import read_settings
from benchmark.errors import BenchmarkError, ConfigurationError, check_known
from benchmark.pipeline.records import Origin, Record
from benchmark.text import brief, counted, listed

#: Name of the file that describes a submission.
SUBMISSION = "submission.toml"

#: Folder of the results folder that keeps what forms of submissions scored.
KEPT = "submissions"

#: What each submission says, and what the keys mean.
REQUIRED = {
    "method": "its name in tables",
    "authors": "a list of names",
    "trained_on": "the data that it was trained on; 'nothing' for a method that does not learn",
    "seen": "a list of the classes of the test set that were in its training data; [] for none",
    "compute": "machine and time",
    "licence": "of the distances or forms",
    "citation": "a BibTeX entry or a sentence",
    "code": "an address, or why there is none",
    "data": "the data set whose shapes are compared",
}

#: What is scored: one of these.
SCORED = ("distances", "forms")

#: What else a submission may say.
_OPTIONAL = ("input", *SCORED)

#: Keys whose values are lists of text; all others are text.
_LISTS = ("authors", "seen")


@dataclass(frozen=True)
class Submission:
    """What a ``submission.toml`` says.

    Parameters
    ----------
    folder
        The folder of the submission.
    facts
        Values by key.
    input
        Whether the method saw complete surfaces or views.
    scored
        The file of distances, or the folder of forms.
    """

    folder: Path
    facts: Mapping[str, Any]
    input: Input
    scored: Path

    @property
    def title(self) -> str:
        """The title of its row, which says that others brought it."""
        return brief(f"{self.facts['method']} (submitted)")

    @property
    def in_words(self) -> str:
        """What a table says of it."""
        facts = self.facts
        kind = "a folder of forms" if self.scored.is_dir() else "distances"
        sentence = (
            f"{self.title}: scored here from {kind} by {listed(facts['authors'])}; "
            f"trained on {facts['trained_on']}; compute: {facts['compute']}; "
            f"licence: {facts['licence']}; code: {facts['code']}; {facts['citation']}"
        )
        return brief(sentence, 2000)


@dataclass(frozen=True)
class SubmittedRows:
    """Rows of others.

    Parameters
    ----------
    records
        A record of each submission with scores.
    notes
        What each submission says of itself, and why others have no row.
    refused
        Folders of the submissions without a row.
    """

    records: tuple[Record, ...]
    notes: tuple[str, ...]
    refused: tuple[str, ...] = ()


def submitted_rows(folder: str | Path, results: str | Path) -> SubmittedRows:
    """Score the submissions in the sub-folders of a folder.

    Parameters
    ----------
    folder
        The folder; each of its sub-folders with a ``submission.toml`` is a submission.
    results
        The results folder, beside whose rows they are shown.

    Returns
    -------
    SubmittedRows
        A record for each submission that can be scored, a sentence on every submission, and the
        folders of those that cannot be scored.

    Raises
    ------
    ConfigurationError
        If there is no submission.
    """
    paths = sorted(Path(folder).glob(f"*/{SUBMISSION}"))
    if not paths:
        problem = f"no folder in {folder} has a {SUBMISSION}"
        raise ConfigurationError(problem, "see docs/how-to/submit.md")
    records = list[Record]()
    notes = list[str]()
    refused = list[str]()
    for path in paths:
        try:
            submission = read_submission(path)
            record = score_submission(submission, Path(results))
            _check_name(record, records)
        except BenchmarkError as error:
            notes.append(f"no row: {path.parent}: {error}")
            refused.append(str(path.parent))
            continue
        records.append(record)
        notes.append(submission.in_words)
        notes += _lacking(record)
    return SubmittedRows(tuple(records), tuple(notes), tuple(refused))


def _check_name(record: Record, others: Iterable[Record]) -> None:
    """Raise ``ConfigurationError`` if another submission has the row of a record."""
    if any(other.row == record.row for other in others):
        raise ConfigurationError("another submission has its name", "choose another 'method'")


def _lacking(record: Record) -> list[str]:
    """Return a note of the shapes that have no result in a submission, if there are any."""
    if not record.unsupported:
        return []
    number = f"{len(record.unsupported)} of {counted(len(record.shapes), 'shape')}"
    reasons = "; ".join(f"{name}: {reason}" for name, reason in record.unsupported)
    return [brief(f"{record.title}: {number} without a result count 0: {reasons}", 2000)]


def read_submission(path: Path) -> Submission:
    """Read and check the ``submission.toml`` of a submission.

    Parameters
    ----------
    path
        The file; the distances or forms that it names lie in its folder.

    Raises
    ------
    BenchmarkError
        If it cannot be read, lacks a key, or has an unknown one or a value of another kind, or if
        a link in its folder leads out of it.
    """
    _check_links(path.parent)
    facts = read_settings(path, [*REQUIRED, *_OPTIONAL])
    for key, value in facts.items():
        _check_value(key, value)
    missing = [key for key in REQUIRED if facts.get(key) in (None, "")]
    if missing:
        said = "; ".join(f"{key}: {REQUIRED[key]}" for key in missing)
        raise ConfigurationError(f"it does not say {listed(missing)}", f"write {said}")

    input_ = facts.get("input", "mesh")
    check_input(input_)
    return Submission(path.parent, facts, input_, _scored_path(path.parent, facts))


def _scored_path(folder: Path, facts: Mapping[str, Any]) -> Path:
    """Return the path of what is scored: a file of distances, or a folder of forms.

    Parameters
    ----------
    folder
        Folder of the submission, in which it has to lie.
    facts
        Values of the ``submission.toml`` by key.

    Raises
    ------
    ConfigurationError
        If both or none are named, or the path leads out of the folder, or nothing is there.
    """
    given = [key for key in SCORED if key in facts]
    if len(given) != 1:
        raise ConfigurationError(
            f"it names {listed(given) or 'neither distances nor forms'}",
            'write distances = "FILE" or forms = "FOLDER"',
        )
    kind = given[0]
    name: str = facts[kind]
    scored = folder / name
    if not scored.resolve().is_relative_to(folder.resolve()):
        raise ConfigurationError(f"{name} lies outside of it", "put it into its folder")
    is_there = scored.is_dir() if kind == "forms" else scored.is_file()
    if not is_there:
        raise ConfigurationError(f"its {kind} {name} are not there", "add them")
    return scored


def _check_links(folder: Path) -> None:
    """Raise ``ConfigurationError`` if a submission leads out of its folder, by a link or a mesh.

    A submission is data of somebody else: what it scores must be in it, also the files that a mesh
    names, such as the buffers of glTF.
    """
    inside = os.path.realpath(folder)
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder)
        if path.is_symlink() and not _is_inside(path, inside):
            problem = f"the link {name} leads out of it"
            raise ConfigurationError(problem, "put the file itself in its place")
        for other in files_beside(path):
            if not _is_inside(other, inside):
                problem = f"the mesh {name} names a file that lies outside of it"
                raise ConfigurationError(problem, "put that file into its folder")


def _is_inside(path: Path, folder: str) -> bool:
    """Return whether a path, of which links are followed, also circular ones, is in a folder."""
    try:
        return Path(os.path.realpath(path)).is_relative_to(folder)
    except ValueError:  # a name that no file can have
        return False


def _check_value(key: str, value: object) -> None:
    """Raise ``ConfigurationError`` unless a value is text, or a list of texts where one belongs."""
    if key in _LISTS:
        is_right = isinstance(value, list) and all(isinstance(each, str) for each in value)
        wanted = "a list of texts"
    else:
        is_right = isinstance(value, str)
        wanted = "text"
    if not is_right:
        raise ConfigurationError(f"'{key}' is not {wanted}", f"write {wanted} in quotes")


def score_submission(submission: Submission, results: Path) -> Record:
    """Score a submission against the shapes of its data set, and return its record.

    Parameters
    ----------
    submission
        What it says of itself, and its distances or forms.
    results
        The results folder. Its records of the data set say which shapes this has.

    Raises
    ------
    BenchmarkError
        If its shapes or classes are not those of the data set, or nothing can be scored.
    """
    data = submission.facts["data"]
    beside = record_beside(results, data, submission.input, submission.title)
    if beside is None:
        raise ConfigurationError(f"'{data}' is no data set with rows here", "name one of tables")
    check_known("class", submission.facts["seen"], beside.labels)
    if submission.scored.is_dir():
        record = _score_forms(submission, beside, results)
    else:
        labels = dict(zip(beside.shapes, beside.labels, strict=True))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that distances may be similarities
            evaluation = score(submission.scored, labels)
        record, _ = record_of_distances(
            evaluation, beside, data, title=submission.title, input_=submission.input
        )
    # Shapes of classes on which the method was trained decide no claim.
    seen_classes = set(submission.facts["seen"])
    labelled = zip(record.shapes, record.labels, strict=True)
    seen_shapes = [shape for shape, label in labelled if label in seen_classes]
    origin = Origin(folder=submission.folder.name)
    return msgspec.structs.replace(record, seen=seen_shapes, merged_from=origin)


def _score_forms(submission: Submission, beside: Record, results: Path) -> Record:
    """Score the forms of a submission, as a run scores those of a method, and return the record.

    Parameters
    ----------
    submission
        The submission, with a folder of forms.
    beside
        A record of the shapes that they are forms of. Parts of these, which a run would also rank,
        are left out.
    results
        The results folder. What is computed is kept in a folder of its own there.

    Raises
    ------
    ConfigurationError
        If the forms have no scores; the error says why.
    """
    planned = plan(
        [beside.data.path or submission.facts["data"]],  # a folder may be called as in tables
        forms={submission.title: submission.scored},
        input=submission.input,
        results=results / KEPT,
        rerun=["failed"],
    )
    jobs = tuple(job for job in planned.jobs if job.record.gallery == beside.gallery)
    planned = replace(planned, jobs=jobs)
    ended = list(run_plan(planned))
    (record,) = planned.known_records(records_after(planned, ended))
    if record.status != "ok":
        raise ConfigurationError(f"its forms have no scores: {record.reason}", "correct them")
    return record
