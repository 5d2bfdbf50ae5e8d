"""A bundle of a small run, and forgeries of it."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner

from benchmark.arrays import digest_of, load_arrays, save_arrays
from benchmark.cli.main import cli
from benchmark.pipeline.storage.keys import digest
from benchmark.pipeline.storage.records import as_text
from benchmark.plugins.remote import folded, unfolded
from tests.toy import write_rods
from tests.verbs import call

#: A scorer that takes no time, and no kernel to compile.
SCORER = "spherical-harmonics[n_degrees=2]"

PLUGIN = '''
# SPDX-License-Identifier: MIT
from benchmark.api import canonical_form


@canonical_form(name="flat", title="Flattened", inputs=("mesh",))
def flat(shape):
    """Halve the height."""
    return shape.mesh.vertices * [1.0, 1.0, 0.5]
'''


def command(*words: object) -> Any:
    """Run a verb in this process."""
    return CliRunner().invoke(cli, list(map(str, words)))


def run(folder: Path) -> None:
    """Write a data set and a plug-in into a folder, and run the plug-in and a method of the suite."""
    write_rods(folder / "rods", bends=(0.0, 1.2))
    (folder / "flat.py").write_text(PLUGIN)
    of_run = ("-m", "flat", "-m", "surface-area", "--input", "mesh", "--executor", "serial", "--scorer", SCORER)
    call("run", "-d", folder / "rods", *of_run, *where(folder))


def where(folder: Path) -> tuple[object, ...]:
    return "--plugin", folder / "flat.py", "--results", folder / "results"


Files = dict[str, bytes]


class Forgery:
    """The files of a bundle of one record, to be changed and packed again."""

    def __init__(self, path: Path, source: str = "plugin/flat.py") -> None:
        with zipfile.ZipFile(path) as archive:
            self.files: Files = {name: archive.read(name) for name in archive.namelist()}
        self.manifest = json.loads(self.files["bundle.json"])
        (self.entry,) = self.manifest["entries"]
        self.key = self.entry["key"]
        self.record = json.loads(self.files[f"records/{self.key}.json"])
        self.source, self.plugin = source, self.files.get(source, b"")

    def arrays(self, kind: str = "arrays") -> list[dict[str, Any]]:
        """Forms, or distances."""
        return list(unfolded(load_arrays(io.BytesIO(self.files[f"{kind}/{self.key}.npz"]), self.key)))

    def put_arrays(self, items: list[Any], kind: str = "arrays", *, told: bool = True) -> None:
        """Put others in their place; with their digest in the record, as a careful forger does."""
        file = io.BytesIO()
        save_arrays(file, self.key, folded(items), compressed=True)
        self.files[f"{kind}/{self.key}.npz"] = file.getvalue()
        if told:
            stage = "forms" if kind == "arrays" else kind
            self.record["digests"][stage] = digest(list(map(digest_of, items)))[:16]

    def put_source(self, source: bytes, *, told: bool = True) -> None:
        """Put another source in the place of that of the plug-in."""
        self.files[self.source] = source
        if told:
            self.manifest["plugin"]["digests"][self.source] = hashlib.sha256(source).hexdigest()

    def rename(self, name: str) -> None:
        """Give the method another name, wherever it stands, and the record the key of that."""
        self.manifest |= {"method": name, "base_name": name}
        self.record["method"] = self.record["recipe"]["method"] = name
        self.rekey()

    def rekey(self) -> None:
        """Give the record the key of its recipe."""
        before, self.key = self.key, digest(self.record["recipe"])
        self.record["key"] = self.entry["key"] = self.key
        for kind in ("arrays", "distances"):
            arrays = load_arrays(io.BytesIO(self.files.pop(f"{kind}/{before}.npz")), before)
            file = io.BytesIO()
            save_arrays(file, self.key, arrays, compressed=True)
            self.files[f"{kind}/{self.key}.npz"] = file.getvalue()
        del self.files[f"records/{before}.json"]

    def write(self, path: Path, further: Callable[[zipfile.ZipFile], object] = lambda archive: None) -> Path:
        """Pack all again, with further files that a careful reader has to refuse."""
        self.files["bundle.json"] = json.dumps(self.manifest).encode()
        self.files[f"records/{self.key}.json"] = as_text(self.record).encode()
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in self.files.items():
                archive.writestr(name, content)
            further(archive)
        return path


def object_array(key: str) -> bytes:
    """A file of arrays of which one is a pickle that runs a program."""

    class Bomb:
        def __reduce__(self) -> Any:
            return (Path.touch, (Path("pwned"),))

    file = io.BytesIO()
    contents = json.dumps({"key": key, "arrays": {"0:vertices": ["|O", [1]]}})
    np.savez(
        file, allow_pickle=True, **{"0:vertices": np.array([Bomb()], dtype=object), "__contents__": np.array(contents)}
    )
    return file.getvalue()
