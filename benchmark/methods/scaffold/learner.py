"""A learner to start from, and its test."""

from string import Template

PLUGIN = Template('''\
"""$title: of all depth images seen in training, take the one most alike, and answer with its canonical pose."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from safetensors.numpy import load, save

from benchmark.contracts import CanonicalForm, MethodInfo, Shape, UnsupportedShape
from benchmark.errors import ConfigurationError
from benchmark.geometry.depth import back_project
from benchmark.learning import CARD, WEIGHTS, Split, TrainingData, checked_weights

#: Every so many-th pixel of an image is kept.
STRIDE = 5


@dataclass(frozen=True, kw_only=True)
class $class_name:
    """The nearest neighbour among the training images, pixel by pixel.

    Parameters
    ----------
    training_seed
        Of no account here; a network would start from it.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="$name",
        title="$title",
        summary="canonical pose of the training image most alike",
        inputs=("view",),
        scale="invariant",
    )
    split: ClassVar[Split] = "table"
    shipped_models: ClassVar[Path] = Path(__file__).with_name("models")

    training_seed: int = 0
    model: Mapping[str, Any] = field(default_factory=dict, init=False, compare=False, repr=False)

    @property
    def model_name(self) -> str:
        """Folder of the model; it must tell all parameters apart that lead to another training."""
        return f"seed{self.training_seed}"

    def train(self, data: TrainingData, folder: Path, options: Mapping[str, Any], say: Callable[[str], None]) -> None:
        """Keep all pairs, smaller; the card is written last, for it means that the model is finished."""
        if options:
            raise ConfigurationError(f"$name has no option '{next(iter(options))}'", "leave it out")
        if (folder / CARD).is_file():
            say("finished before")
            return
        pairs = list(data.pairs())
        images = np.stack([pair.image[::STRIDE, ::STRIDE] for pair in pairs]).astype(np.float16)
        targets = np.stack([pair.target[::STRIDE, ::STRIDE] for pair in pairs]).astype(np.float16)
        weights = save({"images": images, "targets": targets})
        folder.mkdir(parents=True, exist_ok=True)
        (folder / WEIGHTS).write_bytes(weights)
        card = {
            "digest": hashlib.sha256(weights).hexdigest(),
            "data": data.name,
            "data_title": data.title,
            "subjects": data.subjects,
            "identifiers": data.identifiers,
            "schedule_in_words": f"{len(pairs)} pairs, kept as they are",
        }
        (folder / CARD).write_text(json.dumps(card), encoding="utf-8")
        say(f"kept {len(pairs)} pairs")

    def load(self, folder: Path) -> Self:
        """Return the method with the model in ``folder``."""
        loaded = replace(self)
        object.__setattr__(loaded, "model", load(checked_weights(folder)))
        return loaded

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the surface behind the canonical image of the nearest neighbour, of unit area."""
        if shape.depth is None:
            raise UnsupportedShape("there is no depth image", "use the view input")
        if not self.model:
            raise ConfigurationError("$name has no model", "run 'python -m benchmark train $name'")
        image = shape.depth[::STRIDE, ::STRIDE]
        differences = np.abs(self.model["images"].astype(np.float32) - image).sum(axis=(1, 2))
        nearest = int(differences.argmin())
        surface, _ = back_project(self.model["targets"][nearest].astype(np.float32), half_width=1.0)
        return CanonicalForm(surface.vertices / surface.area**0.5, surface.faces, {"neighbour": nearest})
''')

TEST = Template('''\
"""What $title promises."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmark.methods.conformance import check_target
from benchmark.methods.conformance.learners import trained
from benchmark.methods.conformance.shapes import BENDS, view
from benchmark.methods.registry import plugin_methods

PLUGIN = Path(__file__).with_name("$module.py")


def test_it_keeps_the_contract() -> None:
    report = check_target(str(PLUGIN))
    assert report, f"\\n{report}"


def test_every_pose_of_the_training_gets_the_canonical_one(tmp_path: Path) -> None:
    (spec,) = plugin_methods(PLUGIN)
    learner = trained(spec, tmp_path)
    forms = [learner.canonicalise(view(bend)) for bend in BENDS]
    assert [form.notes["neighbour"] for form in forms] == list(range(len(BENDS)))
    for form in forms[1:]:
        np.testing.assert_array_equal(form.vertices, forms[0].vertices)
''')
