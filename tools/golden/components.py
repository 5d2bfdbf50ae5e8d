"""The components of the suite by name: what each makes of the inputs, how near it must come, and what code it runs."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

from benchmark.datasets.catalogue import CATALOGUE, open_dataset
from benchmark.datasets.perturbations.dataset import PERTURBATIONS, STRENGTHS
from benchmark.geometry.camera import DepthSensor
from benchmark.methods.registry import BUILT_IN as METHODS
from benchmark.methods.registry import MethodSpec
from benchmark.methods.scorers import BUILT_IN as SCORERS
from benchmark.system.code import FIRST_PARTY, ROOT
from tools.golden import inputs, stages

#: Moves between processors are below 1e-9 of the size of a form.
FORMS = 1e-8
#: Equal distances have equal disparities there: which are equal in single precision is a decision that rounding takes.
NON_METRIC = 2e-4
#: Networks compute in single precision, whose sums depend on the kernels of the processor.
NETWORKS = 1e-5
#: Distances, measures, and meshes of generators: sums of doubles that cancel nowhere.
DOUBLES = 1e-9

#: Depth images in single precision.
SINGLES = 1e-6

#: Variants of methods that tables print, by base name; their files are that of the method.
VARIANTS: Mapping[str, tuple[str, ...]] = {
    "classic-mds": ("metric=diffusion", "metric=commute-time", "metric=biharmonic"),
    "least-squares-mds": ("metric=diffusion", "metric=commute-time", "metric=biharmonic", "start=classic"),
    "constrained-mds": ("start=classic",),
    "euclidean-distance": ("points=local",),
    "learned": ("smoothing=1", "jump=0.05"),
    "deformation-field": ("reach=0", "rounds=0"),
    "cm-bof": ("allow_mirror=true", "pose=pca"),
}

#: Shapes that are small enough to run without compilation, those that methods refuse among them, and larger ones.
SMALL = ("small", "small-open", "pieces", "tetrahedron", "flat")
LARGER = ("bridged", "closed", "open")
LARGEST = "large"
SIGNED = ("closed", "small", "open", "bridged")

#: Places of the shapes of generated sets that are made: every subject and pose of the humans, every kind of animal.
GENERATED: Mapping[str, tuple[int, ...]] = {
    "humans": tuple(n % 15 * 20 + n for n in range(20)),
    "humans-scanlike": (1, 157, 398),
    "humans-random": (7, 154, 299),
    "animals": (1, 12, 18, 26, 34, 38, 50, 70, 79),
    "animals-few": (1, 16),
    "camera": (1, 42, 153, 298),
    "camera-few": (1, 58),
}

#: Modules of the streams of bodies that networks are trained on.
SAMPLERS: Mapping[str, str] = {
    "people": "humans",
    "animals": "varied_animals.sampler",
    "varied": "varied.sampler",
    "wide": "varied.wide",
    "scans": "scans.sampler",
}

#: Folders that change no figure: errors, texts, files and processes, and what only calls the components.
NO_FIGURES = ("benchmark", "benchmark/system", "benchmark/methods", "benchmark/storage", "benchmark/jobs")


class Part(NamedTuple):
    """One call: its name, what makes its arrays, and whether it takes seconds at most without compilation."""

    name: str
    run: Callable[[], Mapping[str, Any]]
    small: bool = True


class Component(NamedTuple):
    """What is made, by modules and all that they import from the layers below, and the largest difference."""

    parts: tuple[Part, ...]
    modules: tuple[str, ...]
    tolerance: float = DOUBLES


@cache
def components() -> Mapping[str, Component]:
    """All components by name."""
    return dict(_components())


def _components() -> Iterator[tuple[str, Component]]:
    stage = "benchmark.jobs.stages."
    for name, target in METHODS.items():
        module = target.partition(":")[0]
        yield f"method/{name}", Component(tuple(_of_method(name)), (module, f"{stage}form"), _tolerance(name, module))
    for name, target in SCORERS.items():
        modules = (target.partition(":")[0], f"{stage}features", f"{stage}distances")
        yield f"scorer/{name}", Component(tuple(_of_scorer(name)), modules)
    raw = ("dog", "horse", "scan", "flat", "point", "triangle")
    yield (
        "preparation/mesh",
        Component(tuple(Part(name, partial(stages.completed, name)) for name in raw), (f"{stage}complete",)),
    )
    yield "preparation/view", Component(tuple(_views(raw)), (f"{stage}view",), SINGLES)
    yield "preparation/frame", Component(tuple(_frames()), ("benchmark.depth.frame", f"{stage}view"), SINGLES)
    yield "api", Component(tuple(_api()), ("benchmark.api.contracts", "benchmark.geometry.laplacian"), FORMS)
    yield from _data()
    yield from _changes()
    yield "measures", Component(tuple(_measures()), (f"{stage}measures",))
    method, scorer = METHODS["classic-mds"].partition(":")[0], SCORERS["cm-bof"].partition(":")[0]
    whole = Part("classic-mds", partial(stages.scored, "classic-mds", "cm-bof"), small=False)
    modules = (
        method,
        scorer,
        *(f"{stage}{name}" for name in ("complete", "form", "features", "distances", "measures")),
    )
    yield "end-to-end", Component((whole,), modules)


def _tolerance(name: str, module: str) -> float:
    if module.startswith("learned."):
        return NETWORKS
    return NON_METRIC if name == "non-metric-mds" else FORMS


def _of_method(name: str) -> Iterator[Part]:
    spec = MethodSpec(name, METHODS[name])
    variants = [name, *(f"{name}[{variant}]" for variant in VARIANTS.get(name, ()))]
    for variant in variants:
        if spec.learns and "view" in spec.info.inputs:
            for image in ("woman", "man", "nothing", "tiny"):
                call = partial(stages.learned_form, variant, inputs.depth_shape(image))
                yield Part(f"{variant}/{image}", call)
        elif spec.describes:
            for shape in (*SMALL, *LARGER):
                yield Part(f"{variant}/{shape}", partial(stages.descriptors_of, variant, (shape,)), shape in SMALL)
            yield Part(variant, partial(stages.descriptors_of, variant, SIGNED), small=False)
        else:
            is_witness = name.startswith("scikit-learn")
            shapes = (*SMALL, *LARGER, *([LARGEST] if variant == name and not is_witness else []))
            for shape in shapes:
                make = partial(stages.form_of, variant, shape)
                if spec.learns:
                    make = partial(stages.learned_form, variant, inputs.shape(shape))
                yield Part(f"{variant}/{shape}", make, shape in SMALL and (variant == name or shape == "small"))


def _of_scorer(name: str) -> Iterator[Part]:
    for shape in (*SIGNED, "tetrahedron", "flat", "line"):
        yield Part(shape, partial(stages.signature_of, name, shape), name != "cm-bof")
    if name == "cm-bof":
        yield Part("few-pixels", partial(stages.signature_of, f"{name}[image_size=48]", "small"))
        yield Part("few-words", partial(stages.compared, f"{name}[n_words=12,allow_mirror=true]", SIGNED[1:3]))
        for variant in VARIANTS[name]:
            yield Part(variant, partial(stages.signature_of, f"{name}[{variant}]", "closed"), small=False)
            yield Part(f"{variant}/compared", partial(stages.compared, f"{name}[{variant}]", SIGNED), small=False)
    yield Part("compared", partial(stages.compared, name, SIGNED), name != "cm-bof")


def _views(raw: tuple[str, ...]) -> Iterator[Part]:
    for name in raw:
        yield Part(name, partial(stages.seen, name, None))
    yield Part("dog-far", partial(stages.seen, "dog", 190.0))
    yield Part("dog-too-far", partial(stages.seen, "dog", 1e5))
    yield Part("dog-noisy", partial(stages.seen, "dog", 190.0, DepthSensor(0.002, 0.002, 5)))


def _frames() -> Iterator[Part]:
    yield Part("given", partial(stages.observed, True, None))
    yield Part("found", partial(stages.observed, False, None))
    yield Part("no-floor", partial(stages.observed, True, None, False))
    yield Part("sidecar", partial(stages.observed, True, (0.1, -1.0, 0.2), False))
    yield Part("upside", partial(stages.observed, True, (0.0, 0.0, 1.0), False))


def _api() -> Iterator[Part]:
    from benchmark.geometry.geodesics import SOLVERS

    for shape in (*SMALL, *LARGER):
        for solver in SOLVERS:
            yield Part(f"{solver}/{shape}", partial(stages.geodesics, shape, solver), shape in SMALL)
        yield Part(f"laplacian/{shape}", partial(stages.laplacian, shape))
    yield Part("random", stages.draws)


def _data() -> Iterator[tuple[str, Component]]:
    for name in (name for name, source in CATALOGUE.items() if not source.folder and "[" not in name):
        dataset = open_dataset(name, None)
        parts = [Part("all", partial(stages.entries_of, dataset))]
        chosen = [dataset.entries[place] for place in GENERATED[name]]
        parts += [Part(e.identifier, partial(stages.mesh_of, dataset, e), small=False) for e in chosen]
        if name == "humans-scanlike":
            parts.append(Part("bodies", stages.adult_bodies, small=False))
        if name == "animals":
            parts.append(Part("skeletons", stages.animal_skeletons, small=False))
        if name == "humans-random":
            parts.append(Part("subjects", stages.random_bodies))
        if name == "humans":
            parts.append(Part("gallery", stages.humans_gallery, small=False))
        modules = {type(dataset).__module__, type(getattr(dataset, "whole", dataset)).__module__}
        yield f"data/{name}", Component(tuple(parts), tuple(sorted(modules)), FORMS)
    for name, module in SAMPLERS.items():
        part = Part("bodies", partial(stages.sampled, name), small=False)
        yield f"sampler/{name}", Component((part,), (f"benchmark.datasets.{module}",), SINGLES)
    parts = [
        Part(path.name, partial(stages.mesh_file, path.name)) for path in sorted((inputs.INPUTS / "files").iterdir())
    ]
    parts.append(Part("folder", stages.folder_files))
    yield "data/files", Component(tuple(parts), ("benchmark.datasets.folder", "benchmark.geometry.io"))
    parts = []
    for path in sorted((inputs.INPUTS / "frames").iterdir()):
        call = stages.intrinsics_file if path.suffix in (".json", ".yaml", ".txt") else stages.depth_file
        parts.append(Part(path.name, partial(stages.mask_file if "mask" in path.name else call, path.name)))
    yield "data/frames", Component(tuple(parts), ("benchmark.datasets.depth_folder", "benchmark.depth.reading"))


def _changes() -> Iterator[tuple[str, Component]]:
    perturbations = "benchmark.datasets.perturbations."
    for name, known in PERTURBATIONS.items():
        call = stages.changed_frame if known.of_frames else partial(stages.changed, entry=0)
        parts = [Part(f"{n}", partial(call, f"{name}={n}"), small=not known.of_frames and n > 2) for n in STRENGTHS]
        modules = [f"{perturbations}dataset"]
        if known.on_mesh is not None:
            parts.append(Part("scan", partial(stages.changed, f"{name}=3", 1)))
            modules.append(known.on_mesh.__module__)
        elif known.of_frames:
            modules = [f"{perturbations}frames"]
        yield f"change/{name}", Component(tuple(parts), tuple(modules), FORMS)
    parts = [Part(f"{n}", partial(stages.changed, f"jitter={n}", 0)) for n in (1, 2)]
    yield "change/jitter", Component(tuple(parts), ("benchmark.datasets.jittered",))
    parts = [Part(name, partial(stages.changed, "decimation=libigl", n)) for n, name in enumerate(("dog", "scan"))]
    yield "change/decimation", Component(tuple(parts), ("benchmark.datasets.decimated",), FORMS)


def _measures() -> Iterator[Part]:
    for answered in (False, True):
        for name, matrices in {"plain": ("plain-0", "plain-1"), "tied": ("tied",), "constant": ("constant",)}.items():
            yield Part(f"{name}{'-answered' if answered else ''}", partial(stages.measured, matrices, answered))
    for size in (2, 4):
        yield Part(f"split-{size}", partial(stages.split, size))


# Code ----------------------------------------------------------------------------------------------------------------


@cache
def modules_of(component: str) -> tuple[str, ...]:
    """Modules that a component runs: its own, and all that they import of what can change a figure."""
    closure: dict[str, None] = {}
    pending = list(components()[component].modules)
    while pending:
        module = pending.pop()
        if module not in closure and _folder(module) not in NO_FIGURES:
            closure[module] = None
            pending += _imports(module)
    return tuple(sorted(closure))


def folders_of(component: str) -> tuple[str, ...]:
    """Folders of the code that a component runs."""
    return tuple(sorted({_folder(module) for module in modules_of(component)}))


def _folder(module: str) -> str:
    return str(path_of(module).parent.relative_to(ROOT))


def path_of(module: str) -> Path:
    """File of a module."""
    base = ROOT.joinpath(*module.split("."))
    return base / "__init__.py" if base.is_dir() else base.with_suffix(".py")


@cache
def _imports(module: str) -> tuple[str, ...]:
    """Modules of the suite that a module imports, but for types alone and for training."""
    found: list[str] = []
    pending: list[ast.AST] = [ast.parse(path_of(module).read_bytes())]
    while pending:
        node = pending.pop()
        if isinstance(node, ast.FunctionDef) and node.name in ("train", "check_options"):
            continue
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        if isinstance(node, ast.ImportFrom) and node.module:
            found += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        pending += ast.iter_child_nodes(node)
    return tuple(name for name in found if name.split(".")[0] in FIRST_PARTY and path_of(name).is_file())
