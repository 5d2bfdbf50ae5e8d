"""``demo``: a page to play with, of a generated animal or of meshes of the user, without a run."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import benchmark
from benchmark.cli import demo as cli_demo
from tests.registry.plugin import write_plugin
from tests.toy import rod, write_off
from tests.verbs import call, refusal


def content_of(page: Path) -> dict:
    """Return what the script of a page reads."""
    text = page.read_text(encoding="utf-8")
    (gallery,) = re.findall(r'(\{"galleries".*\})', text)[:1]
    return json.loads(gallery.replace(r"<\/", "</"))


@pytest.fixture
def rods(tmp_path: Path) -> list[Path]:
    """A thin rod in two poses, and a thick one."""
    paths = [tmp_path / f"{name}.off" for name in ("thin0", "thin1", "thick")]
    for path, (radius, bend) in zip(paths, ((0.06, 0.0), (0.06, 1.0), (0.2, 0.5)), strict=True):
        write_off(path, rod(radius, bend))
    return paths


def test_meshes_of_the_user_unfold_by_the_named_methods(rods, tmp_path):
    page = tmp_path / "page.html"
    said = call("demo", *rods, "-o", page, "-m", "gps", "-m", "identity", "--no-open")
    assert f"wrote {page}" in said
    (gallery,) = content_of(page)["galleries"]
    assert gallery["title"] == "Your meshes"
    assert [method["name"] for method in gallery["methods"]] == ["identity", "gps", "identity"]
    assert [shape["label"] for shape in gallery["shapes"]] == ["thin", "thin", "thick"]
    for shape in gallery["shapes"]:
        assert len(shape["forms"]) == 3 and all(shape["forms"])
        assert shape["forms"][0] == shape["body"]


def test_a_form_that_cannot_be_made_is_named_and_left_out(rods, tmp_path):
    plugin = tmp_path / "refusing.py"
    write_plugin(
        plugin,
        imports="from benchmark.errors import UnsupportedShape",
        methods="def canonicalise(self, shape):\n"
        "        raise UnsupportedShape('this is a rod', 'take a cat')",
    )
    name = re.search(r'name="([\w-]+)"', plugin.read_text())[1]
    words = ["demo", rods[0], "-o", tmp_path / "page.html", "-m", name, "--plugin", plugin]
    said = call(*words, "--no-open", code=1)
    assert f"{name} of thin0: this is a rod; take a cat" in said
    (gallery,) = content_of(tmp_path / "page.html")["galleries"]
    assert gallery["shapes"][0]["forms"][1] is None


def test_a_page_is_replaced_and_no_other_file(rods, tmp_path):
    page = tmp_path / "page.html"
    benchmark.demo(rods[:1], page, methods=["identity"])
    first = page.read_bytes()
    benchmark.demo(rods[:1], page, methods=["identity"])
    assert page.read_bytes() == first
    page.write_text("my notes")
    assert "is another file, which stays" in refusal("demo", rods[0], "-o", page)
    assert page.read_text() == "my notes"


def test_what_is_no_mesh_or_no_method_is_refused(rods, tmp_path):
    page = tmp_path / "page.html"
    assert "nothing.off" in refusal("demo", tmp_path / "nothing.off", "-o", page)
    assert "reads depth views" in refusal("demo", rods[0], "-o", page, "-m", "learned-streamed")
    assert "computes no forms" in refusal("demo", rods[0], "-o", page, "-m", "shape-dna")
    assert not page.exists()


@pytest.mark.parametrize(
    ("platform", "environment", "is_there"),
    [
        ("linux", {}, False),
        ("linux", {"DISPLAY": ":0"}, True),
        ("linux", {"WAYLAND_DISPLAY": "wayland-0"}, True),
        ("darwin", {}, True),
        ("darwin", {"SSH_CONNECTION": "1.2.3.4"}, False),
    ],
)
def test_a_browser_is_opened_where_there_is_a_screen(
    platform, environment, is_there, monkeypatch, rods, tmp_path
):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SSH_CONNECTION"):
        monkeypatch.delenv(name, raising=False)
    for name, text in environment.items():
        monkeypatch.setenv(name, text)
    monkeypatch.setattr(cli_demo.sys, "platform", platform)
    opened = []
    monkeypatch.setattr(cli_demo.webbrowser, "open", opened.append)
    call("demo", rods[0], "-o", tmp_path / "page.html", "-m", "identity")
    assert opened == ([(tmp_path / "page.html").as_uri()] if is_there else [])


@pytest.mark.slow
def test_a_generated_animal_in_two_poses(tmp_path):
    made = benchmark.demo(output=tmp_path / "page.html")
    assert made.problems == ()
    (gallery,) = content_of(made.path)["galleries"]
    assert [shape["name"] for shape in gallery["shapes"]] == ["cat0", "cat4"]
    assert all(all(shape["forms"]) for shape in gallery["shapes"])
