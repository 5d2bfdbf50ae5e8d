"""The learner of :mod:`tests.mean_target` with its other splits, a plugin file of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from benchmark.api.contracts import MethodInfo
from benchmark.api.learning import Split
from tests.mean_target import MeanTarget

PLUGIN_PATH = Path(__file__)


@dataclass(frozen=True, kw_only=True)
class MeanStrict(MeanTarget):
    """The same, trained once for each fold."""

    info: ClassVar[MethodInfo] = replace(MeanTarget.info, name="mean-strict", title="Mean strict")
    split: ClassVar[Split] = "strict"


@dataclass(frozen=True, kw_only=True)
class MeanSampled(MeanTarget):
    """The same, trained on sampled bodies."""

    info: ClassVar[MethodInfo] = replace(MeanTarget.info, name="mean-sampled", title="Mean sampled")
    split: ClassVar[Split] = "sampled"
