"""Methods and scorers by name: those of the suite and of plugin files."""

from benchmark.registry.components import Component, component_of
from benchmark.registry.known import BUILT_IN, SCORERS, by_name
from benchmark.registry.selection import find, select, select_one

__all__ = [
    "BUILT_IN",
    "SCORERS",
    "Component",
    "by_name",
    "component_of",
    "find",
    "select",
    "select_one",
]
