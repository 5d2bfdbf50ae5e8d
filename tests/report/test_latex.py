"""Tables in LaTeX: what stands in them, and that they fit the page."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from benchmark.report.content import contents
from benchmark.report.escaping import latex_text
from benchmark.report.latex import latex_files
from benchmark.report.results import Result
from tests.records import MEASURES, record

TOSCA = {"name": "tosca", "title": "TOSCA", "n_shapes": 80, "n_classes": 9}

ONE_COLUMN = r"\documentclass{article}"
TWO_COLUMNS = r"\documentclass[twocolumn]{article}"


def tosca(method, input_, nn, **more):
    scores = dict.fromkeys(MEASURES, 0.5) | {"NN": nn}
    return Result(record(method, input_, "tosca", nn, data=TOSCA, scores=scores, **more), more.pop("outdated", ""))


@pytest.fixture(scope="module")
def files():
    results = [
        tosca("classic-mds", "mesh", 0.75),
        tosca("classic-mds", "view", 0.5),
        tosca("gps", "mesh", 1.0),
        tosca("accelerated-mds", "view", 0.25, title="A rather long title of a method (start=classic)"),
        Result(tosca("skeleton", "mesh", 0.75).record, "code of baselines.skeleton changed"),
    ]
    found = contents(results, ["III"])
    return latex_files([table for table in found if table.identifier == "III"])


def test_each_input_has_a_file_and_so_has_the_paper_beside_it(files):
    assert list(files) == [
        "table-III-tosca.tex",
        "table-III-tosca-mesh.tex", "paper-table-III-tosca-mesh.tex",
        "table-III-tosca-view.tex", "paper-table-III-tosca-view.tex",
    ]  # fmt: skip
    assert all(rf"\label{{tab:{name.removesuffix('.tex')}}}" in text for name, text in files.items())
    spanning = [name for name, text in files.items() if r"\begin{table*}" in text]
    assert spanning == ["table-III-tosca.tex"]


def test_ours_stands_beside_the_paper_with_the_difference_of_what_is_printed(files):
    (line,) = re.findall(r"Classic MDS.*", files["paper-table-III-tosca-mesh.tex"])
    assert line.startswith(r"Classic MDS~\cite{elad2003bending} & 0.74 & 0.54 & 0.80 & 0.80 & ")
    assert line.endswith(r" & +0.01 & $-$0.04 & $-$0.30 & $-$0.30 \\")
    assert "rather long" not in files["paper-table-III-tosca-view.tex"]
    (chance,) = re.findall(r"Chance.*", files["paper-table-III-tosca-mesh.tex"])
    assert chance.count("--") == 4


def test_a_row_that_has_nothing_under_an_input_stays_out_of_its_table(files):
    assert "rather long" in files["table-III-tosca-view.tex"]
    assert "rather long" not in files["table-III-tosca-mesh.tex"]
    assert "skeleton" in files["table-III-tosca-mesh.tex"].lower()


def test_notes_are_a_block_and_leave_out_what_changed(files):
    text = files["table-III-tosca-mesh.tex"]
    assert r"\tablenotes{" in text
    assert r"\dag{} Made before the last change" in text
    assert "baselines" not in text


def test_two_hyphens_of_a_command_are_no_dash():
    assert latex_text("run --only x") == "run -{}-only x"


def test_all_sources_are_in_the_list(files):
    known = Path("benchmark/reference/references.bib").read_text()
    cited = set(re.findall(r"\\cite\{(\w+)\}", "".join(files.values())))
    assert len(cited) > 5
    assert [key for key in cited if f"{{{key}," not in known] == []


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="needs pdflatex with booktabs, as in Debian's texlive")
@pytest.mark.parametrize("head", [ONE_COLUMN, TWO_COLUMNS])
def test_published_tables_compile_and_fit_the_page(tmp_path, head):
    tables = sorted(Path("results/tables").glob("*.tex"))
    assert len(tables) > 10
    inputs = "\n".join(rf"\input{{{path.resolve()}}}\clearpage" for path in tables)
    packages = r"\usepackage{booktabs,graphicx}"
    report = r"\let\use\usebox\renewcommand{\usebox}[1]{\typeout{scaled \the\wd0 / \the\linewidth}\use{#1}}"
    (tmp_path / "paper.tex").write_text(f"{head}{packages}{report}\\begin{{document}}\n{inputs}\n\\end{{document}}\n")
    done = subprocess.run(
        ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"],
        cwd=tmp_path, capture_output=True, text=True, timeout=100, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-2000:]
    assert "Overfull" not in done.stdout
    assert "Float too large" not in done.stdout
    widths = re.findall(r"scaled ([\d.]+)pt ?/ ([\d.]+)pt", done.stdout)
    assert len(widths) == len(tables)
    # What is meant for the text of an article is legible there, and what spans two columns, across both.
    spans = [r"\begin{table*}" in path.read_text() for path in tables]
    meant = [wide == (head == TWO_COLUMNS) for wide in spans]
    scales = [float(line) / float(own) for (own, line), fits in zip(widths, meant, strict=True) if fits]
    assert len(scales) > 3
    assert min(scales) > 0.7
