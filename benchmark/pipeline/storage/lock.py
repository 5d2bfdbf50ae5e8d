"""Versions of the components of the suite: digests of their golden results, and the code that these were made by.

A component is what makes a part of a result: a method, a scorer, the preparation of an input, a generated data set. Its
version is the digest of its committed golden results, so that code may change as long as they stay.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from benchmark.errors import ConfigurationError
from benchmark.files import write_text
from benchmark.pipeline.storage.keys import digest
from benchmark.source_code import ROOT, code_of, digest_of_bytes, forget_sources, text_of

PATH = ROOT / "benchmark" / "versions.lock"


class Component(NamedTuple):
    """A component as it was when its golden results were made.

    Parameters
    ----------
    golden
        Digest of its golden results: its version.
    folders
        Folders of the code that it runs.
    """

    golden: str
    folders: tuple[str, ...]


class Code(NamedTuple):
    """The modules of a folder: digests of their text, and of their code without docstrings, comments and layout."""

    text: str
    code: str


class Lock(NamedTuple):
    """What ``versions.lock`` says."""

    components: Mapping[str, Component]
    code: Mapping[str, Code]


@cache
def read_lock(path: Path = PATH) -> Lock:
    """Return the versions of all components, and the code that they were checked with.

    Raises
    ------
    ConfigurationError
        If the file is damaged, or two branches have changed it.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{path} cannot be read: {error}", "run make golden, which writes it anew") from error
    return Lock(
        {name: Component(golden, tuple(folders)) for name, (golden, *folders) in content["components"].items()},
        {folder: Code(*digests) for folder, digests in content["code"].items()},
    )


def write_lock(components: Mapping[str, Component], path: Path = PATH) -> None:
    """Write the versions of all components with the code as it is now."""
    forget_sources()
    folders = sorted({folder for component in components.values() for folder in component.folders})
    code = {folder: [text_of(folder), code_of(folder)] for folder in folders}
    versions = {name: [golden, *folders] for name, (golden, folders) in sorted(components.items())}
    write_text(path, f'{{\n"components": {{\n{_lines(versions)}\n}},\n"code": {{\n{_lines(code)}\n}}\n}}\n')
    forget()


def forget() -> None:
    """Read the lock and all sources again at the next call."""
    forget_sources()
    read_lock.cache_clear()
    edited_folders.cache_clear()


@cache
def edited_folders() -> Mapping[str, str]:
    """Return the folders whose code differs from that of the golden results, with the digest of their code."""
    return {
        folder: code_of(folder)
        for folder, (text, code) in read_lock().code.items()
        if text_of(folder) != text and code_of(folder) != code
    }


def versions_of(components: Iterable[str]) -> dict[str, str]:
    """Return the versions of components by name."""
    known = read_lock().components
    return {name: known[name].golden for name in components}


def edited(components: Iterable[str]) -> dict[str, str]:
    """Return the edited folders that components run, with the digest of their code; empty where all is as published."""
    changed, known = edited_folders(), read_lock().components
    if not changed:
        return {}
    folders = {folder for name in components if name in known for folder in known[name].folders}
    return {folder: changed[folder] for folder in sorted(changed.keys() & folders)}


def name_of_edit(folders: Mapping[str, str]) -> str:
    """Return the name of a state of edited folders; "" where there are none."""
    return digest_of_bytes(json.dumps(folders, sort_keys=True).encode()) if folders else ""


def key_of(recipe: Mapping[str, Any]) -> str:
    """Return the key of a recipe; that of edited code is the name of the edit, a hyphen, and the key without one."""
    name = name_of_edit(edited(recipe.get("versions", ())))
    return f"{name}-{digest(recipe)}" if name else digest(recipe)


def words_of_edit(folders: Iterable[str]) -> str:
    """Return what a reader is told of edited code."""
    return f"edited: {', '.join(folders)}; run make golden"


def with_current_versions(recipe: Any, folders: Iterable[str]) -> Any:
    """Return a recipe with today's versions of the components that run certain folders, wherever it names them."""
    if isinstance(recipe, list):
        return [with_current_versions(part, folders) for part in recipe]
    if not isinstance(recipe, dict):
        return recipe
    known, moved = read_lock().components, set(folders)
    current = {name: with_current_versions(part, folders) for name, part in recipe.items()}
    if "versions" in current:
        current["versions"] = {
            name: known[name].golden if name in known and moved & set(known[name].folders) else version
            for name, version in current["versions"].items()
        }
    return current


def _lines(section: Mapping[str, object]) -> str:
    return ",\n".join(f"{json.dumps(name)}: {json.dumps(content)}" for name, content in section.items())
