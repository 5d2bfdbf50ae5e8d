"""Methods and scorers of plugins in processes that do not import them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import CanonicalForm, FloatArray, MethodInfo, Shape
from benchmark.api.scoring import ScorerInfo, SignatureArrays
from benchmark.arrays import Arrays
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.storage.costs import Cost
from benchmark.plugins.modules import close_process
from benchmark.plugins.serving import folded, serve
from benchmark.plugins.specs import PluginSpec, ScorerSpec
from benchmark.run.processes.process import Process

Facts = dict[str, Any]


def _nobody(is_starting: bool) -> None:
    """Do nothing, where nobody measures the time of a job."""


def close_to_plugins(starting: Callable[[bool], object] = _nobody) -> None:
    """Let no plugin into this process from now on: their methods and scorers work in processes of their own.

    Parameters
    ----------
    starting
        Called with True before such a process starts and imports its plugin, and with False after that.
    """
    global _starting
    _starting = starting
    close_process(_reach)


def _reach(spec: PluginSpec[Any, Any]) -> _Remote:
    return _Remote(spec.kind, spec.target, spec.name, spec.base_name)


#: Processes of the methods, or of the scorers, of a plugin: one for all, and one for each that leaves threads or
#: processes behind.
_services: dict[tuple[str, ...], Process] = {}

_starting: Callable[[bool], object] = _nobody


@cache
def _told(remote: _Remote) -> Facts:
    return remote.request("tell", {}, {})[0]


@dataclass(frozen=True)
class _Remote:
    """A method or scorer in the process of its plugin, by what names it there."""

    kind: str
    target: str
    name: str
    base_name: str

    @property
    def facts(self) -> Facts:
        """What its process tells of it, see :attr:`benchmark.plugins.specs.PluginSpec.facts`."""
        return _told(self)

    def create(self) -> Foreign:
        """Return a method or a scorer that works in its process."""
        if self.kind == ScorerSpec.kind:
            return _RemoteScorer(self, msgspec.convert(self.facts["info"], ScorerInfo))
        kind = _RemoteDescriptor if self.facts["describes"] else _RemoteMethod
        return kind(self, msgspec.convert(self.facts["info"], MethodInfo))

    @property
    def _places(self) -> tuple[tuple[str, ...], ...]:
        """Place of its process, that which it shares with others of its plugin, and that which is its own."""
        shared = (self.kind, self.target.rpartition(":")[0])
        own = (*shared, self.base_name)
        return (own if own in _services else shared), shared, own

    @property
    def files(self) -> dict[str, str]:
        """Files that its process has read, with their digests."""
        service = _services.get(self._places[0])
        return service.files if service else {}

    def request(self, work: str, facts: Mapping[str, Any], arrays: Arrays) -> tuple[Facts, Arrays]:
        """Have some work done."""
        place, shared, own = self._places
        if place not in _services:
            self._start(place)
        service = _services[place]
        try:
            return service.request_or_end_alike({"work": work, **asdict(self), **facts}, arrays)
        finally:
            if service.is_occupied and place == shared and work != "tell":  # telling imports the plugin, for all of it
                _services[own] = _services.pop(shared)

    def _start(self, place: tuple[str, ...]) -> None:
        """Start its process, which imports the plugin: that takes no time of the job which needs it."""
        _starting(True)
        try:
            _services[place] = Process(serve, is_plugin=True)
            _services[place].request_or_end_alike({"work": "tell", **asdict(self)})
        finally:
            _starting(False)


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

    remote: _Remote
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


class _RemoteMethod(Foreign):
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
