"""Whatever is killed, damaged or full, a figure is that of an undisturbed run, or there is a reason
in its place.
"""

from __future__ import annotations

import os
import resource
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from random import Random
from unittest.mock import patch

import psutil
import pytest

from benchmark.pipeline.record_files import read_records
from benchmark.pipeline.records import Record
from tests.behaviour.suite import start
from tests.toy import SMALL_SCORER, wait_for, write_rods

PLUGIN = """from benchmark.api import UnsupportedShape, canonical_form

def deep(shape): return shape.mesh.vertices * shape.geodesics()[0].max()
def picky(shape):
    if shape.identifier == "thick0": raise UnsupportedShape("too thick")
    return shape.mesh.vertices ** 3
def writes(shape): shape.geodesics()[:] = 0
deep, picky, writes = (
    canonical_form(name=f.__name__, title=f.__name__)(f) for f in (deep, picky, writes)
)
"""


class World:
    """Rods in a folder whose name is not UTF-8, a mesh that is no mesh, and methods of which most
    go wrong.
    """

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder, self.results, self.random = folder, folder / "results", Random(seed)
        self.rods = write_rods(folder / os.fsdecode(b"r\xf6ds"), bends=(0.0, 1.0))
        (self.rods / os.fsdecode(b"thin\xff2.off")).write_bytes(bytes(range(256)))
        (folder / "own.py").write_text(PLUGIN)

    def start(self, *words: object, results: str = "results", most: int = -1) -> psutil.Process:
        """Start a run of all methods that may write files of at most a size."""
        limit = (
            (lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))) if most >= 0 else None
        )
        selection = ("-d", self.rods, "--input", "mesh", "--plugin", "own.py", "-j", 2)
        options = ("--scorer", SMALL_SCORER, "--results", results)
        # Python would leave compiled modules of the suite cut off.
        with patch.dict(os.environ, {"PYTHONDONTWRITEBYTECODE": "1"} if limit else {}):
            return start("run", *selection, *options, *words, cwd=self.folder, preexec_fn=limit)

    def outcomes(self, results: str = "results") -> dict[str, tuple[object, ...]]:
        """Return status and scores by method."""
        return {record.method: outcome(record) for record in read_records(self.folder / results)}

    def wait_for_files(self, run: psutil.Process, count: int) -> None:
        """Wait until a run has written some files, or has ended."""
        began = time.time()
        written = lambda: [path for path in self.results.rglob("*.npz") if is_newer(path, began)]  # noqa: E731
        wait_for(lambda: len(written()) >= count or run.poll() is not None)

    def kill(self, choose: Callable[[psutil.Process], list[psutil.Process]]) -> None:
        """Kill one of the processes of a run that makes everything anew, at some moment."""
        run = self.start("--force")
        self.wait_for_files(run, self.random.randrange(20))
        if (processes := choose(psutil.Process(run.pid))) and run.poll() is None:
            with suppress(psutil.NoSuchProcess):  # it has just ended by itself
                self.random.choice(processes).kill()
        run.communicate()

    def kill_worker(self) -> None:
        """Kill a worker, or a child of one."""
        self.kill(lambda run: run.children(recursive=True))

    def kill_program(self) -> None:
        """Kill the program, whose workers end with it."""
        self.kill(lambda run: [run])

    def damage(self, count: int = 20) -> None:
        """Cut files, or flip a bit of them, and run."""
        files = sorted(
            path
            for path in (self.results / "runs").rglob("*.*")
            if path.suffix in (".npz", ".json")
        )
        for path in self.random.sample(files, min(count, len(files))):
            content = bytearray(path.read_bytes())
            content[self.random.randrange(len(content))] ^= 1 << self.random.randrange(8)
            path.write_bytes(
                content[: self.random.choice([None, self.random.randrange(len(content))])]
            )
        self.start().communicate()

    def fill_the_disk(self) -> None:
        """Run while no file can be larger than a size."""
        self.start("--force", most=self.random.choice([0, 2000, 20_000])).communicate()

    def run_two(self) -> None:
        """Run twice at a time."""
        for run in [self.start("--force"), self.start("--force")]:
            run.communicate()


def is_newer(path: Path, began: float) -> bool:
    try:
        return path.stat().st_mtime >= began
    except OSError:  # it was replaced at this moment
        return False


def outcome(record: Record) -> tuple[object, ...]:
    return record.status, record.scores, record.per_query, record.unsupported


@pytest.mark.slow
def test_a_figure_is_that_of_an_undisturbed_run_or_there_is_a_reason(tmp_path):
    world = World(tmp_path, seed=0)
    world.start(results="undisturbed").communicate()
    right = world.outcomes("undisturbed")
    assert {name for name, (status, *_) in right.items() if status == "ok"} == {"deep", "picky"}
    for disturb in (
        world.kill_worker,
        world.kill_program,
        world.damage,
        world.fill_the_disk,
        world.run_two,
    ):
        disturb()
        wrong = [
            name for name, of in world.outcomes().items() if of[0] == "ok" and of != right[name]
        ]
        assert not wrong, disturb.__name__
    world.start().communicate()
    assert world.outcomes() == right
