"""A plugin sees no place of the user: nothing that it left there before determines a result."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmark.check import check
from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.pipeline.record_arrays import read_distances
from benchmark.places import make_folder, no_places_of_the_user, remove_folder
from benchmark.registry.known import in_file
from benchmark.runs.workers import Worker
from tests.registry.plugin import write_plugin
from tests.runs.toy import planned, run_toy

#: By name, where a method keeps what it computed.
PLACES = {
    "home": "Path.home() / '.mymethod'",
    "cache": "Path('~/.cache/mymethod').expanduser()",
    "xdg-cache": "Path(os.environ['XDG_CACHE_HOME']) / 'mymethod'",
    "xdg-data": "Path(os.environ['XDG_DATA_HOME']) / 'mymethod'",
    "config": "Path(os.path.expandvars('$HOME/.config/mymethod'))",
    "temporary": "Path(tempfile.gettempdir()) / 'mymethod'",
    "tmpdir": "Path(os.environ['TMPDIR']) / 'mymethod'",
    "matplotlib": "Path(os.environ['MPLCONFIGDIR']) / 'mymethod'",
    "torch": "Path(os.environ['TORCH_HOME']) / 'mymethod'",
}

KEEPS = """
def canonicalise(self, shape):
        for place in PLACES:
            file = place / f"{shape.identifier}.npy"
            if file.exists():
                return shape.form(np.load(file))
        form = shape.mesh.vertices ** 3 * [1, 1, 1.0]
        for place in PLACES:
            place.mkdir(parents=True, exist_ok=True)
            np.save(place / f"{shape.identifier}.npy", form)
        return shape.form(form)
"""


def test_what_a_method_kept_in_an_earlier_run_is_gone(rods, tmp_path, monkeypatch):
    for name in ("HOME", "TMPDIR", "XDG_CACHE_HOME", "XDG_DATA_HOME", "MPLCONFIGDIR", "TORCH_HOME"):
        (tmp_path / name).mkdir()
        monkeypatch.setenv(name, str(tmp_path / name))
    imports = "import os, tempfile\nfrom pathlib import Path\nimport numpy as np\n\nPLACES = ["
    imports += ", ".join(PLACES.values()) + "]"
    plugin = write_plugin(tmp_path / "smooth.py", imports=imports, methods=KEEPS.strip())
    results = tmp_path / "results"
    (first,) = run_toy(rods, results, "smooth", plugins=(plugin,), size=1).values()
    assert first.status == "ok", first.reason
    plugin.write_text(plugin.read_text().replace("[1, 1, 1.0]", "[1, 1, 7.0]"))
    (second,) = run_toy(rods, results, "smooth", plugins=(plugin,), size=1).values()
    assert second.status == "ok", second.reason

    def method(shape):
        return shape.mesh.vertices**3 * [1, 1, 7.0]

    (clean,) = run_toy(rods, tmp_path / "clean", method).values()
    found = read_distances(results, second)
    assert (found == read_distances(tmp_path / "clean", clean)).all(axis=None)
    assert not (found == read_distances(results, first)).all(axis=None)
    assert not any(
        path.is_file()
        for name in ("HOME", "TMPDIR")
        for path in (tmp_path / name).rglob("mymethod/*")
    )


READS = """
from benchmark.api import canonical_form

@canonical_form(name="cached", title="Reads what is cached")
def cached(shape):
    open({cache!r}).close()
    return shape.mesh.vertices

@canonical_form(name="configured", title="Reads a setting")
def configured(shape):
    open({config!r}).close()
    return shape.mesh.vertices
"""


def test_a_file_of_the_user_by_its_path_is_refused(rods, tmp_path, monkeypatch):
    home, plugin, methods = tmp_path / "home", tmp_path / "own.py", ("cached", "configured")
    monkeypatch.setenv("HOME", str(home))
    files = {"cache": home / ".cache" / "mymethod", "config": home / ".config" / "mymethod"}
    for file in files.values():
        file.parent.mkdir(parents=True)
        file.write_text("1")
    plugin.write_text(READS.format(**{name: str(file) for name, file in files.items()}))
    records = run_toy(rods, tmp_path / "results", *methods, plugins=(plugin,), size=1)
    for method in methods:
        assert records[method].status == "failed"
        assert "declare it in info" in records[method].reason
    assert planned(rods, tmp_path / "results", *methods, plugins=(plugin,))


def test_variables_are_as_before_and_what_else_changed_stays(monkeypatch):
    monkeypatch.setenv("XDG_SESSION_ID", "1")
    before = dict(os.environ)
    with no_places_of_the_user():
        inside = Path.home()
        assert inside != Path(before["HOME"])
        assert {os.environ[name] for name in ("TMPDIR", "XDG_CACHE_HOME")} == {str(inside)}
        assert "XDG_SESSION_ID" not in os.environ
        with no_places_of_the_user():
            assert Path.home() == inside
        monkeypatch.setenv("MINE", "1")
    assert dict(os.environ) == {**before, "MINE": "1"}


@pytest.mark.parametrize("variables", [{}, {"HOME": "/tmp", "TMPDIR": "/tmp"}])
def test_a_home_that_is_also_the_folder_of_temporary_files_is_hidden(monkeypatch, variables):
    for name in ("HOME", "TMPDIR"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    home = Path.home()
    with no_places_of_the_user():
        assert Path.home() != home
    assert Path.home() == home


# Folders that go with their process
# ------------------------------------------------------------------------------------------------

MAKES = "import sys\nfrom benchmark.places import make_folder\nprint(make_folder(), flush=True)\n"


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """The folder of temporary files of this process, and of those that it starts."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_the_folder_of_a_killed_process_goes_and_that_of_a_living_one_stays(temporary):
    living = subprocess.Popen(
        [sys.executable, "-c", f"{MAKES}sys.stdin.read()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    stays = Path(living.stdout.readline().strip())
    words = [sys.executable, "-c", f"{MAKES}import os; os.kill(os.getpid(), 9)"]
    goes = Path(subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip())
    (goes / "kept").write_text("")
    (temporary / "canonical-forms-of-nobody").mkdir()

    young = make_folder()  # what was made just now may not be locked yet
    assert goes.is_dir()
    for folder in (stays, goes):
        os.utime(folder, (0, 0))
    own = make_folder()
    assert stays.is_dir()
    assert not goes.exists()
    assert {*temporary.iterdir()} == {
        *map(Path, (young, own)),
        stays,
        temporary / "canonical-forms-of-nobody",
    }
    for folder in (young, own):
        remove_folder(folder)
        assert not Path(folder).exists()
    living.communicate()


def test_a_check_leaves_no_folder(temporary):
    with no_places_of_the_user():
        before = {*temporary.iterdir()}  # that of this process, which goes with it
    (component,) = in_file(write_plugin(temporary / "smooth.py"))
    assert any(finding.outcome == "ok" for finding in check(component))
    left = {path for path in temporary.iterdir() if path.name.startswith("canonical-forms")}
    assert left <= before


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (OSError(11, "Resource temporarily unavailable"), "Resource temporarily unavailable"),
        (RuntimeError("can't start new thread"), "can't start new thread"),
    ],
)
def test_a_process_that_is_not_started_leaves_no_folder(temporary, monkeypatch, error, reason):
    def refuse(*_, **__):
        raise error

    monkeypatch.setattr(subprocess, "Popen", refuse)
    task = SimpleNamespace(process="plugin.py", steps=(), record=None)
    with pytest.raises(BenchmarkError, match=f"no process can be started: {reason}; end other"):
        Worker(2**30, 60.0, 1).begin(task)
    assert [*temporary.iterdir()] == []


def test_without_space_for_temporary_files_the_advice_is_about_them(temporary, monkeypatch):
    def refuse(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tempfile.mkdtemp", refuse)
    task = SimpleNamespace(process="plugin.py", steps=(), record=None)
    said = f"in {temporary}: No space left on device; free some space there, or name .* TMPDIR$"
    with pytest.raises(BenchmarkError, match=said):
        Worker(2**30, 60.0, 1).begin(task)


def test_without_any_place_for_temporary_files_those_that_were_tried_are_named(monkeypatch):
    def refuse():
        raise FileNotFoundError(2, "No usable temporary directory found in ['/nowhere']")

    monkeypatch.setattr("tempfile.gettempdir", refuse)
    with pytest.raises(ConfigurationError, match=r"any folder .*/nowhere.*TMPDIR$"):
        make_folder()
