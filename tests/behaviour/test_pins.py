"""Options, methods, data sets, columns and signatures are those that are written down."""

import pytest

from tests.behaviour.pins import PINNED, current


@pytest.fixture(scope="module")
def now(material):
    return current(material)


@pytest.mark.parametrize("name", ["options.json", "names.json", "columns.json", "scores-0.2.txt", "signatures.txt"])
def test_what_can_be_named_is_what_is_written_down(name, now):
    assert now[name].splitlines() == (PINNED / name).read_text(encoding="utf-8").splitlines()
