"""What the pages of the networks say of their rows is what the committed records and measurements say."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.protocols.tables import ONLY_ABLATED
from benchmark.registry import BUILT_IN
from benchmark.report.escaping import number
from benchmark.report.significance import permutation_test
from benchmark.results import open_results
from retrieval.measures import PRINTED
from tests.rows import is_form

ROOT = Path(__file__).parents[2]

FOLDS = [f"humans fold {fold}" for fold in range(3)]


def told(scores: pd.Series) -> str:
    """NN, FT, ST and DCG as the pages write them."""
    return " ".join(number(scores[measure]).removeprefix("0") for measure in PRINTED)


@pytest.fixture(scope="module")
def records() -> pd.DataFrame:
    """Scored records by CM-BOF, the newest of each place."""
    found = open_results(ROOT / "results", published=True).records()
    found = found[(found["scorer"] == "cm-bof") & (found["status"] == "ok")].sort_values("finished")
    return found.drop_duplicates(["gallery", "input", "method"], keep="last")


def compared(
    records: pd.DataFrame, galleries: list[str], method: str, input_: str, of_forms: str = "mesh"
) -> tuple[pd.Series, pd.DataFrame]:
    """Mean scores of a method over galleries, and those of the classical forms of complete surfaces or of views."""
    rows = records[records["gallery"].isin(galleries)]
    means = {name: found.groupby("method")[list(PRINTED)].mean() for name, found in rows.groupby("input")}
    forms = means[of_forms][[is_form(name) for name in means[of_forms].index]]
    assert len(forms) >= 8
    return means[input_].loc[method], forms


def test_the_field_is_above_every_classical_form_of_complete_surfaces(
    records: pd.DataFrame,
) -> None:
    for galleries in (FOLDS, ["humans"], ["humans-scanlike"]):
        field, forms = compared(records, galleries, "deformation-field", "mesh")
        above = [measure for measure in PRINTED if f"{field[measure]:.2f}" > f"{forms[measure].max():.2f}"]
        assert above == [*PRINTED]


SAMPLED_ANIMALS = "learned-wide-extra[training=animals-sampled]"


@pytest.mark.parametrize(
    ("method", "galleries"), [*(("learned", [fold]) for fold in FOLDS), (SAMPLED_ANIMALS, ["tosca"])]
)
def test_networks_are_above_every_classical_form_of_a_view(
    records: pd.DataFrame, method: str, galleries: list[str]
) -> None:
    ours, forms = compared(records, galleries, method, "view", "view")
    assert all(ours[measure] > forms[measure].max() for measure in PRINTED)
    assert galleries != ["tosca"] or set(forms.idxmax()) == {"mesh-unfolding"}


@pytest.mark.parametrize(
    ("method", "galleries", "readme"),
    [
        ("learned-streamed", FOLDS, "on synthetic humans (NN {NN:.2f})"),
        ("learned-streamed", ["humans"], ""),
        *(("learned-wide-extra", galleries, "") for galleries in (FOLDS, ["humans"], ["humans-scanlike"])),
    ],
)
def test_one_view_is_above_every_classical_form_of_complete_surfaces(
    records: pd.DataFrame, method: str, galleries: list[str], readme: str
) -> None:
    ours, forms = compared(records, galleries, method, "view")
    assert all(ours[measure] > forms[measure].max() for measure in PRINTED)
    text = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    assert readme.format(**ours).replace("NN 0.", "NN .") in text


def test_the_table_of_networks_has_all_their_published_scores(records: pd.DataFrame) -> None:
    page = (ROOT / "docs" / "explanation" / "networks.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([\w-]+)` \| (view|mesh) \| (.*) \|$", page, re.MULTILINE)
    learned = {name for name, target in BUILT_IN.items() if target.startswith("learned.")}
    assert {name for name, *_ in rows} == learned - ONLY_ABLATED
    for name, input_, cells in rows:
        for galleries, cell in zip([FOLDS, ["humans"], ["humans-scanlike"], ["tosca"]], cells.split("|"), strict=True):
            training = "[training=animals-sampled]" if name == "learned-wide-extra" and galleries == ["tosca"] else ""
            found = records[records["gallery"].isin(galleries) & (records["method"] == name + training)]
            found = found[found["input"] == input_]
            expected = told(found[list(PRINTED)].mean()) if len(found) == len(galleries) else ""
            assert cell.strip() == expected, (name, galleries)


def test_the_queries_tell_sampled_animals_from_the_best_classical_form_in_what_the_page_says() -> None:
    found = open_results(ROOT / "results", published=True).queries()
    found = found[(found["gallery"] == "tosca") & (found["input"] == "view") & (found["scorer"] == "cm-bof")]
    sure = set()
    for measure in PRINTED:
        of_shape = found.pivot(index="shape", columns="method", values=measure)
        differences = (of_shape[SAMPLED_ANIMALS] - of_shape["mesh-unfolding"]).to_numpy()
        assert len(differences) == 80
        (probability,) = permutation_test(np.rint(differences[:, None] * 1e6))
        sure |= {measure} if probability < 0.05 else set()
    assert sure == {"ST", "DCG"}
