"""Methods, scorers and data sets by name: those of the suite, of installed packages, and of plugin files."""

from benchmark.code_digest import code_digest, code_of
from benchmark.registry.components import Component, component_of
from benchmark.registry.known import BUILT_IN, SCORERS, by_name, methods
from benchmark.registry.selection import find, select, select_one, variants

__all__ = [
    "BUILT_IN",
    "SCORERS",
    "Component",
    "by_name",
    "code_digest",
    "code_of",
    "component_of",
    "find",
    "methods",
    "select",
    "select_one",
    "variants",
]
