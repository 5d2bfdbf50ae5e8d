"""Jittered sets: moved by a millionth, each number its own way, and otherwise the clean set."""

import numpy as np
import pytest

from benchmark.datasets.catalogue import is_present, open_dataset
from benchmark.datasets.jittered import AMOUNT, clean_name, jittered_name, parsed_jitter
from benchmark.errors import ConfigurationError
from benchmark.geometry.cleaning import extent_of


def test_names_are_read_as_they_are_written():
    assert parsed_jitter(jittered_name("a set", 12)) == ("a set", 12)
    assert parsed_jitter(jittered_name("animals[noise=3]", 1)) == ("animals[noise=3]", 1)
    assert clean_name("tosca[jitter=2]") == clean_name("tosca") == "tosca"
    assert [parsed_jitter(name) for name in ("tosca", "tosca[jitter=0]", "[jitter=1]", "tosca[noise=1]")] == [None] * 4
    assert is_present("humans[jitter=1]", None)
    assert not is_present("tosca[jitter=1]", None)
    with pytest.raises(ConfigurationError):
        open_dataset("no such set[jitter=1]", None)


def test_vertices_move_by_a_millionth_and_each_number_moves_them_in_its_own_way(rods):
    clean = open_dataset(str(rods), None)
    first, again, second = (open_dataset(jittered_name(str(rods), number), None) for number in (1, 1, 2))
    meshes = [clean.load(clean.entries[0])] + [each.load(each.entries[0]) for each in (first, again, second)]
    moves = [mesh.vertices - meshes[0].vertices for mesh in meshes[1:]]
    assert moves[0].std() == pytest.approx(AMOUNT * extent_of(meshes[0]), rel=0.1)
    np.testing.assert_array_equal(moves[0], moves[1])
    assert abs(np.corrcoef(moves[0].ravel(), moves[2].ravel())[0, 1]) < 0.1
    np.testing.assert_array_equal(meshes[1].faces, meshes[0].faces)
