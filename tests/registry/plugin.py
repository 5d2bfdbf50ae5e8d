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
FORM = "def canonicalise(self, shape):\n        return shape.form(shape.mesh.vertices)"


def write_plugin(
    path: Path,
    *,
    imports: str = "",
    name: str = "smooth",
    info: str = "",
    fields: str = "",
    methods: str = FORM,
) -> Path:
    """Write a plugin file with one method."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        PLUGIN.format(imports=imports, name=name, info=info, fields=fields, methods=methods)
    )
    return path
