"""Tables in LaTeX: what stands in them, and that they fit the page."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from benchmark.report.content import contents
from benchmark.report.formats import render
from benchmark.report.latex import Columns, float_of, latex_files
from benchmark.report.results import Result
from tests.records import MEASURES, failed, record

TOSCA = {"name": "tosca", "title": "TOSCA", "n_shapes": 80, "n_classes": 9}

#: Class of a paper, and style of its references.
PAPERS = {
    r"\documentclass{article}": "plain",
    r"\documentclass[11pt]{article}": "plain",
    r"\documentclass[twocolumn]{article}": "plain",
    r"\documentclass{llncs}": "splncs04",
}


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
    assert all(r"\begin{table*}" in text for text in files.values())


def test_data_and_scorer_are_cited_and_a_job_without_scores_says_so(files):
    caption = re.search(r"\\caption{(.*)}", files["table-III-tosca-view.tex"])[1]
    assert r"TOSCA~\cite{bronstein2008tosca} (80 shapes, 9 classes)" in caption
    assert caption.endswith(r"Scorer: CM-BOF~\cite{lian2013cmbof}.")
    bad = failed(method="mine", title="Mine")
    (text,) = latex_files(contents([Result(record("gps")), Result(bad)])).values()
    assert r"Mine & \multicolumn{4}{c}{\textit{timeout}} \\" in text


def test_notes_stand_under_the_table_or_in_a_file_of_their_own_or_nowhere():
    tables = contents([Result(record("gps")), Result(failed(method="mine", title="Mine"))])
    assert list(latex_files(tables)) == ["table-rods.tex"]
    assert "Mine, mesh: timeout: stopped." in latex_files(tables)["table-rods.tex"]
    apart = latex_files(tables, "appendix")
    assert "stopped" not in apart["table-rods.tex"]
    assert r"\paragraph{Table~\ref{tab:table-rods}.} Mine, mesh: timeout: stopped." in apart["notes-table-rods.tex"]
    assert "stopped" not in "".join(latex_files(tables, "none").values())


def test_what_is_printed_is_one_table_or_its_rows_alone():
    tables = contents([Result(record("gps")), Result(record("mine", "view", title="Mine_1"))])
    assert list(render(tables, ["latex"], has_variants=False, has_sources=False)) == ["table-rods.tex"]
    (rows,) = render(tables, ["latex"], rows_only=True, has_sources=False).values()
    assert re.findall(r"^(\S+?)[ ~].*\\\\$", rows, re.MULTILINE) == ["Gps", r"Mine\_1", "Chance"]
    assert all(line.count(" & ") == 8 for line in rows.splitlines() if line != r"\midrule")
    assert "toprule" not in rows


def test_what_is_too_wide_or_too_tall_is_continued_under_one_number():
    wide = [Columns(sign, ("x",), [f"{sign}{k}" for k in range(60)], 8) for sign in ("", "-")]
    text = float_of("t", "caption", [f"row {k}" for k in range(60)], wide, notes=["noted"] * 400)
    parts = text.split(r"\begin{table*}")[1:]
    assert len(parts) >= 5
    assert [r"\caption{caption}" in part for part in parts] == [True] + [False] * (len(parts) - 1)
    assert all(r"\addtocounter{table}{-1}\caption{(continued)}" in part for part in parts[1:])
    assert text.count(r"\label{") == 1
    assert all(f"row {k} & {sign}{k} " in text for k in range(60) for sign in ("", "-"))
    assert text.count("noted.") == 400
    assert min(part.count("row ") for part in parts if "row " in part) >= 4


def test_ours_stands_beside_the_paper_with_the_difference_of_what_is_printed(files):
    (line,) = re.findall(r"Classic MDS.*", files["paper-table-III-tosca-mesh.tex"])
    assert line.startswith(r"Classic MDS \textsuperscript{1} \cite{elad2003bending} & 0.74 & 0.54 & 0.80 & 0.80 & ")
    assert line.endswith(r" & +0.01 & $-$0.04 & $-$0.30 & $-$0.30 \\")
    assert "rather long" not in files["paper-table-III-tosca-view.tex"]
    (chance,) = re.findall(r"Chance.*", files["paper-table-III-tosca-mesh.tex"])
    assert chance.count("--") == 4


def test_all_sources_are_in_the_list(files):
    known = Path("benchmark/reference/references.bib").read_text()
    cited = set(re.findall(r"\\cite\{(\w+)\}", "".join(files.values())))
    assert len(cited) > 5
    assert [key for key in cited if f"{{{key}," not in known] == []


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="needs pdflatex with booktabs, as in Debian's texlive")
@pytest.mark.parametrize("head", PAPERS)
def test_published_tables_and_their_references_fit_a_paper(tmp_path, head):
    """No table is scaled or runs off its page, and BibTeX has nothing to say."""
    name = re.findall(r"{(\w+)}", head)[0]
    if not subprocess.run(["kpsewhich", f"{name}.cls"], capture_output=True, check=False).stdout:
        pytest.skip(f"needs {name}.cls, as in Debian's texlive-publishers")
    tables = sorted(Path("results/tables").glob("*.tex"))
    assert len(tables) > 10
    inputs = "\n".join(rf"\input{{{path.resolve()}}}\clearpage" for path in tables)
    packages = r"\usepackage{booktabs,tabularx}"
    assert not any("resizebox" in path.read_text() for path in tables)
    references = rf"\nocite{{*}}\bibliographystyle{{{PAPERS[head]}}}\bibliography{{references}}"
    shutil.copy("results/tables/references.bib", tmp_path)
    text = f"{head}{packages}\\begin{{document}}\n{inputs}\n{references}\n\\end{{document}}\n"
    (tmp_path / "paper.tex").write_text(text)

    def run(*command):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=100, check=False)
        assert done.returncode == 0, done.stdout[-2000:]
        return done.stdout

    latex = ("pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex")
    run(*latex)
    assert "Warning" not in run("bibtex", "paper")
    run(*latex)
    said = run(*latex)
    for complaint in ("Overfull", "Float too large", "undefined"):
        assert complaint not in said
