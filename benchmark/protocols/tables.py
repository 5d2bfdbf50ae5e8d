"""The tables of the paper as data: data sets, galleries, columns and rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Literal

from benchmark.api.contracts import Input
from benchmark.api.learning import FROZEN_AT
from benchmark.datasets.changes import split_changes
from benchmark.datasets.official import EXTENDED
from benchmark.protocols.trainings import HELD_OUT, SUBJECT_FOLDS
from benchmark.reference import paper

INPUTS: tuple[Input, ...] = ("mesh", "view")

#: Measures that tables show, compare and mark: first those of the paper. A table leaves out one
#: that some of its records lack, because they are older than the measure.
TABLE_MEASURES: tuple[str, ...] = (*paper.PAPER_MEASURES,)

#: Most poses of each subject with ``--quick``, which keeps every k-th pose.
QUICK_POSES = 3

Block = Literal["form", "network", "descriptor", "external"]

#: Stand-ins for the synthetic humans: the first one has folds and networks; the whole galleries of
#: all are averaged.
SYNTHETIC_HUMANS = ("people[draw=0]", "people[draw=1]", "people[draw=2]")

FOLDS = tuple(f"fold {number}" for number in range(len(SUBJECT_FOLDS)))
CATS_AND_HORSES = "held out"

#: How the names of parts begin whose shapes are ranked in another gallery; that of tables of the
#: suite.
AGAINST = "against "
SURFACES = f"{AGAINST}complete surfaces"

#: Parts whose gallery is rendered from several cameras around each surface, with the change of the
#: data set.
CAMERAS: Mapping[str, str] = {
    f"{AGAINST}12 cameras": "[cameras=12]",
    f"{AGAINST}12 cameras and their own": "[cameras-and-own=12]",
}

#: Subjects of each part of a data set, by name or by index in the data set; all of them for the
#: whole one, "".
PARTS: Mapping[str, tuple[int | str, ...]] = {
    "": (),
    SURFACES: (),
    **dict.fromkeys(CAMERAS, ()),
    CATS_AND_HORSES: HELD_OUT,
    **dict(zip(FOLDS, SUBJECT_FOLDS, strict=True)),
}

#: Beginnings of the names of the suite's networks, which stand in their block also where they have
#: no model.
NETWORK_PREFIXES = ("learned", "deformation-field")

#: Parameters of networks over whose values rows are averaged.
AVERAGED_PARAMETERS = ("training_seed=",)

#: What the titles of networks say that this code cannot train.
FROZEN = f"frozen (commit {FROZEN_AT})"

#: What the title of a network says whose model is another one than the title means.
OWN_MODEL = "own model"

#: How the schedules of the tables begin, as patterns: that of the network as printed, and that of
#: all others that this code trains. Where models are not published, as those of TOSCA, whoever has
#: the data trains them by these.
RECIPE_AS_PRINTED = r"500 x 500 pixels, 500 epochs, (?!stretch_depth)"
RECIPE = r"128 x 128 pixels, (60|500) epochs, (early_epochs 0, )?stretch_depth True, "

#: Titles of the paper's rows and of networks; those of all others are their own.
TITLES: Mapping[str, str] = {
    "classic-mds": "Classic MDS",
    "fast-mds": "Fast MDS",
    "non-metric-mds": "Non-metric MDS",
    "least-squares-mds": "Least Square MDS",
    "constrained-mds": "Constrained MDS",
    "gps": "GPS",
    "mesh-unfolding": "Mesh Unfolding",
    "skeleton": "Skeleton-based",
    paper.AS_PRINTED: "Depth network, 500 px, width 16",
    "learned": "Depth network, 128 px",
    "learned[configuration=as_printed,training=animals-III]": (
        "Depth network, 500 px, generated animals"
    ),
    "learned-size-free": "Depth network, size unknown",
    "learned-wide-extra": f"Depth network, extra data, {FROZEN}",
    "learned-wide-extra[training=animals-sampled]": f"Depth network, extra animals, {FROZEN}",
    "learned-streamed": f"Depth network, streamed, {FROZEN}",
    "deformation-field": f"Deformation field, complete surface, {FROZEN}",
    "learned-strict": "strict training",
    "learned-without-srf": "without SRF",
    "learned-without-lrf": "without LRF",
    "learned-without-weighting": "without weighting",
    "learned-average": "average body in the predicted mask",
    "learned-flat": "flat in the predicted mask",
}

#: What methods do on views that is another method than on complete surfaces.
ON_VIEWS: Mapping[str, str] = {"skeleton": "level sets"}

#: Rows of the ablation: those of the paper, one about which it makes a claim without figures, and
#: without any depth.
CONTROLS = ("learned-average", "learned-flat")
ABLATION = (
    "learned-strict",
    "learned-without-srf",
    "learned-without-lrf",
    "learned-without-weighting",
    "learned",
    *CONTROLS,
)

#: Networks that have rows only in the ablation, and in tables that add them.
ONLY_ABLATED = frozenset(ABLATION) - {"learned"}

#: Rows of the tables whose gallery is seen from around: networks, no form, the best form, and the
#: area.
ROUND = (
    "identity",
    "mesh-unfolding",
    "learned",
    "learned-wide-extra",
    "learned-streamed",
    "surface-area",
)

#: Rows of robustness: four methods at three strengths of each change.
ROBUST = ("classic-mds", "gps", "mesh-unfolding", "shape-dna")


@dataclass(frozen=True)
class GalleryGroup:
    """The galleries over which the scores of one heading of a table are means.

    Parameters
    ----------
    title
        Heading.
    parts
        Parts of the data set that are ranked, each by itself; see :data:`PARTS`.
    input
        ``"mesh"`` or ``"view"`` for all rows; ``"as printed"``: complete surfaces, but a view for
        networks.
    over_draws
        Whether the mean is over all stand-ins of the table; networks see only the first one.
    """

    title: str
    parts: tuple[str, ...] = ("",)
    input: Literal["mesh", "view", "as printed"] = "as printed"
    over_draws: bool = False

    @property
    def has_mixed_inputs(self) -> bool:
        """Whether networks see depth views, and all other methods complete surfaces."""
        return self.input == "as printed"


def are_queries_of_another(part: str) -> bool:
    """Return whether the shapes of a part are queries of another gallery: "against 12 cameras"."""
    return part.startswith(AGAINST)


BOTH_INPUTS = (GalleryGroup("mesh", input="mesh"), GalleryGroup("view", input="view"))


@dataclass(frozen=True)
class Table:
    """One table.

    Parameters
    ----------
    identifier
        The paper's numeral, or the name of a data set for its own table.
    caption
        Caption without the data.
    dataset
        Name or path of the data set.
    stand_ins
        Generated data sets that replace it if it is missing; only columns over draws use others
        than the first.
    columns
        Groups of scores.
    has_paper
        Whether the paper's figures stand beside ours.
    names
        The methods that have rows; empty for all but :data:`ONLY_ABLATED`.
    adds
        Methods of these that have rows, too.
    omits_extended
        Whether methods of the family "extended" that are no networks run on its data only if they
        are selected by name.
    runs
        Runs that make it by default: all, full ones, or only those that name it or its data set, or
        it alone.
    part_of
        Table with which it is also made; "" if there is none.
    all_unseen
        Whether it is an error if a model was trained on one of its shapes or subjects.
    is_robustness
        Whether it has one gallery for each change of its data set.
    changes
        Changes of its data set that have a table each, too.
    gallery, cameras, keeps_same_names
        Data set of the gallery of its queries, and whether a query leaves out no shape of its own
        name.
    remark
        What a reader has to know of its data, printed below it.
    """

    identifier: str
    caption: str
    dataset: str = ""
    stand_ins: tuple[str, ...] = ()
    columns: tuple[GalleryGroup, ...] = (GalleryGroup("ours"),)
    has_paper: bool = False
    names: tuple[str, ...] = ()
    adds: tuple[str, ...] = ()
    omits_extended: bool = False
    runs: Literal["quick", "full", "named", "alone"] = "full"
    part_of: str = ""
    all_unseen: bool = True
    is_robustness: bool = False
    changes: tuple[str, ...] = ()
    gallery: str = ""
    cameras: str = ""
    keeps_same_names: bool = False
    remark: str = ""

    @property
    def datasets(self) -> tuple[str, ...]:
        """Data sets for which it can be made."""
        return tuple(filter(None, (self.dataset, *self.stand_ins)))

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of all parts of the data set that it ranks."""
        parts = chain.from_iterable(column.parts for column in self.columns)
        return tuple(dict.fromkeys(parts))

    @property
    def is_ablation(self) -> bool:
        """Whether its rows are trainings of the network."""
        return self.names == ABLATION

    @property
    def is_cross(self) -> bool:
        """Whether some of its galleries are others than their queries."""
        return any(are_queries_of_another(part) for part in self.parts)

    def shows(self, dataset: str) -> bool:
        """Return whether it can be made for a data set.

        A table of queries and another gallery is also made for changed views.
        """
        if self.is_cross:
            base, _ = split_changes(dataset)
            return dataset in self.datasets or base in self.datasets
        return dataset in self.datasets

    def includes(self, base_name: str) -> bool:
        """Return whether a method may have a row if none was selected by name."""
        if self.names:
            return base_name in self.names
        return base_name in self.adds or base_name not in ONLY_ABLATED


#: What is known of the ten people of FAUST, for whom no phenotypes are known.
_REAL_PEOPLE = (
    "Ten real people, scanned: no network has seen them, or their mesh. How near its generated "
    "training bodies come to them is unknown, because clearance is a distance of phenotypes, which "
    "scans lack. Networks of folds are those of fold 0. The files hold no size (each is scaled to "
    "a longest side of 1), so every surface has an area of 1.8 square metres, in the frame of the "
    "training bodies: area is near chance on complete surfaces, and size tells networks nothing."
)

_FAIR = "all methods on one depth view"
_CROSS = "one depth view against views and against complete surfaces"
_BOTH_GALLERIES = (
    GalleryGroup("against views", input="view"),
    GalleryGroup(SURFACES, (SURFACES,), "view"),
)
_AROUND = "one depth view against views of complete surfaces"
_CAMERAS = tuple(GalleryGroup(part, (part,), "view") for part in CAMERAS)

#: Columns of the synthetic humans.
_ALL = "15 subjects"
_FEW = "5 subjects"

_synthetic = partial(Table, dataset="shrec14-synthetic", stand_ins=SYNTHETIC_HUMANS)
_real = partial(Table, dataset="shrec14-real", stand_ins=("humans-scanlike",), omits_extended=True)
_animals = partial(Table, dataset="tosca", stand_ins=("animals",), all_unseen=False)
_further = partial(Table, columns=BOTH_INPUTS, runs="named", part_of="extended")
_faust = partial(Table, dataset="faust", remark=_REAL_PEOPLE)


def _of_further_set(name: str) -> Table:
    """Return the table of an official set that the paper does not use."""
    if name == "faust":
        caption = "Retrieval of real people"
        return _further(name, caption, name, adds=CONTROLS, remark=_REAL_PEOPLE)
    return _further(name, "Retrieval on a further official set", name, all_unseen=False)


TABLES: tuple[Table, ...] = (
    _synthetic(
        "I",
        "Retrieval of synthetic humans",
        columns=(GalleryGroup(_ALL, over_draws=True), GalleryGroup(_FEW, FOLDS)),
        has_paper=True,
        runs="quick",
        omits_extended=True,
    ),
    _real("II", "Retrieval of real humans", has_paper=True),
    _animals("III", "Retrieval of animals and people", has_paper=True, runs="quick"),
    _synthetic(
        "I-view",
        f"Synthetic humans, {_FAIR}",
        part_of="I",
        omits_extended=True,
        adds=CONTROLS,
        columns=(GalleryGroup(_ALL, input="view"), GalleryGroup(_FEW, FOLDS, "view")),
    ),
    _real(
        "II-view",
        f"Real humans, {_FAIR}",
        part_of="II",
        columns=(GalleryGroup("ours", input="view"),),
    ),
    _animals(
        "III-view",
        f"Animals and people, {_FAIR}",
        part_of="III",
        columns=(
            GalleryGroup("all shapes", input="view"),
            GalleryGroup("cats and horses", (CATS_AND_HORSES,), "view"),
        ),
    ),
    _synthetic(
        "IV",
        "Ablation of the depth network",
        columns=(GalleryGroup("ours", FOLDS, "view"),),
        has_paper=True,
        names=ABLATION,
    ),
    _synthetic(
        "I-cross",
        f"Synthetic humans, {_CROSS}",
        columns=_BOTH_GALLERIES,
        runs="alone",
        omits_extended=True,
    ),
    _real("II-cross", f"Real humans, {_CROSS}", columns=_BOTH_GALLERIES, runs="alone"),
    _animals(
        "III-cross",
        f"Animals and people, {_CROSS}",
        columns=_BOTH_GALLERIES,
        runs="alone",
        changes=("[view-angle=3]", "[view-angle=5]"),
    ),
    _real("II-cameras", f"Real humans, {_AROUND}", columns=_CAMERAS, names=ROUND, runs="alone"),
    _animals(
        "III-cameras",
        f"Animals and people, {_AROUND}",
        columns=_CAMERAS,
        names=ROUND,
        runs="alone",
        changes=("[view-angle=3]", "[view-angle=5]"),
    ),
    *(_of_further_set(name) for name in EXTENDED),
    _faust("faust-cameras", f"Real people, {_AROUND}", columns=_CAMERAS, names=ROUND, runs="alone"),
    Table(
        "robustness",
        "Robustness to changes of the shapes",
        "animals-few",
        columns=(GalleryGroup("mesh", input="mesh"),),
        names=ROBUST,
        runs="alone",
        all_unseen=False,
        is_robustness=True,
    ),
)


def gallery_name(dataset: str, part: str, *, quick: bool) -> str:
    """Return the name of a gallery: data set, part, and whether poses were omitted."""
    words = [dataset, part]
    if quick:
        words.append("(quick)")
    return " ".join(filter(None, words))


def own_table(dataset: str, part: str = "") -> Table:
    """Return the table of a data set that no table of the suite uses.

    It shows complete surfaces and views, side by side. With a part that begins with
    :data:`AGAINST`, its shapes are queries of another gallery.
    """
    if are_queries_of_another(part):
        columns = tuple(replace(column, parts=(part,)) for column in BOTH_INPUTS)
        name = f"{dataset} {part}"
        return Table(name, f"Retrieval on {name}", dataset, columns=columns, all_unseen=False)
    name = dataset
    if any(table.identifier == dataset for table in TABLES):
        name = f"{dataset}-folder"
    return Table(name, f"Retrieval on {dataset}", dataset, columns=BOTH_INPUTS, all_unseen=False)
