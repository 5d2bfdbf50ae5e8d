"""What of the paper holds: its figures for TOSCA, the only official set here, and its claims.

:data:`TOLERANCE` was committed with its first outcome (394cbf19), a day after our scores of TOSCA
(769b38d8). Stand-ins give no verdicts on figures, because an equal figure on other data shows
nothing; claims and orders can be compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations, product
from textwrap import wrap

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame

from benchmark.protocols.tables import TABLES, TITLES
from benchmark.reference.paper import CLAIMS, CLASSICAL, MEASURES, PRINTED, Claim
from benchmark.report.formats import markdown_table
from benchmark.report.frames import hundredths, kind_of
from benchmark.report.statistics import ALPHA, FEWEST_CLASSES, permutation_test
from benchmark.report.tables import SAME, Scored, TableView, least_difference, query_measures

#: Largest difference of a reproduced score from the paper's: two hundredths more than the standard
#: deviation of NN over draws of the codebook on a hundred shapes (median .026).
TOLERANCE = 0.05


def classical_figures(views: Sequence[TableView]) -> tuple[DataFrame, DataFrame] | None:
    """Return the paper's figures of Table III, and ours on complete surfaces of TOSCA, by method and measure.

    Ours are NaN where a row is incomplete; None without a table of TOSCA.
    """
    view = table_of_tosca(views)
    if view is None:
        return None
    complete = {
        row.method: one.means for row in view.rows for one in row.scored.values() if one.is_complete
    }
    printed = DataFrame({name: PRINTED["III"][name] for name in CLASSICAL}).T
    return printed, DataFrame(complete, index=MEASURES).T.reindex(index=printed.index)


def table_of_tosca(views: Sequence[TableView]) -> TableView | None:
    """Return Table III on TOSCA, whatever its copy; None if there is none."""
    places = {(view.table.identifier, view.dataset): view for view in reversed(views)}
    return places.get(("III", "tosca"))


def is_near(printed: NDArray[np.float64], ours: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which figures are reproduced."""
    return np.abs(printed - ours) <= TOLERANCE + SAME


def _exchanged(printed: DataFrame, ours: DataFrame) -> str:
    """Say how many figures are reproduced if our rows are exchanged or are all alike, and how far we keep the order."""
    if ours.isna().any(axis=None):
        return ""
    near = is_near(printed.to_numpy()[:, None], ours.to_numpy()).sum(axis=2)
    counts = near[range(len(ours)), [*permutations(range(len(ours)))]].sum(axis=1)
    alike = is_near(printed.to_numpy(), ours.mean().to_numpy()).sum()
    values = printed.to_numpy()
    constants = is_near(values[:, None], values + TOLERANCE).sum(axis=0).max(axis=0).sum()
    order = [f"{name} {rho:.2f}" for name, rho in printed.rank().corrwith(ours.rank()).items()]
    return (
        f"With our rows exchanged at random, {counts.mean():.1f} are reproduced on average, and "
        f"{(counts >= near.trace()).mean():.0%} of all exchanges reproduce {near.trace()} or more; the mean of each of "
        f"our columns reproduces {alike}, and one constant for each measure, chosen in hindsight, {constants}. "
        f"Rank correlation with the paper: {', '.join(order).replace('0.', '.')}. "
    )


@dataclass(frozen=True)
class AssessedClaim:
    """Outcome of a claim.

    Parameters
    ----------
    claim
        The claim.
    decision
        Supported: the row leads in every comparison, and each lead is certain. Contradicted: it is
        certainly behind in at least one. Undecided: neither. Not decidable: too few classes. Not
        comparable.
    queries, n_queries
        Queries of classes that no compared row has seen in training, and all queries.
    leads, certain, n_comparisons
        Comparisons (rows times measures) in which it leads, that are certain, and all.
    trainings
        Choices of a seed for each row, times folds, all of which have to agree; 0 without a
        network.
    """

    claim: Claim
    decision: str
    queries: int = 0
    n_queries: int = 0
    leads: int = 0
    certain: int = 0
    n_comparisons: int = 0
    trainings: int = 0


def assess(claim: Claim, view: TableView | None) -> AssessedClaim:
    """Judge a claim by a permutation test of its rows on unseen queries; on the five subjects of Table I."""
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
    leads, certain, trainings = _leads(
        rows, labels, np.ix_(unseen, [MEASURES.index(name) for name in claim.measures])
    )
    decision = "undecided"
    if (n_classes := len(set(labels))) < FEWEST_CLASSES:
        decision = f"not decidable: {n_classes} classes"
    elif np.any(certain & (leads < 0)):
        decision = "contradicted"
    elif np.all(certain & (leads > 0)):
        decision = "supported"
    counts = int((leads > 0).sum()), int(certain.sum()), leads.size, trainings
    return AssessedClaim(claim, decision, len(unseen), len(rows[0].labels), *counts)


def _leads(
    rows: Sequence[Scored], labels: Sequence[str], chosen: tuple[NDArray[np.intp], ...]
) -> tuple[NDArray[np.float64], NDArray[np.bool_], int]:
    """Return the total leads of the first row, which of them are certain, and the trainings that must agree on these.

    A lead is certain if it is so with each choice of one seed for each row. Each fold of a network
    is a network of its own, and must have the same sign.
    """
    is_network = any(kind_of(one.all_records[0]) == "network" for one in rows)
    sizes = (
        [len(query_measures(of)) for of in rows[0].records.values()]
        if is_network
        else [len(rows[0].labels)]
    )
    folds = np.repeat(np.arange(len(sizes)), sizes)[chosen[0].ravel()]
    lead, least = (
        _lead(np.array([one.values[chosen] for one in rows])),
        least_difference(rows)[0][chosen[1].ravel()],
    )
    certain, choices = (
        np.abs(lead) / len(labels) > least + SAME,
        [*product(*(one.trainings for one in rows))],
    )
    for trainings in choices:
        values = np.array([training[chosen] for training in trainings])
        certain &= permutation_test(values, labels)[0, 1:] < ALPHA
        for fold in {*folds.tolist()}:
            certain &= np.sign(_lead(values[:, folds == fold])) == np.sign(lead)
    return lead, certain, len(choices) * len(sizes) * is_network


def _lead(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray((values[0] - values[1:]).sum(axis=1).round(6))


def claims(views: Sequence[TableView]) -> list[AssessedClaim]:
    """Judge the paper's claims, all methods on one view, on official data or the stand-in."""
    first = {view.table.identifier: view for view in reversed(views)}
    return [
        assess(claim, first.get("IV" if claim.table == "IV" else f"{claim.table}-view"))
        for claim in CLAIMS
    ]


def verdicts_markdown(views: Sequence[TableView]) -> str:
    """Return verdicts and claims as Markdown; "" without a table of the suite."""
    if not any(view.table in TABLES for view in views):
        return ""
    lines = [f"**What holds up in the paper.** {views[0].by.note}", ""]
    figures, tosca = classical_figures(views), table_of_tosca(views)
    if figures and tosca:
        printed, ours = figures
        near = is_near(printed.to_numpy(), ours.to_numpy())
        lines += wrap(
            f"Table III, {tosca.title}, complete surfaces: {near.sum()} of {near.size} classical figures are "
            f"reproduced (`=`, at most .05 apart). {_exchanged(printed, ours)}Each cell: the paper's figure, ours.",
            100,
        )
        cells = printed.map(hundredths) + " " + ours.map(hundredths) + np.where(near, " =", "")
        body = [
            [TITLES[str(name)], *of_row]
            for name, of_row in zip(cells.index, cells.to_numpy(), strict=True)
        ]
        lines += ["", *markdown_table(["Method", *cells.columns], body), ""]
    lines += wrap(
        "The paper's claims, all methods on one depth view. Queries: those of classes on which no compared network was "
        "trained. Leads: comparisons (rows times measures) in which the row is ahead; certain: those significant among "
        "these rows and measures, in either direction (5 %; studentised permutation test over whole classes), larger "
        "than codebooks and trainings scatter, and of one sign in all trainings: seeds of the networks times folds. "
        f"Below {FEWEST_CLASSES} classes, nothing is decided.",
        100,
    )
    rows = []
    for one in claims(views):
        is_tested = one.decision in ("supported", "contradicted", "undecided")
        counted = [one.decision, *[f"{one.queries} of {one.n_queries}"] * bool(one.n_queries)]
        counted += [f"{one.leads} of {one.n_comparisons}"] * bool(one.n_comparisons)
        counted += [str(one.certain), str(one.trainings or "")] * is_tested
        rows.append([one.claim.words, TITLES.get(one.claim.better, ""), one.claim.table, *counted])
    head = ["Claim", "row", "table", "decision", "queries", "leads", "certain", "trainings"]
    return "\n".join([*lines, "", *markdown_table(head, rows)]) + "\n"
