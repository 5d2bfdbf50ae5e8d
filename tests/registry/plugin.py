"""Plugin files that tests edit."""

from __future__ import annotations

from pathlib import Path

PLUGIN = '''
"""A plugin."""

from dataclasses import dataclass
from typing import ClassVar

from benchmark.api import MethodInfo
{imports}


@dataclass(frozen=True, kw_only=True)
class Smooth:
    """Smoothed surface."""

    info: ClassVar[MethodInfo] = MethodInfo(name="{name}", title="Smooth", {info})
    {fields}

    {methods}
'''
DATA_SET = """
from pathlib import Path

from benchmark.api import SIDE, Camera, Entry, Mesh, ShapeSet
{imports}


def load(entry):
    {load}


RODS = ShapeSet(name={name!r}, shapes={shapes}, load=load, {more})
"""
FORM = "def canonicalise(self, shape):\n        return shape.form(shape.mesh.vertices)"


def write_plugin(
    path: Path, *, imports: str = "", name: str = "smooth", info: str = "", fields: str = "", methods: str = FORM
) -> Path:
    """Write a plugin file with one method."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(PLUGIN.format(imports=imports, name=name, info=info, fields=fields, methods=methods))
    return path


def write_data_set(path: Path, *, load: str, shapes: str, **more: str) -> Path:
    """Write a plugin file with one data set, which may have another name, more options and other imports."""
    given = {"name": "rods", "more": "", "imports": "from tests.toy import rod"} | more
    path.write_text(DATA_SET.format(load=load, shapes=shapes, **given))
    return path
