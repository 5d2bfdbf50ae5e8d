"""Where a case takes place: a folder of its own, commands that are looked at, and a note of what was crossed."""

from __future__ import annotations

import json
import random
import re
import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmark.storage.record_schema import fault_of
from tools.faults.cases import Border, Case, Crossing, Outcome
from tools.faults.commands import BENCHMARK, Done, Launcher, Running

#: Seconds after which a command that has little to do stands still; machines are busy.
STALL = 150.0

#: Seconds that the first commands of a new machine may take, which compile kernels.
COMPILED = 900.0

#: Folder of the run that nobody perturbs, beside those of the cases.
UNDISTURBED = "undisturbed"

#: Exit codes that the documentation knows.
OK, NOT_OK, USAGE, INTERRUPTED = 0, 1, 2, 130

#: How lines begin that only a program writes that did not expect its fault; a message may quote them.
TRACES = re.compile(
    r"^[ +|]*(Exception Group )?"
    r"(Traceback \(most recent call last\)|Fatal Python error|Exception ignored in|Error in atexit)",
    re.MULTILINE,
)

#: The cheapest method: no form, so nothing to draw and no codebook.
INNOCENT = "surface-area"

Scores = dict[str, Any]


@dataclass
class Scene:
    """The place of one case.

    Parameters
    ----------
    case
        The case.
    seed
        Seed of the program; with the name of the case it determines what is drawn.
    folder
        Empty folder of the case.
    launcher
        Starts its commands.
    rods
        Data set of four small shapes in two classes, to be left as it is.
    expected
        Scores by method of an undisturbed run on the rods.
    patience
        Seconds that a look at a plugin file may take; 0 for the usual limit.
    """

    case: Case
    seed: int
    folder: Path
    launcher: Launcher
    rods: Path
    expected: Mapping[str, Scores]
    patience: float = 0.0
    outcome: Outcome = field(init=False)
    random: random.Random = field(init=False)

    def __post_init__(self) -> None:
        self.outcome = Outcome(self.case.name)
        self.random = random.Random(f"{self.seed} {self.case.name}")

    @property
    def results(self) -> Path:
        """Results folder of the case."""
        return self.folder / "results"

    def begin_with_results(self) -> None:
        """Take a copy of the results of the undisturbed run."""
        shutil.copytree(self.folder.parent / UNDISTURBED / "results", self.results)

    def cross(self, border: Border, said: str) -> None:
        """Note that a border was crossed."""
        self.outcome.crossings.append(Crossing(border, said))

    def require(self, condition: bool, border: Border, said: str) -> None:
        """Note that a border was crossed unless a condition holds."""
        if not condition:
            self.cross(border, said)

    # Commands --------------------------------------------------------------------------------------------------------

    def selection(self, *methods: str, data: Path | None = None, plugin: Path | None = None) -> list[str]:
        """Options that select methods on the rods, or on another folder."""
        words = ["-d", str(data or self.rods), "--input", "mesh", "--results", str(self.results)]
        words += [word for name in methods for word in ("-m", name)]
        return words + (["--plugin", str(plugin)] if plugin else [])

    def start(self, *arguments: object, target: str = BENCHMARK, **options: Any) -> Running:
        """Start a command; see :meth:`Launcher.start`."""
        words = [str(word) for word in arguments]
        return self.launcher.start(words, self.folder, target=target, patience=self.patience, **options)

    def command(
        self,
        *arguments: object,
        codes: tuple[int, ...] = (OK, NOT_OK, USAGE),
        seconds: float = STALL,
        may_trace: bool = False,
        **options: Any,
    ) -> Done:
        """Run a command to its end and look at how it ends.

        Parameters
        ----------
        *arguments
            Words after the name of the program.
        codes
            Exit codes that are right.
        seconds
            Time after which it stands still, and is stopped.
        may_trace
            Whether it is asked to show where a method failed.
        **options
            See :meth:`Launcher.start`.
        """
        return self.finish(
            self.start(*arguments, **options), shown(arguments), codes=codes, seconds=seconds, may_trace=may_trace
        )

    def finish(
        self, running: Running, name: str, *, codes: tuple[int, ...], seconds: float = STALL, may_trace: bool = False
    ) -> Done:
        """Wait for a command and look at how it ends; see :meth:`command`."""
        if running.has_ended(seconds):
            done = running.done()
            self.look_for_orphans(name)
        else:
            running.stop()
            done = running.done(was_stopped=True)
            self.cross(Border.STALL, f"{name}: stopped after {seconds:.0f} s; {_end(done.said)}")
            return done
        is_traced = not may_trace and TRACES.search(done.said) is not None
        self.require(not is_traced, Border.TRACEBACK, f"{name}: {_end(done.said)}")
        self.require(done.code in codes, Border.EXIT_CODE, f"{name}: {done.code}, not {codes}; {_end(done.said)}")
        if done.code and 0 < done.code < 128:  # what a signal ends says nothing
            self.require(bool(done.said.strip()), Border.SILENCE, f"{name}: exit code {done.code} without a word")
        return done

    def look_for_orphans(self, name: str) -> None:
        """Note the processes that outlived a command, and end them."""
        for process in self.launcher.orphans():
            self.cross(Border.ORPHAN, f"{name}: process {process.pid}, {_command_line(process)}")
        self.launcher.end_everything()

    # Records ---------------------------------------------------------------------------------------------------------

    def record_files(self, results: Path | None = None) -> dict[str, bytes]:
        """Content of the records by file name."""
        found = {}
        for path in filter(Path.is_file, ((results or self.results) / "runs" / "records").glob("*.json")):
            try:
                found[path.name] = path.read_bytes()
            except FileNotFoundError:
                continue  # a failure that is being retried
        return found

    def records(self, results: Path | None = None) -> dict[str, dict[str, Any]]:
        """Whole records by method; a file that is none crosses a border."""
        found = {}
        for name, content in self.record_files(results).items():
            try:
                record = json.loads(content)
            except (ValueError, RecursionError):
                record = None
            if fault := fault_of(record):
                self.cross(Border.HALF, f"{name}: {fault}; {content[:80]!r} ...")
            else:
                found[record["method"]] = record
        return found

    def check_scores(self, *methods: str, results: Path | None = None) -> None:
        """Compare the scores of methods with those of the undisturbed run."""
        found = self.records(results)
        for name in methods:
            if name not in found:
                self.cross(Border.LOST, f"no record of {name}")
                continue
            mine = scores_of(found[name])
            self.require(mine["status"] == "ok", Border.SPREAD, f"{name}: {found[name].get('reason', mine)}")
            self.require(
                mine["status"] != "ok" or mine == self.expected[name], Border.SCORES, f"{name}: {mine['scores']}"
            )


def attend(case: Case, seed: int, folder: Path, launcher: Launcher, rods: Path, expected: Mapping[str, Any]) -> Outcome:
    """Let a case take place; an error of the fault program counts as a border that was crossed."""
    scene = Scene(case, seed, folder, launcher, rods, expected)
    begun = time.monotonic()
    try:
        case.act(scene)
    except Exception as error:
        scene.cross(Border.PROGRAM, f"{type(error).__name__}: {error}")
    finally:
        scene.outcome.seconds = time.monotonic() - begun
    scene.outcome.tried = scene.outcome.tried or 1
    return scene.outcome


def scores_of(record: Mapping[str, Any]) -> Scores:
    """What of a record depends on the shapes alone."""
    return {name: record.get(name) for name in ("status", "scores", "per_query", "shapes", "labels")}


def shown(arguments: tuple[object, ...]) -> str:
    """A command line on one line."""
    return " ".join(repr(str(word))[1:-1] if str(word) else "''" for word in arguments)[:300]


def _end(text: str) -> str:
    """The last words, on one line."""
    return " | ".join(text.strip().splitlines()[-4:])[-400:]


def _command_line(process: Any) -> str:
    try:
        return " ".join(process.cmdline())[:120]
    except Exception:
        return "already gone"
