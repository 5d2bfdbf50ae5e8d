"""A copy of the suite with a repository and results of its own."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from benchmark.system.fingerprints import FIRST_PARTY
from tests.toy import RADII, rod, write_off, write_rods

ROOT = Path(__file__).parents[3]

#: Size of a shape that is refused by a tolerance alone.
TOO_SMALL = 1e-101


class Copy:
    """A repository with the packages of the suite, a data set with two shapes that are refused, and results."""

    def __init__(self, folder: Path, bends: tuple[float, ...], chosen: tuple[str, ...]) -> None:
        self.root, self.data, self.results = folder / "suite", folder / "rods", folder / "results"
        self.selection = ("-d", str(self.data), *chosen)
        for package in FIRST_PARTY:  # with kernels that are compiled, and without the weights of networks
            ignored = shutil.ignore_patterns("models", "*.pyc")
            shutil.copytree(ROOT / package, self.root / package, ignore=ignored)
        (self.root / ".gitignore").write_text("__pycache__/\n")
        write_rods(self.data, bends)
        small = rod(RADII["thick"], 0.0)
        (self.data / "thin9.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n")
        write_off(self.data / "thick9.off", small.with_vertices(small.vertices * TOO_SMALL))
        self.git("init", "-q")
        self.commit()
        self.git("tag", "first")
        code, said = self.run("run", *self.selection)
        assert code == 0, said

    def git(self, *words: str) -> None:
        name = ("-c", "user.name=test", "-c", "user.email=test@test")
        subprocess.run(["git", *name, *words], cwd=self.root, check=True, capture_output=True)

    def commit(self) -> None:
        self.git("add", "-A")
        self.git("commit", "-q", "-m", "edit")

    def run(self, *words: str, results: Path | None = None) -> tuple[int, str]:
        """Exit code and output of a verb of the copy."""
        done = subprocess.run(
            [sys.executable, "-m", "benchmark", *words, "--results", str(results or self.results)],
            capture_output=True, text=True, check=False, cwd=self.root, env=os.environ | {"PYTHONPATH": str(self.root)},
        )  # fmt: skip
        return done.returncode, done.stdout + done.stderr

    def edited(self, *edits: tuple[str, str, str]) -> tuple[int, str]:
        """Exit code and output of ``rekey`` after an edit that was committed."""
        for file, before, after in edits:
            path = self.root / file
            text = path.read_text()
            assert before in text, (file, before)
            path.write_text(text.replace(before, after))
        self.commit()
        return self.run("rekey", "--from", "HEAD~1")

    def planned(self) -> str:
        return self.run("plan", *self.selection)[1].splitlines()[-1]

    def records(self) -> list[dict[str, Any]]:
        return [json.loads(path.read_text()) for path in (self.results / "runs" / "records").glob("*.json")]
