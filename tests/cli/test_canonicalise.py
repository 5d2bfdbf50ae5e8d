"""The form of one mesh as a file: whole, or not there."""

import pytest

from benchmark.cli.canonicalise import canonicalise_facts
from tests.toy import rod, write_off

PLUGIN = """
from benchmark.contracts import CanonicalForm, canonical_form

@canonical_form(name="noting", title="Noting")
def noting(shape):
    return CanonicalForm(shape.mesh.vertices, shape.mesh.faces, {"note": NOTE})
"""


@pytest.fixture
def form_with(tmp_path):
    """What is told of a form with a note, given as source."""
    write_off(tmp_path / "rod.off", rod(0.1, 0.5))

    def make(note):
        (tmp_path / "noting.py").write_text(PLUGIN.replace("NOTE", note))
        names = (str(tmp_path / name) for name in ("rod.off", "form.off"))
        return canonicalise_facts(*names, "noting", [str(tmp_path / "noting.py")], 0)

    return make


def test_a_form_whose_notes_cannot_be_told_is_not_written(form_with, tmp_path):
    with pytest.raises(TypeError):
        form_with("object()")
    assert not (tmp_path / "form.off").exists()


@pytest.mark.parametrize(("source", "told"), [("'so'", "so"), ("3", 3.0)])
def test_notes_are_told_as_plain_values(form_with, tmp_path, source, told):
    assert form_with(source)[1] == {"note": told}
    assert (tmp_path / "form.off").exists()
