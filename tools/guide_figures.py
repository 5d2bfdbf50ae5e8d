"""``python -m tools.guide_figures [RESULTS]``: draw the pictures of the guide from a quick run of
the animals.

They are transparent, with words on white, so that they are read on light and on dark pages.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from PIL import Image

from baselines.classic_mds import ClassicMDS
from benchmark.api.contracts import Mesh, Shape
from benchmark.datasets.catalogue import open_dataset
from benchmark.defaults import DEFAULT_SCORER
from benchmark.geometry.camera import Camera
from benchmark.geometry.preparation import prepare
from benchmark.pipeline.record_files import read_records
from benchmark.pipeline.records import Record
from benchmark.report.drawing import shaded
from benchmark.report.figures import figure_of_records
from benchmark.report.forms import StoredForms
from benchmark.report.grids import ON_WHITE, TEXT_WIDTH, TITLE_SIZE, grid
from benchmark.report.play import play_data, play_galleries
from benchmark.text import say
from retrieval.cmbof import CMBOF
from retrieval.codebook import nearest_words, sample_codebook
from retrieval.features import EDGE_RATIO, _detect_all
from retrieval.pose import normalise
from retrieval.views import BACKGROUND, render
from tools.form_costs import METHODS

FOLDER = Path(__file__).parents[1] / "results" / "figures"

#: Grey of axes, with a contrast of 3 to white and to dark pages.
GREY = "#767676"

#: Shapes of the pictures of forms: three poses of a cat and of a man.
SHAPES = ("cat0", "cat4", "cat8", "michael0", "michael7", "michael14")

#: Command of the run whose forms are drawn, without its methods.
QUICK_RUN = "python -m benchmark run -d animals --quick --input mesh --subjects cat,michael,horse"

#: Colours of a picture, so that it is small.
N_COLOURS = 128

#: Methods of the small page to play with.
PLAYED = (
    "identity",
    "classic-mds",
    "least-squares-mds",
    "gps",
    "constrained-mds",
    "mesh-unfolding",
    "skeleton",
)
PLAY_DATA = FOLDER / "play.json"

#: Pixels per inch.
DPI = 200

#: Views of the scorer that are shown.
N_SHOWN = 18

#: Words of the codebook that are shown.
N_WORDS = 40

#: Two cats and a man, whose words are compared.
COMPARED = {"cat, standing": "cat0", "cat, another pose": "cat4", "man": "michael0"}


def main() -> None:
    """Draw all pictures."""
    results = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("results")
    for name in METHODS:
        save(figure_of_forms(name, results), f"guide-{name}")
    write_play_data(results)
    meshes = {name: prepared(name) for name in dict.fromkeys((*SHAPES, *COMPARED.values()))}
    save(figure_of_pose(meshes["michael0"], meshes["michael14"]), "guide-pose")
    forms = {title: form_of(meshes[name]) for title, name in COMPARED.items()}
    save(figure_of_views(forms["cat, standing"]), "guide-scorer-views")
    save(figure_of_features([forms["cat, standing"], forms["man"]]), "guide-scorer-features")
    save(figure_of_words(forms), "guide-scorer-words")


def write_play_data(results: Path) -> None:
    """Write the small data of the page to play with, for a site without a quick run."""
    records = records_of(results)
    galleries = play_galleries(StoredForms(results), [records[name] for name in PLAYED])
    content, numbers = play_data(galleries)
    text = json.dumps({"content": content, "numbers": numbers}, separators=(",", ":"))
    PLAY_DATA.write_text(text + "\n", encoding="utf-8")
    say(f"wrote {PLAY_DATA}")


def save(figure: Figure, name: str, dpi: int = DPI) -> None:
    """Write a figure without a background."""
    path = FOLDER / f"{name}.png"
    figure.savefig(path, dpi=dpi, transparent=True)
    with Image.open(path) as drawn:
        drawn.quantize(N_COLOURS, Image.Quantize.FASTOCTREE).save(path, optimize=True)
    say(f"wrote {path}")


def figure_of_forms(method: str, results: Path) -> Figure:
    """Return the forms of all poses by a method, beside their shapes."""
    record = records_of(results)[method]
    return figure_of_records({record.title: record}, StoredForms(results), SHAPES)


def records_of(results: Path) -> dict[str, Record]:
    """Return the records of the quick run of some animals by their method.

    Raises ``SystemExit`` with the command of that run if a form that is drawn has none.
    """
    found = {}
    for record in read_records(results, published=False):
        is_of_run = record.data.name == "animals" and record.data.quick and record.input == "mesh"
        if is_of_run and record.scorer == DEFAULT_SCORER and set(SHAPES) <= {*record.shapes}:
            found[record.method] = record
    missing = [name for name in dict.fromkeys((*METHODS, *PLAYED)) if name not in found]
    if missing:
        methods = " ".join(f"-m {name}" for name in missing)
        command = f"{QUICK_RUN} --results {results} {methods}"
        raise SystemExit(f"these forms have no quick run: {', '.join(missing)}; run `{command}`")
    return found


def prepared(name: str) -> Mesh:
    """Return the prepared surface of a generated shape, with y up and towards the viewer."""
    animals = open_dataset("animals")
    (entry,) = [entry for entry in animals.shapes if entry.identifier == name]
    mesh = prepare(animals.load(entry)).mesh
    return mesh.with_vertices(mesh.vertices @ animals.camera(entry).rotation.T)


def form_of(mesh: Mesh) -> Mesh:
    """Return the form of a surface by Classic MDS, as the scorer turns it."""
    form = ClassicMDS().canonicalise(Shape(identifier="shape", mesh=mesh))
    scorer = CMBOF()
    return normalise(form.mesh, scorer.pose, scorer.image_size)


def figure_of_pose(*poses: Mesh) -> Figure:
    """Return two poses, coloured by the distance from one hand: in the air, along the surface."""
    camera = Camera((0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
    side = TEXT_WIDTH / 4
    columns = []
    for title, mesh in zip(("Standing", "Waving"), poses, strict=True):
        hand = int(mesh.vertices[:, 0].argmax())
        straight = np.linalg.norm(mesh.vertices - mesh.vertices[hand], axis=1)
        along = Shape(identifier="shape", mesh=mesh).geodesics()[hand]
        longest = along.max()
        pictures = [
            shaded(mesh, camera, round(side * DPI), distances / longest)
            for distances in (straight, along)
        ]
        columns.append((title, pictures))
    return grid(columns, side)


def figure_of_views(form: Mesh) -> Figure:
    """Return depth images of a form from some sides."""
    images = views_of(form)
    places = np.linspace(0, len(images) - 1, N_SHOWN).astype(int)
    n_columns = N_SHOWN // 2
    shown = [shade(images[place]) for place in places]
    return grid(
        [("", shown[column::n_columns]) for column in range(n_columns)], TEXT_WIDTH / n_columns
    )


def views_of(form: Mesh) -> NDArray[np.float32]:
    """Return the depth images of a form from all sides."""
    scorer = CMBOF()
    return render(form, scorer.image_size, scorer.views)


def shade(image: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return a depth image in grey, near points dark, transparent where there is no surface."""
    is_seen = image < BACKGROUND
    near = image[is_seen].min()
    far = image[is_seen].max()
    grey = np.where(is_seen, 0.2 + 0.65 * (image - near) / max(far - near, 1e-6), 1.0)
    return np.dstack([grey, grey, grey, is_seen.astype(float)])


def figure_of_features(forms: list[Mesh]) -> Figure:
    """Return one view of each form with its features."""
    side = TEXT_WIDTH / 2
    images = [views_of(form)[4] for form in forms]
    figure = grid([("", [shade(image)]) for image in images], side)
    for axes, image in zip(figure.axes, images, strict=True):
        frames = _detect_all(image[None], np.float32(BACKGROUND), 0.0, EDGE_RATIO)[0]
        for x, y, scale, angle in frames:
            radius = 3 * scale
            circle = Circle((x, y), radius, fill=False, color="#c8553d", linewidth=0.8)
            axes.add_patch(circle)
            ends = [x, x + radius * np.cos(angle)], [y, y + radius * np.sin(angle)]
            axes.plot(*ends, color="#c8553d", linewidth=0.8)
    return figure


def figure_of_words(forms: dict[str, Mesh]) -> Figure:
    """Return how often the words that the first form uses most occur in all views of each form."""
    scorer = CMBOF()
    features = {title: scorer.signature(form)["descriptors"] for title, form in forms.items()}
    codebook = sample_codebook(features.values(), scorer.n_words, 0)
    counts = {title: word_counts(found, codebook) for title, found in features.items()}
    first = next(iter(counts.values()))
    words = np.argsort(-first, kind="stable")[:N_WORDS]
    figure = Figure((TEXT_WIDTH / 2, 2.4))  # narrow, so that its words are read on a telephone
    rows: Any = figure.subplots(len(forms), 1, sharex=True, sharey=True)
    for axes, (title, of_words) in zip(rows, counts.items(), strict=True):
        axes.bar(range(N_WORDS), of_words[words], color="#3a82be")
        axes.set_title(title, fontsize=TITLE_SIZE, loc="left", bbox=ON_WHITE)
        axes.yaxis.set_major_locator(MaxNLocator(3, integer=True))
        axes.tick_params(labelsize=TITLE_SIZE, color=GREY, bottom=False, labelbottom=False)
        for label in axes.get_yticklabels():
            label.set_bbox(ON_WHITE)
        axes.spines[["top", "right"]].set_visible(False)
        axes.spines[["left", "bottom"]].set_color(GREY)
    figure.subplots_adjust(0.09, 0.03, 0.99, 0.92, 0, 0.55)
    return figure


def word_counts(descriptors: NDArray[np.uint8], codebook: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return how often each word of a codebook is the nearest one of a feature."""
    return np.bincount(nearest_words(descriptors, codebook), minlength=len(codebook))


if __name__ == "__main__":
    main()
