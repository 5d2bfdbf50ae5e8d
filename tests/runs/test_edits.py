"""A file that is edited during a run: what is stored is of the planned files, or not stored."""

from __future__ import annotations

import builtins
import errno
import hashlib
import json
import os
import shutil
import sys
import time
from pathlib import Path

import pytest

from benchmark.pipeline.record_arrays import read_distances
from benchmark.pipeline.record_files import read_records
from benchmark.runs import unchanged, workers
from benchmark.runs.runner import run_jobs
from benchmark.runs.unchanged import CodeChanged, PlannedFiles, plan_code
from tests.runs.toy import ThisProcess, done, planned

PLUGIN = """
import builtins
from pathlib import Path

import package.deep
from top import FACTOR
from benchmark.api import canonical_form


@canonical_form(name="edited", title="Edited", files=("declared.txt",))
def edited(shape):
    getattr(builtins, "edit", lambda _: None)(shape.identifier)
    import late
    scale = float(Path(__file__).with_name("declared.txt").read_text())
    return shape.mesh.vertices ** 3 * [1, scale * FACTOR, late.FACTOR * package.deep.FACTOR]
"""

SCORER = """
import builtins
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from benchmark.api import ScorerInfo


@dataclass(frozen=True, kw_only=True)
class Scores:
    info: ClassVar[ScorerInfo] = ScorerInfo(name="scores", title="Scores", files=("power.txt",))

    def signature(self, form):
        getattr(builtins, "edit_scorer", lambda: None)()
        power = float(Path(__file__).with_name("power.txt").read_text())
        return {"extent": np.ptp(form.vertices, axis=0) ** power}

    def compare(self, signatures, draw):
        extents = np.array([of["extent"] for of in signatures])
        return np.linalg.norm(extents[:, None] - extents, axis=2)
"""

FILES = {
    "edited.py": PLUGIN,
    "top.py": "from under import FACTOR\n",
    "under.py": "FACTOR = 1.0\n",
    "late.py": "from below import FACTOR\n",
    "below.py": "FACTOR = 1.0\n",
    "package/__init__.py": "SHARE = 1.0\n",
    "package/deep.py": "from package import SHARE\n\nFACTOR = SHARE\n",
    "declared.txt": "1.0",
    "scores.py": SCORER,
    "power.txt": "1.0",
}

#: By file, what stands there after the edit.
EDITED = {
    "edited.py": PLUGIN.replace("** 3", "** 5"),
    "top.py": "FACTOR = 7.0\n",
    "under.py": "FACTOR = 7.0\n",
    "late.py": "FACTOR = 7.0\n",
    "below.py": "FACTOR = 7.0\n",
    "package/__init__.py": "SHARE = 7.0\n",
    "package/deep.py": "FACTOR = 7.0\n",
    "declared.txt": "7.0",
    "scores.py": SCORER.replace("** power", "** power * [1, 1, 7]"),
    "power.txt": "7.0",
}


def write(path, text):
    path.write_text(text)


def write_of_the_same_time(path, text):
    """Write a text with the times that the file had, as a copy with its times does."""
    before = path.stat()
    path.write_text(text)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def replace_by_renaming(path, text):
    beside = path.with_name("beside")
    beside.write_text(text)
    beside.replace(path)


def remove(path, text):
    path.unlink()


class Folder:
    """A plugin and a scorer, and runs of them on rods; each run takes place in this process."""

    def __init__(self, folder: Path, rods: Path) -> None:
        self.folder, self.rods = folder, rods
        for name, text in FILES.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
            os.utime(path, ns=(10**18, 10**18))

    def planned(self, results, **options):
        plugins = (self.folder / "edited.py", self.folder / "scores.py")
        return planned(self.rods, results, "edited", plugins=plugins, scorer="scores", **options)

    def run(self, results, **options):
        (record,) = done(self.planned(results), results, **options).values()
        return record


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """The folder of all plugins: a process imports one helper of a name."""
    before = [*sys.path]
    yield tmp_path_factory.mktemp("place") / "own"
    sys.path[:] = before


@pytest.fixture
def folder(place, rods):
    if place.exists():
        shutil.rmtree(place)
    return Folder(place, rods)


@pytest.fixture(scope="module")
def known():
    return {}


@pytest.fixture
def clean(folder, known, tmp_path):
    """Return a function that returns the distances of a run without edits, of given contents."""

    def distances(**contents):
        key = json.dumps(contents)
        if key not in known:
            with pytest.MonkeyPatch.context() as patch:
                for name in ("edit", "edit_scorer"):
                    patch.delattr(builtins, name, raising=False)
                own = Folder(folder.folder, folder.rods)
                for name, text in contents.items():
                    (own.folder / name).write_text(text)
                results = tmp_path / f"clean{len(known)}"
                record = own.run(results)
                assert record.status == "ok", record.reason
                known[key] = read_distances(results, record)
        return known[key]

    return distances


def is_same(first, second):
    return bool((first == second).all(axis=None))


def once_at(identifier, act):
    """Return what a step at a shape calls: it acts the first time."""
    done_before = []

    def edit(of=identifier):
        if of == identifier and not done_before:
            done_before.append(of)
            act()

    return edit


def arrange(monkeypatch, name, act):
    """Let the act take place within a step: of the scorer for its files, otherwise of the method at
    its third shape.
    """
    is_of_scorer = name in ("scores.py", "power.txt")
    hook = once_at("" if is_of_scorer else "thin0", act)
    monkeypatch.setattr(
        builtins,
        "edit_scorer" if is_of_scorer else "edit",
        hook if not is_of_scorer else (lambda: hook("")),
        raising=False,
    )


@pytest.mark.parametrize(
    ("name", "how"),
    [
        *((name, write_of_the_same_time) for name in EDITED),
        *((name, write) for name in ("below.py", "declared.txt")),
        *((name, replace_by_renaming) for name in ("edited.py", "power.txt")),
    ],
)
def test_an_edit_within_a_step_leaves_the_job_incomplete_with_the_name_of_the_file(
    folder, clean, tmp_path, monkeypatch, name, how
):
    path, results = folder.folder / name, tmp_path / "results"
    arrange(monkeypatch, name, lambda: how(path, EDITED[name]))
    jobs = folder.planned(results)
    (record,) = done(jobs, results).values()
    assert record.status == "incomplete"
    assert path.name in record.reason.partition(" changed during the run")[0], record.reason
    assert not any(record.scores for record in read_records(results))
    again = folder.run(results)
    assert again.status == "ok"
    assert is_same(read_distances(results, again), clean(**{name: EDITED[name]}))
    path.write_text(FILES[name])  # what was stored before the edit is of the planned files
    back = folder.run(results)
    assert (back.status, back.key) == ("ok", jobs[0].record.key)
    assert is_same(read_distances(results, back), clean())


@pytest.mark.parametrize("name", EDITED)
def test_an_edit_between_steps_or_before_the_first_one_does_so_too(folder, tmp_path, name):
    results = tmp_path / "results"
    jobs = folder.planned(results)
    (folder.folder / name).write_text(EDITED[name])
    (record,) = done(jobs, results).values()
    assert record.status == "incomplete"
    assert Path(name).name in record.reason.partition(" changed during the run")[0], record.reason


@pytest.mark.parametrize("name", ["declared.txt", "below.py", "top.py", "power.txt"])
def test_a_file_that_is_removed_within_a_step_is_named(folder, clean, tmp_path, monkeypatch, name):
    path, results = folder.folder / name, tmp_path / "results"
    arrange(monkeypatch, name, lambda: remove(path, ""))
    (record,) = done(folder.planned(results), results).values()
    assert record.status == "incomplete"
    assert path.stem in record.reason, record.reason
    path.write_text(FILES[name])
    again = folder.run(results)
    assert is_same(read_distances(results, again), clean())


@pytest.mark.parametrize("name", EDITED)
def test_a_file_that_is_edited_and_put_back_within_a_step_gives_the_planned_figures(
    folder, clean, tmp_path, monkeypatch, name
):
    path, results = folder.folder / name, tmp_path / "results"

    def read_meanwhile():
        path.write_text(EDITED[name])
        if path.suffix == ".py":  # a late import of a thread, or of the next line
            __import__("importlib").invalidate_caches()
        time.sleep(0.02)

    def put_back(_):
        write_of_the_same_time(path, FILES[name])

    arrange(monkeypatch, name, read_meanwhile)
    steps = []

    def watch(state):
        if not steps and path.read_text() == EDITED[name]:
            steps.append(state)
            put_back(state)

    jobs = folder.planned(results)
    (record,) = run_jobs(jobs, results, workers=ThisProcess(), watch=watch)
    if record.status == "incomplete":  # one step more was tried meanwhile
        assert Path(name).name in record.reason
        record = folder.run(results)
    assert record.status == "ok", record.reason
    assert is_same(read_distances(results, record), clean())


def test_a_file_that_is_only_touched_within_a_step_costs_one_step(
    folder, clean, tmp_path, monkeypatch
):
    results, calls = tmp_path / "results", []
    for name in ("declared.txt", "late.py", "scores.py"):
        arrange(monkeypatch, name, (folder.folder / name).touch)
    hook = builtins.edit
    monkeypatch.setattr(builtins, "edit", lambda of: (calls.append(of), hook(of)))
    record = folder.run(results)
    assert (record.status, record.reason) == ("ok", "")
    assert sorted(calls) == ["thick0", "thick1", "thin0", "thin0", "thin1"]
    assert is_same(read_distances(results, record), clean())


def test_a_file_that_is_touched_between_steps_costs_nothing(folder, clean, tmp_path, monkeypatch):
    results, calls = tmp_path / "results", []
    monkeypatch.setattr(builtins, "edit", calls.append, raising=False)
    jobs = folder.planned(results)
    declared = folder.folder / "declared.txt"
    (record,) = run_jobs(jobs, results, workers=ThisProcess(), watch=lambda _: declared.touch())
    assert record.status == "ok", record.reason
    assert sorted(calls) == ["thick0", "thick1", "thin0", "thin1"]
    assert is_same(read_distances(results, record), clean())


def test_a_module_that_takes_the_place_of_another_one_is_seen(folder, tmp_path, monkeypatch):
    results = tmp_path / "results"

    def shadow():
        (folder.folder / "below").mkdir()
        (folder.folder / "below" / "__init__.py").write_text("FACTOR = 7.0\n")

    arrange(monkeypatch, "below.py", shadow)
    (record,) = done(folder.planned(results), results).values()
    assert record.status == "incomplete"
    assert "below" in record.reason or "__init__.py" in record.reason


def link_to_an_endless_device(path):
    path.symlink_to("/dev/zero")


def link_to_an_endless_file(path):
    path.symlink_to("/proc/self/pagemap")


@pytest.mark.parametrize("kind", [os.mkfifo, link_to_an_endless_device, link_to_an_endless_file])
@pytest.mark.parametrize("name", ["declared.txt", "below.py"])
def test_a_file_in_whose_place_comes_what_has_no_end_is_named(folder, name, kind):
    path = folder.folder / name
    files = PlannedFiles(plan_code(str(folder.folder / "edited.py"), [], ["declared.txt"]))

    def replace():
        path.unlink()
        kind(path)

    for _ in range(2):  # within a step, and then before one
        with pytest.raises(CodeChanged, match=path.stem), files.unchanged():
            replace()


# The suite
# ------------------------------------------------------------------------------------------------


@pytest.fixture
def suite(tmp_path, monkeypatch):
    """A source file that stands for those of the suite."""
    source = tmp_path / "tasks.py"
    source.write_text("")
    monkeypatch.setattr(unchanged, "suite_sources", lambda: [source])
    return source


@pytest.mark.parametrize("is_edited", [True, False])
def test_a_failure_after_an_edit_of_the_suite_is_no_fault_of_the_method(
    folder, suite, tmp_path, monkeypatch, is_edited
):
    def fail(_):
        if is_edited:
            suite.write_text("edited = True")
        raise TypeError("a field is missing")

    monkeypatch.setattr(builtins, "edit", fail, raising=False)
    (record,) = done(folder.planned(tmp_path / "results"), tmp_path / "results").values()
    expected = ("incomplete", "tasks.py changed during the run") if is_edited else ("failed", "")
    assert record.status == expected[0]
    assert record.reason.startswith(expected[1])
    monkeypatch.setattr(builtins, "edit", lambda _: None)
    suite.touch()
    if is_edited:
        assert folder.run(tmp_path / "results").status == "ok"


@pytest.mark.parametrize("n_edits", [1, 9])
def test_a_process_that_starts_during_an_edit_of_the_suite_makes_nothing(
    folder, clean, tmp_path, monkeypatch, n_edits
):
    left = [*range(n_edits)]

    def state_before():
        return left.pop() if left else unchanged.state_of_suite()

    monkeypatch.setattr(workers, "state_of_suite", state_before)
    record = folder.run(tmp_path / "results", size=1)
    if n_edits == 1:  # the next process has one state of the suite
        assert (record.status, record.reason) == ("ok", "")
        assert is_same(read_distances(tmp_path / "results", record), clean())
    else:
        assert record.status == "incomplete"
        assert record.reason.startswith("the suite changed during the run")
        assert not any((tmp_path / "results" / "runs" / "forms").glob("*.npz"))


def test_a_worker_ends_with_the_code_that_it_holds(folder, clean, tmp_path):
    """In processes: a helper is edited while the first steps are under way, and put back after the
    run.
    """
    results, path = tmp_path / "results", folder.folder / "below.py"
    jobs, edited = folder.planned(results), []

    def edit(_):
        if not edited and any((results / "runs" / "forms").glob("*.npz")):
            edited.append(path.write_text(EDITED["below.py"]))

    slow = PLUGIN.replace("    import late", "    import time; time.sleep(0.5)\n    import late")
    (folder.folder / "edited.py").write_text(slow)
    jobs = folder.planned(results)
    (record,) = run_jobs(jobs, results, size=1, watch=edit)
    assert edited
    assert record.status == "incomplete"
    assert record.reason.startswith("below.py changed during the run")
    path.write_text(FILES["below.py"])
    again = folder.run(results)
    assert again.status == "ok", again.reason
    assert is_same(read_distances(results, again), clean())


# Models
# ------------------------------------------------------------------------------------------------


def write_model(folder, factor, name="card.json weights.safetensors"):
    """Write a model whose weights are a text, or one of its files."""
    folder.mkdir(parents=True, exist_ok=True)
    facts = {
        "digest": hashlib.sha256(factor.encode()).hexdigest(),
        "data": "figure",
        "subjects": ["a"],
        "identifiers": ["a0"],
    }
    if "weights" in name:
        (folder / "weights.safetensors").write_text(factor)
    if "card" in name:
        (folder / "card.json").write_text(json.dumps(facts))


@pytest.fixture
def model(tmp_path):
    write_model(tmp_path / "model", "1.0")
    return tmp_path / "model"


def files_of(folder, model):
    card = hashlib.sha256((model / "card.json").read_bytes()).hexdigest()
    return PlannedFiles(plan_code(str(folder.folder / "edited.py"), [], []), model, card)


@pytest.mark.parametrize("name", ["weights.safetensors", "card.json", "card.json weights"])
def test_a_model_that_is_replaced_before_it_is_loaded_or_meanwhile_is_named(folder, model, name):
    first = name.partition(" ")[0]
    files = files_of(folder, model)
    for _ in range(2):  # within a step, and then before one
        with (
            pytest.raises(CodeChanged, match=f"^{first}.* changed during the run"),
            files.unchanged(),
        ):
            write_model(model, "7.0", name)
    write_model(model, "1.0")
    with files.unchanged():
        pass


def test_a_model_that_is_replaced_and_put_back_within_a_step_is_named(folder, model):
    files = files_of(folder, model)
    with (
        pytest.raises(CodeChanged, match="^card.json, weights.safetensors changed"),
        files.unchanged(),
    ):
        write_model(model, "7.0")
        write_model(model, "1.0")
    with files.unchanged():
        pass


def test_an_error_of_a_file_that_was_half_written_is_no_fault_of_the_method(folder, model):
    files = files_of(folder, model)
    with pytest.raises(CodeChanged, match="^top.py"), files.unchanged():
        (folder.folder / "top.py").write_text("FACTOR = ")
        raise SyntaxError
    (folder.folder / "top.py").write_text(FILES["top.py"])
    with pytest.raises(ZeroDivisionError), files.unchanged():
        raise ZeroDivisionError
    with pytest.raises(KeyboardInterrupt), files.unchanged():
        (folder.folder / "top.py").write_text("FACTOR = ")
        raise KeyboardInterrupt


def test_contents_decide_where_a_clock_is_too_coarse(folder, model, monkeypatch):
    """Times of whole seconds, and files that keep their size and their place on the disk."""
    real = unchanged._state_of

    def coarse(path):
        state = real(path)
        whole_seconds = state.changed_ns // 10**9 * 10**9
        return state._replace(inode=0, modified_ns=whole_seconds, changed_ns=whole_seconds)

    files = files_of(folder, model)
    monkeypatch.setattr(unchanged, "_state_of", coarse)
    with pytest.raises(CodeChanged, match=r"^below.py"), files.unchanged():
        (folder.folder / "below.py").write_text("FACTOR = 3.0\n")


@pytest.mark.parametrize("name", ["card.json", "weights.safetensors"])
def test_a_file_of_a_model_that_is_gone_is_named(folder, model, name):
    files = files_of(folder, model)
    (model / name).unlink()
    with pytest.raises(CodeChanged, match=rf"^{name} changed during the run"), files.unchanged():
        pass


def test_code_that_may_not_be_read_any_more_is_no_fault_of_the_method(folder, monkeypatch):
    files = PlannedFiles(plan_code(str(folder.folder / "edited.py"), [], []))

    def refuse(*_):
        raise PermissionError(errno.EACCES, "Permission denied", str(folder.folder / "top.py"))

    for name in ("code_of", "sources_of"):
        with monkeypatch.context() as patched:
            patched.setattr(unchanged, name, refuse)
            with pytest.raises(CodeChanged, match=r"its code \(top.py: Permission denied\)"):
                files.unchanged().__enter__()
