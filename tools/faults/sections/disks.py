"""Disks that are full, folders that cannot be written or go away, and two runs in one folder."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from tools.faults.cases import Border, Case
from tools.faults.commands import Launcher
from tools.faults.fork_server import CLOSED
from tools.faults.plugin_files import LIGHT
from tools.faults.scene import INNOCENT, NOT_OK, OK, STALL, USAGE, Scene

if TYPE_CHECKING:
    from collections.abc import Iterator

#: Largest file that can be written, in bytes: what a command says fits into the smallest, all artefacts nearly into the
#: largest.
_SIZES = (2000, 4000, 6000, 8000, 16_000)

#: Sizes of a small disk.
_DISKS = ("4k", "16k", "64k", "128k")

METHODS = (INNOCENT, "light-size", "light-children")


def cases() -> list[Case]:
    """Cases of this section."""
    found: dict[str, Callable[[Scene], None]] = {}
    for size in _SIZES:
        found[f"files-of-{size}-bytes"] = lambda scene, size=size: _small_files(scene, size)  # type: ignore[misc]
    if _can_mount():
        for size in _DISKS:
            found[f"disk-of-{size}"] = lambda scene, size=size: _small_disk(scene, size)  # type: ignore[misc]
    for name, make in _PLACES.items():
        found[f"results-{name}"] = lambda scene, make=make: _refused(scene, make)  # type: ignore[misc]
    for part in _VANISHING:
        found[f"vanishing-{part.replace('/', '-') or 'all'}"] = lambda scene, part=part: _vanishing(scene, part)  # type: ignore[misc]
    found["two-runs"] = _two_runs
    found["two-runs-one-killed"] = lambda scene: _two_runs(scene, is_killed=True)
    found["output-device-full"] = _full_output
    found["output-closed"] = _closed_output
    return [Case(f"disks/{name}", act) for name, act in found.items()]


def _run(scene: Scene, **options: object) -> tuple[int | None, str]:
    plugin = scene.folder / "light.py"
    plugin.write_text(LIGHT)
    selection = scene.selection(INNOCENT, plugin=plugin)
    done = scene.command("run", *selection, "-j", 1, "--retry", "all", **options)  # type: ignore[arg-type]
    return done.code, done.said


def _recover(scene: Scene, code: int | None, said: str) -> None:
    """What was refused room says so; with room again, all is done."""
    scene.records()
    whole = {name: content for name, content in scene.record_files().items() if b'"status": "ok"' in content}
    if code != OK:
        scene.require("Traceback" not in said and bool(said.strip()), Border.SILENCE, said[-300:])
    again, said = _run(scene)
    scene.require(again == OK, Border.SPREAD, f"run again: {again}; {said.strip()[-300:]}")
    now = scene.record_files()
    for name, content in whole.items():
        scene.require(now.get(name) == content, Border.LOST, name)
    scene.check_scores(*METHODS)
    left = [path.name for path in (scene.results / "runs").rglob("*.tmp")]
    scene.require(not left, Border.HALF, f"left behind: {left}")


def _small_files(scene: Scene, size: int) -> None:
    _recover(scene, *_run(scene, limits={"RLIMIT_FSIZE": size}))


def _small_disk(scene: Scene, size: str) -> None:
    with _mounted(scene.results, size):
        code, said = _run(scene)
        scene.records()
        kept = scene.folder / "kept"
        shutil.copytree(scene.results, kept)
    shutil.rmtree(scene.results)
    kept.rename(scene.results)
    _recover(scene, code, said)


@contextmanager
def _mounted(folder: Path, size: str) -> Iterator[None]:
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder], check=True, capture_output=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", folder], check=True, capture_output=True)


def _can_mount() -> bool:
    return os.geteuid() == 0 and shutil.which("mount") is not None and _mounts()


def _mounts() -> bool:
    import tempfile

    with tempfile.TemporaryDirectory() as place:
        try:
            with _mounted(Path(place) / "disk", "4k"):
                return True
        except (subprocess.CalledProcessError, OSError):
            return False


def _without_rights(path: Path) -> None:
    path.mkdir()
    path.chmod(0o555)


#: Results folders that cannot be used.
_PLACES: dict[str, Callable[[Path], object]] = {
    "is-a-file": lambda path: path.write_text("mine"),
    "without-rights": _without_rights,
    "loop": lambda path: path.symlink_to(path),
    "link-to-nowhere": lambda path: path.symlink_to("/proc/nowhere"),
    "device": lambda path: path.symlink_to("/dev/null"),
    "runs-is-a-file": lambda path: (path.mkdir(), (path / "runs").write_text("mine")),
    "records-is-a-file": lambda path: ((path / "runs").mkdir(parents=True), (path / "runs" / "records").write_text("")),
    "progress-is-a-file": lambda path: (
        (path / "runs").mkdir(parents=True), (path / "runs" / "progress").write_text(""),
    ),
    "artefacts-without-rights": lambda path: (
        (path / "runs").mkdir(parents=True), _without_rights(path / "runs" / "artefacts"),
    ),
    "progress-without-rights": lambda path: (
        (path / "runs").mkdir(parents=True), _without_rights(path / "runs" / "progress"),
    ),
}  # fmt: skip


def _refused(scene: Scene, make: Callable[[Path], object]) -> None:
    """A results folder that cannot be used is named in one line, by every verb that needs it."""
    make(scene.results)
    selection = scene.selection(INNOCENT)
    for verb in ("run", "plan", "tables", "prune", "merge"):
        words = {"prune": ["--results", scene.results], "merge": [scene.results, "--results", scene.results]}
        done = scene.command(verb, *words.get(verb, selection), ordinary_rights=True)
        if done.code == USAGE:
            lines = done.error.strip().splitlines()
            scene.require(len(lines) == 1, Border.SILENCE, f"{verb}: {done.error.strip()[:300]!r}")
    scene.outcome.tried = 5


#: Parts of the results folder that somebody removes while a run is under way.
_VANISHING = ("", "runs/records", "runs/artefacts", "runs/scratch", "runs/progress")


def _vanishing(scene: Scene, part: str) -> None:
    plugin = scene.folder / "light.py"
    plugin.write_text(LIGHT)
    selection = scene.selection(INNOCENT, plugin=plugin)
    running = scene.start("run", *selection, "-j", 1)
    moment = time.monotonic() + scene.random.uniform(0.0, 5.0)
    while time.monotonic() < moment and not running.has_ended(0.05):
        pass
    shutil.rmtree(scene.results / part, ignore_errors=True)
    scene.finish(running, f"run, {part or 'the folder'} vanishes", codes=(OK, NOT_OK, USAGE))
    code, said = _run(scene)
    scene.require(code == OK, Border.SPREAD, f"run again: {code}; {said.strip()[-300:]}")
    scene.check_scores(*METHODS)


def _two_runs(scene: Scene, *, is_killed: bool = False) -> None:
    """Two runs share one folder; both end, or the one that is left does all."""
    plugin = scene.folder / "light.py"
    plugin.write_text(LIGHT)
    selection = scene.selection(INNOCENT, plugin=plugin)
    other = Launcher()
    place = scene.folder / "other"
    place.mkdir()
    try:
        first = other.start([*map(str, ("run", *selection, "-j", 1))], place)
        second = scene.start("run", *selection, "-j", 1)
        if is_killed:
            moment = time.monotonic() + scene.random.uniform(0.2, 5.0)
            while time.monotonic() < moment and not first.has_ended(0.02):
                pass
            other.end_everything()
        scene.finish(second, "second run", codes=(OK,))
        if not first.has_ended(STALL):
            first.stop()
            scene.cross(Border.STALL, "first run")
        said = first.done().said
        scene.require(is_killed or first.code == OK, Border.EXIT_CODE, f"first run: {first.code}; {said[-300:]}")
        scene.check_scores(*METHODS)
    finally:
        other.close()


def _full_output(scene: Scene) -> None:
    """Verbs that print to a device that is full end with a message, not with a traceback."""
    _run(scene)
    for verb in ("plan", "tables"):
        scene.command(verb, *scene.selection(INNOCENT), output="/dev/full")


def _closed_output(scene: Scene) -> None:
    """A reader that goes away, as ``head`` does, ends a verb without a word."""
    for verb in (["list", "methods"], ["--help"], ["plan", *scene.selection()]):
        scene.command(*verb, codes=(OK, NOT_OK, USAGE, 141, -13), output=CLOSED)
    scene.outcome.tried = 3
