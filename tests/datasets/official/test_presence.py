"""Official sets that are here, or are not: where they are wanted, the table that ranks them, what is said of them."""

import pytest

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
