"""Verdicts on figures and claims, worked by hand from made-up records."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pandas import DataFrame

from benchmark.pipeline.storage.records import scorer_name
from benchmark.reference import paper
from benchmark.reference.paper import CLAIMS, Claim
from benchmark.report.content import TableContent, contents
from benchmark.report.formats import render
from benchmark.report.reproduction import (
    TOLERANCE,
    AssessedClaim,
    assess_claims,
    keeps_order,
    over_trainings,
    paper_tables,
    reproduced_figures,
    reproduction_markdown,
)
from benchmark.report.results import Result
from tests.records import MEASURES, published, record

TOSCA = {"name": "tosca", "title": "TOSCA"}
N = 40


def scored(method: str, scores: dict[str, float], input_: str = "mesh", **more: Any) -> Result:
    return Result(record(method, input_, "tosca", **({"data": TOSCA, "scores": scores} | more)))


def printed(method: str, table: str = "III") -> dict[str, float]:
    return dict(paper.rows(table)[method].values[table])


def of(figures: DataFrame, method: str, input_: str = "mesh", table: str = "III") -> dict[str, str]:
    chosen = figures[(figures["table"] == table) & (figures["method"] == method) & (figures["input"] == input_)]
    return dict(zip(chosen["measure"], chosen["outcome"], strict=True))


# Figures -------------------------------------------------------------------------------------------------------------


def test_the_paper_has_31_rows_of_four_figures_and_its_classical_rows_may_have_seen_either_input() -> None:
    figures = reproduced_figures([])
    assert figures["input"].value_counts().to_dict() == {"view": 31 * 4, "mesh": 24 * 4}
    assert set(figures["outcome"]) == {"not comparable"}
    assert not figures[figures["input"] == "mesh"]["method"].str.startswith("learned").any()


def test_figures_of_the_paper_itself_are_reproduced_up_to_the_tolerance_and_no_further() -> None:
    exact = printed("gps")
    figures = reproduced_figures(contents([scored("gps", exact), scored("skeleton", printed("skeleton"))]))
    assert set(of(figures, "gps").values()) == {"reproduced"}
    assert set(of(figures, "fast-mds").values()) == {"not comparable"}
    moved = {name: value + TOLERANCE * (1 if name != "DCG" else 1.001) for name, value in exact.items()}
    assert of(reproduced_figures(contents([scored("gps", moved)])), "gps") == {
        "NN": "reproduced", "FT": "reproduced", "ST": "reproduced", "DCG": "unexplained",
    }  # fmt: skip


def test_what_a_random_order_scores_too_is_at_chance_and_not_reproduced() -> None:
    chance = dict.fromkeys(MEASURES, 0.0) | {"NN": printed("gps")["NN"] - TOLERANCE, "FT": printed("gps")["FT"] - 0.06}
    tables = [replace(table, chance=chance) for table in contents([scored("gps", printed("gps"))])]
    assert of(reproduced_figures(tables), "gps") == {
        "NN": "at chance", "FT": "reproduced", "ST": "reproduced", "DCG": "reproduced",
    }  # fmt: skip
    assert "0.71 0.71 c | 0.52 0.52 =" in reproduction_markdown(tables)
    far = [replace(table, chance=chance) for table in contents([scored("gps", dict.fromkeys(MEASURES, 0.3))])]
    assert set(of(reproduced_figures(far), "gps").values()) == {"unexplained"}


def test_rows_that_the_paper_prints_as_equal_say_nothing_and_a_tie_of_ours_does_not_agree() -> None:
    above, equal, tie = (0.2, 0.3), (0.5, 0.1), (0.2, 0.5)
    assert keeps_order(0.5, 0.5, [above, above, above, equal, equal])
    assert not keeps_order(0.5, 0.5, [above, above, equal])
    assert not keeps_order(0.5, 0.5, [above, above, tie, tie])
    last_bit = (0.2, 0.5 - 1e-16)
    assert not keeps_order(0.5, 0.5, [above, above, last_bit, last_bit])


def test_what_differs_beside_the_figure_is_named() -> None:
    far = dict.fromkeys(MEASURES, 0.3)
    model = {
        "digest": "1", "data": "animals", "schedule": "60 epochs", "extra_data": False, "card": {},
    }  # fmt: skip
    figures = reproduced_figures(contents([scored("gps", far), scored("learned", far, "view", models=[model])]))
    assert set(of(figures, "gps").values()) == {"unexplained"}
    assert set(of(figures, "learned", "view").values()) == {"other training"}
    stand_in = {"name": "animals", "title": "animals", "stand_in_for": "tosca"}
    generated = Result(record("gps", "mesh", "animals", data=stand_in, scores=far))
    assert set(of(reproduced_figures(contents([generated])), "gps").values()) == {"other data"}


def test_the_official_set_comes_before_its_stand_in_and_quick_runs_are_not_judged() -> None:
    far, exact = dict.fromkeys(MEASURES, 0.3), printed("gps")
    stand_in = {"name": "animals", "title": "animals", "stand_in_for": "tosca"}
    generated = Result(record("gps", "mesh", "animals", data=stand_in, scores=far))
    both = contents([generated, scored("gps", exact)])
    for tables in (both, both[::-1]):
        assert paper_tables(tables)["III"].data["name"] == "tosca"
        assert set(of(reproduced_figures(tables), "gps").values()) == {"reproduced"}
    quick = contents([scored("gps", exact, data=TOSCA | {"quick": True})])
    assert quick
    assert not paper_tables(quick)


def of_folds(*methods: str) -> list[Result]:
    """Published results of Table I on complete surfaces."""
    chosen = (r for r in published() if r["gallery"].startswith("humans fold") and r["input"] == "mesh")
    return [Result(r) for r in chosen if r["method"] in methods and scorer_name(r) == "cm-bof"]


def test_a_row_without_one_of_its_folds_is_neither_compared_nor_given_an_interval() -> None:
    results = of_folds("classic-mds", "gps")
    partial = [r for r in results if (r.record["method"], r.record["gallery"]) != ("gps", "humans fold 2")]
    table = next(table for table in contents(partial) if table.identifier == "I")
    assert {method for method, _ in table.significance} == {"classic-mds"}
    assert set(of(reproduced_figures([table]), "gps", table="I").values()) == {"not comparable"}
    claim = Claim("", "I", "classic-mds", ("gps",), "mesh", MEASURES)
    assert assess_claims({"I": table}, [claim])[0].missing == ("gps",)
    first = next(t for t in contents(r for r in results if r.record["gallery"] == "humans fold 0") if len(t.lines))
    assert first.size == "3 x 100 shapes, 5 classes"  # folds that are missing count as 0


# Claims --------------------------------------------------------------------------------------------------------------


def queries(method: str, hits: int, input_: str = "view", n_classes: int = 20) -> Result:
    """A row that finds the first ``hits`` of forty queries, by all measures."""
    shapes = [f"shape{k}" for k in range(N)]
    values = [1.0] * hits + [0.0] * (N - hits)
    return scored(
        method, dict.fromkeys(MEASURES, hits / N), input_,
        shapes=shapes, labels=[f"class{k % n_classes}" for k in range(N)], per_query=dict.fromkeys(MEASURES, values),
    )  # fmt: skip


def decided(*results: Result, claim: Claim | None = None) -> AssessedClaim:
    chosen = claim or Claim("GPS leads.", "III", "gps", ("fast-mds", "skeleton"), measures=("NN",))
    (judged,) = assess_claims(paper_tables(contents(results)), [chosen])
    return judged


def test_a_claim_that_all_queries_carry_is_supported_and_its_opposite_contradicted() -> None:
    rows = (queries("gps", 35), queries("fast-mds", 5), queries("skeleton", 6))
    assert decided(*rows) == AssessedClaim(decided(*rows).claim, "supported", 2, 2, 2)
    few = [queries(method, hits, n_classes=5) for method, hits in (("gps", 35), ("fast-mds", 5), ("skeleton", 6))]
    assert decided(*few).decision == "undecided"
    opposite = Claim("GPS is behind.", "III", "fast-mds", ("gps",), measures=("NN", "DCG"))
    assert decided(*rows, claim=opposite) == AssessedClaim(opposite, "contradicted", 0, 2, 2)


def test_a_lead_is_certain_only_if_each_training_has_it() -> None:
    better, same, behind, other = (queries("learned", hits).record for hits in (35, 34, 2, 5))
    _, probabilities = over_trainings([better, same], [other])
    assert probabilities.max() < 0.001
    leads, probabilities = over_trainings([better, behind], [other])
    assert leads.min() > 0
    assert probabilities.min() == 1


def test_the_claims_hold_in_the_papers_own_figures() -> None:
    without_figures = set()
    for claim in CLAIMS:
        values = {name: row.values[claim.table] for name, row in paper.rows(claim.table).items()}
        without_figures |= set(claim.others) - set(values)
        others = [values[other] for other in claim.others if other in values]
        for measure in claim.measures:
            assert all(values[claim.better][measure] > other[measure] for other in others), claim.words
    assert without_figures == {"learned-without-weighting"}


# The document --------------------------------------------------------------------------------------------------------


def document() -> tuple[str, list[TableContent]]:
    tables = contents([scored("gps", printed("gps")), scored("skeleton", dict.fromkeys(MEASURES, 0.3))])
    return reproduction_markdown(tables), tables


def test_the_document_counts_every_figure_once() -> None:
    text, _ = document()
    counts = {
        tuple(cells[:2]): [int(cell) for cell in cells[2:]]
        for line in text.split("**The paper's claims.**")[0].splitlines()
        if len(cells := [cell.strip() for cell in line.strip("|").split("|")]) == 10 and cells[2].isdigit()
    }
    assert counts["III", "mesh"] == [32, 4, 0, 0, 0, 0, 4, 24]
    assert counts["all", "view"] == [124, 0, 0, 0, 0, 0, 0, 124]
    assert all(sum(numbers[1:]) == numbers[0] for numbers in counts.values())
    assert "| GPS | mesh | 0.71 0.71 = | 0.52 0.52 = | 0.72 0.72 = | 0.76 0.76 = |" in text
    assert "| Skeleton-based | mesh | 0.78 0.30 x |" in text
    assert "| Our | view | 0.97 -- | 0.82 -- | 0.89 -- | 0.93 -- |" in text
    assert "**Table II: not run.**" in text


def test_the_tables_bring_the_reproduction_where_a_table_of_the_paper_was_run() -> None:
    text, tables = document()
    assert render(tables, ("markdown",))["reproduction.md"] == text
    own = [replace(table, table=replace(table.table, identifier="mine")) for table in tables]
    assert "reproduction.md" not in render(own, ("markdown",))
    assert "reproduction.md" not in render(tables, ("latex", "csv", "json"))
