"""A learner without a network, for tests: its model is the mean of the target images, one number."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self

from benchmark.api.contracts import CanonicalForm, MethodInfo, Shape
from benchmark.api.learning import CARD, WEIGHTS, Split, TrainingData, checked_weights
from benchmark.errors import UnsupportedShape

PLUGIN_PATH = Path(__file__)


@dataclass(frozen=True, kw_only=True)
class MeanTarget:
    """Stretch the view by what was learned."""

    info: ClassVar[MethodInfo] = MethodInfo(name="mean-target", title="Mean target", inputs=("view",))
    split: ClassVar[Split] = "table"
    shipped_models: ClassVar[Path] = Path(__file__).with_name("models")

    configuration: str = "plain"
    training_seed: int = 0
    training: str = ""
    factor: float = 1.0

    @property
    def model_name(self) -> str:
        return f"{self.configuration}-seed{self.training_seed}"

    def train(self, data: TrainingData, folder: Path, options: Mapping[str, Any], say: Callable[[str], None]) -> None:
        if (folder / CARD).is_file():
            say("finished before")
            return
        means = [float(pair.target.mean()) for pair in data.pairs()]
        say(f"{len(means)} of {data.n_pairs} pairs, {len(list(data.validation()))} held out, {sorted(options.items())}")
        write_model(folder, sum(means) / len(means) + self.training_seed, data.identifiers, data.subjects)

    def load(self, folder: Path) -> Self:
        return replace(self, factor=1.0 + float(checked_weights(folder)))

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        if shape.depth is None:
            raise UnsupportedShape("no depth image", "use the view input")
        return shape.form(shape.mesh.vertices * [self.factor, 1, 1])


def write_model(
    folder: Path,
    value: float,
    identifiers: tuple[str, ...] = ("somebody0",),
    subjects: tuple[str, ...] = ("somebody",),
    **card: Any,
) -> None:
    """Put a finished model into a folder."""
    weights = repr(value).encode()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / WEIGHTS).write_bytes(weights)
    facts = {
        "digest": hashlib.sha256(weights).hexdigest(),
        "data": folder.parent.name,
        "identifiers": identifiers,
        "subjects": subjects,
        "schedule_in_words": "one pass",
    }
    (folder / CARD).write_text(json.dumps(facts | card))
