"""Training of the field to predict canonical positions on fresh bodies or scans."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal, cast

import torch
from torch import Tensor

from benchmark.api.contracts import Interval
from benchmark.api.learning import read_card
from benchmark.api.streaming import MakesScans, MakesSurfaces
from benchmark.errors import ConfigurationError
from learned.field.batches import MakesSurfaceBatches, SurfaceBatch
from learned.field.configuration import Field
from learned.field.methods import DeformationField
from learned.field.model import load_field
from learned.field.network import FieldNetwork, Unbent, build_field
from learned.field.scans import MakesScanBatches, bodies_made
from learned.training.loop import Objective, Plan, Trained, TrainingLoop, TrainingRun, fresh_bodies

NAMES = ("position loss", "edge loss", "isometry loss")
"""Columns of the history."""

_LEAST = 1e-8
"""Added to squared distances, whose root has no gradient at zero."""


def losses(unbent: Unbent, positions: Tensor, targets: Tensor, normals: Tensor, target_normals: Tensor) -> Tensor:
    """Compute all terms of the loss, unweighted.

    Parameters
    ----------
    unbent
        Output of the field at the positions.
    positions, targets
        Positions in the pose and in the canonical pose, shape (n, 2 p, 3): the first p are the starts of p edges along
        the surface, the others their ends.
    normals, target_normals
        Unit normals there, shape (n, 2 p, 3).

    Returns
    -------
    torch.Tensor
        Shape (3,), in the order of :data:`NAMES`. Mean distance to the true positions, in units of sqrt(area); mean
        squared error of rotated edges, relative to their lengths, plus that of rotated normals; mean squared relative
        change in edge length.
    """
    edges, true_edges, unbent_edges = _edges(positions), _edges(targets), _edges(unbent.positions)
    lengths = _lengths(edges)
    starts, ends = unbent.rotations.chunk(2, dim=1)
    turned = ((starts + ends) / 2 @ edges[..., None])[..., 0]
    facing = (unbent.rotations @ normals[..., None])[..., 0]
    return torch.stack(
        [
            _lengths(unbent.positions - targets).mean(),
            ((turned - true_edges) / lengths[..., None]).square().sum(-1).mean()
            + (facing - target_normals).square().sum(-1).mean(),
            (_lengths(unbent_edges) / lengths - 1).square().mean(),
        ]
    )


def weighted(terms: Tensor, configuration: Field) -> Tensor:
    """Return the loss to minimise, a scalar."""
    return terms[0] + configuration.edge * terms[1] + configuration.isometry * terms[2]


def _edges(points: Tensor) -> Tensor:
    starts, ends = points.chunk(2, dim=1)
    return ends - starts


def _lengths(vectors: Tensor) -> Tensor:
    return (vectors.square().sum(-1) + _LEAST).sqrt()


LOOKED_AT = 16
"""Number of validation bodies."""


@dataclass(frozen=True, kw_only=True)
class FieldPlan(Plan):
    """Training plan of a field; see :class:`learned.training.loop.Plan` for the other parameters.

    Parameters
    ----------
    shapes
        ``"bodies"``: surfaces of fresh bodies. ``"scans"``: scans of fresh bodies.
    uses
        Steps that use each scan; a divisor of ``bodies``. It is 1 for bodies that are not scanned.
    start
        ``"random"``: random weights. ``"shipped"``: weights of the shipped model of this configuration.
    """

    steps: Annotated[int, Interval(1)] = 12_000
    bodies: Annotated[int, Interval(2)] = 8
    learning_rate: Annotated[float, Interval(0, closed="neither")] = 5e-4
    shapes: Literal["bodies", "scans"] = "bodies"
    uses: Annotated[int, Interval(1, 64)] = 1
    start: Literal["random", "shipped"] = "random"

    def __post_init__(self) -> None:
        """Raise ``ConfigurationError`` if ``uses`` does not divide ``bodies``, or exceeds 1 without scans."""
        super().__post_init__()
        if self.bodies % self.uses or (self.shapes == "bodies" and self.uses > 1):
            raise ConfigurationError(
                f"{self.bodies} {self.shapes} a step cannot be shown {self.uses} times each",
                "take -o shapes=scans and a divisor of the bodies, such as -o bodies=8 -o uses=8",
            )


Makes = MakesSurfaces | MakesScans


def train_field(
    configuration: Field,
    plan: FieldPlan,
    make: Makes,
    validation: Makes | None,
    run: TrainingRun,
) -> Trained[FieldNetwork]:
    """Train a field, resuming from a checkpoint if there is one; see :class:`learned.training.loop.TrainingLoop`.

    Parameters
    ----------
    configuration, plan
        Configuration and training plan.
    make
        Maker of bodies, or of scans if the plan says so.
    validation
        Maker of other bodies or scans for validation curves; None for no curves.
    run
        Folder and device, and the seed of the weights.

    Raises
    ------
    TrainingError
        If a body cannot be made, a loss is not finite, or the checkpoint does not fit. A checkpoint of the last
        completed step remains, unless a loss is not finite.
    """
    network, details = build_field(configuration, run.seed), {}
    if plan.start == "shipped":
        folder = DeformationField(configuration=configuration.name).model_folder
        network.load_state_dict(load_field(folder).state_dict())
        details["started_from"] = read_card(folder)["digest"]
    network.to(run.device)
    unseen = _batches(replace(plan, bodies=LOOKED_AT, uses=1), configuration, validation)(0) if validation else None
    objective = _Objective(network, configuration, run.device, unseen)
    batches = _batches(plan, configuration, make, perturbed=True)
    progress, precision = TrainingLoop(network, objective, batches, plan, run).train()
    seen = fresh_bodies(plan, progress) | {"bodies": bodies_made(plan.steps, plan.bodies, plan.uses)}
    return Trained(network, progress, precision, seen, details)


def _batches(
    plan: FieldPlan, configuration: Field, make: Makes, perturbed: bool = False
) -> Callable[[int], SurfaceBatch]:
    if plan.shapes == "scans":
        return MakesScanBatches(cast(MakesScans, make), configuration, plan.bodies, plan.uses, perturbed)
    return MakesSurfaceBatches(cast(MakesSurfaces, make), configuration, plan.bodies, perturbed)


@dataclass
class _Objective(Objective[SurfaceBatch]):
    network: FieldNetwork
    configuration: Field
    device: torch.device
    unseen: SurfaceBatch | None
    terms = NAMES
    watched = "position error"

    def losses(self, batch: SurfaceBatch, half: bool) -> Tensor:
        return self._terms(self._unbent(batch, half), batch)

    def total(self, losses: Tensor, batch: SurfaceBatch) -> Tensor:
        return weighted(losses, self.configuration)

    def measured(self, half: bool) -> Mapping[str, float]:
        """Return the mean error of positions, as a share of the body height, and the other terms of the loss."""
        if self.unseen is None:
            return {}
        unbent = self._unbent(self.unseen, half)
        distances = (unbent.positions.cpu() - self.unseen.targets).norm(dim=-1).mean(dim=1)
        terms = self._terms(unbent, self.unseen).tolist()
        error = float((distances / self.unseen.heights).mean())
        return {"position error": error, **dict(zip(self.terms[1:], terms[1:], strict=True))}

    def _unbent(self, batch: SurfaceBatch, half: bool) -> Unbent:
        seen = (batch.points, batch.normals, batch.positions, batch.position_normals)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=half):
            unbent: Unbent = self.network(*(tensor.to(self.device) for tensor in seen))
        return unbent

    def _terms(self, unbent: Unbent, batch: SurfaceBatch) -> Tensor:
        known = (batch.positions, batch.targets, batch.position_normals, batch.target_normals)
        return losses(unbent, *(tensor.to(self.device) for tensor in known))
