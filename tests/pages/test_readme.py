"""What README and the pages on reproduction and networks say is what published records and
experiments say.
"""

import csv
import json
import re
from itertools import permutations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.check import check
from benchmark.pipeline.record_files import read_records
from benchmark.reference.paper import AS_PRINTED, CLASSICAL, PAPER_MEASURES, PRINTED
from benchmark.registry import components_named
from benchmark.report.formats import markdown
from benchmark.report.notation import hundredths
from benchmark.report.notes import table_notes
from benchmark.report.tables import table_views
from benchmark.report.verdicts import classical_scores, is_near
from tests.pages.blocks import blocks_of
from tests.pages.test_claims import PAGE as PAGE_OF_CLAIMS
from tests.pages.test_docs import PAGES
from tests.verbs import call
from tools.page_parts import PART

ROOT = Path(__file__).parents[2]
TABLES = ROOT / "results" / "tables"
README = (ROOT / "README.md").read_text(encoding="utf-8")

#: The column of each table that the pages cite.
CITED = {
    "I": "5 subjects",
    "I-view": "5 subjects",
    "II": "ours",
    "II-view": "ours",
    "III": "ours",
    "III-view": "all shapes",
    "IV": "ours",
    "III-cross": "against complete surfaces",
}

#: Names that have brackets, in the sentences below.
SHORT = {
    AS_PRINTED: "printed",
    "learned-wide-extra[training=animals-sampled]": "animals",
    "learned[configuration=as_printed,training=animals-III]": "printed animals",
}


def sentences_of(name):
    text = (Path(__file__).parent / name).read_text(encoding="utf-8")
    return dict(re.findall(r"^## (\S+)\n(.+?)\n*(?=^## |\Z)", text, re.MULTILINE | re.DOTALL))


#: By page, what it says, with figures in braces.
SAYS = sentences_of("sentences.txt")


#: By page, the words around figures that are compared with no record, with their sources.
SOURCES = sentences_of("sources.txt")

#: A figure: a score, a share, or a number of the random order's kind.
FIGURE = re.compile(r"(?<![\w.])-?\.\d+\b|\d+(?:\.\d+)? ?%|(?<![\w./-])\d+\.\d+(?![\w.-])")


class Scores(dict):
    """Scores that are written as in tables: all, or those that a format names."""

    def __format__(self, measures):
        return " ".join(hundredths(self[name]) for name in measures.split() or PAPER_MEASURES)


def above(one, other):
    return [name for name in PAPER_MEASURES if one[name] > other[name]]


@pytest.fixture(scope="module")
def every_view():
    return table_views(read_records(ROOT / "results", local=False))


@pytest.fixture(scope="module")
def views(every_view):
    return {
        view.table.identifier: view
        for view in every_view
        if view.dataset in ("people[draw=0]", "humans-scanlike", "tosca", "faust")
    }


@pytest.fixture(scope="module")
def rows(views):
    named = {
        table: {SHORT.get(row.method, row.method): row.scored for row in views[table].rows}
        for table in CITED
    }
    return {
        t: {name: of[CITED[t]] for name, of in named[t].items() if CITED[t] in of} for t in CITED
    }


@pytest.fixture(scope="module")
def scores(views, rows):
    """Scores by table and row, also of the random order and the best of the paper's classical
    forms.
    """
    found = {
        f"paper_{t}": {SHORT.get(name, name): Scores(of) for name, of in PRINTED[t].items()}
        for t in PRINTED
    }
    for table, of_table in rows.items():
        of = {name: Scores(one.means) for name, one in of_table.items()}
        of["random"] = Scores(views[table].chance[CITED[table]])
        of["best"] = Scores(
            {
                m: max((of[name][m] for name in CLASSICAL if name in of), default=0)
                for m in PAPER_MEASURES
            }
        )
        found[table.replace("-", "_")] = of
    others = (
        ("I", "15 subjects", "I_all"),
        ("I-view", "15 subjects", "I_all_view"),
        ("faust", "mesh", "faust"),
        ("faust", "view", "faust_view"),
    )
    for table, column, name in others:
        found[name] = {
            row.method: Scores(row.scored[column].means)
            for row in views[table].rows
            if column in row.scored
        }
        found[name]["random"] = Scores(views[table].chance[column])
    return found


@pytest.fixture(scope="module")
def judged(every_view, views, rows):
    """What else follows from records."""
    printed, ours = (frame.to_numpy() for frame in classical_scores(every_view))
    near = is_near(printed[:, None], ours).sum(axis=2)
    orders = [*permutations(range(len(CLASSICAL)))]
    forms = [
        row.scored
        for table in ("I", "I-view")
        for row in views[table].rows
        if row.kind == "form" and row.scored
    ]
    network = rows["III-view"]["learned"]
    return {
        "reproduced": near.trace(),
        "exchanged": near[range(len(CLASSICAL)), orders].sum(axis=1).mean(),
        "of_two": Scores(views["III-view"].chance["cats and horses"]),
        "lowest": hundredths(min(PRINTED["I"][name]["DCG"] for name in CLASSICAL)),
        "least": {
            n: hundredths(min(of[f"{n} subjects"].means["DCG"] for of in forms)) for n in (5, 15)
        },
        "seen": sum(label in network.seen_classes for label in network.labels),
    }


def lines_of(path):
    return [*csv.DictReader((ROOT / "results" / path).read_text(encoding="utf-8").splitlines())]


def of_two_scorers():
    return [
        row for row in lines_of("figures/two-scorers.csv") if row.get("input", "mesh") == "mesh"
    ]


@pytest.fixture(scope="module")
def experiments():
    table = lines_of("experiments/experiments.csv")
    return {
        tuple(row[k] for k in ("experiment", "setting", "epoch", "measure")): float(row["value"])
        for row in table
    }


@pytest.fixture(scope="module")
def measured():
    """Figures of experiments."""
    of_trainings = pd.read_csv(ROOT / "results/experiments/depth-range.csv").query("epochs > 0")
    hidden = (
        pd.read_csv(ROOT / "results/experiments/hidden.csv")
        .groupby(["of", "pose"])[["in mask", "error"]]
        .mean()
    )
    of_poses = {who: hidden.loc[who].loc[["sitting", "kicking"]] for who in hidden.index.levels[0]}
    return {
        "depths": of_trainings.groupby("setting")["FT"].mean().map(hundredths).to_dict(),
        "hidden": {
            who: " and ".join(map(hundredths, of["in mask"])) for who, of in of_poses.items()
        },
        "wrong": {
            who: " and ".join(f"{x:.1f}".removeprefix("0") for x in of["error"])
            for who, of in of_poses.items()
        },
    }


@pytest.mark.parametrize("page", SAYS)
def test_pages_say_what_the_records_say(page, scores, judged, measured):
    text = " ".join((ROOT / page).read_text(encoding="utf-8").split())
    said = SAYS[page].format(**scores, **judged, **measured).splitlines()
    lacking = "\n".join(sentence for sentence in said if sentence not in text)
    assert not lacking, f"{page} must say:\n{lacking}"


#: Commands and code, which show no results.
CODE = re.compile(r"```.*?```|^    [^\n]*(?:python|=)[^\n]*$", re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_figure_of_a_page_is_compared_or_has_a_source(path, scores, judged, measured):
    page = path.relative_to(ROOT).as_posix()
    without_parts = PART.sub("", path.read_text(encoding="utf-8"))  # which are compared elsewhere
    text = " ".join(CODE.sub("", without_parts).split())
    if path == PAGE_OF_CLAIMS:  # its claims are compared by their own tests
        text = text.partition("## 1. ")[0]
    for sentence in SAYS.get(page, "").splitlines():
        text = text.replace(
            sentence.format(**scores, **judged, **measured), re.sub(r"\{.*?\}", "~", sentence)
        )
    text = re.sub(r"`[^`]*`|\]\([^)]*\)", "", text)
    for line in SOURCES.get(page, "").splitlines():
        words, source = line.split(" <- ")
        assert words in text, f"{page} no longer says: {words}"
        text = text.replace(words, "")
        named = re.findall(r"[\w/-]+\.(?:py|toml|json|csv|md)\b", source)
        assert [path for path in named if not (ROOT / path).is_file()] == [], line
        if (ROOT / source).is_file():
            known = (ROOT / source).read_text(encoding="utf-8")
            assert [figure for figure in FIGURE.findall(words) if figure not in known] == [], source
    assert FIGURE.findall(text) == [], (
        f"compare these figures of {page} in sentences.txt, or name their source"
    )


def test_the_figure_of_two_scorers_has_the_scores_of_table_iii(scores):
    by_cmbof = [row for row in of_two_scorers() if row["scorer"] == "cm-bof"]
    assert {row["method"] for row in by_cmbof} == {*CLASSICAL}
    for row in by_cmbof:
        assert float(row["value"]) == pytest.approx(
            scores["III"][row["method"]][row["measure"]], abs=1e-6
        )


def test_the_picture_of_the_finding_has_the_scores_of_table_iii(views, scores, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "results" / "experiments"))
    import finding

    drawn = finding.lines(views["III"])
    assert len(drawn) == len(CLASSICAL) + len(finding.CONTROLS)
    of_paper = [line.paper for line in drawn if line.paper is not None]
    assert sorted(of_paper) == sorted(PRINTED["III"][name]["DCG"] for name in CLASSICAL)
    shown = sorted(line.ours for line in drawn)
    assert shown == sorted(scores["III"][name]["DCG"] for name in (*CLASSICAL, *finding.CONTROLS))
    assert all(line.interval[0] < line.ours < line.interval[1] for line in drawn)


def test_table_iii_has_the_ranks_of_a_second_scorer(views):
    assert views["III"].ranks.keys() == {*CLASSICAL}
    assert views["III"].ranks["skeleton"] == {
        "NN": (1, 6),
        "FT": (3, 6),
        "ST": (7, 3),
        "DCG": (3, 6),
    }
    assert "|Fast MDS|.73 .52 .77 .77|*.80 .54 .79 .80*|8 8 8 8|" in markdown(views["III"])
    assert any("Skeleton-based (NN 1 to 6, FT 3 to 6" in note for note in table_notes(views["III"]))
    assert any(
        "Ranks by spherical harmonics: those of 8 rows" in note
        for note in table_notes(views["III-view"])
    )


def test_the_form_that_scores_highest_is_that_of_the_page_on_choosing(scores):
    for table, name in (("I", "gps"), ("II", "gps"), ("III", "mesh-unfolding")):
        assert scores[table][name]["DCG"] == scores[table]["best"]["DCG"]


def test_the_paper_ranks_all_shapes_of_tosca_and_perhaps_fifteen_people(judged):
    sts = [of["ST"] for of in PRINTED["III"].values()]
    assert max(sts) < judged["of_two"]["ST"]
    assert judged["least"][15] < judged["lowest"] < judged["least"][5]


def medians_of_damaged_frames():
    """Return the median errors of forms of frames with missing pixels; that of a refused frame is
    infinite.
    """
    errors = pd.read_csv(ROOT / "results/experiments/depth-frames.csv")
    judged = errors["frame"].isin(errors.loc[errors["code"] == "after", "frame"])
    of_methods = errors[judged].fillna({"classic-mds": np.inf, "learned-streamed": np.inf})
    medians = of_methods.groupby(["code", "damage"])[["classic-mds", "learned-streamed"]]
    return {*medians.median().to_numpy().ravel().tolist()}


def test_figures_of_experiments_are_those_of_their_file(experiments):
    known = {float(row["value"]) for row in lines_of("experiments/experiments.csv")}
    of_settings = pd.read_csv(ROOT / "results/experiments/depth-range.csv").groupby(
        ["fold", "seed", "epochs", "setting"]
    )
    known |= {*of_settings[[*PAPER_MEASURES, "error"]].mean().to_numpy().ravel().tolist()}
    known |= {
        *of_settings[[*PAPER_MEASURES, "error"]]
        .mean()
        .groupby(["epochs", "setting"])
        .mean()
        .to_numpy()
        .ravel()
        .tolist()
    }
    known |= medians_of_damaged_frames()
    page = (ROOT / "results" / "experiments" / "README.md").read_text(encoding="utf-8")
    lines = PART.sub("", page).splitlines()  # parts are compared elsewhere
    printed = [
        word
        for line in lines
        if line.startswith("|")
        for word in re.findall(r"(?<![\w.])\.\d+", line)
    ]
    assert len(printed) > 80
    for word in printed:
        assert any(
            abs(value - float(word)) <= 0.5 * 10.0 ** (1 - len(word)) + 1e-9 for value in known
        ), word
    curve = {
        n: experiments["epochs, earlier set", "128 pixels", n, "FT"]
        for n in ("30", "60", "125", "250", "500")
    }
    assert max(curve, key=curve.get) == "60"


def test_experiments_find_no_cause_by_their_rules(experiments):
    wide, again = "dilations 6 to 18 minus printed", "128 pixels, trained again"
    t = [experiments["A", f"{n} pixels, {wide}", "60", "t of (NN + FT) / 2"] for n in (128, 192)]
    assert not t[0] <= 2 < t[1]
    assert (
        experiments["B", "width 48, trained again", "60", "FT"]
        <= experiments["B", "width 16", "60", "FT"]
    )
    of_last = (("500", "FT"), ("40 to 120", "FT"), ("last", "variation of FT"))
    late, early, varied = (experiments["C", again, *of] for of in of_last)
    assert late >= early - 2 * varied


def test_networks_at_128_pixels_have_the_epochs_of_the_page():
    for path in ROOT.glob("learned/models/*/literal-seed*/card.json"):
        assert json.loads(path.read_bytes())["schedule"]["epochs"] == (
            500 if "animals-III" in path.parts else 60
        )


def test_the_readme_names_what_must_be_installed():
    makefile, project = (
        (ROOT / name).read_text(encoding="utf-8") for name in ("Makefile", "pyproject.toml")
    )
    first, end = re.search(r'requires-python = ">=([\d.]+),<3\.(\d+)"', project).groups()
    assert f"You need Python {first} to 3.{int(end) - 1}, " in README
    assert f"`{re.search(r'apt-get install [.0-9a-z -]+', makefile)[0]}`" in " ".join(
        README.split()
    )


def test_committed_tables_are_those_of_the_published_records(tmp_path):
    words = ("tables", "--published", "--paper", "--results", ROOT / "results", "-o")
    call(*words, tmp_path / "all")
    made, committed = (
        {path.name: path.read_bytes() for path in f.iterdir()} for f in (tmp_path / "all", TABLES)
    )
    assert made == committed
    assert json.loads(made["tables.json"])
    call(*words, tmp_path / "one", "-t", "robustness")
    assert (tmp_path / "one" / "robustness.md").read_bytes() == committed["robustness.md"]


def test_the_plugin_of_the_readme_keeps_the_contract(tmp_path):
    (block,) = (text for text in blocks_of(README, "python") if "BiharmonicMDS" in text)
    path = tmp_path / "biharmonic.py"
    path.write_text(block, encoding="utf-8")
    (component,) = components_named(str(path))
    assert {finding.outcome for finding in check(component)} == {"ok"}
