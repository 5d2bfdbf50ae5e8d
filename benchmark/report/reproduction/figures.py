"""An outcome on each figure of the paper, by rules that were set before any figure of ours was looked at.

The rule on chance came later; it only takes from what counts as reproduced.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from benchmark.api.contracts import Input
from benchmark.protocols.tables import INPUTS
from benchmark.reference import paper
from benchmark.report.content import Row, TableContent
from benchmark.report.rounding import millionths

Outcome = Literal[
    "reproduced", "at chance", "same order", "other data", "other training", "unexplained", "not comparable"
]  # fmt: skip

#: From the best to the worst that can be said. The three before the last are figures that differ, by what else differs.
OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)

#: Distance up to which a figure counts as reproduced: two of the paper's hundredths more than what another draw of the
#: codebook moves NN by on a hundred shapes (median standard deviation .026).
TOLERANCE = 0.05

#: Share of comparisons with the other rows that must point the paper's way, and how many there must be. Of eight
#: coins, six or more fall the same given way once in seven times.
AGREEING = 0.75
FEWEST = 3

#: Scores carry six decimals: a distance within half of the last is no distance.
_SLACK = 5e-7


@dataclass(frozen=True)
class ReproducedFigure:
    """One figure of the paper beside ours.

    Parameters
    ----------
    table
        The paper's numeral.
    method, title
        The row.
    input
        What our methods saw; the paper does not say what its baselines had.
    measure
        The column.
    paper
        As printed.
    ours
        None where there is none.
    chance
        What a random order would score in our gallery; None without a gallery.
    outcome
        What can be said.
    """

    table: str
    method: str
    title: str
    input: Input
    measure: str
    paper: float
    ours: float | None
    chance: float | None
    outcome: Outcome


def paper_tables(tables: Iterable[TableContent]) -> dict[str, TableContent]:
    """The content for each of the paper's tables: of the official set, else of the stand-in; never of a quick run."""
    found: dict[str, TableContent] = {}
    for table in tables:
        identifier = table.identifier
        if identifier not in paper.NUMERALS or table.quick or table.scorer or not table.has_paper:
            continue
        if identifier not in found or found[identifier].data["stand_in_for"]:
            found[identifier] = table
    return found


def reproduced_figures(tables: Iterable[TableContent]) -> list[ReproducedFigure]:
    """Every figure of the paper under each input that its row may have had, in the paper's order.

    Parameters
    ----------
    tables
        All tables that were made; see :func:`paper_tables`.
    """
    contents = paper_tables(tables)
    return [
        figure
        for numeral in paper.NUMERALS
        for input_ in INPUTS
        for figure in _of_table(numeral, contents.get(numeral), input_)
    ]


def _of_table(numeral: str, content: TableContent | None, input_: Input) -> Iterable[ReproducedFigure]:
    ours = {row.method: row for row in content.rows} if content is not None else {}
    rows = {name: row for name, row in paper.rows(numeral).items() if input_ == "view" or not paper.is_learned(name)}
    for name, printed in rows.items():
        for measure in paper.MEASURES:
            told = printed.values[numeral][measure]
            found = _score(ours.get(name), input_, measure)
            others = [
                (other.values[numeral][measure], theirs)
                for of_other, other in rows.items()
                if of_other != name and (theirs := _score(ours.get(of_other), input_, measure)) is not None
            ]
            outcome: Outcome = "not comparable"
            if found is not None and content is not None:
                is_at_chance = is_near(told, content.chance[measure])
                outcome = _outcome(told, found, others, content, ours[name], is_at_chance=is_at_chance)
            chance = content.chance[measure] if content is not None else None
            yield ReproducedFigure(numeral, name, printed.title, input_, measure, told, found, chance, outcome)


def _score(row: Row | None, input_: Input, measure: str) -> float | None:
    cell = row.cells.get(input_) if row is not None else None
    return cell.scores[measure] if cell is not None and cell.scores else None


def _outcome(
    told: float,
    found: float,
    others: Sequence[tuple[float, float]],
    content: TableContent,
    row: Row,
    *,
    is_at_chance: bool,
) -> Outcome:
    if is_near(told, found):
        return "at chance" if is_at_chance else "reproduced"
    if keeps_order(told, found, others):
        return "same order"
    if content.data["stand_in_for"]:
        return "other data"
    return "other training" if row.models else "unexplained"


def is_near(told: float, found: float) -> bool:
    """Return whether a figure is as near to the paper's as one that is reproduced."""
    return abs(told - found) <= TOLERANCE + _SLACK


def keeps_order(told: float, found: float, others: Sequence[tuple[float, float]]) -> bool:
    """Return whether enough comparisons with other rows of the table point the same way.

    Parameters
    ----------
    told, found
        The figure of the paper and ours.
    others
        The same for each other row. Rows that the paper prints as equal are no comparison; a tie of ours is one that
        does not point the paper's way.
    """
    signs = [(told - theirs, millionths(found - ours)) for theirs, ours in others if theirs != told]
    agreeing = sum(printed * measured > 0 for printed, measured in signs)
    return len(signs) >= FEWEST and agreeing >= AGREEING * len(signs)


def mean_distance(figures: Iterable[ReproducedFigure], *, without_nn: bool = False) -> float | None:
    """Mean absolute difference to the paper over its classical rows; None without figures of ours."""
    distances = [
        abs(each.paper - each.ours)
        for each in figures
        if each.ours is not None and not paper.is_learned(each.method) and not (without_nn and each.measure == "NN")
    ]
    return sum(distances) / len(distances) if distances else None
