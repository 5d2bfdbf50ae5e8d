"""Runs cases side by side, within a time, and collects what came of them."""

from __future__ import annotations

import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

from tests.toy import RADII, rod, write_off
from tools.faults.cases import Case, Outcome
from tools.faults.commands import Launcher
from tools.faults.plugin_files import LIGHT
from tools.faults.scene import COMPILED, INNOCENT, OK, UNDISTURBED, Scene, Scores, attend, scores_of

#: Sections whose methods make forms.
_WITH_FORMS = frozenset({"plugins"})


def run(
    cases: Sequence[Case],
    seed: int,
    *,
    seconds: float | None = None,
    workers: int = 1,
    tell: Callable[[Outcome], None] = lambda _: None,
) -> list[Outcome]:
    """Try cases in their order, each in a folder of its own that is removed afterwards.

    An interrupt lets the cases that have begun come to their end; what was tried until then is returned.

    Parameters
    ----------
    cases
        What to try.
    seed
        Determines all that is drawn.
    seconds
        Time after the first case in which further ones begin; None for no limit.
    workers
        Cases at a time.
    tell
        Told each outcome.
    """
    place = Path(tempfile.mkdtemp(prefix="faults-"))
    launchers: SimpleQueue[Launcher] = SimpleQueue()
    found: dict[str, Outcome] = {}
    stopped = threading.Event()
    opened = [Launcher() for _ in range(min(workers, len(cases)))]
    for launcher in opened:
        launchers.put(launcher)
    try:
        rods = write_rods(place / "rods")
        with_forms = any(case.section in _WITH_FORMS for case in cases)
        expected = undisturbed(place / UNDISTURBED, rods, opened[0], with_forms=with_forms)
        begun = time.monotonic()

        def attempt(case: Case) -> None:
            if stopped.is_set() or (seconds is not None and time.monotonic() - begun > seconds):
                return
            launcher = launchers.get()
            folder = place / case.name.replace("/", "-")
            folder.mkdir()
            try:
                outcome = attend(case, seed, folder, launcher, rods, expected)
            finally:
                launchers.put(launcher)
                shutil.rmtree(folder, ignore_errors=True)
            found[case.name] = outcome
            tell(outcome)

        with ThreadPoolExecutor(workers) as pool:
            try:
                for attempted in [pool.submit(attempt, case) for case in cases]:
                    attempted.result()
            except KeyboardInterrupt:
                stopped.set()
        return [found[case.name] for case in cases if case.name in found]
    finally:
        for launcher in opened:
            launcher.close()
        shutil.rmtree(place, ignore_errors=True)


def write_rods(folder: Path) -> Path:
    """Four shapes of about a hundred vertices in two classes."""
    for name, radius in RADII.items():
        for number, bend in enumerate((0.0, 1.2)):
            write_off(folder / f"{name}{number}.off", rod(radius, bend, rings=14, sides=8))
    return folder


def undisturbed(folder: Path, rods: Path, launcher: Launcher, *, with_forms: bool) -> dict[str, Scores]:
    """Scores by method of a run that nobody perturbs; its results are left for cases to begin with."""
    folder.mkdir()
    plugin = folder / "light.py"
    plugin.write_text(LIGHT)
    scene = Scene(Case(UNDISTURBED, lambda _: None), 0, folder, launcher, rods, {})
    done = [scene.command("run", *scene.selection(INNOCENT, plugin=plugin), "-j", 1, codes=(OK,), seconds=COMPILED)]
    found = {name: scores_of(record) for name, record in scene.records().items()}
    if with_forms:  # where none was ever scored, that compiles kernels, which takes longer than any case allows
        elsewhere = ("-d", rods, "--input", "mesh", "-m", "identity", "--results", folder / "forms")
        done += [scene.command("run", *elsewhere, "--executor", "serial", codes=(OK,), seconds=COMPILED)]
    if scene.outcome.crossings:
        raise RuntimeError(f"an undisturbed run crosses a border: {scene.outcome.crossings[0].said}; {done[-1].said}")
    if not found:  # results of edited code lie elsewhere
        raise RuntimeError("an undisturbed run has left no records; run make golden if code was edited")
    return found
