"""Tables at a terminal, and which rows there are."""

import os
import re
from pathlib import Path

import pytest
from benchmark.cli.selection import recorded
from benchmark.cli.terminal import drawn
from benchmark.report.content import contents
from rich.console import Console
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.cli.options import Selection
from benchmark.errors import ConfigurationError
from benchmark.pipeline.storage.store import Store
from tests.records import copy_published

ROOT = Path(__file__).parents[2]


def published(*methods, table="III", dataset="tosca", results=ROOT / "results", **more):
    """Tables of what came with the suite."""
    options = {"tables": (table,), "methods": methods, "datasets": (dataset,), "plugins": ()}
    selection = Selection(**options, results=results, **more)
    store = Store(results / "runs", published_only=True)
    return contents(recorded(selection, store), (table,), blanks=not selection.is_narrow)


def shown(table, width, only=""):
    console = Console(width=width, record=True, file=open(os.devnull, "w"))  # noqa: SIM115, PTH123
    console.print(drawn(table, only))
    return console.export_text().splitlines()


@pytest.fixture(scope="module")
def table():
    return published("gps", "identity")[0]


def test_a_table_is_as_wide_as_the_terminal_and_loses_no_figure(table):
    figures = re.findall(r"\d\.\d\d|--", "\n".join(shown(table, 200)))
    for width in (80, 100, 140):
        lines = shown(table, width)
        assert max(map(len, lines)) <= width
        assert re.findall(r"\d\.\d\d|--", "\n".join(lines)) == figures


# Which rows there are ------------------------------------------------------------------------------------------------


def rows(*methods, **more):
    return [row.method for row in published(*methods, **more)[0].rows]


def test_a_named_method_has_its_row_and_no_other_has_a_blank_one():
    assert rows("gps") == ["gps"]
    assert rows("gps", "identity") == ["gps", "identity"]


def test_a_table_that_is_none_or_has_no_record_is_refused_and_nothing_is_written(tmp_path):
    copy_published(tmp_path / "records", lambda each: each["gallery"] == "tosca" and each["method"] == "gps")
    out = str(tmp_path / "out")
    for verb in (["tables"], ["tables", "--format", "markdown", "--check"], ["report"]):
        for table, message in (("V", "unknown table 'V'"), ("II", "belongs to table II")):
            done = CliRunner().invoke(cli, [*verb, "-t", table, "--results", str(tmp_path), "-o", out])
            assert isinstance(done.exception, ConfigurationError), done.output
            assert message in str(done.exception)
    assert not (tmp_path / "out").exists()
