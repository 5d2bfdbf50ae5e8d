"""Two trees of the suite, a commit and the working tree, and requests answered by the code of either."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmark.errors import ConfigurationError
from benchmark.storage.environment import ROOT, commit, git
from benchmark.system.fingerprints import FIRST_PARTY
from benchmark.system.kernels import compiled_files, drop_stale_kernels
from benchmark.system.process_reaper import MARK, mark_of_this

#: Seconds between two looks at how far the processes of a tree are.
_INTERVAL = 0.3

#: The verb that answers requests, hidden in the help of the command line.
VERB = "sample"


@dataclass(frozen=True)
class Tree:
    """The code of one commit, or of the working tree.

    Parameters
    ----------
    root
        Folder that holds the packages of the suite.
    name
        The commit, as people name it.
    """

    root: Path
    name: str

    def sources(self) -> dict[str, Path]:
        """Return the modules of the suite by their dotted names."""
        found = {}
        for package in FIRST_PARTY:
            for path in sorted((self.root / package).rglob("*.py")):
                parts = path.relative_to(self.root).with_suffix("").parts
                found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
        return found

    def digest(self) -> str:
        """Return a digest of all modules: 16 hexadecimal digits."""
        found = hashlib.sha256()
        for name, path in self.sources().items():
            found.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
        return found.hexdigest()[:16]


@contextmanager
def checked_out(name: str, folder: Path, working: Tree) -> Iterator[Tree]:
    """Check a commit out beside the working tree; kernels that it shares are not compiled again.

    Parameters
    ----------
    name
        Anything that git takes for a commit.
    folder
        Where it goes; removed in the end.
    working
        The working tree, whose repository holds the commit.

    Raises
    ------
    ConfigurationError
        If the suite is not in a git repository, there is no such commit, or it knows no samples.
    """
    digits = git(working.root, "rev-parse", "--verify", f"{name}^{{commit}}")
    if digits is None:
        raise ConfigurationError(f"'{name}' is no commit of {working.root}", "name one that 'git log' lists")
    remove_tree(folder, working)
    git(working.root, "worktree", "prune")
    if git(working.root, "worktree", "add", "--detach", "--force", str(folder), digits) is None:
        raise ConfigurationError(f"git cannot check out {name} in {folder}", "run 'git worktree prune'")
    try:
        tree = Tree(folder, digits[:10])
        if not (folder / "benchmark" / "jobs" / "rekey" / "sampling.py").is_file():
            raise ConfigurationError(
                f"the code of {tree.name} cannot make samples", "name a later commit, or run the rows again"
            )
        drop_stale_kernels(working.root)
        for source, kept in compiled_files(working.root):
            there = folder / source.relative_to(working.root)
            if there.is_file() and there.read_bytes() == source.read_bytes():
                _share(source, there, kept)
        drop_stale_kernels(folder, changed=_unlike(tree, working))
        yield tree
    finally:
        remove_tree(folder, working)


def _share(source: Path, there: Path, kept: Sequence[Path]) -> None:
    """Let a file of another tree have the compiled kernels of an equal one; they are known by its time."""
    status = source.stat()
    os.utime(there, ns=(status.st_atime_ns, status.st_mtime_ns))
    for path in kept:
        target = there.parent / "__pycache__" / path.name
        target.parent.mkdir(exist_ok=True)
        with suppress(OSError):
            shutil.copy2(path, target)


def _unlike(one: Tree, other: Tree) -> frozenset[Path]:
    """Files of a tree that the other one has not, or otherwise."""
    theirs = other.sources()
    return frozenset(
        path for name, path in one.sources().items()
        if name not in theirs or theirs[name].read_bytes() != path.read_bytes()
    )  # fmt: skip


def remove_tree(folder: Path, working: Tree) -> None:
    """Remove a commit that was checked out."""
    if folder.exists():
        git(working.root, "worktree", "remove", "--force", str(folder))
        shutil.rmtree(folder, ignore_errors=True)


def working_tree() -> Tree:
    """Return the tree of the code that runs, named by its commit, with "+" if it differs from it."""
    if not (name := commit()):
        raise ConfigurationError(f"{ROOT} is no git repository", "clone the suite to compare its commits")
    return Tree(ROOT, name)


def ask(
    tree: Tree,
    requests: Sequence[Mapping[str, Any]],
    folder: Path,
    watch: Callable[[int], None],
    variables: Mapping[str, str] | None = None,
    limit: float | None = None,
) -> list[dict[str, Any]]:
    """Let a tree answer requests, each in a process of its own; what was answered before is not asked again.

    A process that ends by itself is started once more without the rows at which it was; none outlives this program.

    Parameters
    ----------
    tree
        Whose code answers.
    requests
        See :mod:`benchmark.jobs.rekey.sampling`.
    folder
        Where requests and answers are kept.
    watch
        Told the number of shapes that are done, over all requests.
    variables
        Variables of the environment.
    limit
        Seconds after which the processes are ended; None for no limit.

    Returns
    -------
    list of dict
        The lines of all answers, each with the number of its ``request``; the rows that no process could answer have an
        ``error``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    jobs = [_Asked(tree, request, folder, str(number), variables or {}) for number, request in enumerate(requests)]
    start = time.monotonic()
    try:
        for job in jobs:
            job.start()
        while any(not job.ended() for job in jobs):
            watch(sum(job.answered() for job in jobs))
            if limit is not None and time.monotonic() - start > limit:
                break
            time.sleep(_INTERVAL)
    finally:
        for job in jobs:
            job.stop()
    return [line | {"request": number} for number, job in enumerate(jobs) for line in job.lines()]


class _Asked:
    """A request and the process that answers it."""

    def __init__(
        self, tree: Tree, request: Mapping[str, Any], folder: Path, name: str, variables: Mapping[str, str]
    ) -> None:
        self._tree, self._request, self._variables = tree, dict(request), variables
        self._question, self._answer = folder / f"{name}.request.json", folder / f"{name}.answer.jsonl"
        self._log = folder / f"{name}.log"
        self._process: subprocess.Popen[bytes] | None = None
        self._seen, self._count = 0, 0

    def start(self) -> None:
        self._question.write_text(json.dumps(self._request), encoding="utf-8")
        words = [sys.executable, "-m", "benchmark", VERB, str(self._question.resolve()), str(self._answer.resolve())]
        environment = os.environ | {"PYTHONPATH": str(self._tree.root), MARK: mark_of_this(), **self._variables}
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(words, cwd=self._tree.root, env=environment, stdout=log, stderr=log)

    def ended(self) -> bool:
        """Return whether all is answered, or cannot be."""
        if self._process is None or self._process.poll() is None:
            return self._process is None
        if self._process.returncode == 0:
            return True
        begun = next((line["begun"] for line in reversed(self.lines()) if "begun" in line), None)
        told = self._log.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1:]
        if begun is None:
            raise ConfigurationError(
                f"the code of {self._tree.name} answers nothing: {''.join(told)}", f"see {self._log}"
            )
        missing = [number for number in begun if number not in self._rows()]
        if not missing:
            raise ConfigurationError(f"the code of {self._tree.name} ends early: {''.join(told)}", f"see {self._log}")
        with self._answer.open("a", encoding="utf-8") as file:
            for number in missing:
                file.write(json.dumps({"row": number, "error": "its process ends by itself"}) + "\n")
        self.start()
        return False

    def stop(self) -> None:
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._process.wait()

    def lines(self) -> list[dict[str, Any]]:
        if not self._answer.exists():
            return []
        found = []
        for text in self._answer.read_text(encoding="utf-8").splitlines():
            with suppress(ValueError):
                found.append(json.loads(text))
        return found

    def answered(self) -> int:
        size = self._answer.stat().st_size if self._answer.exists() else 0
        if size != self._seen:
            self._seen, self._count = size, sum(line.get("steps", 0) for line in self.lines())
        return self._count

    def _rows(self) -> set[int]:
        return {line["row"] for line in self.lines() if "row" in line}
