"""Bad plugin files, each beside an innocent method: in a run, and in every other verb that looks at methods."""

from __future__ import annotations

import re
from pathlib import Path

from tools.faults.cases import Border, Case
from tools.faults.plugin_files import BadPlugin, bad_plugins
from tools.faults.scene import INNOCENT, OK, USAGE, Scene

#: Seconds for a job, a form or a check, and for a look at a file: few for what never ends, enough for what should end
#: on a busy machine.
_HANGING, _ENDING = (5, 5), (60, 30)


def cases() -> list[Case]:
    """One case a plugin."""
    return [Case(f"plugins/{plugin.name}", lambda scene, p=plugin: _try(scene, p)) for plugin in bad_plugins()]  # type: ignore[misc]


def _try(scene: Scene, plugin: BadPlugin) -> None:
    path = scene.folder / "plugin.py"
    path.write_bytes(plugin.source.encode("latin-1"))
    seconds, scene.patience = _HANGING if plugin.hangs else _ENDING
    limit = ("--timeout", f"{seconds}s")
    selection = scene.selection(INNOCENT, plugin=path)
    _other_verbs(scene, plugin, path, selection, limit)
    _run(scene, plugin, selection, limit)
    scene.command("report", *selection, "-o", scene.folder / "report", *limit)
    scene.command("why", INNOCENT, *selection, may_trace=True)
    scene.outcome.tried = 7


def _run(scene: Scene, plugin: BadPlugin, selection: list[str], limit: tuple[str, str]) -> None:
    """The innocent method keeps its scores whatever the other one does, unless the file is refused before the run."""
    done = scene.command("run", *selection, "-j", 1, *limit)
    found = scene.records()
    if done.code == USAGE and not plugin.statuses:
        _require_refusal(scene, done.error, found)
        return
    scene.check_scores(INNOCENT)
    if plugin.statuses:
        record = found.get(plugin.method)
        if record is None:
            scene.cross(Border.SILENCE, f"no record of {plugin.method}")
            return
        status, reason = record["status"], str(record.get("reason", ""))
        scene.require(
            status in plugin.statuses, Border.SILENCE, f"status {status}, not {plugin.statuses}: {reason[:200]}"
        )
        scene.require(
            status == "ok" or bool(re.search(plugin.says, reason)),
            Border.SILENCE, f"{reason[:200]!r} does not say {plugin.says!r}",
        )  # fmt: skip
        all_ok = all(each["status"] == "ok" for each in found.values())
        scene.require((done.code == OK) == all_ok, Border.EXIT_CODE, f"run: {done.code}, all ok: {all_ok}")


def _require_refusal(scene: Scene, said: str, found: dict[str, object]) -> None:
    """A file that cannot be used is refused in one line before any work begins."""
    scene.require(not found, Border.SPREAD, "refused, but only after some jobs were done")
    lines = said.strip().splitlines()
    scene.require(
        len(lines) == 1 and lines[0].startswith("error: "), Border.SILENCE,
        f"refused by {len(lines)} lines: {said.strip()[:300]!r}",
    )  # fmt: skip


def _other_verbs(scene: Scene, plugin: BadPlugin, path: Path, selection: list[str], limit: tuple[str, str]) -> None:
    scene.command("list", "methods", "--plugin", path)
    scene.command("plan", *selection)
    scene.command("check", path, *limit)
    mesh = next(iter(sorted(scene.rods.glob("*.off"))))
    words = ("canonicalise", "-m", plugin.method or INNOCENT, mesh, "-o", scene.folder / "form.off", "--plugin", path)
    done = scene.command(*words, *limit)
    whole = (scene.folder / "form.off").is_file()
    scene.require(whole == (done.code == OK), Border.HALF, f"canonicalise: {done.code}, file written: {whole}")
