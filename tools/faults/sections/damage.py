"""Results folders with damaged or alien files: what is whole still counts, what is not is made again."""

from __future__ import annotations

import json
import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path

from tools.faults.cases import Border, Case
from tools.faults.plugin_files import LIGHT
from tools.faults.scene import INNOCENT, OK, Scene

METHODS = (INNOCENT, "light-size", "light-children")

#: Cases of each kind of damage to each kind of file.
_REPETITIONS = 3

#: Aliens that nest, in the words of JSON.
_DEEP = b"[" * 100_000


def _flip(content: bytes, draw: random.Random) -> bytes:
    """Change one bit."""
    changed = bytearray(content)
    changed[draw.randrange(len(changed))] ^= 1 << draw.randrange(8)
    return bytes(changed)


def _flip_many(content: bytes, draw: random.Random) -> bytes:
    for _ in range(20):
        content = _flip(content, draw)
    return content


def _truncate(content: bytes, draw: random.Random) -> bytes:
    return content[: draw.randrange(len(content))]


def _alien(_: bytes, draw: random.Random) -> bytes:
    return draw.choice(
        (b"", bytes(500), b"null", b"[]", b"{}", b'{"key": 1}', _DEEP, b"\xff\xfe", b"PK\3\4" + bytes(99))
    )


def _digits(content: bytes, draw: random.Random) -> bytes:
    """Change a digit to another one, which leaves any text well-formed."""
    places = [place for place, byte in enumerate(content) if chr(byte) in "123456789"]
    if not places:
        return content + b"\0"
    changed = bytearray(content)
    place = draw.choice(places)
    changed[place] = ord(draw.choice([digit for digit in "123456789" if digit != chr(changed[place])]))
    return bytes(changed)


def _doubled(content: bytes, _: random.Random) -> bytes:
    return content + content


DAMAGE: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "bit": _flip, "bits": _flip_many, "cut": _truncate, "alien": _alien, "digit": _digits, "doubled": _doubled,
}  # fmt: skip

#: Where files are damaged, as patterns in the results folder.
PARTS = {"record": "runs/records/*.json", "artefact": "runs/artefacts/*/*.npz"}

_Place = Callable[[Path, random.Random], object]

#: What else may lie in a results folder.
ALIENS: dict[str, _Place] = {
    "file-among-records": lambda results, _: (results / "runs/records/notes.json").write_text("mine"),
    "folder-among-records": lambda results, _: (results / "runs/records/x.json").mkdir(),
    "pipe-among-records": lambda results, _: os.mkfifo(results / "runs/records" / f"{'0' * 32}.json"),
    "loop-among-records": lambda results, _: (results / "runs/records/loop.json").symlink_to("loop.json"),
    "name-no-text-among-records": lambda results, _: Path(
        os.fsdecode(os.fsencode(results) + b"/runs/records/\xff\xfe.json")
    ).write_text("{}"),
    "record-of-another-name": lambda results, _: shutil.copy(
        next((results / "runs/records").glob("*.json")), results / "runs/records" / f"{'0' * 32}.json"
    ),
    "record-of-hostile-text": lambda results, _: _rewrite(
        results, lambda r: r | {"title": "\x1b[31m|$\\input{x}<script>\n", "reason": "\udcff" * 3}
    ),
    "record-of-wrong-types": lambda results, draw: _rewrite(
        results, lambda r: r | {draw.choice(sorted(r)): draw.choice((None, 1, "x", [], {}, [[]], True))}
    ),
    "record-without-a-part": lambda results, draw: _rewrite(results, lambda r: _without(r, draw.choice(sorted(r)))),
    "record-of-infinite-scores": lambda results, _: _rewrite(
        results, lambda r: r | {"scores": {name: float("inf") for name in r["scores"]}}
    ),
    "record-of-huge-numbers": lambda results, _: _rewrite(results, lambda r: r | {"n_shapes": 10**400}),
    "progress-of-others": lambda results, _: (results / "runs/progress/1-0").write_text("not;a;status"),
    "folder-among-progress": lambda results, _: (results / "runs/progress/1-1").mkdir(),
    "file-among-artefacts": lambda results, _: (results / "runs/artefacts/notes").write_text("mine"),
    "folder-as-artefact": lambda results, _: _replace_by_folder(next((results / "runs/artefacts").glob("*/*.npz"))),
    "published-noise": lambda results, draw: _write(results / "records" / f"{'a' * 32}.json", draw.randbytes(500)),
    "model-without-card": lambda results, _: _write(results / "models/t/m/weights.safetensors", b"x"),
    "model-card-noise": lambda results, draw: _write(results / "models/t/m/card.json", draw.randbytes(200)),
    "model-card-empty": lambda results, _: _write(results / "models/t/m/card.json", b"{}"),
    "model-card-types": lambda results, _: _write(results / "models/t/m/card.json", b'{"digest": 1, "kind": []}'),
    "model-card-deep": lambda results, _: _write(results / "models/t/m/card.json", _DEEP),
    "models-is-a-file": lambda results, _: _write(results / "models", b""),
}


def cases() -> list[Case]:
    """Cases of this section."""
    found = []
    for part, pattern in PARTS.items():
        for kind, change in DAMAGE.items():
            for number in range(_REPETITIONS):
                name = f"damage/{part}-{kind}-{number}"
                found.append(Case(name, lambda s, p=pattern, c=change: _try(s, lambda f, d: _damage(f, d, p, c))))  # type: ignore[misc]
    return found + [Case(f"damage/{name}", lambda s, place=place: _try(s, place)) for name, place in ALIENS.items()]  # type: ignore[misc]


def _try(scene: Scene, place: _Place) -> None:
    """Every verb copes; a run makes what is damaged again and leaves the rest alone."""
    plugin = scene.folder / "light.py"
    plugin.write_text(LIGHT)
    selection = scene.selection(INNOCENT, plugin=plugin)
    scene.begin_with_results()
    before = scene.record_files()
    place(scene.results, scene.random)
    damaged = scene.record_files()
    for verb in ("plan", "tables"):
        scene.command(verb, *selection)
    shown = scene.command("tables", *selection, "--format", "json")
    _check_shown(scene, shown.output)
    scene.command("why", INNOCENT, *selection, may_trace=True)
    scene.command("compare", INNOCENT, "light-size", "--plugin", plugin, "--results", scene.results)
    scene.command("prune", "--dry-run", "--results", scene.results)
    scene.command("list", "models", "--results", scene.results)
    scene.command("merge", scene.results, "--results", scene.folder / "merged")
    again = scene.command("run", *selection, "-j", 1, codes=(OK,))
    after = scene.record_files()
    for name, content in before.items():
        if damaged.get(name) == content:
            scene.require(after.get(name) == content, Border.LOST, f"{name}, which was whole; {again.said[-200:]}")
    _check_made_again(scene, before)
    scene.command("prune", "--results", scene.results, codes=(OK,))
    scene.outcome.tried = 10


def _check_shown(scene: Scene, text: str) -> None:
    """No table shows a score that no run has found."""
    try:
        rows = json.loads(text)
    except ValueError:
        return  # refused, which was looked at already
    for row in rows:
        expected = scene.expected.get(row["method"])
        if expected and row["status"] == "ok":
            found = {name: row[name] for name in ("NN", "FT", "ST", "DCG")}
            right = {name: expected["scores"][name] for name in found}
            close = all(found[name] is not None and abs(found[name] - right[name]) < 1e-9 for name in found)
            scene.require(close, Border.SCORES, f"tables show {row['method']} {found}, not {right}")


def _check_made_again(scene: Scene, before: dict[str, bytes]) -> None:
    """The records that were there before the damage are there again; other files are nobody's business."""
    whole = scene.folder / "whole" / "runs" / "records"
    whole.mkdir(parents=True)
    for name, content in scene.record_files().items():
        if name in before:
            (whole / name).write_bytes(content)
    scene.check_scores(*METHODS, results=scene.folder / "whole")


def _damage(results: Path, draw: random.Random, pattern: str, change: Callable[[bytes, random.Random], bytes]) -> None:
    path = draw.choice(sorted(results.glob(pattern)))
    path.write_bytes(change(path.read_bytes(), draw))


def _rewrite(results: Path, change: Callable[[dict[str, object]], dict[str, object]]) -> None:
    """Write a record that is well-formed JSON but was changed."""
    path = next(iter(sorted((results / "runs/records").glob("*.json"))))
    path.write_text(json.dumps(change(json.loads(path.read_text()))))


def _without(record: dict[str, object], part: str) -> dict[str, object]:
    return {name: value for name, value in record.items() if name != part}


def _replace_by_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
