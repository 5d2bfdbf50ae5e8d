"""The source distribution and the wheel are built, installed in a new environment, and used as
README says.

Each command of README runs in an empty folder, in which a reader has his own data alone.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
from pathlib import Path

import pytest
from PIL import Image

from benchmark.check.shapes import BENDS, figure
from benchmark.kernel_cache import compiled_kernels, suite_sources
from tests.pages.blocks import blocks_of, commands_of
from tests.toy import rod, write_off

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")

#: The wheel has at most so many bytes.
LARGEST_WHEEL = 25e6

#: Commands of README that need a checkout, or run for an hour.
ELSEWHERE = re.compile(
    r"make |git |pip |cd |\. \.venv|export PIP|.*benchmark run --all(?! --quick)"
    r"|.*report --quick"  # of the jobs that `make bench` ran
)

#: Commands for a method of one's own, to which README adds --quick for a first try.
FOR_A_TRY = re.compile(r"python -m benchmark (run|compare) .*-t III")

#: What a reader puts in the places of words in capitals.
PLACES = {"FOLDER": "meshes", "NAME=DIR": "Mine=forms", "DIR": "data"}


def run(words: list[str], folder: Path) -> str:
    """Run a program that does not see this checkout; return what it printed."""
    hidden = ("PYTHONPATH", "CANONICAL_FORMS_DATA", "CANONICAL_FORMS_MODELS", "NUMBA_CACHE_DIR")
    environment = {name: text for name, text in os.environ.items() if name not in hidden}
    done = subprocess.run(
        words, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{words}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout + done.stderr


def build(kind: str, source: Path, target: Path) -> Path:
    """Build the source distribution or the wheel of a source tree; return its file."""
    program = f"from setuptools import build_meta; build_meta.build_{kind}({str(target)!r})"
    said = run([sys.executable, "-c", program], source)
    assert "absent from the `packages` configuration" not in said
    (made,) = target.iterdir()
    return made


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from the source distribution, which is built from what git knows, or would
    take.
    """
    folder = tmp_path_factory.mktemp("build")
    words = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    tree = folder / "tree"
    for name in filter(None, listed.split("\0")):
        source = ROOT / name
        if source.is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, tree / name)
    (folder / "sdist").mkdir()
    (folder / "wheel").mkdir()
    with tarfile.open(build("sdist", tree, folder / "sdist")) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    (unpacked,) = (folder / "unpacked").iterdir()
    return build("wheel", unpacked, folder / "wheel")


@pytest.fixture(scope="module")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Python of a new environment with the wheel, which shares what the suite depends on."""
    folder = tmp_path_factory.mktemp("environment")
    run([sys.executable, "-m", "venv", "--without-pip", str(folder)], folder)
    packages = Path(sysconfig.get_path("purelib", vars={"base": str(folder)}))
    here = str(folder / "bin" / "python")
    pip = [sys.executable, "-m", "pip", "--python", here, "install", "--quiet"]
    run([*pip, "--no-deps", "--no-index", "--no-compile", str(wheel)], folder)
    (packages / "shared.pth").write_text(sysconfig.get_path("purelib") + "\n")
    copy_kernels(packages)
    return here


def copy_kernels(packages: Path) -> None:
    """Copy the compiled kernels of the checkout to an installed copy: numba takes minutes for them.

    It keeps them as long as a source has the size and the time of that which was compiled; the
    suite, as long as no source was put in its place later.
    """
    for source in suite_sources():
        installed = packages / source.relative_to(ROOT)
        if installed.is_file():
            shutil.copystat(source, installed)
    for source in suite_sources():
        kept = packages / source.parent.relative_to(ROOT) / "__pycache__"
        for kernel in compiled_kernels(source):
            kept.mkdir(exist_ok=True, parents=True)
            shutil.copy(kernel, kept)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder in which a reader has his own data alone."""
    write_off(tmp_path / "cat.off", rod(0.1, 0.7))
    # Views of rods are nearly flat: solvers take thousands of steps to a stress of next to nothing.
    for name, width in {"narrow": 1.0, "wide": 1.6}.items():
        for number, bend in enumerate(BENDS[:2]):
            body = figure(bend)
            body = body.with_vertices(body.vertices * [width, 1, 1])
            write_off(tmp_path / "meshes" / f"{name}{number}.off", body)
    shutil.copytree(tmp_path / "meshes", tmp_path / "forms")
    (tmp_path / "data").mkdir()
    (tmp_path / "distances.txt").write_text("0 1 4 3\n1 0 5 2\n4 5 0 1\n3 2 1 0\n")
    (tmp_path / "labels.txt").write_text("cat\ncat\ndog\ndog\n")
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    with Image.open(ROOT / "examples/depth/man-1/kneeling.png") as frame:
        frame.resize((640, 480), Image.Resampling.NEAREST).save(tmp_path / "depth.png")
    return tmp_path


def commands() -> list[str]:
    """Return the commands of README that a reader of the wheel can run, with his own places."""
    found = []
    for line in commands_of(README):
        command = re.sub(r"\s+#.*", "", line).strip()
        if command and not ELSEWHERE.match(command):
            found.append(f"{command} --quick" if FOR_A_TRY.match(command) else command)
    text = "\n".join(found)
    for word, place in PLACES.items():
        text = re.sub(rf"(?<![\w-]){word}(?!\w)", place, text)
    return text.splitlines()


def write_methods(folder: Path, text: str) -> None:
    """Write the methods that README shows into the files by which its commands call them."""
    methods = [code for code in blocks_of(README, "python") if "MethodInfo(" in code]
    named = re.findall(r"(?<![/\w])(\w+\.py)\b", text)
    files = [name for name in dict.fromkeys(named) if not (folder / name).exists()]
    for file, code in zip(files, methods, strict=True):
        (folder / file).write_text(code)


def test_the_wheel_is_small(wheel):
    assert wheel.stat().st_size < LARGEST_WHEEL


def test_the_report_is_that_of_a_checkout(python, tmp_path):
    methods = ["-m", "gps", "-m", "mesh-unfolding"]
    words = ["-m", "benchmark", "report", "--published", "-t", "III", *methods, "-o"]
    run([python, *words, str(tmp_path / "installed")], tmp_path)
    run([sys.executable, *words, str(tmp_path / "checkout")], ROOT)
    files = [path for path in (tmp_path / "checkout").rglob("*") if path.is_file()]
    names = {path.relative_to(tmp_path / "checkout") for path in files}
    assert any(name.suffix == ".webp" for name in names)
    made = {path for path in (tmp_path / "installed").rglob("*") if path.is_file()}
    assert {path.relative_to(tmp_path / "installed") for path in made} == names
    for name in names:
        here, there = tmp_path / "installed" / name, tmp_path / "checkout" / name
        assert here.read_bytes() == there.read_bytes(), name


def test_models_that_are_left_out_are_fetched(python, tmp_path):
    words = [python, "-m", "benchmark", "models", "fetch", "--from", str(ROOT / "learned/models")]
    assert "2 models fetched" in run(
        [*words, "people-fold-0/literal-seed0", "humans-sampled"], tmp_path
    )
    assert "humans-sampled" in run([python, "-m", "benchmark", "list", "models"], tmp_path)


def test_the_commands_of_the_readme_run(python, folder):
    text = "\n".join(commands())
    assert len(re.findall("python -m benchmark", text)) > 10
    assert text.count(" --quick") == 2
    write_methods(folder, text)
    script = f'set -euo pipefail; PATH="{Path(python).parent}:$PATH"\n{text}\n'
    said = run(["bash", "-xc", script], folder)
    assert (folder / "results" / "report" / "index.html").is_file()
    assert (folder / "form.off").is_file()
    assert re.search(r"people\[draw=0\].*animals held out.*jobs to run; --jobs", said, re.DOTALL)

    # Tables of the published records are those of a checkout.
    made = {path.name: path.read_bytes() for path in (folder / "published").iterdir()}
    published = {path.name: path.read_bytes() for path in (ROOT / "results/tables").iterdir()}
    assert made.keys() == published.keys()
    assert [name for name, content in made.items() if content != published[name]] == []
