"""Text of ``describe`` about a method."""

from __future__ import annotations

import dataclasses
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmark.api.parameters import format_value
from benchmark.reference.bibliography import source_of
from benchmark.text import clean

if TYPE_CHECKING:
    from benchmark.plugins.registry import MethodSpec

#: Sets whose trainings show people alone.
_PEOPLE = ("humans", "shrec14-synthetic")

_KINDS = {"paper": "a row of the paper", "control": "a yardstick", "extended": "beyond the paper"}


def trained_on_people(spec: MethodSpec) -> str:
    """Warn of a method whose model was shown people alone; "" for any other, and where a table chooses the model."""
    from benchmark.protocols.trainings import TRAININGS

    if spec.is_foreign or not spec.learns or spec.missing_packages():
        return ""
    folder = getattr(spec.create(), "model_folder", None)
    training = TRAININGS.get(folder.parent.name) if isinstance(folder, Path) else None
    if training is None or training.dataset not in _PEOPLE:
        return ""
    return f"its model of training '{training.name}' was shown people alone: of another shape it makes a person"


def facts_of(spec: MethodSpec) -> dict[str, Any]:
    """Everything that is to be known of a method before it is run, in plain values."""
    info = spec.info
    chosen = {name: format_value(value) for name, value in spec.parameters.items()}
    return {
        "name": spec.name,
        "title": info.title,
        "family": info.family,
        "kind": "learner" if spec.learns else "descriptor" if spec.describes else "method",
        "summary": clean(spec.summary),
        "source": source_of(info.cite),
        "departs": info.departs,
        "inputs": list(info.inputs),
        "scale": info.scale,
        "deterministic": info.deterministic,
        "warning": trained_on_people(spec),
        "requires": list(info.requires),
        "missing": list(spec.missing_packages()),
        "defined_in": spec.target,
        "parameters": [dataclasses.asdict(each) | {"chosen": chosen.get(each.name)} for each in spec.parameter_texts],
    }


def lines_of(facts: dict[str, Any], width: int) -> list[str]:
    """The same for a reader: a line for each fact, and two or more for each parameter."""
    needs = ", ".join(facts["requires"]) or "nothing beyond the core"
    if facts["missing"]:
        needs += f" (not installed: {', '.join(facts['missing'])})"
    rows = [
        ("", facts["summary"]),
        ("kind", f"{facts['kind']}, {_KINDS.get(facts['family'], facts['family'])}"),
        ("source", facts["source"] or "none"),
        *([("departs", facts["departs"])] if facts["departs"] else []),
        ("inputs", " and ".join(facts["inputs"])),
        ("scale", facts["scale"]),
        ("random", "no" if facts["deterministic"] else "yes: the form depends on --seed"),
        *([("warning", facts["warning"])] if facts["warning"] else []),
        ("needs", needs),
        ("defined in", facts["defined_in"]),
    ]
    lines = [f"{facts['name']}: {facts['title']}"]
    for name, text in rows:
        lines += _wrapped(f"  {name:<12}" if name else "  ", text, width)
    lines.append("  parameters" + ("" if facts["parameters"] else "  none"))
    for each in facts["parameters"]:
        chosen = f", here {each['chosen']}" if each["chosen"] is not None else ""
        default = each["default"] if each["default"] else "''"
        lines += _wrapped(f"    {each['name']:<16}", f"{each['values']}; default {default}{chosen}", width)
        lines += _wrapped(" " * 20, each["meaning"], width) if each["meaning"] else []
    return lines


def _wrapped(head: str, text: str, width: int) -> list[str]:
    inner = max(20, width - len(head))
    parts = textwrap.wrap(clean(text), inner, break_on_hyphens=False) or [""]
    return [(head if not number else " " * len(head)) + part for number, part in enumerate(parts)]
