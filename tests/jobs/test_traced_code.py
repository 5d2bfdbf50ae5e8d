"""Every function that runs while a stage is computed is in a module that the recipe of the stage names.

Kernels are not compiled here, so that they are seen, but where generated meshes would take minutes to make. There the
kernels of the generators are not watched; what they call they name as globals of their modules, which a fingerprint
follows like any other import, for compiled code cannot import.
"""

import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from benchmark.geometry.io import write_mesh
from benchmark.methods.registry import BUILT_IN, methods, variant
from tests.toy import RADII, rod, write_off

ROOT = Path(__file__).parents[2]

PAIRED = "learned.paired.methods learned.paired.model learned.paired.network learned.images"

#: Learners with a shipped model for the first generated humans: what is asked for, its input, modules that must run.
LEARNERS = {
    "learned": ("learned[training=humans-fold-0]", "view", PAIRED),
    "learned-without-srf": ("learned-without-srf[training=humans-fold-0]", "view", PAIRED),
    "learned-without-lrf": ("learned-without-lrf[training=humans-fold-0]", "view", PAIRED),
    "learned-strict": ("learned-strict[training=humans-strict-0-0]", "view", PAIRED),
    "learned-wide": ("learned-wide[training=humans-fold-0]", "view", PAIRED),
    "learned-wide-extra": ("learned-wide-extra", "view", PAIRED),
    "learned-streamed": (
        "learned-streamed",
        "view",
        "learned.streamed.methods learned.streamed.model learned.streamed.network learned.streamed.crop "
        "learned.streamed.stitching",
    ),
    "deformation-field": (
        "deformation-field",
        "mesh",
        "learned.field.methods learned.field.model learned.field.detail learned.field.network learned.frame",
    ),
    "implicit-template": (
        "implicit-template",
        "mesh",
        "learned.template.methods learned.template.model learned.template.search learned.frame",
    ),
}


def small_rod(radius, bend):
    return rod(radius, bend, rings=8, sides=6)


@pytest.fixture(scope="module")
def rods(tmp_path_factory):
    return written(tmp_path_factory.mktemp("traced") / "rods", small_rod)


@pytest.fixture(scope="module")
def finer_rods(tmp_path_factory):
    """As many vertices as a hundred eigenfunctions need."""
    return written(tmp_path_factory.mktemp("finer") / "rods", partial(rod, rings=16, sides=9))


def written(folder, make):
    for name, radius in RADII.items():
        for number, bend in enumerate((0.0, 1.0)):
            write_off(folder / f"{name}{number}.off", make(radius, bend))
    return folder


def trace(dataset, *chosen, inputs=("mesh",), plugins=(), size=30, image=0, compiled=False, **more):
    """What :mod:`tests.jobs.tracing` saw, by stage."""
    asked = {"dataset": str(dataset), "chosen": chosen, "inputs": inputs, "plugins": list(map(str, plugins))}
    done = subprocess.run(
        [sys.executable, "-m", "tests.jobs.tracing", json.dumps(asked | {"size": size, "image": image} | more)],
        capture_output=True, text=True, cwd=ROOT, check=False, timeout=1100,
        env=os.environ | {"NUMBA_DISABLE_JIT": "0" if compiled else "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def assert_named(found, **expected):
    """Nothing ran outside; and of each stage, what must have run did, so that an empty trace cannot pass."""
    assert {stage: each["outside"] for stage, each in found.items() if each["outside"]} == {}
    for stage, modules in expected.items():
        assert set(modules.split()) <= set(found[stage]["ran"]), stage


DYNAMIC = """
import importlib

from benchmark.api.contracts import canonical_form


@canonical_form(name="sly", title="Sly", inputs=("mesh",))
def sly(shape):
    form = importlib.import_module("baselines.pca").PCA().canonicalise(shape)
    return form.vertices
"""


def test_stages_run_what_their_recipes_name_and_a_hidden_import_is_seen(rods, tmp_path):
    (tmp_path / "sly.py").write_text(DYNAMIC)
    found = trace(rods, "identity", plugins=[tmp_path / "sly.py"], inputs=["mesh", "view"])
    assert "baselines.pca" in found["form sly"]["outside"]
    del found["form sly"]
    assert_named(
        found,
        source="benchmark.datasets.files benchmark.geometry.io benchmark.geometry.formats.text",
        mesh="benchmark.jobs.stages.complete benchmark.geometry.preparation benchmark.geometry.cleaning",
        view="benchmark.jobs.stages.view benchmark.geometry.depth benchmark.geometry.rasterise",
        frame="benchmark.jobs.stages.view benchmark.geometry.depth",
        measures="benchmark.jobs.stages.measures retrieval.metrics retrieval.chance",
        **{"form identity": "baselines.identity benchmark.api.contracts benchmark.jobs.stages.form"},
    )


KERNELS = {
    "classic-mds": "baselines._kernels.eigen benchmark.geometry.geodesic_graph",
    "least-squares-mds": "baselines._kernels.smacof baselines._kernels.quasi_newton baselines._kernels.coarse_start",
    "non-metric-mds": "baselines._kernels.isotonic baselines._kernels.smacof baselines._kernels.quasi_newton",
    "mesh-unfolding": "baselines._kernels.arap",
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", [name for name, target in BUILT_IN.items() if not target.startswith("learned.")])
def test_every_method_runs_what_its_recipe_names(rods, finer_rods, name):
    dataset, inputs, size = (finer_rods, ["mesh"], 130) if name == "wks-mean" else (rods, ["mesh", "view"], 40)
    found = trace(dataset, name, inputs=inputs, size=size)
    module = BUILT_IN[name].partition(":")[0]
    assert_named(found, **{f"form {name}": f"{module} {KERNELS.get(name, '')} benchmark.jobs.stages.form"})
    if "descriptors" in found:
        assert module in found["descriptors"]["ran"]


def test_every_learner_is_traced():
    assert {name for name, target in BUILT_IN.items() if target.startswith("learned.")} == set(LEARNERS)
    known = methods()
    for asked, _, _ in LEARNERS.values():
        assert variant(asked, known).create().model_folder.is_dir()


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", LEARNERS)
def test_every_learner_runs_what_its_recipe_names(name):
    asked, seen, modules = LEARNERS[name]
    found = trace("humans", asked, inputs=[seen], compiled=True, size=500)
    assert_named(found, **{f"form {name}": modules})


@pytest.mark.slow
def test_the_scorer_runs_what_its_recipe_names(rods):
    found = trace(rods, "identity", image=32, size=30)
    assert_named(
        found,
        features="retrieval.cmbof retrieval.pose retrieval.views retrieval.features retrieval.scale_space "
        "retrieval.gaussian_blur retrieval.gradient_histograms",
        distances="retrieval.cmbof retrieval.codebook retrieval.clock",
        measures="retrieval.metrics retrieval.splits",
    )


@pytest.mark.slow
def test_the_second_scorer_runs_what_its_recipe_names(rods):
    found = trace(rods, "identity", image=32, size=30, scorer="spherical-harmonics")
    module = "retrieval.spherical_harmonics"
    assert_named(found, features=module, distances=module)


@pytest.mark.exhaustive
@pytest.mark.timeout(1200)
@pytest.mark.parametrize(
    ("name", "also", "generator"),
    [
        ("humans", (), "benchmark.datasets.humans"),
        ("humans-scanlike", (), "benchmark.datasets.humans_scanlike benchmark.datasets.scanning"),
        (
            "animals",
            ("horse", "gorilla", "david"),
            "benchmark.datasets.animals.generate benchmark.datasets.animals.anatomy benchmark.datasets.animals.people",
        ),
    ],
)
def test_every_generated_set_runs_what_its_recipe_names(name, also, generator):
    found = trace(name, "identity", inputs=["view"], compiled=True, size=200, also=also)
    assert_named(found, source=generator)
    assert "benchmark.jobs.stages.view" in found["view"]["ran"]


@pytest.mark.slow
def test_official_layouts_run_what_their_recipes_name(tmp_path):
    import scipy.io

    def surface(mesh):
        x, y, z = (mesh.vertices[:, [k]] for k in range(3))
        return {"surface": {"X": x, "Y": y, "Z": z, "TRIV": mesh.faces + 1}}

    def upright(radius, bend):  # cameras of animals would see one that lies end on
        mesh = small_rod(radius, bend)
        return mesh.with_vertices(mesh.vertices[:, [1, 2, 0]])

    folder = tmp_path / "tosca"
    for name, radius in RADII.items():
        beast = {"thin": "cat", "thick": "dog"}[name]
        folder.mkdir(exist_ok=True)
        scipy.io.savemat(folder / f"{beast}0.mat", surface(upright(radius, 0.0)))
        np.savetxt(folder / f"{beast}1.vert", upright(radius, 0.5).vertices)
        np.savetxt(folder / f"{beast}1.tri", upright(radius, 0.5).faces + 1, fmt="%d")
        write_off(folder / f"{beast}2.off", upright(radius, 1.0))
    found = trace("tosca", "identity", inputs=["mesh", "view"], data_root=str(tmp_path), poses=3)
    assert_named(found, source="benchmark.datasets.files benchmark.geometry.formats.text")
    for part, count in ("synthetic", 300), ("real", 400):
        folder = tmp_path / "shrec14" / part
        folder.mkdir(parents=True)
        for number in range(count):
            write_mesh(folder / f"{number}.obj", small_rod(0.06 + 0.0004 * number, 0.1 * (number % 20)))
        found = trace(f"shrec14-{part}", "identity", inputs=["mesh", "view"], data_root=str(tmp_path))
        assert_named(found, source="benchmark.datasets.files benchmark.geometry.formats.text")


@pytest.mark.slow
def test_every_file_format_runs_what_its_recipe_names(tmp_path):
    folder = tmp_path / "formats"
    for name, radius in RADII.items():
        for number, suffix in enumerate((".off", ".obj", ".ply", ".stl")):
            mesh = small_rod(radius, 0.5 * number)
            if suffix == ".stl":
                import trimesh

                (folder / f"{name}{number}.stl").write_bytes(
                    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(file_type="stl")
                )
            else:
                folder.mkdir(exist_ok=True)
                write_mesh(folder / f"{name}{number}{suffix}", mesh)
    found = trace(folder, "identity", inputs=["mesh", "view"], poses=4)
    assert_named(found, source="benchmark.datasets.files benchmark.geometry.formats.text benchmark.geometry.io")
