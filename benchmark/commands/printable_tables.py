"""Tables as text in several formats, as files, and in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pandas import DataFrame

from benchmark.pipeline.records import Record
from benchmark.report.columns import scores_frame
from benchmark.report.formats import as_json, latex, markdown, robustness_markdown
from benchmark.report.output import TABLE_FORMATS, table_files, write_files
from benchmark.report.record_facts import scored_by
from benchmark.report.table_view import TableView


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
    has_robustness, has_verdicts
        Whether the table of robustness, and what the paper's claims come to, belong to them.
    """

    views: tuple[TableView, ...]
    records: tuple[Record, ...]
    notes: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    has_robustness: bool = False
    has_verdicts: bool = False

    def __repr__(self) -> str:
        """Return the names of the tables."""
        return f"Tables({', '.join(view.stem for view in self.views)})"

    def markdown(self) -> str:
        """Return them as Markdown."""
        texts = [*map(markdown, self.views)]
        if self.has_robustness:
            texts.append(robustness_markdown(self.records))
        return "\n".join(filter(None, texts))

    def latex(self) -> str:
        r"""Return them for ``\input``; see :func:`benchmark.report.formats.latex`."""
        return "\n".join(map(latex, self.views))

    @property
    def scores(self) -> DataFrame:
        """Their scores, one value a line, as in ``scores.csv``."""
        return scores_frame(self.records)

    @property
    def rows(self) -> DataFrame:
        """A line for each row and column of a table, with the keys of ``tables --format json``."""
        return DataFrame(as_json(self.views))

    def texts(self, format: str) -> list[str]:
        """Return the contents of the files of a format."""
        files = table_files(
            self.views, self.records, [format], verdicts=False, robustness=self.has_robustness
        )
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
            If a file would be replaced that was edited or that no command has written.
        """
        files = table_files(
            self.views,
            self.records,
            formats,
            verdicts=self.has_verdicts,
            robustness=self.has_robustness,
        )
        # A list of the files and their digests, by which later writes find edited ones.
        listed = f"written{scored_by(self.records).suffix}.json"
        write_files(Path(folder), files, force=force, listed=listed)
        return list(files)

    def _repr_markdown_(self) -> str:
        """Show them as Markdown."""
        return self.markdown()
