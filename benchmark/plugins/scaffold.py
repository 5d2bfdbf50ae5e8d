"""Templates for ``new``: a working plugin of each kind with its test, and the program of an external one."""

from __future__ import annotations

import keyword
import re
import sys
from collections.abc import Callable, Container
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

from benchmark.datasets.catalogue import CATALOGUE
from benchmark.errors import ConfigurationError
from benchmark.files import write_text
from benchmark.plugins.registry import methods
from benchmark.plugins.scorers import scorers
from benchmark.text import LONGEST_NAME, RESERVED, is_name

__all__ = ["KINDS", "new_plugin"]

#: Example of each kind; ``new`` writes it under another name.
_EXAMPLES = {
    "method": "ray-stretch",
    "external": "graph-stress",
    "descriptor": "distance-profile",
    "learner": "nearest-view",
    "scorer": "distance-distribution",
    "dataset": "bent-ellipsoids",
}

#: Distributions of each installed module, cached because the query takes half a second.
_installed = cache(packages_distributions)

KINDS = tuple(_EXAMPLES)
"""Kinds of plugins that can be written."""


def new_plugin(kind: str, name: str, folder: Path = Path()) -> list[Path]:
    """Write a small working plugin and its test; no file is overwritten.

    Parameters
    ----------
    kind
        One of :data:`KINDS`.
    name
        Name in lower case, with hyphens between words.
    folder
        Folder for ``name_with_underscores.py`` and ``test_name_with_underscores.py``; created if necessary.

    Returns
    -------
    list of pathlib.Path
        The plugin, its test, and the program of an external one.

    Raises
    ------
    ConfigurationError
        If the name is invalid, a file already exists, or the folder cannot be written.
    """
    _check_name(kind, name)
    texts: dict[Path, str] = {}
    for source in _sources(_EXAMPLES[kind]):
        parts = source.name, source.read_text("utf-8")
        for old, new in zip(_spellings(_EXAMPLES[kind]), _spellings(name), strict=True):
            parts = parts[0].replace(old, new), parts[1].replace(old, new)
        texts[folder / parts[0]] = parts[1]
    _check_python(name, next(iter(texts.values())))
    for path in texts:
        if path.exists():
            raise ConfigurationError(f"{path} exists already", "choose another name or folder")
    try:
        for path, text in texts.items():
            write_text(path, text)
    except OSError as error:
        raise ConfigurationError(f"{folder} cannot be written to: {error}", "choose another folder") from error
    return list(texts)


def _spellings(name: str) -> tuple[str, str, str, str]:
    """Return a name as written on the command line, for a module, for a class, and in tables."""
    title = " ".join(word.capitalize() for word in name.split("-"))
    return name, name.replace("-", "_"), title.replace(" ", ""), title


def _sources(example: str) -> list[Path]:
    """Return the plugin file of an example, its test, and the program that it calls."""
    package = Path(__file__).parents[1] / "examples"  # in an installed suite; a checkout has them at its root
    folder = package if package.is_dir() else Path(__file__).parents[2] / "examples"
    module = example.replace("-", "_")
    return [folder / f"{module}.py", folder / f"test_{module}.py", *folder.glob(f"{module}.cpp")]


def _check_name(kind: str, name: str) -> None:
    """Raise ``ConfigurationError`` if the name is invalid or taken."""
    what = "data set" if kind == "dataset" else kind
    if not is_name(name):
        words = re.findall(r"[a-z][a-z0-9]*|[0-9]+", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", name).lower())
        hint = "join lower-case words by hyphens" + (f": {'-'.join(words)}" if words and words[0].isalpha() else "")
        if len(name) > LONGEST_NAME:
            name, hint = f"{name[:20]}...", f"use {LONGEST_NAME} characters at most"
        raise ConfigurationError(f"'{name}' cannot be the name of a {what}", hint)
    known: dict[str, Callable[[], Container[str]]] = {"data set": lambda: CATALOGUE, "scorer": scorers}
    taken, names = (what, known[what]()) if what in known else ("method", methods())
    if name in names or name in RESERVED:
        raise ConfigurationError(f"there is already a {taken} '{name}'", "choose another name")


def _check_python(name: str, plugin: str) -> None:
    """Raise ``ConfigurationError`` if a name would hide another name in the file, or the file another module."""
    _, module, class_name, _ = _spellings(name)
    is_imported = re.search(rf"^(?:(?:from|import) .*\b{class_name}\b|    {class_name},$)", plugin, re.MULTILINE)
    if keyword.iskeyword(module) or keyword.iskeyword(class_name) or is_imported:
        raise ConfigurationError(f"'{name}' has another meaning in the file", f"choose another name: my-{name}")
    if module in sys.stdlib_module_names or module in _installed():
        raise ConfigurationError(
            f"{module}.py would hide the Python module '{module}'", f"choose another name: my-{name}"
        )
