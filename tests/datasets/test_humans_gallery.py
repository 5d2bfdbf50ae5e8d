"""Galleries of any number of generated bodies."""

import hashlib
from dataclasses import astuple

import pytest

from benchmark.datasets.catalogue import is_known, open_dataset
from benchmark.datasets.human_poses import POSES
from benchmark.datasets.humans import sample_human
from benchmark.datasets.humans_gallery import HumansGallery, _body
from benchmark.errors import ConfigurationError
from benchmark.protocols.galleries import galleries


def test_a_name_in_any_spelling_is_one_gallery_with_a_table_of_its_own():
    names = ("humans[subjects=5,poses=3]", " humans [poses=03, subjects=5]")
    chosen = [galleries((), [name]) for name in names]
    assert [[gallery.name for gallery in each] for each in chosen] == [["humans[subjects=5,poses=3]"]] * 2
    (gallery,) = chosen[0]
    assert len(gallery.entries) == 15
    assert gallery.table.identifier == gallery.name
    assert open_dataset("humans", None).name == "humans"
    assert not is_known("humans[subjects=5")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("humans[]", "is no gallery"),
        ("humans[poses=3]", "is no gallery"),
        ("humans[subjects=5,height=2]", "is no gallery"),
        ("humans[subjects=many]", "subjects of .* is no number"),
        ("humans[subjects=1]", "cannot have 1 subjects; choose 2 to"),
        ("humans[subjects=5,poses=21]", "cannot have 21 poses; choose 2 to 20"),
    ],
)
def test_what_is_no_gallery_is_refused(name, said):
    with pytest.raises(ConfigurationError, match=said):
        open_dataset(name, None)


def test_a_larger_gallery_begins_with_the_smaller_one_and_repeats_no_body():
    small, large = HumansGallery(5, 2), HumansGallery(2000, 3)
    recipes = [large.recipe(entry) for entry in large.entries if entry.pose in list(POSES)[:2]]
    assert [small.recipe(entry) for entry in small.entries] == recipes[: len(small.entries)]
    assert len(set(recipes)) == len(recipes)
    trained = {astuple(sample_human(index, 0, 0)[0]) for index in range(200)}
    assert (
        hashlib.sha256(repr([_body(f"body-{n}") for n in range(200)]).encode()).hexdigest()[:16] == "fd10170ec93762bf"
    )
    assert not trained & {astuple(_body(f"body-{index}")) for index in range(2000)}
