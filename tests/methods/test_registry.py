import pickle

import pytest

from benchmark.contracts import Descriptor, Method
from benchmark.errors import ConfigurationError
from benchmark.methods import registry

PLUGIN = '''
from benchmark.contracts import canonical_form


@canonical_form(name="{name}", title="Flattened")
def flatten(shape):
    """Drop one axis."""
    return shape.mesh.vertices * [1, 1, 0.5]
'''


def write_plugin(folder, name="flatten", file="mine.py"):
    path = folder / file
    path.write_text(PLUGIN.format(name=name))
    return path


@pytest.mark.parametrize("name", list(registry.BUILT_IN))
def test_a_built_in_method_carries_its_own_name_and_can_be_made(name):
    spec = registry.methods()[name]
    assert spec.info.name == name
    assert isinstance(spec.create(), (Method, Descriptor))
    assert pickle.loads(pickle.dumps(spec.create())) == spec.create()  # noqa: S301


def test_an_unknown_method_is_answered_with_the_nearest_name():
    with pytest.raises(ConfigurationError, match="unknown method 'clasic-mds'; did you mean classic-mds"):
        registry.select(["clasic-mds"], registry.methods())


def test_selection_keeps_the_order_of_the_tables():
    known = registry.methods()
    assert [spec.name for spec in registry.select(["gps", "identity"], known)] == ["gps", "identity"]
    assert len(registry.select([], known)) == len(known)


def test_a_plugin_file_adds_its_methods_and_is_kept_beside_named_ones(tmp_path):
    path = write_plugin(tmp_path)
    known = registry.methods([path])
    assert list(known)[-1] == "flatten"
    assert [spec.name for spec in registry.select(["gps"], known, [path])] == ["gps", "flatten"]
    assert known["flatten"].info.title == "Flattened"


def test_two_methods_of_one_name_are_an_error(tmp_path):
    with pytest.raises(ConfigurationError, match="two methods are called 'gps'.*rename one"):
        registry.methods([write_plugin(tmp_path, name="gps")])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = (", "cannot be imported: SyntaxError"),
        ("raise RuntimeError('boom')", "cannot be imported: RuntimeError: boom"),
        ("x = 1", "defines no method"),
    ],
)
def test_a_broken_plugin_is_named(tmp_path, text, message):
    path = tmp_path / "broken.py"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=message):
        registry.methods([path])


def test_a_missing_plugin_is_named(tmp_path):
    with pytest.raises(ConfigurationError, match="is not a Python file"):
        registry.methods([tmp_path / "nothing.py"])


def test_a_class_without_behaviour_is_refused(tmp_path):
    path = tmp_path / "lazy.py"
    path.write_text(
        "from benchmark.contracts import MethodInfo\nclass Lazy:\n    info = MethodInfo(name='lazy', title='Lazy')\n"
    )
    with pytest.raises(ConfigurationError, match="neither 'canonicalise' nor 'describe'"):
        registry.methods([path])["lazy"].create()


def test_a_missing_package_makes_a_method_unavailable_not_broken(tmp_path):
    path = tmp_path / "needy.py"
    path.write_text(
        PLUGIN.format(name="needy").replace('title="Flattened"', 'title="Needy", requires=("no_such_package",)')
    )
    assert registry.methods([path])["needy"].missing_packages() == ("no_such_package",)


def test_parameters_in_brackets_make_a_variant_with_its_own_name_and_title():
    known = registry.methods()
    names = ["least-squares-mds", "least-squares-mds[start=classic, max_iterations=7]"]
    plain, variant = registry.select(names, known)
    assert (plain.name, variant.name) == tuple(names)
    assert variant.title == "Least Square MDS (start=classic, max_iterations=7)"
    assert (variant.create().start, variant.create().max_iterations) == ("classic", 7)
    assert variant.resolved_parameters() != plain.resolved_parameters()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("least-squares-mds[stard=classic]", "unknown parameter of least-squares-mds 'stard'; did you mean start"),
        ("least-squares-mds[max_iterations=many]", "'many' does not fit .*; write a int"),
        ("least-squares[start=classic]", "unknown method 'least-squares'; did you mean least-squares-mds"),
        ("gps[", "unknown method"),
    ],
)
def test_a_wrong_parameter_is_named(name, message):
    with pytest.raises(ConfigurationError, match=message):
        registry.select([name], registry.methods())


def test_all_methods_and_some_more():
    known = registry.methods()
    plain = [spec.name for spec in registry.select([], known)]
    more = registry.select(["all", "least-squares-mds[start=classic]"], known)
    place = plain.index("least-squares-mds") + 1
    assert [spec.name for spec in more] == [*plain[:place], "least-squares-mds[start=classic]", *plain[place:]]
    assert not [spec.name for spec in more if spec.named]
    assert [spec.name for spec in registry.select(["all", "gps"], known)] == plain
