"""Official sets that are here, or are not: where they are wanted, the table that ranks them, what is said of them."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.official import EXTENDED, SETS
from benchmark.errors import DatasetError
from benchmark.protocols.galleries import galleries
from tests.datasets.official.layouts import make


def test_an_absent_set_says_where_it_is_wanted_and_where_it_comes_from(tmp_path):
    with pytest.raises(DatasetError, match="'faust' is not at .*/faust; put it there .* http://faust.is.tue.mpg.de"):
        open_dataset("faust", tmp_path)


def test_the_extended_table_is_made_for_every_set_that_is_here(sets, tmp_path):
    assert set(EXTENDED) == set(SETS) - {"tosca"} - {"shrec14-synthetic", "shrec14-real", "topkids", "scape"}
    assert list(dict.fromkeys(gallery.name for gallery in galleries(["extended"], data_root=sets))) == [*EXTENDED]
    make("kids", tmp_path)
    chosen = galleries(["extended"], data_root=tmp_path)
    assert {(gallery.dataset.name, len(gallery.entries)) for gallery in chosen} == {("kids", 32)}
    assert {gallery.name for gallery in galleries([], ["kids"], tmp_path)} == {"kids"}


def test_the_list_fits_a_terminal_and_names_where_sets_belong(sets, tmp_path):
    (tmp_path / "kids").mkdir()
    environment = {"CANONICAL_FORMS_DATA": str(tmp_path)}
    lines = CliRunner().invoke(cli, ["list", "datasets"], env=environment).output.splitlines()
    assert lines[0].split() == ["name", "state", "shapes", "classes", "source"]
    assert max(map(len, lines)) <= 84
    by_name = {line.split()[0]: line for line in lines}
    assert re.search(r"not at shrec07 +400 +20 +IMATI", by_name["shrec07"])
    assert re.search(r"present +32 +2 +TU Munich", by_name["kids"])
    assert all(known.url.startswith("http") and known.terms for known in SETS.values())


ROOT = Path(__file__).parents[3]


def test_every_set_is_cited():
    entries = (ROOT / "benchmark" / "reference" / "references.bib").read_text()
    assert [name for name, known in SETS.items() if not re.search(rf"^@\w+{{{known.citation},$", entries, re.M)] == []
