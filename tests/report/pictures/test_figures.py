"""Figures for papers: of forms that are there or made, and of cost; the same figure is the same file."""

import pytest
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.errors import ConfigurationError
from benchmark.report.content import contents
from benchmark.report.pictures.charts import cost_figure
from benchmark.report.pictures.painting import ENDINGS, save
from benchmark.report.results import Result
from tests.records import failed, record
from tests.toy import write_rods


def table(*records):
    return contents([Result(each) for each in records])[0]


def costs(method, nn, seconds, **more):
    return record(method, nn=nn, cost={"seconds_per_shape": {"canonicalise": seconds}}, **more)


@pytest.mark.parametrize("ending", ENDINGS)
def test_the_same_figure_is_the_same_file(ending, tmp_path):
    for name in ("first", "second"):
        save(cost_figure(table(costs("gps", 0.75, 1.0))), tmp_path / f"{name}{ending}")
    first, second = ((tmp_path / f"{name}{ending}").read_bytes() for name in ("first", "second"))
    assert first == second
    assert len(first) > 1000


def test_the_front_of_a_figure_leaves_controls_out_and_titles_are_no_formulas():
    rows = [
        costs("slow", 1.0, 9.0, title="Cost $ x_{"), costs("fast", 0.75, 1.0), costs("beaten", 0.5, 2.0),
        costs("control", 1.0, 0.1, family="control"),
    ]  # fmt: skip
    figure = cost_figure(table(*rows), "NN")
    (place,) = figure.axes
    front = next(line for line in place.lines if line.get_drawstyle() == "steps-post")
    assert [list(front.get_xdata()), list(front.get_ydata())] == [[1.0, 9.0], [0.75, 1.0]]
    assert any("Cost $ x_{" in text.get_text() for text in place.texts)
    figure.draw_without_rendering()


def test_no_scores_are_no_figure_of_cost():
    with pytest.raises(ConfigurationError, match="no row of the table has scores and a cost"):
        cost_figure(table(failed(), failed(method="fast-mds")))


@pytest.mark.slow
def test_figures_of_forms_make_what_they_lack_and_name_what_is_not_there(tmp_path):
    write_rods(tmp_path / "rods")
    asked = ["report", "-d", str(tmp_path / "rods"), "--input", "mesh", "-m", "gps", "-m", "shape-dna"]
    asked += ["--results", str(tmp_path / "results"), "--figure", str(tmp_path / "figure.png")]
    for more in ([], ["--of", "effect"], ["--subject", "thick"], ["--shape", "thin0", "--shape", "thick1"]):
        (tmp_path / "figure.png").unlink(missing_ok=True)
        done = CliRunner().invoke(cli, [*asked, *more])
        assert done.exit_code == 0, done.output
        assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
    for more, said in (
        (["--subject", "thinn"], "subject of"),
        (["--shape", "thin9"], "shape of"),
        (["--of", "effect", "--shape", "thin9"], "shape of"),
    ):
        done = CliRunner().invoke(cli, [*asked, *more])
        assert isinstance(done.exception, ConfigurationError)
        assert said in str(done.exception)
    alone = [*asked[:5], "-m", "shape-dna", *asked[9:]]
    assert "none of the methods computes forms" in str(CliRunner().invoke(cli, alone).exception)


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Words that choose the results of a descriptor on rods."""
    base = tmp_path_factory.mktemp("ran")
    write_rods(base / "rods")
    chosen = ["-d", str(base / "rods"), "-m", "surface-area", "--input", "mesh", "--results", str(base / "results")]
    assert CliRunner().invoke(cli, ["run", *chosen, "-j", "0"]).exit_code == 0
    return chosen


@pytest.mark.parametrize("what", ["precision-recall", "confusion", "classes"])
def test_a_chart_is_a_picture_with_fonts_that_publishers_take(ran, what, tmp_path):
    for ending, head in ((".png", b"\x89PNG"), (".pdf", b"%PDF")):
        target = tmp_path / f"{what}{ending}"
        done = CliRunner().invoke(cli, ["report", *ran, "--of", what, "--figure", str(target)])
        assert (done.exit_code, done.stdout) == (0, f"wrote {target}\n")
        assert target.read_bytes().startswith(head)
    fonts = (tmp_path / f"{what}.pdf").read_bytes()
    assert b"/Type3" not in fonts
    assert b"/CIDFontType2" in fonts


@pytest.mark.parametrize("what", ["precision-recall", "confusion"])
def test_without_distances_a_chart_says_so(what, tmp_path):
    asked = ["report", "-t", "III", "--published", "--of", what, "--figure", str(tmp_path / "chart.pdf")]
    assert "no distances of the table are stored here" in str(CliRunner().invoke(cli, asked).exception)
