"""Which differences between rows are significant, and which are larger than the scatter of scores.

A test over classes says nothing about the scatter: two runs of one method would differ as well,
because each draws its codebook and each training starts at its own seed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.defaults import DEFAULT_SCORER
from benchmark.pipeline.records import Record
from benchmark.registry.names import base_name
from benchmark.report.record_facts import block_of
from benchmark.report.rows import RowScores, scores_in
from benchmark.report.statistics import ALPHA, permutation_test

#: Differences below half a unit of the last decimal of records are none.
SAME = 5e-7

#: Standard errors of means over three draws of the codebook, for records that do not hold theirs:
#: those of four methods on complete surfaces of TOSCA, over twelve draws.
DRAW_ERRORS = {"NN": 0.011, "FT": 0.004, "ST": 0.006, "DCG": 0.003}


@dataclass(frozen=True, eq=False)
class ComparedRivals:
    """Rows of a block in one column that can be compared, with the outcome of their tests.

    Parameters
    ----------
    rivals
        Scores of the rows by method, all in the same measures.
    is_significant
        Which differences have p < .05 in the test of all rows and measures, shape (rows, rows,
        measures).
    is_above_scatter
        Which of them are also larger than the scatter of codebooks and trainings.
    """

    rivals: Mapping[str, RowScores]
    is_significant: NDArray[np.bool_]
    is_above_scatter: NDArray[np.bool_]

    @property
    def n_classes(self) -> int:
        """Number of classes over which is tested."""
        return len({*self._first.labels})

    @property
    def measures(self) -> Sequence[str]:
        """Names of the measures that are tested."""
        return self._first.measures

    @property
    def _first(self) -> RowScores:
        """Scores of the first row."""
        return next(iter(self.rivals.values()))

    def marks(self) -> dict[str, dict[str, str]]:
        """Return how the score of each row is marked, by method and measure.

        The best row is marked ``"bold"``; several rows are, if their scores are equal. A row that
        is not significantly worse than the first of these is ``"italic"``. A row that is, but by no
        more than repeated codebooks or trainings differ, is ``"scatter"``. All others have the mark
        "".
        """
        means = _means(self.rivals.values())
        is_best = means >= means.max(axis=0) - SAME
        marks: dict[str, dict[str, str]] = {method: {} for method in self.rivals}
        for number, measure in enumerate(self.measures):
            best = int(is_best[:, number].argmax())  # the first of the best rows
            for row, of_row in enumerate(marks.values()):
                if is_best[row, number]:
                    of_row[measure] = "bold"
                elif not self.is_significant[best, row, number]:
                    of_row[measure] = "italic"
                elif not self.is_above_scatter[best, row, number]:
                    of_row[measure] = "scatter"
                else:
                    of_row[measure] = ""
        return marks


def compare_rivals(rivals: Mapping[str, RowScores]) -> ComparedRivals:
    """Test all differences between some rows, in all measures at once."""
    rows = [*rivals.values()]
    means = _means(rows)
    p_values = permutation_test([row.values for row in rows], rows[0].labels)
    is_significant = p_values < ALPHA
    is_above = np.abs(means[:, None] - means) > scatter_of(rows).largest + SAME
    return ComparedRivals(rivals, is_significant, is_significant & is_above)


class Scatter(NamedTuple):
    """How far the scores of rows may be apart though their methods are equally good.

    Parameters
    ----------
    largest
        The largest difference that may be chance, by measure; infinite where every difference may.
    where
        What a smaller difference is within, in words.
    """

    largest: NDArray[np.float64]
    where: str


def scatter_of(rows: Sequence[RowScores]) -> Scatter:
    """Return by how much the scores of some rows may differ by chance.

    The scorer draws random codebooks: two scores differ by chance up to twice the standard error of
    their difference. Networks are trained with random seeds: their scores differ by chance up to
    the range over seeds and folds, too.

    Parameters
    ----------
    rows
        Scores of the rows that are compared.

    Returns
    -------
    Scatter
        The largest difference that may be chance, by measure, and its cause in words. It is
        infinite if all rows are networks that were trained once.
    """
    measures = rows[0].measures
    records_of_rows = [row.all_records for row in rows]
    squared_errors = [_squared_error(records, measures) for records in records_of_rows]
    # The variance of a difference is the sum of two variances.
    of_codebooks = np.asarray(2 * np.sqrt(2 * np.mean(squared_errors, axis=0)))
    are_networks = all(block_of(records[0]) == "network" for records in records_of_rows)
    if not are_networks:
        return Scatter(of_codebooks, "within the scatter of codebooks")
    ranges = [_range(records, measures) for records in records_of_rows if len(records) > 1]
    if not ranges:
        return Scatter(np.full(len(measures), np.inf), "one training each")
    of_trainings = np.max(ranges, axis=0)
    return Scatter(np.maximum(of_codebooks, of_trainings), "within the spread of trainings")


def _squared_error(records: Sequence[Record], measures: Sequence[str]) -> NDArray[np.float64]:
    """Return the squared standard error, by measure, of a mean over records."""
    squares = np.square([_draw_errors(record, measures) for record in records])
    return np.asarray(squares.sum(axis=0) / len(records) ** 2)


def _draw_errors(record: Record, measures: Sequence[str]) -> list[float]:
    """Return the standard errors of the scores of a record over draws of the codebook.

    They are 0 for a scorer without draws, and infinite for a measure of which none is known.
    """
    errors = record.draw_errors
    if not errors and base_name(record.scorer) == DEFAULT_SCORER:
        errors = DRAW_ERRORS
    unknown = math.inf if errors else 0.0
    return [errors.get(measure, unknown) for measure in measures]


def _range(records: Iterable[Record], measures: Sequence[str]) -> NDArray[np.float64]:
    """Return the range of the scores of records, by measure."""
    scores = [scores_in(record, measures) for record in records]
    return np.asarray(np.ptp(scores, axis=0))


def _means(rows: Iterable[RowScores]) -> NDArray[np.float64]:
    """Return the means of rows, shape (rows, measures)."""
    return np.array([[*row.means.values()] for row in rows])
