"""Sources of methods as text."""

import pytest

from benchmark.plugins.registry import BUILT_IN, methods
from benchmark.reference.paper import source_of


@pytest.mark.parametrize("name", BUILT_IN)
def test_every_source_is_told_as_text(name):
    cite = methods()[name].info.cite
    told = source_of(cite)
    assert (told != cite) or not cite
    assert not set("\\{}") & set(told)
