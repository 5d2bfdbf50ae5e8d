"""Errors are text on one line, with the place where they were raised."""

import shlex

import pytest

from benchmark.errors import (
    BenchmarkError,
    UnreadableMesh,
    UnsupportedShape,
    did_you_mean,
    locate,
    one_line,
    short_reason,
    surface_command,
    with_hint,
    without_hint,
)
from benchmark.files import named_errors


@pytest.mark.parametrize("given", [(5, None), (b"x", ["y"]), ("thin", "feed it")])
def test_problem_and_hint_are_text_whatever_a_method_passes(given):
    error = BenchmarkError(*given)
    assert str(error) == "; ".join(str(part) for part in given if part is not None)
    assert (type(error.problem), type(error.hint)) == (str, str)


def test_a_message_is_taken_apart_where_it_was_put_together():
    assert without_hint(str(BenchmarkError("thin", "feed it; often"))) == "thin"
    assert without_hint(str(BenchmarkError("thin"))) == "thin"
    assert with_hint("thin", "") == without_hint(with_hint("thin", "feed it")) == "thin"
    assert with_hint("thin", "feed it") == str(BenchmarkError("thin", "feed it"))


def test_an_error_is_named_on_one_line_with_file_and_line():
    assert one_line(ValueError("a\n b")) == "ValueError: a b"
    assert one_line(UnsupportedShape("thin", "feed it")) == "thin; feed it"
    try:
        raise KeyError
    except KeyError as error:
        assert locate(error) == f"test_errors.py:{error.__traceback__.tb_lineno}: KeyError"


def test_a_message_names_its_file_only_when_it_is_printed(tmp_path):
    path = tmp_path / "points.ply"
    with (
        pytest.raises(UnreadableMesh) as caught,
        named_errors(path, "ply file", UnreadableMesh, "export it again"),
    ):
        raise UnreadableMesh(f"no faces in {path}", f"m.load_new_mesh('{path.name}')")
    error = caught.value
    assert (error.problem, error.hint) == ("no faces in <file>", "m.load_new_mesh('<file>')")
    assert str(error) == f"{path}: no faces in points.ply; m.load_new_mesh('points.ply')"
    assert error.located == f"{path}: no faces in points.ply"
    for other in (OSError(2, "No such file", str(path)), ValueError(f"cannot parse {path}")):
        reading = named_errors(path, "ply file", UnreadableMesh, "export it again")
        with pytest.raises(UnreadableMesh) as caught, reading:
            raise other
        assert str(tmp_path) not in caught.value.problem
        assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("message", "short"),
    [
        ("too thin; feed it", "too thin"),
        ("/a/b c.off: cut off; fetch it", "b c.off: cut off"),
        (
            "smooth.py reads /home/me/x/table.txt in a way; declare it",
            "smooth.py reads table.txt in a way",
        ),
        ("1/2 of 3 / 4", "1/2 of 3 / 4"),
    ],
)
def test_tables_for_print_have_the_short_reason(message, short):
    assert short_reason(message) == short


def test_a_name_that_is_known_twice_is_suggested_once():
    assert did_you_mean("model", "x", ["people", "people"]).hint == "choose one of people"
    assert did_you_mean("model", "peopl", ["people", "people"]).hint == "did you mean people?"


@pytest.mark.parametrize(
    ("name", "called"),
    [
        ("scan of Åsa-1.ply", "scan of Åsa-1.ply"),
        ("it's.ply", "FILE"),
        ('a"; b.ply', "FILE"),
        ("$(id).ply", "FILE"),
        ("`id`.ply", "FILE"),
        ("a\\.ply", "FILE"),
    ],
)
def test_a_command_to_copy_is_whole_whatever_a_file_is_called(name, called):
    command = surface_command(name)
    assert f"load_new_mesh('{called}')" in command
    assert len(shlex.split(command)) == 3
