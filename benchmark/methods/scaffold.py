"""A working plugin to start from: a method in one file, and its test in another."""

from __future__ import annotations

import keyword
import re
import sys
from importlib.metadata import packages_distributions
from pathlib import Path
from string import Template

from benchmark.errors import ConfigurationError
from benchmark.methods.information import LONGEST_NAME, is_name
from benchmark.methods.registry import methods

#: Names that the written module imports: a class of that name would hide them.
_IMPORTED = frozenset({"Annotated", "CanonicalForm", "ClassVar", "Interval", "MethodInfo", "Shape"})

_METHOD = Template('''\
"""$title: every vertex as far from the middle of the surface as the way along the surface is long."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from benchmark.contracts import CanonicalForm, Interval, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class $class_name:
    """Vertices pushed outwards along the rays from the geodesic centre, which stretches bent limbs.

    Parameters
    ----------
    strength
        Not negative. 0 leaves the shape as it is; 1 puts each vertex at its geodesic distance from the centre.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="$name",
        title="$title",
        summary="vertices at their geodesic distance from the centre",
    )

    strength: Annotated[float, Interval(0)] = 1.0

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the pushed vertices; the centre is the vertex nearest to all others along the surface."""
        geodesics = shape.geodesics()
        centre = int(geodesics.sum(axis=1).argmin())
        rays = shape.mesh.vertices - shape.mesh.vertices[centre]
        straight = np.maximum(np.linalg.norm(rays, axis=1), 1e-12)
        stretch = 1 + self.strength * (geodesics[centre] / straight - 1)
        return shape.form(rays * stretch[:, None], largest_stretch=float(stretch.max()))
''')

_TEST = Template('''\
"""What $title promises."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmark.methods.conformance import check_target, figure
from benchmark.contracts import Shape
from benchmark.methods.registry import plugin_methods

PLUGIN = Path(__file__).with_name("$module.py")


def test_it_keeps_the_contract() -> None:
    report = check_target(str(PLUGIN))
    assert report, f"\\n{report}"


def test_vertices_lie_at_their_geodesic_distance_from_the_centre() -> None:
    (spec,) = plugin_methods(PLUGIN)
    shape = Shape(identifier="figure", mesh=figure())
    form = spec.load()(strength=1.0).canonicalise(shape)
    geodesics = shape.geodesics()
    centre = geodesics.sum(axis=1).argmin()
    distances = np.linalg.norm(form.vertices - form.vertices[centre], axis=1)
    np.testing.assert_allclose(distances, geodesics[centre], atol=1e-9)
''')


def new_method(name: str, folder: Path = Path()) -> list[Path]:
    """Write a plugin file with a small working method, and a test of it; nothing is overwritten.

    Parameters
    ----------
    name
        Name of the method: lower case, words joined by hyphens.
    folder
        Where to write ``name_with_underscores.py`` and ``test_name_with_underscores.py``; made if it is not there.

    Returns
    -------
    list of pathlib.Path
        The plugin and its test.

    Raises
    ------
    ConfigurationError
        If the name cannot be used, a file is there already, or the folder cannot be written to.
    """
    module, class_name = _checked(name)
    values = {
        "name": name,
        "module": module,
        "class_name": class_name,
        "title": " ".join(word.capitalize() for word in name.split("-")),
    }
    texts = {
        folder / f"{module}.py": _METHOD.substitute(values),
        folder / f"test_{module}.py": _TEST.substitute(values),
    }
    for path in texts:
        if path.exists():
            raise ConfigurationError(f"{path} exists already", "choose another name or folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path, text in texts.items():
            with path.open("x", encoding="utf-8") as file:
                file.write(text)
    except OSError as error:
        raise ConfigurationError(f"{folder} cannot be written to: {error}", "choose another folder") from error
    return list(texts)


def _checked(name: str) -> tuple[str, str]:
    """Names of the module and of the class, or an error that says what is wrong with the name."""
    if len(name) > LONGEST_NAME:
        raise ConfigurationError(
            f"'{name[:20]}...' is too long for the name of a method", f"use {LONGEST_NAME} characters at most"
        )
    if not is_name(name):
        words = re.findall(r"[a-z][a-z0-9]*|[0-9]+", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", name).lower())
        mend = "join lower-case words by hyphens" + (f": {'-'.join(words)}" if words and words[0].isalpha() else "")
        raise ConfigurationError(f"'{name}' cannot be the name of a method", mend)
    if name in methods():
        raise ConfigurationError(f"there is a method '{name}' already", "choose another name")
    module, class_name = name.replace("-", "_"), "".join(word.capitalize() for word in name.split("-"))
    if keyword.iskeyword(module) or keyword.iskeyword(class_name) or class_name in _IMPORTED:
        raise ConfigurationError(f"'{name}' has a meaning of its own in the file", f"choose another name: my-{name}")
    if module in sys.stdlib_module_names or module in packages_distributions():
        raise ConfigurationError(
            f"{module}.py would hide the Python module '{module}'", f"choose another name: my-{name}"
        )
    return module, class_name
