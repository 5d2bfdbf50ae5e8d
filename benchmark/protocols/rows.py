"""Rows that tables have without being asked for them: which methods, their variants, and what robustness shows."""

from __future__ import annotations

from benchmark.reference import paper

__all__ = [
    "AVERAGED",
    "FURTHER_TRAININGS",
    "ONLY_ABLATED",
    "ONLY_NAMED",
    "QUICK_CONTROLS",
    "ROBUSTNESS_ROWS",
    "VARIANTS",
]

#: Methods beyond the paper's that have rows in quick runs without being asked for: what a canonical form has to beat.
QUICK_CONTROLS = ("identity",)

#: Values of a parameter of learners, beside its default, that a row is the mean of where there is a model of them.
AVERAGED: dict[str, tuple[int | str, ...]] = {
    "training_seed": (0, 1, 2),
    "training": ("humans-fold-1", "humans-fold-2"),
}

#: Methods that have rows in the ablation alone, unless they are asked for by name.
ONLY_ABLATED = {row.method for row in paper.ABLATION} - {row.method for row in paper.ROWS}

#: Witnesses of our own: rows where they are asked for by name.
ONLY_NAMED = frozenset({"scikit-learn-classical-mds", "scikit-learn-smacof", "scikit-learn-isomap"})

FURTHER_METRICS = tuple({"metric": metric} for metric in ("diffusion", "commute-time", "biharmonic"))

#: Variants that have rows beside their method where it was not asked for by name.
VARIANTS: dict[str, tuple[dict[str, str], ...]] = {
    "classic-mds": FURTHER_METRICS,
    "least-squares-mds": FURTHER_METRICS,
    "euclidean-distance": ({"points": "local"},),
}

#: Trainings of learners that have rows on a set beside those that its table names, where there is a model: the other
#: reading of the paper's "other animals", and sampled bodies, none of them of the set. The generated animals have no
#: row of the latter, for they are the middle of what is sampled.
FURTHER_TRAININGS: dict[str, dict[str, tuple[str, ...]]] = {
    "tosca": {"learned": ("tosca-III-people",), "learned-wide-extra": ("animals-sampled",)},
    "animals": {"learned": ("animals-III-people",)},
}

#: Rows of the table of robustness, with their variants, where none is asked for by name; it has 47 galleries. Of the
#: paper's forms least-squares and non-metric MDS are missing, which scale the same distances as classic MDS; beside
#: them one other metric, the input itself, and two descriptors.
ROBUSTNESS_ROWS: dict[str, tuple[dict[str, str], ...]] = {
    "classic-mds": ({"metric": "biharmonic"},),
    **dict.fromkeys(("fast-mds", "constrained-mds", "gps", "mesh-unfolding", "skeleton"), ()),
    **dict.fromkeys(("identity", "surface-area", "shape-dna"), ()),
}
