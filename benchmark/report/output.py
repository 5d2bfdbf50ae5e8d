"""Files of tables, and output folders: a command replaces its own files, and no others."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import msgspec
from pandas import DataFrame, Series

from benchmark.errors import ConfigurationError, UnreadableMesh
from benchmark.files import file_digest, read_file, write_together
from benchmark.pipeline.records import Record
from benchmark.report.columns import scores_frame
from benchmark.report.formats import (
    as_json,
    bibtex_of_tables,
    latex,
    markdown,
    robustness_markdown,
)
from benchmark.report.record_facts import fold_of, of_newest_versions, scored_by
from benchmark.report.table_view import TableView
from benchmark.report.verdicts import verdicts_markdown
from benchmark.text import listed as listed_names
from benchmark.text import say

#: List of the written files with their digests.
WRITTEN_LIST = "written.json"

#: Formats of tables in files.
TABLE_FORMATS = ("latex", "markdown", "csv", "json")


def table_files(
    views: Sequence[TableView],
    records: Sequence[Record],
    formats: Sequence[str] = TABLE_FORMATS,
    *,
    verdicts: bool = True,
    of_robustness: Sequence[Record] = (),
    is_whole: bool = True,
) -> dict[str, str]:
    """Return tables in several formats, as texts by the name of their file.

    LaTeX and Markdown have a file for each table, CSV and JSON one for all. If another scorer or
    seed than the default was used, the names of the files say so.

    Parameters
    ----------
    views
        The tables.
    records
        The records that they come from.
    formats
        Some of :data:`TABLE_FORMATS`.
    verdicts
        Whether to add a Markdown file on the claims of the paper, and whether they hold.
    of_robustness
        The records of the table of robustness, which is added to Markdown and CSV; empty to leave
        it out.
    is_whole
        Whether CSV has all scores of the records, and not those of the rows of these tables alone.
    """
    files: dict[str, str] = {}
    suffix = scored_by(records).suffix
    if "latex" in formats and views:
        for view in views:
            files[f"{view.stem}.tex"] = latex(view)
        files[f"references{suffix}.bib"] = bibtex_of_tables(views)
    if "markdown" in formats:
        for view in views:
            files[f"{view.stem}.md"] = markdown(view)
        if verdicts:
            files[f"reproduction{suffix}.md"] = verdicts_markdown(views)
        files[f"robustness{suffix}.md"] = robustness_markdown(of_robustness)
    if "csv" in formats:
        scores = scores_of_tables(views, records, of_robustness=of_robustness, is_whole=is_whole)
        files[f"scores{suffix}.csv"] = scores.to_csv(index=False, float_format="%.6f")
    if "json" in formats and views:
        files[f"tables{suffix}.json"] = json.dumps(as_json(views), indent=1) + "\n"
    return {name: text for name, text in files.items() if text}  # without empty files


def scores_of_tables(
    views: Sequence[TableView],
    records: Sequence[Record],
    *,
    of_robustness: Sequence[Record],
    is_whole: bool,
) -> DataFrame:
    """Return the scores of the rows that tables print, one value a line.

    Parameters
    ----------
    views
        The tables.
    records
        Records that they come from, and others. Those of other versions of the data, which tables
        leave out, are left out here, too.
    of_robustness
        Those of the table of robustness; empty if it is none of the tables.
    is_whole
        Whether to return all scores of the records, and not those of these rows alone.

    Returns
    -------
    pandas.DataFrame
        As :func:`benchmark.report.columns.scores_frame`.
    """
    scores = scores_frame(of_newest_versions(records))
    if is_whole:
        return scores
    is_printed = Series(data=False, index=scores.index)
    for view in views:
        is_printed |= _are_of_table(scores, view)
    is_printed |= _are_of_robustness(scores, of_robustness)
    return scores[is_printed]


def _are_of_table(scores: DataFrame, view: TableView) -> Series:
    """Return which lines of scores a table prints: of its rows, and of the paper."""
    printed: set[tuple[str, ...]] = set()
    for row in view.printed_rows:
        if row.method in view.paper:
            printed.add((view.dataset, "", row.method, "paper"))
        for record in row.records:
            printed.add((record.data.name, fold_of(record), row.method, record.input))
    places = zip(scores.dataset, scores.fold, scores.method, scores.input, strict=True)
    are_printed = Series([place in printed for place in places], scores.index, dtype=bool)
    return are_printed & (scores.table == view.table.identifier)


def _are_of_robustness(scores: DataFrame, records: Iterable[Record]) -> Series:
    """Return which lines of scores belong to the table of robustness, which has these records."""
    shown = {(record.data.name, record.method) for record in records}
    places = zip(scores.dataset, scores.method, strict=True)
    are_shown = Series([place in shown for place in places], scores.index, dtype=bool)
    return are_shown & (scores.input == "mesh") & (scores.fold == "")


def write_files(
    folder: Path,
    files: Mapping[str, str | bytes],
    *,
    force: bool = False,
    listed: str = WRITTEN_LIST,
) -> None:
    """Write files into a folder, and remove those of the last time that are not written again.

    The removed ones are named on stderr. A list in the folder keeps the digest of each file, by
    which files are found that the user has edited since. These are never removed, and replaced only
    by ``force``.

    Parameters
    ----------
    folder
        The folder, created if necessary.
    files
        Texts or bytes by name.
    force
        Whether to replace files that were edited or come from elsewhere.
    listed
        Name of the list. Files of other lists in the folder are left alone.

    Raises
    ------
    ConfigurationError
        Before anything is written, if a file would be replaced that was edited or that no command
        has written.
    """
    check_folder(folder)
    contents: dict[str, bytes] = {}
    for name, text in files.items():
        contents[name] = text.encode() if isinstance(text, str) else text
    digests = {name: hashlib.sha256(contents[name]).hexdigest() for name in sorted(contents)}
    earlier = _earlier(folder / listed)  # digests of what the last command wrote
    if not force:
        _check_own(folder, digests, earlier)
    # The list belongs to the files: without it, they would count as edited the next time.
    written = {folder / name: data for name, data in contents.items()}
    write_together(written | {folder / listed: json.dumps(digests, indent=0).encode()})
    removed: list[str] = []
    for name in sorted(earlier.keys() - contents.keys()):
        is_unedited = _digest(folder / name) == earlier[name]
        if is_unedited:
            (folder / name).unlink()
            removed.append(name)
    if removed:
        say(f"removed from {folder}, of an earlier command: {listed_names(removed)}", err=True)


def check_folder(folder: Path) -> None:
    """Raise ``ConfigurationError`` if files cannot be written into a folder, as it is a file."""
    if folder.exists() and not folder.is_dir():
        raise ConfigurationError(f"{folder} is not a folder", "choose another one with -o")


def _check_own(folder: Path, digests: Mapping[str, str], earlier: Mapping[str, str]) -> None:
    """Raise ``ConfigurationError`` if a file would be replaced that no command left like this."""
    for name, digest in digests.items():
        present = _digest(folder / name)
        if present and present not in (earlier.get(name), digest):
            what = "was edited" if name in earlier else "was not written by this command"
            raise ConfigurationError(
                f"{folder / name} {what}", "choose another folder with -o, or pass --force"
            )


def _earlier(path: Path) -> dict[str, str]:
    """Return the digests of the files that the last command wrote, by name.

    Parameters
    ----------
    path
        The list of these files. If it is missing or damaged, it counts as empty.
    """
    try:
        listed = msgspec.json.decode(read_file(path), type=dict[str, str])
    except (OSError, msgspec.DecodeError, UnicodeError):
        return {}
    # Listed files may be deleted: leave out names that lead out of the folder of the list.
    root = path.parent.resolve()
    return {
        name: digest
        for name, digest in listed.items()
        if "\0" not in name and (root / name).resolve().is_relative_to(root)
    }


def _digest(path: Path) -> str:
    """Return the digest of a file; "" if nothing is there, and "not a file" for a folder."""
    if not path.exists():
        return ""
    try:
        return file_digest(path)
    except UnreadableMesh:
        return "not a file"
