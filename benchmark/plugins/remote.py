"""Methods and scorers of plugins in processes that do not import them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NoReturn, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import CanonicalForm, FloatArray, MethodInfo, Shape
from benchmark.api.learning import read_card
from benchmark.api.scoring import ScorerInfo, SignatureArrays
from benchmark.arrays import Arrays
from benchmark.execution.processes.calls import Guard
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.storage.costs import Cost
from benchmark.plugins.closing import close_process
from benchmark.plugins.inspection import LIMIT, look, told
from benchmark.plugins.services import service, services, watch_starts
from benchmark.plugins.serving import folded, serve, spec_of, tell
from benchmark.plugins.specs import ScorerSpec

Facts = dict[str, Any]


def close_to_plugins(starting: Callable[[bool], object] = bool) -> None:
    """Let no plugin into this process from now on: their methods and scorers work in processes of their own.

    Parameters
    ----------
    starting
        See :func:`benchmark.plugins.services.watch_starts`.
    """
    watch_starts(starting)
    close_process(Remote.__name__)


@dataclass(frozen=True)
class Remote:
    """A method or scorer in the process of its plugin, by what names it there."""

    kind: str
    target: str
    name: str
    base_name: str

    @property
    def facts(self) -> Facts:
        """What its process tells of it, see :attr:`benchmark.plugins.specs.PluginSpec.facts`."""
        key = (self.kind, self.target, self.name)
        if key not in told:
            facts = self._ask()
            told[key] = told[self.kind, self.target, facts["name"]] = facts
        return told[key]

    def _ask(self) -> Facts:
        return self.request("tell", {}, {})[0]

    def chosen(self, parameters: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return parameters that were looked at before."""
        return parameters

    def create(self) -> Foreign:
        """Return a method or a scorer that works in its process."""
        if self.kind == ScorerSpec.kind:
            return _RemoteScorer(self, msgspec.convert(self.facts["info"], ScorerInfo))
        kind = _RemoteDescriptor if self.facts["describes"] else RemoteMethod
        return kind(self, msgspec.convert(self.facts["info"], MethodInfo))

    @property
    def _places(self) -> tuple[tuple[str, ...], ...]:
        """Place of its process, that which it shares with others of its plugin, and that which is its own."""
        shared = (self.kind, self.target.rpartition(":")[0])
        own = (*shared, self.base_name)
        return (own if own in services else shared), shared, own

    @property
    def files(self) -> dict[str, str]:
        """Files that its process has read, with their digests."""
        process = services.get(self._places[0])
        return process.files if process else {}

    def request(self, work: str, facts: Mapping[str, Any], arrays: Arrays) -> tuple[Facts, Arrays]:
        """Have some work done."""
        place, shared, own = self._places
        process = service(place, serve, {"work": "tell", **asdict(self)})
        try:
            return process.request_or_end_alike({"work": work, **asdict(self), **facts}, arrays)
        finally:
            if process.is_occupied and place == shared and work != "tell":  # telling imports the plugin, for all of it
                services[own] = services.pop(shared)


@dataclass(frozen=True)
class Foreign:
    """A method or scorer whose work is done in the process of its plugin.

    Parameters
    ----------
    remote
        Has the work done.
    info
        What it says about itself.
    book
        Told the cost of each work.
    model
        Folder of the trained model; "" where it does not learn.
    """

    remote: Remote
    info: Any
    book: Callable[[Cost], None] = lambda cost: None
    model: str = ""

    @property
    def files(self) -> dict[str, str]:
        """Files that its process has read so far, with their digests."""
        return self.remote.files

    def _worked(self, work: str, facts: Mapping[str, Any], arrays: Arrays) -> Arrays:
        told, found = self.remote.request(work, {**facts, "model": self.model}, arrays)
        if "cost" in told:
            self.book(Cost.from_json(told["cost"]))
        return found

    def _on_shape(self, work: str, shape: Shape) -> Arrays:
        facts = {"seed": shape.seed, "source_area": shape.source_area}
        depth = {} if shape.depth is None else {"depth": shape.depth}
        return self._worked(work, facts, {"vertices": shape.mesh.vertices, "faces": shape.mesh.faces, **depth})


class RemoteMethod(Foreign):
    """A method in the process of its plugin."""

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """See :class:`benchmark.api.contracts.Method`."""
        found = self._on_shape("canonicalise", shape)
        notes = {name.removeprefix("note:"): value.item() for name, value in found.items() if name.startswith("note:")}
        return CanonicalForm(found["vertices"], found["faces"], notes)

    def load(self, folder: Path) -> Self:
        """See :class:`benchmark.api.learning.Learner`."""
        return replace(self, model=str(folder))


class _RemoteDescriptor(Foreign):
    def describe(self, shape: Shape) -> FloatArray:
        """See :class:`benchmark.api.contracts.Descriptor`."""
        return np.asarray(self._on_shape("describe", shape)["descriptor"])

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """See :class:`benchmark.api.contracts.Descriptor`."""
        arrays = folded([{"descriptor": each} for each in descriptors])
        return np.asarray(self._worked("distances", {}, arrays)["distances"])


class _RemoteScorer(Foreign):
    def signature(self, form: Mesh) -> SignatureArrays:
        """See :class:`benchmark.api.scoring.Scorer`."""
        return self._worked("signature", {}, {"vertices": form.vertices, "faces": form.faces})

    def compare(self, signatures: Sequence[SignatureArrays], draw: int) -> NDArray[np.float64]:
        """See :class:`benchmark.api.scoring.Scorer`."""
        return np.asarray(self._worked("compare", {"draw": draw}, folded(signatures))["distances"])


@dataclass(frozen=True)
class Inspected(Remote):
    """The same in the process that talks to the user: a plugin that hangs or crashes costs it an error."""

    def _ask(self) -> Facts:
        return dict(self.look(tell))

    def chosen(self, parameters: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the parameters that differ from their defaults, normalised."""
        chosen = self.facts["chosen"]
        return {name: tuple(value) if isinstance(value, list) else value for name, value in chosen.items()}

    def create(self) -> Foreign:
        """See :class:`Remote`; a learner knows its models."""
        if "learner" in self.facts:
            return _InspectedLearner(self, msgspec.convert(self.facts["info"], MethodInfo))
        return super().create()

    def look(self, function: Callable[..., Any], *arguments: str) -> Any:
        """Call a function with what names the plugin, in a process that may import it."""
        hint = "correct the plugin: importing it and making its methods must end at once"
        guard = Guard(f"{self.kind} '{self.name}'", hint, LIMIT, quiet=True)
        return look(function, self.kind, self.name, self.base_name, self.target, *arguments, guard=guard)


@dataclass(frozen=True)
class _InspectedLearner(RemoteMethod):
    """A learner that was looked at; see :class:`benchmark.api.learning.Learner`."""

    remote: Inspected

    @property
    def model_name(self) -> str:
        return str(self.remote.facts["learner"]["model_name"])

    @property
    def split(self) -> str:
        return str(self.remote.facts["learner"]["split"])

    @property
    def shipped_models(self) -> Path:
        return Path(self.remote.facts["learner"]["shipped_models"])

    @property
    def model_folder(self) -> Path | None:
        folder = self.remote.facts["learner"]["model_folder"]
        return None if folder is None else Path(folder)

    def train(self, *_: object) -> NoReturn:
        raise AssertionError("a plugin is trained in a process of its own")

    def check_card(self, card: Mapping[str, Any], folder: Path) -> None:
        self.remote.look(_check_card, str(folder))


def _check_card(kind: str, name: str, base_name: str, target: str, folder: str) -> None:
    """Check the card of a model, in a process that may import the learner."""
    check = getattr(spec_of(kind, name, base_name, target).create(), "check_card", None)
    if check is not None:
        check(read_card(Path(folder)), Path(folder))
