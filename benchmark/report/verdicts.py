"""What of the paper holds: verdicts on its figures for TOSCA, the only official set here, and on its claims.

The rules of :data:`TOLERANCE` and :data:`AGREEING` were committed with their first outcome (394cbf19), a day after our
scores of TOSCA (769b38d8). Stand-ins give no verdicts on figures, because an equal figure on other data shows nothing;
claims and orders can be compared.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations, product
from textwrap import wrap
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from benchmark.protocols.tables import TABLES, TITLES
from benchmark.reference.paper import CLAIMS, CLASSICAL, MEASURES, PRINTED, Claim
from benchmark.report.formats import hundredths, markdown_table
from benchmark.report.statistics import ALPHA, FEWEST_CLASSES, tukey_test
from benchmark.report.tables import Scored, TableView

Verdict = Literal["reproduced", "same order", "otherwise", "no figure"]

#: Largest difference of a reproduced score from the paper's: two hundredths more than the standard deviation of NN over
#: draws of the codebook on a hundred shapes (median .026).
TOLERANCE = 0.05

#: Least share of comparisons with other rows that agree with the paper. Of seven coin tosses, six or more are
#: heads with probability 1/16.
AGREEING = 0.75

_SLACK = 5e-7
_MARKS = {"reproduced": "=", "same order": "~", "otherwise": "x", "no figure": ""}


def verdicts(views: Sequence[TableView]) -> dict[str, list[tuple[float, float, Verdict]]]:
    """Return verdicts on the classical figures of Table III on TOSCA, from complete surfaces and all rows.

    Returns
    -------
    dict
        By method, for each measure: the paper's figure, ours (NaN if missing), and the verdict; empty without results
        on TOSCA.
    """
    found = defaultdict(list)
    for view in views:
        if (view.table.identifier, view.dataset) != ("III", "tosca"):
            continue
        complete = {row.method: one for row in view.rows for one in row.scored.values() if one.is_complete}
        for measure in MEASURES:
            ours = {name: one.means[measure] for name, one in complete.items()}
            printed = {name: PRINTED["III"][name][measure] for name in CLASSICAL}
            for name, theirs in printed.items():
                found[name].append((theirs, ours.get(name, np.nan), verdict_of(name, printed, ours)))
    return found


def _exchanged(assessed: Mapping[str, Sequence[tuple[float, float, Verdict]]]) -> str:
    """Say how many figures are reproduced if our rows are exchanged or are all alike, and how far we keep the order."""
    printed, ours = np.array([[figure[:2] for figure in figures] for figures in assessed.values()]).transpose(2, 0, 1)
    if np.isnan(ours).any():
        return ""
    near = (np.abs(printed[:, None] - ours) <= TOLERANCE + _SLACK).sum(axis=2)
    counts = near[range(len(ours)), [*permutations(range(len(ours)))]].sum(axis=1)
    alike = (np.abs(printed - ours.mean(axis=0)) <= TOLERANCE + _SLACK).sum()
    order = [f"{name} {spearmanr(printed[:, k], ours[:, k]).statistic:.2f}" for k, name in enumerate(MEASURES)]
    return (
        f"With our rows exchanged at random, {counts.mean():.1f} are reproduced on average, and "
        f"{(counts >= near.trace()).mean():.0%} of all exchanges reproduce {near.trace()} or more; the mean of each of "
        f"our columns reproduces {alike}. Rank correlation with the paper: {', '.join(order).replace('0.', '.')}."
    )


def verdict_of(name: str, printed: Mapping[str, float], ours: Mapping[str, float]) -> Verdict:
    """Return the verdict on the figure of a row, given all figures of its column."""
    if name not in ours:
        return "no figure"
    if abs(printed[name] - ours[name]) <= TOLERANCE + _SLACK:
        return "reproduced"
    others = [other for other in printed if other in ours and printed[other] != printed[name]]
    leads = [(printed[name] - printed[other], round(ours[name] - ours[other], 6)) for other in others]
    agreeing = sum(theirs * own > 0 for theirs, own in leads)  # a tie of ours disagrees
    return "same order" if len(others) >= 3 and agreeing >= AGREEING * len(others) else "otherwise"


@dataclass(frozen=True)
class AssessedClaim:
    """Outcome of a claim.

    Parameters
    ----------
    claim
        The claim.
    decision
        Supported: the row leads in every comparison, and each lead is significant over classes. Contradicted: it is
        significantly behind in at least one. Undecided: neither. Not decidable: too few classes. Not comparable.
    queries, n_queries
        Queries of classes that no compared row has seen in training, and all queries.
    leads, certain, n_comparisons
        Comparisons (rows times measures) in which it leads, whose sign is significant, and all.
    """

    claim: Claim
    decision: str
    queries: int = 0
    n_queries: int = 0
    leads: int = 0
    certain: int = 0
    n_comparisons: int = 0


def assess(claim: Claim, view: TableView | None) -> AssessedClaim:
    """Judge a claim by the randomised Tukey test of its rows on unseen queries; on the five subjects of Table I."""
    if view is None:
        return AssessedClaim(claim, "not comparable")
    title = "5 subjects" if "5 subjects" in view.groups else view.columns[0].title
    scored = {row.method: row.scored[title] for row in view.rows if title in row.scored}
    complete = {method: one for method, one in scored.items() if not one.missing}
    if not complete.keys() >= {claim.better, *claim.others}:
        return AssessedClaim(claim, "not comparable")
    rows = [complete[name] for name in (claim.better, *claim.others)]
    seen = set[str]().union(*(one.seen_classes for one in rows))
    unseen = [place for place, label in enumerate(rows[0].labels) if label not in seen]
    labels = [rows[0].labels[place] for place in unseen]
    if not unseen:
        return AssessedClaim(claim, "not comparable", 0, len(rows[0].labels))
    leads, p_values = _leads(rows, labels, np.ix_(unseen, [MEASURES.index(name) for name in claim.measures]))
    certain = p_values < ALPHA
    decision = "undecided"
    if np.isnan(p_values).any():
        decision = f"not decidable: {len(set(labels))} classes"
    elif np.any(certain & (leads < 0)):
        decision = "contradicted"
    elif np.all(certain & (leads > 0)):
        decision = "supported"
    counts = int((leads > 0).sum()), int(certain.sum()), leads.size
    return AssessedClaim(claim, decision, len(unseen), len(rows[0].labels), *counts)


def _leads(
    rows: Sequence[Scored], labels: Sequence[str], chosen: tuple[NDArray[np.intp], ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the total leads of the first row, and their largest p-values over all choices of one training a row."""
    lead = _lead(np.array([one.values[chosen] for one in rows]))
    tests = []
    for trainings in product(*(one.trainings for one in rows)):
        values = np.array([training[chosen] for training in trainings])
        same_sign = np.sign(_lead(values)) == np.sign(lead)
        tests.append(np.where(same_sign, tukey_test(values, labels)[0, 1:], 1.0))
    return lead, np.max(tests, axis=0)


def _lead(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray((values[0] - values[1:]).sum(axis=1).round(6))


def claims(views: Sequence[TableView]) -> list[AssessedClaim]:
    """Judge the paper's claims, all methods on one view, on official data or the stand-in."""
    first = {view.table.identifier: view for view in reversed(views)}
    return [assess(claim, first.get("IV" if claim.table == "IV" else f"{claim.table}-view")) for claim in CLAIMS]


def verdicts_markdown(views: Sequence[TableView]) -> str:
    """Return verdicts and claims as Markdown; "" without a table of the suite."""
    if not any(view.table in TABLES for view in views):
        return ""
    assessed, lines = verdicts(views), ["**What of the paper holds up.**", ""]
    if assessed:
        counts = Counter(verdict for figures in assessed.values() for *_, verdict in figures)
        lines += wrap(
            f"Table III, TOSCA, complete surfaces: {counts['reproduced']} of {counts.total()} classical figures are "
            f"reproduced (`=`, at most .05 apart), {counts['same order']} keep the order (`~`, at least three "
            f"quarters of the comparisons with other rows agree), {counts['otherwise']} do neither (`x`). "
            f"{_exchanged(assessed)} Each cell: the paper's figure, ours.",
            100,
        )
        body = []
        for name, figures in assessed.items():
            cells = (f"{hundredths(theirs)} {hundredths(ours)} {_MARKS[verdict]}" for theirs, ours, verdict in figures)
            body.append([TITLES[name], *map(str.strip, cells)])
        lines += ["", *markdown_table(["Method", *MEASURES], body), ""]
    lines += wrap(
        "The paper's claims, all methods on one depth view. Queries: those of classes on which no compared network was "
        "trained. Leads: comparisons (rows times measures) in which the row is ahead; certain: those significant in a "
        "randomised Tukey test over whole classes, in either direction (5 %, whatever the training seed). Below "
        f"{FEWEST_CLASSES} classes, nothing is decided.", 100,
    )  # fmt: skip
    rows = []
    for one in claims(views):
        is_tested = one.decision in ("supported", "contradicted", "undecided")
        counted = [one.decision, *[f"{one.queries} of {one.n_queries}"] * bool(one.n_queries)]
        counted += [f"{one.leads} of {one.n_comparisons}"] * bool(one.n_comparisons) + [str(one.certain)] * is_tested
        rows.append([one.claim.words, TITLES.get(one.claim.better, ""), one.claim.table, *counted])
    head = ["Claim", "row", "table", "decision", "queries", "leads", "certain"]
    return "\n".join([*lines, "", *markdown_table(head, rows)]) + "\n"
