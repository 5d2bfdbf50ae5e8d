"""Runs jobs and watches which functions are called while each stage is computed.

    python -m tests.jobs.tracing '{"dataset": "animals", "methods": ["gps"], ...}'

prints, by stage, the modules of this suite whose functions ran, and those of them that the recipe of the stage does not
name. Whether compiled kernels are seen is up to ``NUMBA_DISABLE_JIT``: they are plain functions then.

What is not asked to be named, and why:

- :data:`CALLERS` hand arrays from one stage to the next. They choose neither values nor order: what they pass is the
  result of a stage and named by its recipe.
- Below :data:`NAMING` nothing is made: recipes, fingerprints, and the method from the parameters that its recipe holds.
- Where a camera stands is asked of the data set; the answer, all numbers of it, is in the recipe.
- Bodies of modules run once, when they are imported; what they define is watched when it is called.
"""

from __future__ import annotations

import copy
import json
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.catalogue import open_dataset
from benchmark.jobs import recipes
from benchmark.jobs.execution import gallery, runner
from benchmark.jobs.job_specs import ScoringTask, ShapeBatch
from benchmark.jobs.plan import JobSettings, make_plan
from benchmark.jobs.rekey.sampling import decimated, make_small
from benchmark.jobs.stages import distances, measures
from benchmark.methods.registry import MethodSpec, methods, select
from benchmark.methods.scorers import DEFAULT, ScorerSpec, scorer_of, scorers
from benchmark.protocols.galleries import Gallery
from benchmark.protocols.tables import Table
from benchmark.storage.store import Store
from benchmark.system import fingerprints

ROOT = Path(__file__).parents[2]

#: Machinery that calls stages.
CALLERS = frozenset(
    {"benchmark.jobs.preparation", "benchmark.jobs.method_run", "benchmark.jobs.execution.gallery",
     "benchmark.jobs.execution.runner", "benchmark.storage.costs", "benchmark.storage.store", "benchmark.system.arrays",
     "benchmark.storage.environment"}
)  # fmt: skip

#: Machinery that names things; whatever it calls makes nothing.
NAMING = frozenset(
    {"benchmark.jobs.recipes", "benchmark.storage.keys", "benchmark.system.fingerprints", "benchmark.methods.registry"}
)  # fmt: skip


class Tracer:
    """Knows which stage is being computed, and books the code that runs on it."""

    def __init__(self) -> None:
        self.ran: dict[str, set[CodeType]] = {}
        self._open: list[set[CodeType]] = []
        self._naming = 0
        self._modules: dict[str, str] = {}

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event == "call":
            if self.module(code) in NAMING:
                self._naming += 1
            elif not self._naming and self._open:
                self._open[-1].add(code)
        elif event == "return" and self.module(code) in NAMING:
            self._naming -= 1

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Book what runs in the body on a stage; what runs before and after goes to the stage around it."""
        naming, self._naming = self._naming, 0
        self._open.append(self.ran.setdefault(name, set()))
        try:
            yield
        finally:
            self._open.pop()
            self._naming = naming

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Book nothing."""
        self._naming += 1
        try:
            yield
        finally:
            self._naming -= 1

    def module(self, code: CodeType) -> str:
        """Name of the module of this suite in which a function is written; "" for any other."""
        file = code.co_filename
        if file not in self._modules:
            path = Path(file)
            ours = path.is_relative_to(ROOT) and path.relative_to(ROOT).parts[0] in fingerprints.FIRST_PARTY
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts) if ours else ""
            self._modules[file] = name.removesuffix(".__init__")
        return self._modules[file]

    def modules(self, stage: str) -> set[str]:
        """Modules whose functions ran in a stage."""
        names = {self.module(code) for code in self.ran[stage] if code.co_name != "<module>"}
        return names - fingerprints.IGNORED - CALLERS - {""}


def few(dataset: Dataset, entries: tuple[Entry, ...], tracer: Tracer, fewer: Callable[[Any], Any]) -> Dataset:
    """The data set with some of its entries; reading or generating a mesh is a stage of its own."""
    kind: Any = type(dataset)

    def load(self: Any, entry: Entry) -> Any:
        with tracer.stage("source"):
            mesh = kind.load(self, entry)
        with tracer.aside():
            return fewer(mesh)

    def camera(self: Any, entry: Entry) -> Any:
        with tracer.aside():
            return kind.camera(self, entry)

    names = {"entries": entries, "load": load, "camera": camera, "__module__": kind.__module__}
    smaller = copy.copy(dataset)
    vars(smaller).pop("entries", None)
    object.__setattr__(smaller, "__class__", type(kind.__name__, (kind,), names))
    return smaller


def named(stage: str, dataset: Dataset, spec: MethodSpec, scorer: ScorerSpec) -> set[str]:
    """Modules that the recipe of a stage names."""
    found = {
        "source": lambda: [recipes.source_code(recipes.dataset_module(dataset))],
        "frame": lambda: [recipes.preparation_code("view")],
        "mesh": lambda: [recipes.preparation_code("mesh")],
        "view": lambda: [recipes.preparation_code("view")],
        "form": lambda: [recipes.method_code(spec)],
        "features": lambda: [recipes.features_code(scorer)],
        "distances": lambda: [recipes.distances_code(scorer)],
        "descriptors": lambda: [recipes.method_code(spec), recipes.distances_code(scorer)],
        "measures": lambda: [recipes.measures_code()],
    }[stage]()
    return {name for fingerprint in found for name in fingerprint.code}


def watch(tracer: Tracer, *, with_features: bool) -> None:
    """Make the store and the ranking tell the tracer which stage begins."""
    real = Store.get_or_compute

    def get_or_compute(self: Store, recipe: Any, compute: Any, **options: Any) -> Any:
        stage = recipe["stage"]

        def traced() -> Any:
            if stage == "source":  # the data set tells of it
                return compute()
            with tracer.stage(stage):
                return compute()

        return real(self, recipe, traced, **options)

    def ranked(name: str, function: Any) -> Any:
        def traced(*arguments: Any, **options: Any) -> Any:
            with tracer.stage(name):
                return function(*arguments, **options)

        return traced

    Store.get_or_compute = get_or_compute  # type: ignore[method-assign]
    distances.descriptor_distances = ranked("descriptors", distances.descriptor_distances)
    measures.scores = ranked("measures", measures.scores)
    measures.over_splits = ranked("measures", measures.over_splits)
    if not with_features:
        distances.form_distances = lambda _, signatures, draw: _ramp(len(signatures))
        gallery.features_of = lambda found: found  # type: ignore[assignment]
        from benchmark.jobs.stages import features

        features.extract = lambda scorer, form: {}  # type: ignore[assignment]


def _ramp(count: int) -> Any:
    import numpy as np

    return np.abs(np.subtract.outer(np.arange(count), np.arange(count))).astype(float)


def traced(
    dataset: str, chosen: list[str], inputs: list[str], plugins: list[str], size: int, image: int, data_root: str = "",
    subjects: int = 2, poses: int = 2, also: Sequence[str] = (), scorer: str = DEFAULT,
) -> dict[str, dict[str, list[str]]]:  # fmt: skip
    """Run methods on the first shapes of a data set.

    Parameters
    ----------
    dataset, data_root, subjects, poses
        Which shapes: those of the first subjects in a few poses.
    also
        Further subjects, of which one shape is enough.
    chosen, plugins, inputs
        Which methods on what.
    size
        Vertices of a prepared shape.
    image
        Pixels of the views of the scorer; 0 leaves features out.
    scorer
        Name of the scorer.

    Returns
    -------
    dict
        For each stage, ``form`` followed by the name of the method, modules that ``ran`` and those ``outside`` of what
        the recipe names.
    """
    make_small(size, image or 256)
    root = Path(data_root) if data_root else None
    full = open_dataset(dataset, root)
    first = list(dict.fromkeys(entry.subject for entry in full.entries))[:subjects]
    of = {subject: [e for e in full.entries if e.subject == subject] for subject in [*first, *also]}
    entries = tuple(e for subject, all_of in of.items() for e in all_of[: 1 if subject in also else poses])
    files = [Path(plugin) for plugin in plugins]
    judge = scorer_of(scorer, scorers())
    found: dict[str, dict[str, list[str]]] = {}
    for spec in select(chosen, methods(files), files):
        for input_ in inputs:
            if input_ not in spec.info.inputs:
                continue
            tracer = Tracer()
            with tempfile.TemporaryDirectory() as folder, Watching(tracer, with_features=bool(image)):
                small = few(full, entries, tracer, partial(decimated, vertices=size))
                runner.open_dataset = lambda *_, small=small: small
                _run(small, entries, input_, spec, Path(folder), root, judge)  # type: ignore[arg-type]
            for stage in tracer.ran:
                name = f"form {spec.base_name}" if stage == "form" else stage
                place = found.setdefault(name, {"ran": [], "outside": []})
                ran = tracer.modules(stage)
                place["ran"] = sorted({*place["ran"], *ran})
                place["outside"] = sorted({*place["outside"], *(ran - named(stage, full, spec, judge))})
    return found


class Watching:
    """Watches while a body runs, and puts back what it had changed."""

    def __init__(self, tracer: Tracer, *, with_features: bool) -> None:
        from benchmark.jobs.stages import features

        self.tracer, self.with_features = tracer, with_features
        self._changed: list[tuple[Any, str]] = [
            (Store, "get_or_compute"),
            (gallery, "features_of"),
            (runner, "open_dataset"),
        ]
        self._changed += [(distances, name) for name in ("descriptor_distances", "form_distances")]
        self._changed += [(measures, name) for name in ("scores", "over_splits")]
        self._changed += [(features, "extract")]
        self._before = [getattr(place, name) for place, name in self._changed]

    def __enter__(self) -> None:
        watch(self.tracer, with_features=self.with_features)
        sys.setprofile(self.tracer)

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)
        for (place, name), value in zip(self._changed, self._before, strict=True):
            setattr(place, name, value)


def _run(
    dataset: Dataset,
    entries: tuple[Entry, ...],
    input_: Any,
    spec: MethodSpec,
    results: Path,
    root: Path | None,
    scorer: ScorerSpec,
) -> None:
    store = Store.open(results)
    has_pairs = len(entries) == 2 * len({entry.subject for entry in entries})  # a split of lone shapes ranks nothing
    table = Table("traced", "Traced", dataset.name, all_unseen=False, split_size=2 if has_pairs else 0)
    gallery = Gallery(table, dataset.name, dataset, entries, data_root=root)
    (job,) = make_plan([gallery], [input_], [spec], store, JobSettings(scorer=scorer))
    if job.state != "missing":
        raise SystemExit(f"{job.name}: {job.state}, {job.reason}")
    runner.work(ShapeBatch((job,), job.identifiers), lambda *_: None)
    runner.work(ScoringTask((job,)), lambda *_: None)
    record = store.records.read(job.key) or {}
    if record.get("status") != "ok":
        raise SystemExit(f"{job.name}: {record.get('reason')}\n{record.get('traceback')}")


if __name__ == "__main__":
    print(json.dumps(traced(**json.loads(sys.argv[1]))))
