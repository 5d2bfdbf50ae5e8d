"""Odd command lines: every verb with every option given what nobody would give it."""

from __future__ import annotations

from collections.abc import Iterator

import click

from benchmark.cli.main import cli
from tools.faults.cases import Border, Case
from tools.faults.scene import INNOCENT, USAGE, Scene, shown

#: Command lines in one case, and cases.
PER_CASE, CASES = 8, 30

#: Values that some option will not expect.
ODD = (
    "", " ", "\n", "-", "--", "-1", "0", "00", "1e999", "nan", "inf", "0x10", "1_000", "٣", "9" * 40, "x" * 5000,
    "\x1b[31mred\x1b[0m", "|", "$HOME", "%s%n", "{0}", "<script>", "💥", "\u202egpj", "[", "]", "[=]", "[a=1", "x[a=]",
    "x[a=1,a=2]", "surface-area[a=1]", "surface-area[[]]", "all[a=1]", "I;II", "no-such-thing", "~", ".", "..",
    "/proc/none/none", "a/../b", "https://example.org/x", "C:\\x",
    "\udcff", "deadbeef", "--help", "@file", "*", "ok,failed", "1s1", "1h30m", "-0", "+5", "True", "none",
)  # fmt: skip


def cases() -> list[Case]:
    """Cases of some command lines each."""
    return [Case(f"arguments/{number:02}", _try) for number in range(CASES)]


def _try(scene: Scene) -> None:
    verbs = sorted(_verbs(cli))
    paths = _paths(scene)
    for _ in range(PER_CASE):
        words, command = scene.random.choice(verbs)
        arguments = _odd_line(scene, [*words.split()], command, paths)
        done = scene.command(*arguments)
        if done.code == USAGE:
            lines = done.error.strip().splitlines()
            scene.require(
                len(lines) == 1, Border.SILENCE,
                f"{shown(tuple(arguments))}: not one line but {done.error.strip()[:300]!r}",
            )  # fmt: skip
        for name in ("null", "full"):
            scene.require(
                (scene.folder / name).is_symlink(), Border.SPREAD, f"{shown(tuple(arguments))}: no device left"
            )
        scene.outcome.tried += 1


def _verbs(group: click.Group, above: str = "") -> Iterator[tuple[str, click.Command]]:
    for name, command in group.commands.items():
        if isinstance(command, click.Group):
            yield from _verbs(command, f"{above}{name} ")
        else:
            yield f"{above}{name}", command


def _paths(scene: Scene) -> list[str]:
    (scene.folder / "text").write_text("a file\n")
    (scene.folder / "noise.py").write_bytes(bytes(range(256)))
    (scene.folder / "empty").mkdir(exist_ok=True)
    # Links, so that a verb that replaces what it should write to does no harm to the machine.
    for name in ("null", "full"):
        (scene.folder / name).symlink_to(f"/dev/{name}")
    names = ("text", "noise.py", "empty", "absent/absent", "null", "full")
    return [str(scene.folder / name) for name in names] + [str(scene.rods)]


def _odd_line(scene: Scene, words: list[str], command: click.Command, paths: list[str]) -> list[str]:
    """A line that would do little work, with one to three parts that are odd."""
    draw = scene.random
    values = _harmless(scene, command)
    options = [parameter for parameter in command.params if parameter.name != "help"]
    for parameter in draw.sample(options, min(len(options), draw.choice((1, 1, 2, 3)))):
        name = str(parameter.name)
        odd = draw.choice(paths) if draw.random() < 0.25 else draw.choice(ODD)
        if isinstance(parameter, click.Option):
            values[name] = [parameter.opts[0]] + ([] if parameter.is_flag else [odd])
        else:
            values[name] = [odd] * draw.choice((0, 1, 1, 1, 2))
    parts = list(values.values())
    if draw.random() < 0.2:
        parts.append([draw.choice(ODD)])
    draw.shuffle(parts)
    return words + [word for part in parts for word in part]


def _harmless(scene: Scene, command: click.Command) -> dict[str, list[str]]:
    """Values by parameter that make a verb do little: the rods, the cheapest method, folders of the scene."""
    mesh = str(sorted(scene.rods.glob("*.off"))[0])
    known = {
        "datasets": ["-d", str(scene.rods)], "methods": ["-m", INNOCENT], "inputs": ["--input", "mesh"],
        "results": ["--results", str(scene.results)], "only": ["--only", "no-such-training"], "jobs": ["-j", "1"],
        "output": ["-o", str(scene.folder / "out")], "timeout": ["--timeout", "20s"],
    }  # fmt: skip
    arguments = {
        "what": "methods", "name": str(scene.rods), "source": mesh, "target": INNOCENT, "first": INNOCENT,
        "second": "identity", "folders": str(scene.results), "method": INNOCENT,
    }  # fmt: skip
    found: dict[str, list[str]] = {}
    for parameter in command.params:
        name = str(parameter.name)
        if isinstance(parameter, click.Argument):
            found[name] = [arguments.get(name, "x")]
        elif name in known:
            found[name] = known[name]
        elif parameter.required and isinstance(parameter.type, click.Choice):
            found[name] = [parameter.opts[0], str(next(iter(parameter.type.choices)))]
        elif parameter.required:
            found[name] = [parameter.opts[0], arguments.get(name, "x")]
    if command.name == "export":
        found["output"] = ["-o", str(scene.folder / f"export-{scene.random.randrange(10**6)}")]
    return found
