"""Results of edited code join the others once the golden results were made by that code."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.arrays import load_arrays, save_arrays
from benchmark.files import locked, write_atomically, write_text
from benchmark.pipeline.storage.keys import digest
from benchmark.pipeline.storage.lock import edited_folders, read_lock, with_current_versions

#: Folder of what edited code has made, in that of the runs.
EDITED = "edited"

#: File in the folder of an edit that names the folders of the code and their digests.
CODE_FILE = "code.json"

#: Array that holds the recipe of a result of edited code, whose key changes when golden results are accepted.
RECIPE = "__recipe__"


def code_of_edit(folder: Path) -> dict[str, str]:
    """Return the digests of the edited folders by whose code a folder of results was made; empty if it does not say."""
    try:
        return dict(json.loads((folder / CODE_FILE).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return {}


def stale_edits(root: Path) -> Iterable[Path]:
    """Folders of edits that are no longer in the code, in a folder of runs."""
    current = edited_folders().items()
    return [folder for folder in (root / EDITED).glob("*") if not code_of_edit(folder).items() <= current]


def adopt_edited(root: Path) -> None:
    """Bring what was made by code that has golden results by now to the other results, under the keys of today."""
    golden = {folder: code.code for folder, code in read_lock().code.items()}
    for edit in list((root / EDITED).glob("*")):
        code = code_of_edit(edit)
        if code and code.items() <= golden.items():
            with locked(root, alone=True), suppress(FileNotFoundError):  # another process may have been faster
                _adopt(root, edit, code)


def _adopt(root: Path, edit: Path, folders: Mapping[str, str]) -> None:
    keys: dict[str, str] = {}
    for path in sorted(edit.glob("artefacts/*/*.npz")):
        with suppress(ValueError, KeyError, OSError):  # a damaged one is made again
            arrays = load_arrays(path, path.stem)
            recipe = with_current_versions(json.loads(str(arrays.pop(RECIPE))), folders)
            key = keys[f"{edit.name}-{path.stem}"] = digest(recipe)
            _write(root / "artefacts" / key[:2] / f"{key}.npz", key, arrays)
    for path in sorted(edit.glob("records/*.json")):
        record = json.loads(path.read_text(encoding="utf-8"))
        recipe = with_current_versions(record["recipe"], folders)
        artefacts = sorted(keys.get(key, key) for key in record.get("artefacts", ()))
        adopted = {**record, "recipe": recipe, "key": digest(recipe), "artefacts": artefacts}
        write_text(root / "records" / f"{adopted['key']}.json", json.dumps(adopted, sort_keys=True))
    shutil.rmtree(edit)


def _write(path: Path, key: str, arrays: Mapping[str, np.ndarray[Any, Any]]) -> None:
    write_atomically(path, lambda file: save_arrays(file, key, arrays, compressed=True))
