"""Files of tables, and output folders: a command replaces its own files, and no others."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from benchmark.errors import ConfigurationError, UnreadableMesh
from benchmark.files import file_digest, read_file, write_atomically, write_text
from benchmark.pipeline.records import Record
from benchmark.report.columns import scores_frame
from benchmark.report.formats import as_json, bibliography, latex, markdown, robustness_markdown
from benchmark.report.frames import scored_by
from benchmark.report.tables import TableView
from benchmark.report.verdicts import verdicts_markdown

#: List of the written files with their digests.
LIST = "written.json"

FORMATS = ("latex", "markdown", "csv", "json")


def table_files(
    views: Sequence[TableView],
    records: Sequence[Record],
    formats: Sequence[str] = FORMATS,
    *,
    verdicts: bool = True,
    robustness: bool = True,
) -> dict[str, str]:
    """Return tables as text by file name: a LaTeX and a Markdown file each, one CSV and one JSON file for all.

    Files of another scorer or seed than the default have other names.

    Parameters
    ----------
    views
        The tables.
    records
        The records that they come from.
    formats
        Some of :data:`FORMATS`.
    verdicts, robustness
        Whether to add what the paper's claims come to, and the table of robustness, to Markdown.
    """
    files, suffix = dict[str, str](), scored_by(records).suffix
    if "latex" in formats:
        files |= {f"{view.stem}.tex": latex(view) for view in views} | {
            f"references{suffix}.bib": bibliography(views)
        }
    if "markdown" in formats:
        files |= {f"{view.stem}.md": markdown(view) for view in views}
        if verdicts and (text := verdicts_markdown(views)):
            files[f"reproduction{suffix}.md"] = text
        if robustness and (text := robustness_markdown(records)):
            files[f"robustness{suffix}.md"] = text
    if "csv" in formats:
        files[f"scores{suffix}.csv"] = scores_frame(records).to_csv(
            index=False, float_format="%.6f"
        )
    if "json" in formats:
        files[f"tables{suffix}.json"] = json.dumps(as_json(views), indent=1) + "\n"
    return files


def write_files(
    folder: Path, files: Mapping[str, str | bytes], *, force: bool = False, listed: str = LIST
) -> None:
    """Write files into a folder, and remove those that the last command wrote there and this one does not.

    Parameters
    ----------
    folder
        The folder, created if necessary.
    files
        Texts or bytes by name.
    force
        Whether to replace files that were edited or come from elsewhere.
    listed
        Name of the list of these files; files of another list are left alone.

    Raises
    ------
    ConfigurationError
        Before anything is written, if a file would be replaced that was edited or that no command
        has written.
    """
    contents = {
        name: text.encode() if isinstance(text, str) else text for name, text in files.items()
    }
    earlier = _earlier(folder / listed)
    for name, data in contents.items():
        present = _digest(folder / name)
        if (
            present
            and not force
            and present not in (earlier.get(name), hashlib.sha256(data).hexdigest())
        ):
            what = "was edited" if name in earlier else "was not written by this command"
            raise ConfigurationError(
                f"{folder / name} {what}", "choose another folder with -o, or pass --force"
            )
    for name, data in contents.items():
        write_atomically(folder / name, lambda file, data=data: file.write(data))  # type: ignore[misc]
    for name in earlier.keys() - contents.keys():
        if _digest(folder / name) == earlier[name]:
            (folder / name).unlink()
    digests = {name: hashlib.sha256(contents[name]).hexdigest() for name in sorted(contents)}
    write_text(folder / listed, json.dumps(digests, indent=0))


def _earlier(path: Path) -> dict[str, str]:
    """Return the digests of the files of the last command, without names outside the folder."""
    try:
        listed = msgspec.json.decode(read_file(path), type=dict[str, str])
    except (OSError, msgspec.DecodeError, UnicodeError):
        return {}
    root = path.parent.resolve()
    return {
        name: digest
        for name, digest in listed.items()
        if "\0" not in name and (root / name).resolve().is_relative_to(root)
    }


def _digest(path: Path) -> str:
    """Return the digest of what lies at a path: "" for nothing, and another text for what is no file."""
    if not path.exists():
        return ""
    try:
        return file_digest(path)
    except UnreadableMesh:
        return "not a file"
