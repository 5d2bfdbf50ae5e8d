"""``python -m tools.studies.printed_network``: why FT of the network as printed is lower than its NN promises.

Its published models of the three folds read ten bodies that no set and no training has, in the twenty poses that the
models know. Before the forms are ranked, one thing at a time of what was predicted is put right: the grain of the
depth, the depth, the mask, or what changes with the pose, by means of the predictions of some poses of a body. Where
the scores then rise, this stood in the way. Rows go to :data:`FIGURES`; those that are there are not made again. Models
that were trained otherwise are measured beside them: ``--models RESULTS/models --named "falling step size"``.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import json  # noqa: E402
from collections.abc import Callable, Iterable, Mapping, Sequence  # noqa: E402
from dataclasses import replace  # noqa: E402
from itertools import islice  # noqa: E402
from pathlib import Path  # noqa: E402

import click  # noqa: E402
import numpy as np  # noqa: E402
import torch  # noqa: E402
from scipy.ndimage import distance_transform_edt  # noqa: E402
from torch import Tensor  # noqa: E402

from benchmark.datasets.human_poses import POSES  # noqa: E402
from benchmark.datasets.humans import CANONICAL_POSE, Humans  # noqa: E402
from benchmark.datasets.humans_gallery import HumansGallery  # noqa: E402
from benchmark.jobs.preparation import Preparation  # noqa: E402
from benchmark.jobs.stages.distances import form_distances  # noqa: E402
from benchmark.jobs.stages.measures import scores  # noqa: E402
from benchmark.protocols.trainings import SUBJECT_FOLDS, fold_name  # noqa: E402
from benchmark.report.escaping import markdown_table  # noqa: E402
from benchmark.storage.store import Store  # noqa: E402
from learned.images import COVERED, enlarge, shrink, smooth  # noqa: E402
from learned.paired.model import load_model, predict  # noqa: E402
from learned.surface import surface_behind  # noqa: E402
from retrieval.cmbof import CMBOF  # noqa: E402
from retrieval.measures import PRINTED  # noqa: E402
from tools.studies.people import interval  # noqa: E402

BODIES, RESOLUTION, SMOOTHING = 10, 128, 3.0
PUBLISHED = Path("learned/models")
STORE = Path("build/printed-network")
FIGURES = Path("results/printed-network.json")

Row = dict[str, float | str]
Change = Callable[[Tensor, Tensor], Tensor]
"""From the predictions of a body in all poses, shape (20, 2, r, r), and its true image, to what is ranked."""


def _each(change: Callable[[Tensor, Tensor], Tensor]) -> Change:
    return lambda predictions, truth: torch.stack([change(prediction, truth) for prediction in predictions])


def true_depth(prediction: Tensor, truth: Tensor) -> Tensor:
    """The predicted mask, and inside it the true depth, that of the nearest pixel where there is none."""
    return torch.stack([_spread(truth[0], truth[1]), prediction[1]])


def true_mask(prediction: Tensor, truth: Tensor) -> Tensor:
    """The true mask, and inside it the predicted depth, that of the nearest pixel where there is none."""
    return torch.stack([_spread(*prediction), truth[1]])


def _spread(depth: Tensor, mask: Tensor) -> Tensor:
    """Depth inside a mask, and outside of it that of the nearest pixel inside."""
    rows, columns = distance_transform_edt(mask.numpy() <= COVERED, return_distances=False, return_indices=True)
    return depth[torch.from_numpy(rows).long(), torch.from_numpy(columns).long()]


def means_of(count: int) -> Change:
    """Means of the predictions of so many poses each, none in two means."""
    return lambda predictions, _: predictions.unflatten(0, (-1, count)).mean(dim=1)


AS_PREDICTED, SMOOTHED = OF_OTHERS = "as predicted", "grain averaged away"
CHANGES: dict[str, Change] = {
    AS_PREDICTED: lambda predictions, _: predictions,
    SMOOTHED: _each(lambda prediction, _: smooth(prediction, SMOOTHING)),
    "true depth in the predicted mask": _each(true_depth),
    "predicted depth in the true mask": _each(true_mask),
    "predicted depth in the true mask, grain averaged away": _each(lambda p, t: smooth(true_mask(p, t), SMOOTHING)),
    "every fifth pose, as predicted": lambda predictions, _: predictions[::5],
    "means of five poses": means_of(5),
    "means of five poses, grain averaged away": lambda p, t: CHANGES[SMOOTHED](means_of(5)(p, t), t),
}


@click.command()
@click.option("--models", type=click.Path(path_type=Path, exists=True), default=PUBLISHED, help="Other trainings.")
@click.option("--named", default="", help="What is other about them.")
def main(models: Path, named: str) -> None:
    """Rank the forms of each row that is missing, and print them all."""
    torch.set_num_threads(1)
    found: list[Row] = json.loads(FIGURES.read_text()) if FIGURES.is_file() else []
    names = {f"{named}: {name}": name for name in OF_OTHERS} if named else {name: name for name in CHANGES}
    missing = [name for name in names if name not in {row["row"] for row in found}]
    if missing:
        seen = images()
        predicted = [
            predictions(models / fold_name("humans", fold) / "literal-seed0", seen)
            for fold in range(len(SUBJECT_FOLDS))
        ]
        truths = {body: poses[CANONICAL_POSE] for body, poses in seen.items()}
        for name in missing:
            found.append({"row": name, **measured(CHANGES[names[name]], predicted, truths)})
            FIGURES.write_text(json.dumps(found, indent=1) + "\n")
            print(found[-1], flush=True)
    print(table(found))


def images() -> dict[str, dict[str, Tensor]]:
    """Depth and mask of the bodies in each pose, shape (2, r, r), as the network is shown and as it should predict."""
    gallery = replace(HumansGallery(4 * BODIES), half_width=Humans().half_width)
    preparation = Preparation(gallery, "view", Store.open(STORE))
    bodies: dict[str, dict[str, Tensor]] = {}
    for entry in gallery.entries:
        depth = preparation.shape(entry).depth
        assert depth is not None
        bodies.setdefault(entry.subject, {})[entry.pose] = torch.from_numpy(shrink(depth, RESOLUTION))
        whole = (body for body, poses in bodies.items() if len(poses) == len(POSES) and not _is_cut(poses.values()))
        if len(chosen := list(islice(whole, BODIES))) == BODIES:
            return {body: bodies[body] for body in chosen}
    raise click.ClickException("too few of the bodies fit the frame of the camera")


def _is_cut(poses: Iterable[Tensor]) -> bool:
    """Return whether a body reaches the rim of the frame, which the models were trained in."""
    rims = (image[1][edge] for image in poses for edge in ((0,), (-1,), (slice(None), 0), (slice(None), -1)))
    return any(bool(rim.any()) for rim in rims)


def predictions(model: Path, seen: Mapping[str, Mapping[str, Tensor]]) -> dict[str, Tensor]:
    """Predictions of a model for each body in all poses, shape (20, 2, r, r)."""
    network, _ = load_model(model)
    return {
        body: torch.stack([predict(network, image[:1]).float() for image in poses.values()])
        for body, poses in seen.items()
    }


def measured(change: Change, predicted: Sequence[Mapping[str, Tensor]], truths: Mapping[str, Tensor]) -> Row:
    """Scores of the forms, means over the models, and by how much poses and bodies differ.

    ``pose over body`` is the mean squared distance of a changed prediction from the mean of its body, over that of the
    means of the bodies from the mean of all.
    """
    by_body: dict[str, list[float]] = {name: [] for name in PRINTED}
    ratios, scorer = [], CMBOF()
    for of_model in predicted:
        changed = {body: change(images, truths[body]) for body, images in of_model.items()}
        forms = [surface_behind(enlarge(image))[0] for images in changed.values() for image in images]
        subjects = [body for body, images in changed.items() for _ in images]
        signatures = [scorer.signature(form) for form in forms]
        ranked = scores((form_distances(scorer, signatures, draw) for draw in range(scorer.info.draws)), subjects)
        for name in PRINTED:
            by_body[name] += np.reshape(ranked["per_query"][name], (len(changed), -1)).mean(axis=1).tolist()
        ratios.append(pose_over_body(torch.stack(list(changed.values()))))
    low, high = interval(by_body["FT"])
    return {
        **{name: round(float(np.mean(values)), 4) for name, values in by_body.items()},
        "FT low": round(low, 4),
        "FT high": round(high, 4),
        "pose over body": round(float(np.mean(ratios)), 3),
        "chance NN": ranked["chance"]["NN"],
        "chance FT": ranked["chance"]["FT"],
    }


def pose_over_body(images: Tensor) -> float:
    """Variance of images between the poses of a body over that between bodies; images of shape (bodies, poses, ...)."""
    means = images.mean(dim=1, keepdim=True)
    return float((images - means).square().mean() / (means - means.mean(dim=0)).square().mean())


def table(found: Sequence[Mapping[str, float | str]]) -> str:
    """The rows as Markdown, for ``docs/appendix/paper-network.md``."""
    names = (*PRINTED, "FT low", "FT high", "pose over body")
    body = [[f"{row['row']}", *(f"{row[name]:.2f}" for name in names)] for row in found]
    return "\n".join(markdown_table(["what is ranked", *names], body))


if __name__ == "__main__":
    main()
