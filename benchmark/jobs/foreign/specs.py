"""Methods and scorers of plugins as they are known to processes that do not import them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NoReturn, Self, cast

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import CanonicalForm, Descriptor, FloatArray, Method, MethodInfo, Shape
from benchmark.api.scoring import Scorer, ScorerInfo, SignatureArrays
from benchmark.geometry.mesh import Mesh
from benchmark.methods.specs import Info, Made, MethodSpec, PluginSpec, S, ScorerSpec
from benchmark.storage.costs import Cost
from benchmark.system.arrays import Arrays
from benchmark.system.services import Service

Facts = dict[str, Any]


@dataclass(frozen=True)
class _FromItsProcess(PluginSpec[Info, Made]):
    """A plugin of which all that is known was told by the process that imports it.

    Parameters
    ----------
    spelling
        Name with parameters, in its one spelling.
    """

    spelling: str = ""

    @property
    def name(self) -> str:
        """Name on the command line."""
        return self.spelling

    @property
    def title(self) -> str:
        """Name in the tables."""
        return str(self._facts["title"])

    @property
    def info(self) -> Info:
        """Return what it says about itself."""
        told = {name: tuple(value) if isinstance(value, list) else value for name, value in self._facts["info"].items()}
        return cast(Info, self.info_type(**told))

    def resolved_parameters(self) -> dict[str, Any]:
        """All parameters as JSON tells them."""
        return dict(self._facts["parameters"])

    @cached_property
    def sources(self) -> dict[str, str]:
        """What the plugin consists of."""
        return dict(self._facts["sources"])

    def load(self) -> NoReturn:
        """Raise, for the class is in another process."""
        raise AssertionError(f"{self.target} is not imported here")

    @property
    def _remote(self) -> _Remote:
        return _Remote({"kind": self.kind, "target": self.target, "name": self.spelling, "base_name": self.base_name})

    @property
    def _facts(self) -> Facts:
        return _told(self.kind, self.target, self.spelling, self.base_name)


@dataclass(frozen=True)
class ForeignMethodSpec(_FromItsProcess[MethodInfo, Method | Descriptor], MethodSpec):
    """A method of a plugin."""

    @property
    def describes(self) -> bool:
        """Return whether it is a descriptor."""
        return bool(self._facts["describes"])

    @property
    def learns(self) -> bool:
        """Return whether it is a learner."""
        return bool(self._facts["learns"])

    def create(self) -> Method | Descriptor:
        """Return the method, which works in its process."""
        kind = _RemoteDescriptor if self.describes else _RemoteMethod
        return cast(Method | Descriptor, kind(self._remote, self.info))


@dataclass(frozen=True)
class ForeignScorerSpec(_FromItsProcess[ScorerInfo, Scorer], ScorerSpec):
    """A scorer of a plugin."""

    def create(self) -> Scorer:
        """Return the scorer, which works in its process."""
        return cast(Scorer, _RemoteScorer(self._remote, self.info))


def kept_apart(spec: S) -> S:
    """Return a plugin as workers are told of it: one of somebody else, so that they do not import it."""
    if not spec.is_foreign or isinstance(spec, _FromItsProcess):
        return spec
    kind: Any = ForeignScorerSpec if isinstance(spec, ScorerSpec) else ForeignMethodSpec
    return cast(S, kind(spec.base_name, spec.target, named=spec.named, spelling=spec.name))


#: Processes of the methods, or of the scorers, of a plugin: one for all, and one for each that leaves threads or
#: processes behind.
_services: dict[tuple[str, ...], Service] = {}


@cache
def _told(kind: str, target: str, name: str, base_name: str) -> Facts:
    return _Remote({"kind": kind, "target": target, "name": name, "base_name": base_name}).request("tell", {}, {})[0]


@dataclass(frozen=True)
class _Remote:
    """A method or scorer in the process of its plugin, by the facts that name it there."""

    facts: Mapping[str, str]

    @property
    def _places(self) -> tuple[tuple[str, ...], ...]:
        """Place of its process, that which it shares with others of its plugin, and that which is its own."""
        shared = (self.facts["kind"], self.facts["target"].rpartition(":")[0])
        own = (*shared, self.facts["base_name"])
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
            from benchmark.jobs.foreign.serving import serve

            _services[place] = Service(serve)
        service = _services[place]
        try:
            return service.request({"work": work, **self.facts, **facts}, arrays)
        finally:
            if service.is_occupied and place == shared and work != "tell":  # telling imports the plugin, for all of it
                _services[own] = _services.pop(shared)


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
        return CanonicalForm(found["vertices"], found.get("faces", shape.mesh.faces), notes)

    def load(self, folder: Path) -> Self:
        """See :class:`benchmark.api.learning.Learner`."""
        return replace(self, model=str(folder))


class _RemoteDescriptor(Foreign):
    def describe(self, shape: Shape) -> FloatArray:
        """See :class:`benchmark.api.contracts.Descriptor`."""
        return np.asarray(self._on_shape("describe", shape)["descriptor"])

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """See :class:`benchmark.api.contracts.Descriptor`."""
        from benchmark.jobs.foreign.serving import folded

        arrays = folded([{"descriptor": each} for each in descriptors])
        return np.asarray(self._worked("distances", {}, arrays)["distances"])


class _RemoteScorer(Foreign):
    def signature(self, form: Mesh) -> SignatureArrays:
        """See :class:`benchmark.api.scoring.Scorer`."""
        return self._worked("signature", {}, {"vertices": form.vertices, "faces": form.faces})

    def compare(self, signatures: Sequence[SignatureArrays], draw: int) -> NDArray[np.float64]:
        """See :class:`benchmark.api.scoring.Scorer`."""
        from benchmark.jobs.foreign.serving import folded

        return np.asarray(self._worked("compare", {"draw": draw}, folded(signatures))["distances"])
