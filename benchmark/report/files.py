"""Table files: rendering, writing, and telling whether those on disk are up to date."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path

from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.files import sweep, write_text
from benchmark.report.content import TableContent
from benchmark.report.formats import as_csv, as_json, markdown
from benchmark.report.latex import Notes, latex_files, latex_rows
from benchmark.report.reproduction.document import reproduction_markdown
from benchmark.report.reproduction.figures import paper_tables
from benchmark.report.statistics.document import has_splits, intervals_markdown, splits_markdown

#: Characters by which a file of ours is known again: they tell its kind and name, and no figure.
_HEAD = 16

#: First line of the BibTeX file, by which it is told from the list of somebody's paper.
_BIBLIOGRAPHY = (
    "% Sources of the canonical forms benchmark, written by 'tables'; keep entries of your own elsewhere.\n\n"
)


def render(
    tables: Sequence[TableContent], formats: Iterable[str], where: Notes = "table", *, has_variants: bool = True,
    rows_only: bool = False, has_sources: bool = True,
) -> dict[str, str]:  # fmt: skip
    """Texts by file name: LaTeX and Markdown files per table, one CSV and JSON file for all.

    Parameters
    ----------
    tables, formats
        The tables, and names of formats.
    where, has_variants
        For LaTeX, see :func:`benchmark.report.latex.latex_files`.
    rows_only
        Whether LaTeX is the rows of each table alone.
    has_sources
        Whether the BibTeX entries of the methods, the scorer and the data come with LaTeX.
    """
    files: dict[str, str] = {}
    for name in formats:
        if name == "latex":
            rows = {f"{table.file_stem}.tex": latex_rows(table) for table in tables if rows_only}
            files |= rows or latex_files(tables, where, has_variants=has_variants)
            files |= {"references.bib": bibliography()} if has_sources else {}
        elif name == "markdown":
            files |= {f"{table.file_stem}.md": markdown(table) for table in tables}
            files |= {f"splits-{t.file_stem}.md": splits_markdown(t) for t in tables if has_splits(t)}
            files |= {f"intervals-{t.file_stem}.md": intervals_markdown(t) for t in tables if t.significance}
            files |= {"reproduction.md": reproduction_markdown(tables)} if paper_tables(tables) else {}
        elif name == "csv":
            files["tables.csv"] = as_csv(tables)
        else:
            files["tables.json"] = as_json(tables)
    return files


def bibliography() -> str:
    """Return the BibTeX file of the sources of methods, scorers and data."""
    return _BIBLIOGRAPHY + resources.files("benchmark.reference").joinpath("references.bib").read_text(encoding="utf-8")


def write(files: Mapping[str, str], folder: Path, *, force: bool = False) -> None:
    """Write the files into a folder, which is made if need be; each is whole, or what it was before.

    Raises
    ------
    ConfigurationError
        If one would take the place of a file that is no such table: one that begins otherwise. Not with force.
    BenchmarkError
        If they cannot be written.
    """
    found = {name: _content(folder / name) or "" for name in files if (folder / name).exists()}
    strange = [name for name, text in found.items() if not text.startswith(files[name][:_HEAD])]
    if strange and not force:
        raise ConfigurationError(
            f"{folder / strange[0]} was not written by 'tables'",
            "choose another folder with -o, or pass --force to replace it",
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            write_text(folder / name, text)
        sweep(folder, deep=False)
    except OSError as error:
        raise BenchmarkError(
            f"cannot write to {folder}: {error.strerror}", "free some space or choose another folder with -o"
        ) from error


def stale(files: Mapping[str, str], folder: Path) -> list[str]:
    """Names of files that are missing in a folder or differ from what they should hold."""
    return [name for name, text in files.items() if _content(folder / name) != text]


def _content(path: Path) -> str | None:
    """Return what a file holds; None where there is none that can be read."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return None
