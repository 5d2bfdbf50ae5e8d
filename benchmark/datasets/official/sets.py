"""The official sets: layout, size, cameras, origin and terms of use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from benchmark.datasets.base import Entry
from benchmark.datasets.files import FolderDataset
from benchmark.datasets.official import tosca
from benchmark.datasets.official.layouts import Classed, Layout, Listed, Named
from benchmark.datasets.settings import with_settings
from benchmark.geometry.camera import Camera

_UNSTATED = "not stated; ask its makers, and cite"


@dataclass(frozen=True, kw_only=True)
class OfficialSet:
    """A published data set.

    Parameters
    ----------
    title
        Name in captions.
    folder
        Folder under the data root.
    layout
        Layout of the files.
    origin
        Publisher.
    url
        Download address.
    terms
        Terms of use, if stated.
    citation
        Key in ``benchmark/reference/references.bib``.
    camera_for
        Function from entry to depth camera; None for a view along +y with z up.
    other_use
        Purpose of a set with a single subject, which does not allow retrieval; "" for a set that is ranked.
    """

    title: str
    folder: str
    layout: Layout
    origin: str
    url: str
    citation: str
    terms: str = _UNSTATED
    camera_for: Callable[[Entry], Camera] | None = None
    other_use: str = ""

    def open(self, name: str, data_root: Path) -> FolderDataset:
        """Read the list of shapes; a ``dataset.toml`` may set canonical poses and cameras.

        Raises
        ------
        DatasetError
            If the set differs from the published one: wrong counts, missing or duplicate files, changed labels.
        ConfigurationError
            If ``dataset.toml`` has an unknown key, class or pose.
        """
        folder = data_root / self.folder
        return with_settings(
            FolderDataset(
                name=name,
                title=self.title,
                entries=self.layout.entries(folder),
                camera_for=self.camera_for,
                folder=folder,
            )
        )


def _blocks(stem: str, subjects: list[str], n_poses: int, first: int = 0) -> Named:
    """Return a layout with file names numbered by subject, then by pose."""
    pairs = [(subject, str(pose)) for subject in subjects for pose in range(n_poses)]
    return Named({stem.format(number): pair for number, pair in enumerate(pairs, start=first)})


def _counted(n: int) -> list[str]:
    return [str(number) for number in range(n)]


#: Classes of SHREC'07 in order of the numbers, twenty shapes each.
WATERTIGHT_CLASSES = (
    *("human", "cup", "glasses", "airplane", "ant", "chair", "octopus", "table", "teddy", "hand"),
    *("plier", "fish", "bird", "spring", "armadillo", "bust", "mechanic", "bearing", "vase", "fourleg"),
)

#: Digests of the numbers of each class of SHREC'10, from the list published by the track.
SHREC10_CLASSES = {
    "19b82b34": "ants",
    "e47a52e9": "crabs",
    "c18b66aa": "hands",
    "d995629e": "humans",
    "e6aebbe8": "octopuses",
    "b50c997c": "pliers",
    "dbad709c": "snakes",
    "3cebd5e0": "spectacles",
    "f8c3b1f1": "spiders",
    "e1e146f0": "teddy",
}

#: Digests of the numbers of each class of SHREC'11.
SHREC11_CLASSES = {
    "c35d4028": "alien",
    "db9a3406": "ants",
    "1ff30416": "armadillo",
    "428004f4": "bird1",
    "7db61c41": "bird2",
    "b78be3fa": "camel",
    "16169ad1": "cat",
    "047ab10e": "centaur",
    "2ee37b0e": "two_balls",
    "bd8b3b6e": "dinosaur",
    "5b553782": "dog1",
    "a8b4e574": "dog2",
    "0fc05027": "glasses",
    "a7cd307e": "gorilla",
    "726debcd": "hand",
    "1f6c798f": "horse",
    "5d22f3c5": "lamp",
    "0e8a25df": "laptop",
    "8614c7ec": "man",
    "db903dae": "octopus",
    "0ae613ce": "pliers",
    "a0d2c29a": "rabbit",
    "ad4c8a95": "santa",
    "e31b7e84": "scissor",
    "ebdc34eb": "shark",
    "1a2591f1": "snake",
    "3584d496": "spiders",
    "ee854109": "dino_ske",
    "7662cad8": "flamingo",
    "d12aa474": "woman",
}

#: Classes of the partial sets of SHREC'16: those of TOSCA except the gorilla.
_CUT_CLASSES = tuple(subject for subject in tosca.CLASS_SIZES if subject != "gorilla")

#: Camera for FAUST, which has y up and faces +z.
Y_UP = Camera((0.0, 0.0, -1.0), (0.0, 1.0, 0.0))

_OF_ONE_SUBJECT = "use it with canonicalise, data sheet and data export"
_CARDIFF = "http://www.cs.cf.ac.uk/shaperetrieval/download.php"

SETS: Mapping[str, OfficialSet] = {
    "shrec14-synthetic": OfficialSet(
        title="SHREC'14 synthetic",
        folder="shrec14/synthetic",
        layout=_blocks("{}", _counted(15), 20),
        origin="Cardiff",
        url=_CARDIFF,
        terms="academic research; cite",
        citation="pickup2014shrec",
    ),
    "shrec14-real": OfficialSet(
        title="SHREC'14 real",
        folder="shrec14/real",
        layout=_blocks("{}", _counted(40), 10),
        origin="Cardiff",
        url=_CARDIFF,
        terms="academic research; cite",
        citation="pickup2014shrec",
    ),
    "shrec07": OfficialSet(
        title="SHREC'07 watertight",
        folder="shrec07",
        layout=_blocks("{}", list(WATERTIGHT_CLASSES), 20, first=1),
        origin="IMATI Genova",
        url="http://watertight.ge.imati.cnr.it",
        terms="academic purposes, not to be passed on; cite",
        citation="giorgi2007watertight",
    ),
    "shrec10": OfficialSet(
        title="SHREC'10 non-rigid",
        folder="shrec10",
        layout=Listed(10, 20, members=SHREC10_CLASSES),
        origin="NIST",
        url="https://www.itl.nist.gov/iad/vug/sharp/contest/2010/NonRigid",
        citation="lian2010shrec",
    ),
    "shrec11": OfficialSet(
        title="SHREC'11 non-rigid",
        folder="shrec11",
        layout=Listed(30, 20, members=SHREC11_CLASSES),
        origin="NIST",
        url="https://www.nist.gov/itl/iad/shrec-2011-datasets",
        citation="lian2011shrec",
    ),
    "shrec12-generic": OfficialSet(
        title="SHREC'12 generic",
        folder="shrec12-generic",
        layout=Listed(60, 20, prefix="d"),
        origin="NIST",
        url="https://www.itl.nist.gov/iad/vug/sharp/contest/2012/Generic3D",
        citation="li2012shrec",
    ),
    "shrec15": OfficialSet(
        title="SHREC'15 non-rigid",
        folder="shrec15",
        layout=Listed(50, 24),
        origin="Peking",
        url="http://www.icst.pku.edu.cn/zlian/shrec15-non-rigid/index.htm",
        citation="lian2015shrec",
    ),
    "shrec15-canonical": OfficialSet(
        title="SHREC'15 canonical forms",
        folder="shrec15-canonical",
        layout=Listed(10, 10, prefix=""),
        origin="Cardiff",
        url=_CARDIFF,
        terms="academic research; cite",
        citation="pickup2015canonical",
    ),
    "shrec16-cuts": OfficialSet(
        title="SHREC'16 partial, cuts",
        folder="shrec16-partial/cuts",
        layout=Classed({f"cuts_{subject}_shape_": subject for subject in _CUT_CLASSES}),
        origin="Ca' Foscari",
        url="http://www.dais.unive.it/~shrec2016/dataset.php",
        citation="cosmo2016partial",
        camera_for=tosca.camera,
    ),
    "shrec16-holes": OfficialSet(
        title="SHREC'16 partial, holes",
        folder="shrec16-partial/holes",
        layout=Classed({f"holes_{subject}_shape_": subject for subject in _CUT_CLASSES}),
        origin="Ca' Foscari",
        url="http://www.dais.unive.it/~shrec2016/dataset.php",
        citation="cosmo2016partial",
        camera_for=tosca.camera,
    ),
    "faust": OfficialSet(
        title="FAUST registrations",
        folder="faust",
        layout=_blocks("tr_reg_{:03d}", _counted(10), 10),
        origin="MPI, by login",
        url="http://faust.is.tue.mpg.de",
        terms="non-commercial research, http://faust.is.tue.mpg.de/data_license",
        citation="bogo2014faust",
        camera_for=lambda _: Y_UP,
    ),
    "kids": OfficialSet(
        title="KIDS",
        folder="kids",
        layout=Named(
            {
                f"{subject}.{'isometry' if pose else 'null'}.{pose}": (subject, str(pose))
                for subject in ("0001", "0002")
                for pose in range(16)
            }
        ),
        origin="TU Munich",
        url="https://vision.in.tum.de/data/datasets/kids",
        citation="rodola2014kids",
    ),
    "topkids": OfficialSet(
        title="SHREC'16 topological noise",
        folder="topkids",
        layout=Named({f"kid{pose:02d}": ("kid", str(pose)) for pose in range(26)}),
        origin="TU Munich",
        url="https://vision.in.tum.de/~laehner/shrec2016/dataset.php",
        citation="laehner2016topkids",
        other_use=_OF_ONE_SUBJECT,
    ),
    "scape": OfficialSet(
        title="SCAPE",
        folder="scape",
        # The 71 meshes skip number 51.
        layout=Named({f"mesh{pose:03d}": ("scape", str(pose)) for pose in range(72) if pose != 51}),
        origin="Stanford",
        url="http://ai.stanford.edu/~drago/Projects/scape/scape.html",
        terms="academic purposes, not to be passed on; cite",
        citation="anguelov2005scape",
        other_use=_OF_ONE_SUBJECT,
    ),
}

#: Rankable sets without a table in the paper.
EXTENDED = tuple(name for name, known in SETS.items() if not known.other_use and not name.startswith("shrec14"))
