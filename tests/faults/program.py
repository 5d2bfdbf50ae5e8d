"""Runs cases side by side, within a time, and gathers what came of them."""

from __future__ import annotations

import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

from tests.faults.cases import Case, Outcome
from tests.faults.commands import Launcher
from tests.faults.plugin_files import LIGHT
from tests.faults.scene import INNOCENT, Scene, Scores, attend, scores_of
from tests.toy import RADII, rod, write_off

#: Sections whose runs hold methods of a plugin file, too.
_WITH_PLUGIN = frozenset({"kills", "disks"})


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
        Time after which no further case begins; None for no limit.
    workers
        Cases at a time.
    tell
        Told each outcome.
    """
    begun = time.monotonic()
    place = Path(tempfile.mkdtemp(prefix="faults-"))
    launchers: SimpleQueue[Launcher] = SimpleQueue()
    found: dict[str, Outcome] = {}
    stopped = threading.Event()
    opened = [Launcher() for _ in range(min(workers, len(cases)))]
    for launcher in opened:
        launchers.put(launcher)
    try:
        rods = write_rods(place / "rods")
        with_plugin = any(case.section in _WITH_PLUGIN for case in cases)
        expected = undisturbed(place / "undisturbed", rods, opened[0], with_plugin=with_plugin)

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


def undisturbed(folder: Path, rods: Path, launcher: Launcher, *, with_plugin: bool) -> dict[str, Scores]:
    """Scores by method of a run that nobody disturbs; this compiles the kernels of a new machine, too."""
    folder.mkdir()
    plugin = folder / "light.py"
    plugin.write_text(LIGHT)
    scene = Scene(Case("undisturbed", lambda _: None), 0, folder, launcher, rods, {})
    selection = scene.selection(INNOCENT, plugin=plugin if with_plugin else None)
    # The methods of the plugin leave processes behind that only the end of a worker ends.
    executor = ("-j", 1) if with_plugin else ("--executor", "serial")
    done = scene.command("run", *selection, *executor, codes=(0,))
    if scene.outcome.crossings:
        raise RuntimeError(f"an undisturbed run crosses a border: {scene.outcome.crossings[0].said}; {done.said}")
    return {name: scores_of(record) for name, record in scene.records().items()}
