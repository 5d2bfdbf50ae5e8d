"""Versions of the components of the suite: digests of their golden results, and of the code that computed them.

A component computes part of a result: a method, a scorer, the preparation of an input, a generated data set. Its
version is the digest of its committed golden results, so code may change as long as these do not. Results of edited
code are stored separately, and merged with the others once ``make golden`` passes with that code.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

from benchmark.arrays import load_arrays, save_arrays
from benchmark.errors import ConfigurationError
from benchmark.files import locked, write_atomically, write_text
from benchmark.pipeline.storage.keys import digest
from benchmark.source_code import ROOT, code_of, digest_of_bytes, forget_sources, text_of

PATH = ROOT / "benchmark" / "versions.lock"


class Component(NamedTuple):
    """A component, as of its golden results.

    Parameters
    ----------
    golden
        Its version: the digest of its golden results.
    folders
        Folders of the code that it runs.
    """

    golden: str
    folders: tuple[str, ...]


class Code(NamedTuple):
    """Digests of the modules of a folder: of their text, and of their code without docstrings, comments and layout."""

    text: str
    code: str


class Lock(NamedTuple):
    """Content of ``versions.lock``."""

    components: Mapping[str, Component]
    code: Mapping[str, Code]


@cache
def read_lock(path: Path = PATH) -> Lock:
    """Return the versions of all components, and the digests of the code checked against them.

    Raises
    ------
    ConfigurationError
        If the file is damaged or has merge conflicts.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{path} cannot be read: {error}", "run make golden, which rewrites it") from error
    return Lock(
        {name: Component(golden, tuple(folders)) for name, (golden, *folders) in content["components"].items()},
        {folder: Code(*digests) for folder, digests in content["code"].items()},
    )


def write_lock(components: Mapping[str, Component], path: Path = PATH) -> None:
    """Write the versions of all components and the digests of the current code."""
    forget_sources()
    folders = sorted({folder for component in components.values() for folder in component.folders})
    code = {folder: [text_of(folder), code_of(folder)] for folder in folders}
    versions = {name: [golden, *folders] for name, (golden, folders) in sorted(components.items())}
    write_text(path, f'{{\n"components": {{\n{_lines(versions)}\n}},\n"code": {{\n{_lines(code)}\n}}\n}}\n')
    forget()


def forget() -> None:
    """Clear the caches of the lock and of all sources."""
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
    """Return the edited folders that components run, with the digests of their code; empty if nothing was edited."""
    changed, known = edited_folders(), read_lock().components
    if not changed:
        return {}
    folders = {folder for name in components if name in known for folder in known[name].folders}
    return {folder: changed[folder] for folder in sorted(changed.keys() & folders)}


def key_of(recipe: Mapping[str, Any]) -> str:
    """Return the key of a recipe; for edited code, it is prefixed with the name of the edit and a hyphen."""
    folders = edited(recipe.get("versions", ()))
    name = digest_of_bytes(json.dumps(folders, sort_keys=True).encode())
    return f"{name}-{digest(recipe)}" if folders else digest(recipe)


def words_of_edit(folders: Iterable[str]) -> str:
    """Return the message for edited code."""
    return f"edited: {', '.join(folders)}; run make golden"


def with_current_versions(recipe: Any, folders: Iterable[str]) -> Any:
    """Return a recipe with the current versions of all components that run code of ``folders``."""
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


# Results of edited code ----------------------------------------------------------------------------------------------

#: Folder for results of edited code, in the folder of the runs.
EDITED = "edited"

#: File in the folder of an edit with the edited folders of code and their digests.
CODE_FILE = "code.json"

#: Name of the array with the recipe of a result of edited code; its key changes when golden results are accepted.
RECIPE = "__recipe__"


def code_of_edit(folder: Path) -> dict[str, str]:
    """Return the digests of the edited code that computed a folder of results; empty if they are not recorded."""
    try:
        return dict(json.loads((folder / CODE_FILE).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return {}


def stale_edits(root: Path) -> Iterable[Path]:
    """Return the folders of edits that are no longer in the code."""
    current = edited_folders().items()
    return [folder for folder in (root / EDITED).glob("*") if not code_of_edit(folder).items() <= current]


def adopt_edited(root: Path) -> None:
    """Merge the results of edits whose code has passed ``make golden`` into the other results, under current keys."""
    golden = {folder: code.code for folder, code in read_lock().code.items()}
    for edit in list((root / EDITED).glob("*")):
        code = code_of_edit(edit)
        if code and code.items() <= golden.items():
            with locked(root, alone=True), suppress(FileNotFoundError):  # another process may have been faster
                _adopt(root, edit, code)


def _adopt(root: Path, edit: Path, folders: Mapping[str, str]) -> None:
    keys: dict[str, str] = {}
    for path in sorted(edit.glob("artefacts/*/*.npz")):
        with suppress(ValueError, KeyError, OSError):  # damaged artefacts are recomputed
            arrays = load_arrays(path, path.stem)
            recipe = with_current_versions(json.loads(str(arrays.pop(RECIPE))), folders)
            key = keys[f"{edit.name}-{path.stem}"] = digest(recipe)
            save = partial(save_arrays, key=key, arrays=arrays, compressed=True)
            write_atomically(root / "artefacts" / key[:2] / f"{key}.npz", save)
    for path in sorted(edit.glob("records/*.json")):
        with suppress(ValueError, KeyError, OSError):  # their jobs run again
            record = json.loads(path.read_text(encoding="utf-8"))
            recipe = with_current_versions(record["recipe"], folders)
            artefacts = sorted(keys.get(key, key) for key in record.get("artefacts", ()))
            adopted = {**record, "recipe": recipe, "key": digest(recipe), "artefacts": artefacts}
            write_text(root / "records" / f"{adopted['key']}.json", json.dumps(adopted, sort_keys=True))
    shutil.rmtree(edit)
