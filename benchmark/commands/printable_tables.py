"""Tables as text in several formats, as files, and in a notebook."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from pandas import DataFrame

from benchmark.errors import ConfigurationError
from benchmark.pipeline.records import Record
from benchmark.report.formats import as_json, latex, markdown, robustness_markdown
from benchmark.report.output import TABLE_FORMATS, scores_of_tables, table_files, write_files
from benchmark.report.record_facts import scored_by
from benchmark.report.table_view import TableView
from benchmark.text import listed


@dataclass(frozen=True, eq=False, repr=False)
class Tables:
    """Tables of finished jobs; a notebook shows them.

    Parameters
    ----------
    views
        The tables.
    records
        The records that they come from.
    notes
        What was left out, and how to see it.
    refused
        Folders of the submissions that have no row.
    of_robustness
        The records of the table of robustness; empty if it is none of them.
    is_whole
        Whether no table and no method was left out. What the paper's claims come to, and scores
        that no table prints, then belong to them.
    """

    views: tuple[TableView, ...]
    records: tuple[Record, ...]
    notes: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    of_robustness: tuple[Record, ...] = ()
    is_whole: bool = False

    def __repr__(self) -> str:
        """Return the names of the tables."""
        return f"Tables({', '.join(view.stem for view in self.views)})"

    def markdown(self) -> str:
        """Return them as Markdown."""
        texts = [*map(markdown, self.views), robustness_markdown(self.of_robustness)]
        return "\n".join(filter(None, texts))

    def latex(self) -> str:
        r"""Return them for ``\input``; see :func:`benchmark.report.formats.latex`."""
        _check_is_something(self.views, ["latex"])
        return "\n".join(map(latex, self.views))

    @property
    def scores(self) -> DataFrame:
        """Their scores, one value a line, as in ``scores.csv``."""
        return scores_of_tables(
            self.views,
            self.records,
            of_robustness=self.of_robustness,
            is_whole=self.is_whole,
        )

    @property
    def rows(self) -> DataFrame:
        """A line for each row and column of a table, with the keys of ``tables --format json``."""
        return DataFrame(as_json(self.views))

    def texts(self, format: str) -> list[str]:
        """Return the contents of the files of a format."""
        files = self._files([format], verdicts=False)
        _check_is_something(files, [format])
        return list(files.values())

    def write(
        self, folder: str | Path, formats: Sequence[str] = TABLE_FORMATS, *, force: bool = False
    ) -> list[str]:
        """Write the tables as files, and return the names of the files.

        Parameters
        ----------
        folder
            The folder, created if necessary.
        formats
            Some of ``"latex"``, ``"markdown"``, ``"csv"`` and ``"json"``.
        force
            Whether to replace files that were edited or come from elsewhere.

        Raises
        ------
        ConfigurationError
            If a file would be replaced that was edited or that no command has written, or there is
            no table in these formats.
        """
        files = self._files(formats, verdicts=self.is_whole)
        _check_is_something(files, formats)
        # A list of the files and their digests, by which later writes find edited ones.
        list_of_files = f"written{scored_by(self.records).suffix}.json"
        write_files(Path(folder), files, force=force, listed=list_of_files)
        return list(files)

    def _files(self, formats: Sequence[str], *, verdicts: bool) -> dict[str, str]:
        """Return the files of some formats, as texts by name."""
        return table_files(
            self.views,
            self.records,
            formats,
            verdicts=verdicts,
            of_robustness=self.of_robustness,
            is_whole=self.is_whole,
        )

    def _repr_markdown_(self) -> str:
        """Show them as Markdown."""
        return self.markdown()


def _check_is_something(found: Collection[object], formats: Sequence[str]) -> None:
    """Raise ``ConfigurationError`` if there is nothing in some formats.

    The table of robustness is in Markdown, and its scores are in CSV.
    """
    if not found:
        problem = f"the table of robustness is not in {listed(formats)}"
        raise ConfigurationError(problem, "take markdown, or csv for its scores")
