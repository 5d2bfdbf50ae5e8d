"""Folders in which models of a learner lie: trained here, named by the user, shipped."""

from __future__ import annotations

import os
from pathlib import Path

from benchmark.api.learning import Learner

#: Environment variable of a folder of models laid out as those of the repository, for installations without them all.
MODELS_VARIABLE = "CANONICAL_FORMS_MODELS"

#: File beside the models of the repository; a wheel, which has no room for all of them, leaves it out.
_ALL_HERE = "README.md"


def model_places(learner: Learner, trained_here: Path | None = None) -> list[Path]:
    """Folders of models, those that come first count: trained here, of the variable, shipped with the learner.

    Parameters
    ----------
    learner
        The learner.
    trained_here
        Folder of the models that were trained here; None where they do not count.
    """
    named = os.environ.get(MODELS_VARIABLE, "")
    places = (trained_here, Path(named) if named else None, learner.shipped_models)
    return [place for place in places if place is not None]


def where_else(learner: Learner) -> str:
    """Say where shipped models are that this installation lacks; "" where it has all of them."""
    package = Path(__file__).parents[2]
    if not learner.shipped_models.is_relative_to(package) or (learner.shipped_models / _ALL_HERE).is_file():
        return ""
    place = learner.shipped_models.relative_to(package)
    return f", or name the folder {place} of a checkout in {MODELS_VARIABLE}: installed packages lack this model"
