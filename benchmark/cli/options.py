"""Options that several verbs share, and the selection that they make.

Every ``--help`` imports this module, so it imports nothing heavy.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Argument, Option

from benchmark.errors import ConfigurationError
from benchmark.text import DATA_VARIABLE, EVERY

_UNITS = {"": 1, "s": 1, "m": 60, "h": 3600}


def duration(text: str | float) -> float:
    """Parse a duration such as ``90``, ``90s``, ``10m`` or ``2h``; return seconds."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([smh]?)", str(text).strip())
    if not match or float(match[1]) == 0:
        raise ValueError(f"'{text}' is not a duration; write 90s, 10m or 2h")
    return float(match[1]) * _UNITS[match[2]]


Tables = Annotated[list[str], Option("-t", "--table", metavar="TABLE", help="Table; see 'list tables'.")]
Methods = Annotated[list[str], Option("-m", "--method", metavar="METHOD", help="Method, or all; see 'list methods'.")]
Method = Annotated[str, Option("-m", "--method", metavar="METHOD", help="Method; see 'list methods'.")]
Datasets = Annotated[list[str], Option("-d", "--dataset", metavar="DATASET|FOLDER", help="Data set, or your folder.")]
Dataset = Annotated[str, Option("-d", "--dataset", metavar="DATASET|FOLDER", help="Data set or folder.")]
Input = Annotated[Literal["mesh", "view"] | None, Option("--input", help="Default: both.")]
Scorer = Annotated[str, Option("--scorer", metavar="SCORER", help="What compares forms; see 'list scorers'.")]
Plugins = Annotated[list[Path], Option("--plugin", metavar="FILE", help="File with methods, scorers or data sets.")]
Results = Annotated[Path, Option("--results", metavar="DIR", help="Results folder.")]
DataRoot = Annotated[
    Path | None, Option("--data-root", metavar="DIR", envvar=DATA_VARIABLE, help="Folder of the official data sets.")
]
Seed = Annotated[int, Option("--seed", metavar="N", help="Base seed of all methods.")]
Quick = Annotated[bool, Option("--quick", help="Fewer poses per subject, and only the paper's methods.")]
Everything = Annotated[bool, Option("--all", help="All tables but robustness (default of 'plan').")]
Published = Annotated[bool, Option("--published", help="Only published records.")]
Force = Annotated[bool, Option("--force", help="Replace files that this verb did not write.")]
Json = Annotated[bool, Option("--json", help="Print JSON.")]
Timeout = Annotated[float, Option("--timeout", parser=duration, metavar="TIME", help="Limit: 90s, 10m, 2h.")]
Assigned = Annotated[list[str], Option("-o", "--option", metavar="NAME=VALUE", help="Option of the training.")]
Picture = Annotated[Path | None, Option("--picture", metavar="FILE", help="Draw the forms; a folder for several.")]
Intrinsics = Annotated[
    str, Option("--intrinsics", metavar="FILE|fx,fy,cx,cy", help="Camera of a depth image. [file next to it]")
]
Mask = Annotated[Path | None, Option("--mask", metavar="FILE", help="Object in a depth image. [found automatically]")]
DepthScale = Annotated[
    float | None, Option("--depth-scale", metavar="N", help="Depth units a metre. [1000 for integers, 1 for floats]")
]
MethodName = Annotated[str, Argument(metavar="METHOD")]
SetName = Annotated[str, Argument(metavar="NAME|FOLDER")]


@dataclass(frozen=True, kw_only=True)
class Selection:
    """What the shared options select."""

    tables: tuple[str, ...] = ()
    methods: tuple[str, ...] = ()
    datasets: tuple[str, ...] = ()
    input: Literal["mesh", "view"] | None = None
    scorer: str = "cm-bof"
    plugins: tuple[Path, ...] = ()
    results: Path = Path("results")
    data_root: Path | None = None
    subjects: str = ""
    seed: int = 0
    quick: bool = False
    everything: bool = False
    published: bool = False

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Selection:
        """Return what the arguments of a verb select; other arguments are passed over."""
        given: dict[str, Any] = {field.name: values[field.name] for field in fields(cls) if field.name in values}
        given |= {name: tuple(value) for name, value in given.items() if isinstance(value, list)}
        return cls(**given)

    @property
    def is_narrow(self) -> bool:
        """Return whether methods are selected, so that a table omits others that were never run."""
        return bool(self.methods) and EVERY not in self.methods

    def require_data_root(self) -> Path | None:
        """Return the folder of the official data sets, for a verb that reads data."""
        return require_data_root(self.data_root)


def require_data_root(root: Path | None) -> Path | None:
    """Return a folder of official data sets; raise ``ConfigurationError`` if it is missing or the wrong level.

    A folder without sets is valid: a run announces its stand-ins.
    """
    if root is None:
        return None
    if not root.is_dir():
        raise ConfigurationError(
            f"data root {root} is not a readable folder", f"correct --data-root or {DATA_VARIABLE}"
        )
    from benchmark.datasets.catalogue import has_official_sets

    if has_official_sets(root):
        return root
    absolute = root.absolute()
    near = [*absolute.parents[:2], *sorted(path for path in absolute.iterdir() if path.is_dir())]
    if right := next(filter(has_official_sets, near), None):
        raise ConfigurationError(f"data root {root} holds no official data set", f"pass --data-root {right}")
    return root
