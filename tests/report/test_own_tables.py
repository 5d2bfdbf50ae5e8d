"""Tables of somebody's own shapes speak of them and not of the paper; a run prints the rows that were asked for."""

import shutil

import pytest
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.report.content import contents
from benchmark.report.formats import markdown
from benchmark.report.latex import latex
from benchmark.report.results import Result
from tests.records import record
from tests.toy import write_rods

MODEL = {"digest": "a", "training": "t", "data": "humans", "schedule": "60 epochs", "extra_data": False}
HUMANS = {"name": "humans", "title": "Humans", "stand_in_for": "shrec14-synthetic"}


def learned(method="learned", title="Our", gallery="rods", seed=0, **more):
    made = record(method, "view", gallery, title=title, models=[MODEL], **more)
    return Result(made | {"recipe": made["recipe"] | {"seed": seed}})


def table_of(*results, **options):
    (table,) = contents(results, **options)
    return table


def test_the_network_is_not_ours_there_and_the_papers_schedule_is_not_told():
    bridges = {"bridges": {"mean": 0.0, "max": 0.0}}
    table = table_of(learned(notes=bridges), learned("learned-wide-extra", "Our, wide"))
    text = markdown(table)
    assert "| Reconstruction network " in text
    assert "| Reconstruction network, wide " in text
    assert "trained on humans: 60 epochs" in text
    for words in ("Our", "paper", "bridges"):
        assert words not in text
    assert r"Reconstruction network \textsuperscript{1} \cite{canonicalreconstruction}" in latex(table)
    own = table_of(learned("mine", "Our thing", notes={"bridges": {"mean": 0.5, "max": 2.0}}))
    assert "| Our thing " in markdown(own)
    assert "0.5 bridges per shape on average, 2 at most" in markdown(own)


def test_seeds_of_a_training_have_a_row_each_and_another_base_seed_is_told():
    seeded = learned("learned[training_seed=1]", "Our (training_seed=1)", parameters={"training_seed": 1})
    table = table_of(learned(), seeded)
    assert [row.title for row in table.rows] == ["Reconstruction network", "Reconstruction network (training_seed=1)"]
    other = table_of(learned(seed=3))
    assert other.caption == "Retrieval on rods, seed 3"
    assert other.file_stem == "table-rods-seed-3"
    assert markdown(other).startswith("**Table rods. Retrieval on rods, seed 3: rods (4 shapes")


def test_rows_of_the_ablation_are_in_other_tables_of_the_paper_where_they_are_named():
    seeded = [
        learned("learned[training_seed=1]", "Our (training_seed=1)", f"humans fold {k}", data=HUMANS,
                parameters={"training_seed": 1})
        for k in range(3)
    ]  # fmt: skip
    results = [*seeded, Result(record("gps", "view", "humans fold 0", data=HUMANS))]
    for named in (False, True):
        rows = [row.title for row in table_of(*results, tables=["I"], blanks=False, named=named).rows]
        assert rows == ["GPS", *["Our (training_seed=1)"] * named]


@pytest.mark.slow
def test_a_run_prints_what_was_asked_for_and_nothing_else(tmp_path):
    """Also of jobs that were done before, under --quick or for a folder of another name."""
    write_rods(tmp_path / "rods")
    shutil.copytree(tmp_path / "rods", tmp_path / "copy")

    def rows(folder, *methods, more=()):
        named = [word for name in methods for word in ("-m", name)]
        options = ["-d", str(tmp_path / folder), "--input", "mesh", "--results", str(tmp_path / "results"), *more]
        done = CliRunner().invoke(cli, ["run", *options, *named, "-j", "0"])
        assert done.exit_code == 0, done.output
        assert f"**Table {folder}. " in done.output
        return [line.split("|")[1].strip() for line in done.output.splitlines() if line.startswith("| ")][2:-1]

    assert rows("rods", "gps", "fast-mds", more=["--quick"]) == ["GPS ‡ ¹", "Fast MDS"]
    assert rows("rods", "fast-mds", "surface-area") == ["Fast MDS", "Surface area"]
    assert rows("copy", "gps") == ["GPS ‡ ¹"]
