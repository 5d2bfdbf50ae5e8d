"""Tables as files: texts by name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib import resources

from benchmark.report.content import TableContent
from benchmark.report.formats import as_csv, as_json, markdown
from benchmark.report.latex import Notes, latex_files, latex_rows
from benchmark.report.reproduction.document import reproduction_markdown
from benchmark.report.reproduction.figures import paper_tables
from benchmark.report.statistics.document import has_splits, intervals_markdown, splits_markdown

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
