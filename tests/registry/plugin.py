"""A plugin file that tests edit."""

from __future__ import annotations

import textwrap
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

    info: ClassVar[MethodInfo] = MethodInfo(name="smooth", title="Smooth", files=({files}))
    {fields}

    def canonicalise(self, shape):
        {body}
'''


def write_plugin(
    path: Path,
    *,
    imports: str = "",
    fields: str = "",
    files: str = "",
    body: str = "return shape.form(shape.mesh.vertices)",
    name: str = "smooth",
) -> Path:
    """Write a plugin file with one method."""
    text = PLUGIN.format(imports=imports, fields=fields, files=files, body=body)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(textwrap.dedent(text).replace('"smooth"', f'"{name}"'))
    return path
