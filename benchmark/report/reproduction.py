"""Reproduction of the paper's tables: an outcome for each of its scores and claims.

The rules were fixed before any of our scores was known. The rule on chance level was added later and only reduces the
number of reproduced scores.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from benchmark.api.contracts import Input
from benchmark.protocols.tables import INPUTS
from benchmark.reference.paper import CLAIMS, MEASURES, NUMERALS, Claim, is_learned, rows
from benchmark.report.content import TableContent
from benchmark.report.escaping import (
    BLANK,
    markdown_document,
    markdown_line,
    markdown_table,
    markdown_text,
    millionths,
    number,
)
from benchmark.report.significance import ALPHA, class_permutation_test, holm, queries_of
from retrieval.measures import PRINTED

if TYPE_CHECKING:
    from pandas import DataFrame

Outcome = Literal[
    "reproduced", "at chance", "same order", "other data", "other training", "unexplained", "not comparable"
]  # fmt: skip

#: Outcomes from best to worst. The three before the last are scores that differ, by reason.
OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)

#: Mark next to our score, by outcome.
_MARKS = dict(zip(OUTCOMES, ("=", "c", "~", "d", "t", "x", ""), strict=True))

Decision = Literal["supported", "contradicted", "undecided", "not comparable"]

#: Largest difference of a reproduced score from the paper's: two hundredths more than the standard deviation of NN over
#: draws of the codebook on a hundred shapes (median .026).
TOLERANCE = 0.05

#: Minimum fraction of comparisons with other rows that must agree with the paper, and minimum number of comparisons. Of
#: eight coin tosses, six or more are heads with probability 1/7.
AGREEING = 0.75
FEWEST = 3

#: Scores have six decimals; half a unit of the last one counts as no difference.
_SLACK = 5e-7


def paper_tables(tables: Iterable[TableContent]) -> dict[str, TableContent]:
    """Return the content of each of the paper's tables, for official data or the stand-in, without quick runs."""
    contents: dict[str, TableContent] = {}
    for table in tables:
        identifier = table.identifier
        is_comparable = identifier in NUMERALS and table.has_paper and not (table.quick or table.scorer)
        if is_comparable and (identifier not in contents or contents[identifier].data["stand_in_for"]):
            contents[identifier] = table
    return contents


def reproduced_figures(tables: Iterable[TableContent]) -> DataFrame:
    """Return each score of the paper, for every input that its row may have used, in the paper's order.

    Parameters
    ----------
    tables
        All tables; see :func:`paper_tables`.

    Returns
    -------
    pandas.DataFrame
        ``table`` (numeral), ``method``, ``title``, ``input`` of ours (the paper does not state that of its baselines),
        ``measure``, ``paper`` as printed, ``ours`` (NaN if missing), ``chance`` (the chance level of our gallery) and
        ``outcome``.
    """
    from pandas import DataFrame

    contents = paper_tables(tables)
    figures = [
        {"table": numeral, "method": method, "title": row.title, "input": input_, "measure": measure}
        | {"paper": row.values[numeral][measure], "ours": np.nan, "chance": np.nan, "differs": "not comparable"}
        | _ours(contents.get(numeral), method, input_, measure)
        for numeral in NUMERALS
        for input_ in INPUTS
        for method, row in rows(numeral).items()
        if input_ == "view" or not is_learned(method)
        for measure in MEASURES
    ]
    frame = DataFrame(figures)
    outcomes = dict(frame["differs"])
    for _, column in frame.groupby(["table", "input", "measure"]):
        outcomes |= _outcomes(column)
    return frame.assign(outcome=frame.index.map(outcomes)).drop(columns="differs")


def _ours(content: TableContent | None, method: str, input_: Input, measure: str) -> dict[str, float | str]:
    """Return our score, the chance level, and the outcome if the score differs."""
    if content is None:
        return {}
    chance: dict[str, float | str] = {"chance": content.chance[measure]}
    line = content.line(method, input_)
    if line is None or not line.is_complete:
        return chance
    differs = "other data" if content.data["stand_in_for"] else "other training" if line.models else "unexplained"
    return chance | {"ours": line.scores[measure], "differs": differs}


def _outcomes(column: DataFrame) -> dict[int, Outcome]:
    """Return the outcomes of the reproduced scores of one measure, by index in the frame."""
    known = column.dropna(subset="ours")
    pairs = dict(zip(known.index, zip(known["paper"], known["ours"], strict=True), strict=True))
    outcomes: dict[int, Outcome] = {}
    for place, (theirs, ours) in pairs.items():
        if is_near(theirs, ours):
            outcomes[place] = "at chance" if is_near(theirs, column["chance"][place]) else "reproduced"
        elif keeps_order(theirs, ours, [pair for other, pair in pairs.items() if other != place]):
            outcomes[place] = "same order"
    return outcomes


def is_near(theirs: float, ours: float) -> bool:
    """Return whether a score is close enough to the paper's to count as reproduced."""
    return abs(theirs - ours) <= TOLERANCE + _SLACK


def keeps_order(theirs: float, ours: float, others: Sequence[tuple[float, float]]) -> bool:
    """Return whether enough comparisons with other rows of the table agree with the paper.

    Parameters
    ----------
    theirs, ours
        Score of the paper, and ours.
    others
        The same for each other row. Rows that are equal in the paper are not compared; a tie between ours disagrees
        with the paper.
    """
    signs = [(theirs - their, millionths(ours - our)) for their, our in others if their != theirs]
    agreeing = sum(printed * measured > 0 for printed, measured in signs)
    return len(signs) >= FEWEST and agreeing >= AGREEING * len(signs)


@dataclass(frozen=True)
class AssessedClaim:
    """Outcome of a claim, judged by our queries.

    Parameters
    ----------
    claim
        The claim.
    decision
        Supported: the row leads significantly in every comparison. Contradicted: it is significantly behind in at least
        one. Undecided: neither.
    leads, n_comparisons
        Number of comparisons in which the row leads, and of all comparisons: rows times measures.
    certain
        Number of comparisons whose sign is significant for other subjects.
    missing
        Rows without scores, or with a gallery or training missing.
    """

    claim: Claim
    decision: Decision
    leads: int = 0
    n_comparisons: int = 0
    certain: int = 0
    missing: tuple[str, ...] = ()


def assess_claims(contents: Mapping[str, TableContent], claims: Sequence[Claim] = CLAIMS) -> list[AssessedClaim]:
    """Judge each claim by permutation tests over classes of all folds, with Holm's correction over its comparisons.

    Parameters
    ----------
    contents
        Content by the paper's numeral; see :func:`paper_tables`.
    claims
        The claims.
    """
    return [_assess(claim, contents[claim.table].lines if claim.table in contents else ()) for claim in claims]


def _assess(claim: Claim, lines: Iterable[Any]) -> AssessedClaim:
    records = {line.method: line.records for line in lines if line.input == claim.input and line.is_complete}
    names = (claim.better, *claim.others)
    if missing := tuple(name for name in names if name not in records):
        return AssessedClaim(claim, "not comparable", missing=missing)
    columns = [PRINTED.index(name) for name in claim.measures]
    pairs = [over_trainings(records[claim.better], records[name]) for name in claim.others]
    totals = np.concatenate([leads[columns] for leads, _ in pairs])
    certain = np.array(holm(np.concatenate([probabilities[columns] for _, probabilities in pairs]))) < ALPHA
    decision: Decision = "undecided"
    if np.any(certain & (totals < 0)):
        decision = "contradicted"
    elif np.all(certain & (totals > 0)):
        decision = "supported"
    return AssessedClaim(claim, decision, int((totals > 0).sum()), len(totals), int(certain.sum()))


def over_trainings(
    better: Sequence[Mapping[str, Any]], other: Sequence[Mapping[str, Any]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compare two rows whose networks may have several trainings for a gallery.

    Parameters
    ----------
    better, other
        Records with scores of each row.

    Returns
    -------
    tuple of numpy.ndarray
        By printed measure: the total lead of the first row, averaged over trainings; and the largest p-value of
        :func:`class_permutation_test` over pairs of trainings, or 1 if one of them has the opposite sign.
    """
    leads = queries_of([other, better]).gains(0, 1)[0].sum(axis=0)
    pairs = [queries_of(pair).gains(0, 1) for pair in product(_trainings(other), _trainings(better))]
    agrees = [np.sign(gains.sum(axis=0)) == np.sign(leads) for gains, _ in pairs]
    return leads, np.where(agrees, [class_permutation_test(*pair) for pair in pairs], 1.0).max(axis=0)


def _trainings(records: Sequence[Mapping[str, Any]]) -> list[list[Mapping[str, Any]]]:
    """Return the records of each training; galleries with fewer trainings repeat some of them."""
    galleries: dict[str, list[Mapping[str, Any]]] = {}
    for record in records:
        galleries.setdefault(record["gallery"], []).append(record)
    count = max(map(len, galleries.values()))
    return [[of[k % len(of)] for of in galleries.values()] for k in range(count)]


def reproduction_markdown(tables: Sequence[TableContent]) -> str:
    """Return the outcomes of the paper's scores and claims as Markdown: counts, claims, inputs, all scores."""
    contents, figures = paper_tables(tables), reproduced_figures(tables)
    of_tables = [(numeral, contents.get(str(numeral)), _figures(part)) for numeral, part in figures.groupby("table")]
    return markdown_document(
        "reproduction", counts=_counts(figures), claims=_claims(assess_claims(contents)), distances=_distances(figures),
        tables=of_tables, tolerance=TOLERANCE, agreeing=AGREEING, fewest=FEWEST,
    )  # fmt: skip


def _counts(figures: DataFrame) -> Markup:
    """Return the number of scores by table, input and outcome."""
    body = []
    for input_ in INPUTS:
        of_input = figures[figures["input"] == input_]
        for numeral, of_table in [*of_input.groupby("table"), ("all", of_input)]:
            outcomes = of_table["outcome"].value_counts().reindex(OUTCOMES, fill_value=0)
            body.append([str(numeral), input_, *map(str, (len(of_table), *outcomes))])
    return markdown_table(["Table", "input", "figures", *OUTCOMES], body, 2)


def _claims(assessed: Sequence[AssessedClaim]) -> Markup:
    """Return each claim with its decision."""
    body = []
    for one in assessed:
        decision: str = one.decision
        if one.missing:
            decision += f": no scores of {', '.join(one.missing[:3])}{' ...' if len(one.missing) > 3 else ''}"
        counts = (f"{one.leads} of {one.n_comparisons}", str(one.certain)) if one.n_comparisons else (BLANK, BLANK)
        words = (one.claim.words, f"{one.claim.table}, {one.claim.input}", decision)
        body.append([*map(markdown_line, words), *counts])
    return markdown_table(["Claim of the paper", "table", "decision", "leads", "certain"], body, 3)


def _distances(figures: DataFrame) -> Markup:
    """Return the differences of our classical rows, by input, and of the chance level from the paper's scores."""
    body = []
    known = figures[figures["ours"].notna() & ~figures["method"].map(is_learned)]
    for numeral, of_table in known.groupby("table"):
        by_input = {input_: of_table[of_table["input"] == input_] for input_ in INPUTS}
        longest = max(by_input.values(), key=len)
        for name, chosen in (by_input | {"chance level": longest.assign(ours=longest["chance"])}).items():
            distances = (chosen["paper"] - chosen["ours"]).abs()
            if len(chosen):
                means = (distances.mean(), distances[chosen["measure"] != "NN"].mean())
                near = int((distances <= TOLERANCE + _SLACK).sum())
                body.append([str(numeral), name, str(len(chosen)), *(number(mean, 3) for mean in means), str(near)])
    head = ["Table", "input", "figures", "all measures", "without NN", f"within {TOLERANCE:.2f}"]
    return markdown_table(head, body, 2)


def _figures(of_table: DataFrame) -> Markup:
    """Return the paper's scores, ours and marks of outcomes, with a row for each method and input."""
    body = []
    for (_, title, input_), of_row in of_table.groupby(["method", "title", "input"], sort=False):
        cells = zip(of_row["paper"], of_row["ours"], of_row["outcome"], strict=True)
        texts = [f"{number(theirs)} {number(ours)} {_MARKS[outcome]}".rstrip() for theirs, ours, outcome in cells]
        body.append([markdown_text(title), str(input_), *texts])
    return markdown_table(["Method", "input", *MEASURES], body, 2)
