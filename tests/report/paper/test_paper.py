"""The paper of results: what it says, that it compiles, and that its author's changes stay."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from click.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.pipeline.storage.records import Records
from benchmark.pipeline.storage.store import Store
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import contents
from benchmark.report.output import Folder
from benchmark.report.paper.document import TEMPLATES, characters, main_tables, paper_files
from benchmark.report.results import Result
from tests.records import MEASURES, failed, record
from tests.report.test_hostile_text import HOSTILE

ROOT = Path(__file__).parents[3]
TOSCA = {"name": "tosca", "title": "TOSCA", "n_shapes": 80, "n_classes": 9}
MADE = [
    {"environment": json.dumps({"python": "3.11.7", "numpy": version}), "artefacts": 4} for version in ("2.3", "2.4")
]
LONG = "A-title-that-nobody-can-break-" * 4 + "_" * 120


def tosca(method, input_, nn, **more):
    scores = dict.fromkeys(MEASURES, 0.5) | {"NN": nn}
    return record(method, input_, "tosca", nn, data=TOSCA, scores=scores, environments=MADE, **more)


RECORDS = [
    tosca("classic-mds", "mesh", 0.75),
    tosca("classic-mds", "view", 0.5),
    tosca("gps", "mesh", 1.0, finished="2026-02-03T00:00:00+00:00"),
    record("identity", "view", "animals", data={"name": "animals", "stand_in_for": "tosca"}),
    record("gps"),
    record("mine", title=HOSTILE),
    record(
        "cut", title="λ-cut of Ćwikła 猫", coverage=0.5, unsupported=[["cat0", "two pieces"], ["cat1", "two pieces"]]
    ),
    failed(method="late", title=LONG),
    record("gps", gallery="Über_my_shapes_whose_name_is_so_long_that_it_would_be_broken"),
]
NOTHING_KEPT = ArtefactReader(Store(Path("nowhere")), {})


@pytest.fixture(scope="module")
def papers():
    tables = main_tables(contents(map(Result, RECORDS)))
    return {template: paper_files(tables, NOTHING_KEPT, template) for template in TEMPLATES}


@pytest.fixture(scope="module")
def told(papers):
    """Text of the files of an article, by name, with each run of blanks as one."""
    return {name: " ".join(data.decode().split()) for name, data in papers["article"].items() if name.endswith("tex")}


def test_it_has_the_papers_tables_of_the_official_set_and_those_of_own_data(told):
    (named,) = (name for name in told if name.startswith("tables/table-ber_my_shapes"))
    tables = {"table-III-tosca", "table-rods", named[7:-4]}
    intervals = {"intervals-table-III-tosca-mesh", "intervals-table-III-tosca-view", "intervals-table-rods-mesh"}
    intervals |= {f"intervals-{named[7:-4]}-mesh"}
    assert {name for name in told if "/" in name} == {f"tables/{name}.tex" for name in tables | intervals}
    assert all(rf"\input{{tables/{name}}}" in told["results.tex"] for name in tables)
    assert all(rf"\input{{tables/{name}}}" in told["appendix.tex"] for name in intervals)


def test_where_no_table_is_the_papers_or_ones_own_all_are_there():
    animals = record("gps", gallery="animals held out", data={"name": "animals", "stand_in_for": "tosca"})
    assert [table.identifier for table in main_tables(contents([Result(animals)]))] == ["III-held-out"]


def test_the_protocol_says_what_was_run_on_what_and_with_which_versions(told):
    text = told["protocol.tex"]
    assert r"Table~\ref{tab:table-III-tosca}, which is Table~III of~\cite{canonicalreconstruction}, uses" in text
    assert r"uses TOSCA~\cite{bronstein2008tosca}: 80 shapes, 9 classes." in text
    assert r"Table~\ref{tab:table-rods} uses rods: 4 shapes, 2 classes." in text
    assert "4 methods ran in 7 jobs with scores" in text
    assert r"The scorer is CM-BOF~\cite{lian2013cmbof}. All random choices follow from base seed 0." in text
    assert "between 2026-01-01 and 2026-02-03 (UTC) with python 3.11.7, numpy 2.3 and 2.4." in text
    assert r"\emph{Mesh}" in text
    assert r"\emph{View}" in text


def test_the_protocol_names_what_has_no_result_of_every_shape(told):
    text = told["protocol.tex"]
    assert r"Of the 3 rows of Table~\ref{tab:table-III-tosca}, counted for each input, all have" in text
    assert r"Of the 4 rows of Table~\ref{tab:table-rods}, counted for each input, 2 have a result for every" in text
    assert "``λ-cut of Ćwikła 猫'' (mesh), 50.0\\% of the shapes;" in text
    assert "(mesh), none (timeout)." in text
    assert "are not methods of the suite and have no entry" in text


def test_each_table_has_its_best_row_and_its_figure(papers, told):
    assert r"For input \emph{mesh}, ``" in told["results.tex"]
    figures = {name for name in papers["article"] if name.startswith("figures/")}
    assert figures >= {"figures/scores-table-III-tosca.pdf", "figures/scores-table-rods.pdf"}
    assert all(f"{{{name}}}" in told["results.tex"] for name in figures)


def test_intervals_stand_beside_their_figures(told):
    (line,) = re.findall(r"Gps.*?\\\\", told["tables/intervals-table-rods-mesh.tex"])
    assert len(re.findall(r"\\enspace \d\.\d\d–\d\.\d\d", line)) == 4


def test_figures_of_the_paper_are_counted_and_its_claims_judged():
    tables = contents([Result(tosca(name, "view", 0.97)) for name in ("learned", "classic-mds")])
    text = paper_files(tables, NOTHING_KEPT, "ieee")["statistics.tex"].decode()
    assert re.search(r"\nIII & view & (\d & )+\d \\\\", text)
    assert r"\item" not in text


def test_characters_that_latex_lacks_are_declared():
    assert characters("plain Ćwikła – naïve") == characters("")
    assert r"\DeclareUnicodeCharacter{732B}{[U+732B]}" in characters("猫")
    assert r"\DeclareUnicodeCharacter{0105}{a}" in characters("ą")


def folder_of(root, force=False):
    return Folder(root, "paper", "written-by-paper.json", force)


def compiled(folder):
    """Compile a paper as its reader does."""
    # Programs of TeX break their lines by bytes, and so inside of characters and words, wherever a path ends.
    unbroken = {**os.environ, "max_print_line": "10000"}
    done = subprocess.run(["make"], cwd=folder, capture_output=True, timeout=250, check=False, env=unbroken)
    assert done.returncode == 0, done.stdout[-3000:].decode(errors="replace")
    assert "Warning" not in (folder / "paper.blg").read_text(errors="replace")
    assert (folder / "paper.pdf").stat().st_size > 20_000
    log = (folder / "paper.log").read_text(errors="replace")
    assert [word for word in ("Overfull", "Float too large", "undefined", "multiply", "Missing") if word in log] == []


NEEDS_LATEX = pytest.mark.skipif(
    shutil.which("pdflatex") is None or shutil.which("bibtex") is None,
    reason="needs pdflatex and bibtex, as in Debian's texlive",
)


@pytest.fixture
def has_class(template):
    """Skip where the class of a template is not installed."""
    name = {"article": "article", "ieee": "IEEEtran"}[template]
    if not subprocess.run(["kpsewhich", f"{name}.cls"], capture_output=True, check=False).stdout:
        pytest.skip(f"needs {name}.cls, as in Debian's texlive-publishers")


@NEEDS_LATEX
@pytest.mark.parametrize("template", TEMPLATES)
@pytest.mark.usefixtures("has_class")
def test_it_compiles_whatever_titles_hold_and_nothing_runs_off_the_page(papers, tmp_path, template):
    folder_of(tmp_path).write(papers[template])
    compiled(tmp_path)


@pytest.mark.slow
@NEEDS_LATEX
@pytest.mark.parametrize("template", TEMPLATES)
@pytest.mark.usefixtures("has_class")
def test_the_published_results_compile(tmp_path, template):
    command = ["paper", "--published", "--results", str(ROOT / "results"), "--template", template, "-o", str(tmp_path)]
    done = CliRunner().invoke(cli, command)
    assert done.exit_code == 0, done.output
    assert len(list((tmp_path / "tables").glob("table-*.tex"))) == 4
    compiled(tmp_path)


# The folder ----------------------------------------------------------------------------------------------------------


def write(folder, force=False, **files):
    return folder_of(folder, force).write({name.replace("_", "."): text.encode() for name, text in files.items()})


def test_what_its_author_has_changed_is_kept_and_all_else_written_anew(tmp_path):
    assert write(tmp_path, a_tex="1", b_tex="1", old_tex="1", gone_tex="1") == []
    (tmp_path / "a.tex").write_text("mine")
    (tmp_path / "old.tex").write_text("mine")
    assert write(tmp_path, a_tex="2", b_tex="2") == ["a.tex"]
    assert write(tmp_path, a_tex="3", b_tex="3") == ["a.tex"]
    found = {path.name: path.read_text() for path in tmp_path.glob("*.tex")}
    assert found == {"a.tex": "mine", "b.tex": "3", "old.tex": "mine"}
    assert write(tmp_path, force=True, a_tex="4", b_tex="4") == []
    assert (tmp_path / "a.tex").read_text() == "4"
    assert write(tmp_path, a_tex="5", b_tex="4") == []


def test_a_file_of_somebody_else_is_refused_before_anything_is_written(tmp_path):
    (tmp_path / "b.tex").write_text("theirs")
    with pytest.raises(Exception, match=r"b.tex was not written by 'paper'; choose another folder"):
        write(tmp_path, a_tex="1", b_tex="1")
    assert [path.name for path in tmp_path.iterdir()] == ["b.tex"]


def test_a_figure_that_its_author_puts_there_is_kept(tmp_path):
    write(tmp_path, a_tex="1")
    (tmp_path / "forms.pdf").write_text("drawn")
    assert write(tmp_path, a_tex="1", forms_pdf="2") == ["forms.pdf"]
    assert write(tmp_path, a_tex="1", forms_pdf="3") == ["forms.pdf"]
    assert (tmp_path / "forms.pdf").read_text() == "drawn"


def test_stopped_halfway_it_takes_nothing_for_its_authors(tmp_path, monkeypatch):
    write(tmp_path, a_tex="1", b_tex="1")
    with monkeypatch.context() as patch:
        patch.setattr("benchmark.report.output.write_atomically", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            write(tmp_path, a_tex="2", b_tex="2")
    (tmp_path / "a.tex").write_text("2")
    assert write(tmp_path, a_tex="3", b_tex="3") == []


def test_a_list_of_files_leads_out_of_no_folder(tmp_path):
    (tmp_path / "paper").mkdir()
    (tmp_path / "mine").write_text("1")
    digest = "6b86b273ff34fce19d6b804eff5a3f5747ada4eaa22f1d49c01e52ddb7875b4b"
    (tmp_path / "paper" / "written-by-paper.json").write_text(json.dumps({"../mine": [digest]}))
    write(tmp_path / "paper", a_tex="1")
    assert (tmp_path / "mine").exists()


# The verb ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def results(tmp_path):
    folder = Records(tmp_path / "results" / "runs" / "records")
    for each in (record("gps"), record("mine")):
        folder.write(each)
    return tmp_path / "results"


def test_a_folder_with_one_set_and_two_methods_is_a_paper(results, tmp_path):
    done = CliRunner().invoke(cli, ["paper", "--results", str(results), "-o", str(tmp_path / "paper")])
    assert (done.exit_code, done.stderr) == (0, "")
    assert f"compile them: make -C {tmp_path / 'paper'}" in done.stdout
    assert "report -d DATASET --figure" in done.stdout
    assert (tmp_path / "paper" / "tables" / "table-rods.tex").is_file()


def test_a_selection_has_its_own_tables_alone_and_an_empty_folder_says_what_to_do(results, tmp_path):
    chosen = CliRunner().invoke(
        cli, ["paper", "-d", "rods", "-m", "gps", "--results", str(results), "-o", str(tmp_path)]
    )
    assert chosen.exit_code == 0, chosen.output
    assert "Mine" not in (tmp_path / "tables" / "table-rods.tex").read_text()
    nothing = CliRunner().invoke(cli, ["paper", "--results", str(tmp_path / "none"), "-o", str(tmp_path / "p")])
    assert "run it first" in str(nothing.exception)
    assert not (tmp_path / "p").exists()
