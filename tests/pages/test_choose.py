"""What the page on choosing a method says in words, from the published records."""

from pathlib import Path

import pytest

from benchmark.commands.compare import compare
from benchmark.reference.paper import CLASSICAL
from benchmark.registry.known import BUILT_IN
from benchmark.report.record_facts import seconds_of
from tests.pages.test_docs import prose
from tests.pages.test_readme import ROOT, every_view, rows, scores, views  # noqa: F401
from tests.verbs import VERBS

PAGE = (ROOT / "docs/start/choose.md").read_text(encoding="utf-8")

#: Complete surfaces of generated people, real people, generated scans and TOSCA.
GALLERIES = ("I_all", "faust", "II", "III")


def dcg(scores, gallery, method):  # noqa: F811
    return scores[gallery][method]["DCG"]


def forms_of(scores, gallery):  # noqa: F811
    return [method for method in CLASSICAL if method in scores[gallery]]


@pytest.mark.parametrize("gallery", GALLERIES)
def test_si_hks_scores_above_every_form(scores, gallery):  # noqa: F811
    if "si-hks" not in scores[gallery]:
        pytest.skip("it has not run on this set")
    best = max(dcg(scores, gallery, form) for form in forms_of(scores, gallery))
    assert dcg(scores, gallery, "si-hks") > best


def test_unfolding_has_the_highest_score_of_a_form_on_tosca(scores):  # noqa: F811
    forms = forms_of(scores, "III")
    assert max(forms, key=lambda form: dcg(scores, "III", form)) == "mesh-unfolding"


@pytest.mark.parametrize("gallery", GALLERIES[:3])
def test_gps_scores_higher_than_unfolding_on_people(scores, gallery):  # noqa: F811
    assert dcg(scores, gallery, "gps") > dcg(scores, gallery, "mesh-unfolding")


def test_shape_dna_is_some_ten_times_faster_than_si_hks(views):  # noqa: F811
    seconds = {}
    for row in views["III"].rows:
        if row.method in ("shape-dna", "si-hks"):
            (record,) = row.scored["ours"].all_records
            seconds[row.method] = seconds_of(record)
    assert 5 < seconds["si-hks"] / seconds["shape-dna"] < 20


@pytest.mark.parametrize("other", ["mesh-unfolding", "identity"])
def test_the_network_of_animals_does_not_differ_significantly(other):
    frame = compare(
        "learned-wide-extra[training=animals-sampled]",
        other,
        results=ROOT / "results",
        tables=["III-view"],
        data="tosca",
        published=True,
    )
    whole = frame[frame["classes"] >= 8]
    assert len(whole) > 0
    assert (whole["p_alone"] >= 0.05).all()
    assert "Not significantly better than `mesh-unfolding`" in PAGE


def test_nothing_is_said_of_methods_that_the_robustness_table_does_not_have():
    table = (ROOT / "results/tables/robustness.md").read_text(encoding="utf-8")
    assert "SI-HKS" not in table
    assert "`si-hks` is not among them" in " ".join(PAGE.split())


def test_mesh_unfolding_alone_bears_missing_parts_and_others_bear_the_rest():
    lines = (ROOT / "results/tables/robustness.md").read_text(encoding="utf-8").splitlines()
    rows_of_table = [line.strip("|").split("|") for line in lines if line.startswith("|")]
    names = rows_of_table[0][2:]
    cells = {
        (row[0], row[1]): dict(zip(names, map(float, row[2:]), strict=True))
        for row in rows_of_table[2:]
    }
    unfolding, others = "Mesh Unfolding", ("GPS", "ShapeDNA")
    for (change, strength), found in cells.items():
        if change in ("noise", "remeshing", "resolution"):
            behind = [name for name in others if found[name] < found[unfolding]]
            assert behind == (["ShapeDNA"] if (change, strength) == ("noise", "5") else [])
        if change == "missing-parts":
            assert all(found[name] < found[unfolding] for name in others)


def test_every_method_that_the_page_names_exists():
    named = {word.partition("[")[0] for word in prose(PAGE).split("`")[1::2]}
    columns = {"s"}
    assert named - {"identity", "surface-area"} - columns - VERBS.keys() <= {*BUILT_IN}
    assert Path(ROOT / "docs/start/choose.md").is_file()
