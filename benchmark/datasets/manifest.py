"""``MANIFEST.tsv``: a list of the meshes in a folder, one per line, with counts and digests for verification."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmark.datasets.files import is_there, text_of
from benchmark.errors import DatasetError, did_you_mean

MANIFEST_FILE = "MANIFEST.tsv"

_COLUMNS = ("file", "class", "pose", "vertices", "faces", "sha256")


@dataclass(frozen=True)
class ManifestRow:
    """A line of a manifest; missing columns are None.

    Parameters
    ----------
    file
        Path of the mesh, relative to the folder.
    subject, pose
        As in :class:`~benchmark.datasets.base.Entry`.
    n_vertices, n_faces
        Counts of the unprocessed mesh.
    sha256
        Digest of the file, in hexadecimal.
    """

    file: str
    subject: str | None = None
    pose: str | None = None
    n_vertices: int | None = None
    n_faces: int | None = None
    sha256: str | None = None


def read_manifest(folder: Path) -> tuple[ManifestRow, ...]:
    """Read the manifest of a folder; returns no rows if there is none.

    Parameters
    ----------
    folder
        Folder with ``MANIFEST.tsv``: tab-separated, with a header line of the columns ``file`` and any of ``class``,
        ``pose``, ``vertices``, ``faces``, ``sha256``.

    Raises
    ------
    ConfigurationError
        If a column is unknown.
    DatasetError
        If the table is invalid, or contains a file twice or a file outside the folder.
    """
    path = folder / MANIFEST_FILE
    if not is_there(path):
        return ()
    lines = text_of(path).rstrip("\n").split("\n")
    columns = lines[0].split("\t")
    if "file" not in columns:
        raise DatasetError(f"the first line of {path} names no column 'file'", f"begin with {'<tab>'.join(_COLUMNS)}")
    for column in columns:
        if column not in _COLUMNS:
            raise did_you_mean(f"column of {path}", column, _COLUMNS)
    rows: dict[str, ManifestRow] = {}
    for number, line in enumerate(lines[1:], start=2):
        cells = line.split("\t")
        if len(cells) != len(columns):
            raise DatasetError(
                f"{path}: line {number} has {len(cells)} cells, not {len(columns)}", "separate the columns by one tab"
            )
        row = _row(dict(zip(columns, cells, strict=True)), f"{path}: line {number}")
        inside(folder, row.file, path)
        if row.file in rows:
            raise DatasetError(f"{path} names {row.file} twice", "keep one of the lines")
        rows[row.file] = row
    return tuple(rows.values())


def write_manifest(folder: Path, rows: Sequence[ManifestRow]) -> None:
    """Write the manifest of a folder, with all columns."""
    lines = [_COLUMNS] + [(r.file, r.subject, r.pose, r.n_vertices, r.n_faces, r.sha256) for r in rows]
    text = "".join("\t".join(map(str, line)) + "\n" for line in lines)
    (folder / MANIFEST_FILE).write_bytes(text.encode())


def inside(folder: Path, name: str, source: Path) -> Path:
    """Return the path of a listed file, which must be inside the folder after resolving links.

    Parameters
    ----------
    folder
        The folder of the data set.
    name
        Path relative to the folder.
    source
        The list, for the error message.

    Raises
    ------
    DatasetError
        If the path is invalid or outside the folder.
    """
    path = folder / name
    try:
        is_inside = path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError) as error:  # NUL, name too long, circular links
        raise DatasetError(f"{source} names {name[:80]!r}, which is no path: {error}", "correct the name") from error
    if not is_inside:
        raise DatasetError(
            f"{source} names '{name}', which lies outside its folder", "copy the mesh into the folder and name it there"
        )
    return path


def _row(cells: dict[str, str], where: str) -> ManifestRow:
    counts = {}
    for column in ("vertices", "faces"):
        if column in cells and not re.fullmatch("[0-9]{1,18}", cells[column]):
            raise DatasetError(f"{where}: {column} are {cells[column][:80]!r}", "write a whole number")
        counts[column] = int(cells[column]) if column in cells else None
    if not cells["file"]:
        raise DatasetError(f"{where} names no file", "complete or remove the line")
    if cells.get("class") == "":
        raise DatasetError(f"{where} names no class", "complete the line or drop the column")
    return ManifestRow(
        cells["file"], cells.get("class"), cells.get("pose"), counts["vertices"], counts["faces"], cells.get("sha256")
    )
