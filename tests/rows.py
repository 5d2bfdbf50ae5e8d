"""Which rows of the tables are canonical forms, for tests of what the pages say of them."""

from __future__ import annotations

from benchmark.registry import methods


def is_form(name: str) -> bool:
    """Whether a row, by the name of its method with or without parameters, is a canonical form without training."""
    spec = methods()[name.partition("[")[0]]
    return spec.info.family != "control" and not spec.describes and not spec.learns
