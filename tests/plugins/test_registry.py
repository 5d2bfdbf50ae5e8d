import pickle
import subprocess
import sys

import pytest

from benchmark.api.contracts import Descriptor, Method
from benchmark.errors import ConfigurationError
from benchmark.plugins import registry

PLUGIN = '''
from benchmark.api.contracts import canonical_form


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


def test_listing_imports_neither_scipy_nor_numba():
    code = "import sys; from benchmark.plugins import registry; [spec.info for spec in registry.methods().values()]"
    code += "; print({'scipy', 'numba', 'torch', 'matplotlib', 'safetensors'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_of_a_plugin_file_with_a_named_method_the_others_stay_out(tmp_path):
    one, other = write_plugin(tmp_path), write_plugin(tmp_path, name="other", file="other.py")
    one.write_text(PLUGIN.format(name="flatten") + PLUGIN.format(name="second").replace("def flatten", "def second"))
    known = registry.methods([one, other])

    def chosen(*names):
        return [spec.name for spec in registry.select(names, known, [one, other])]

    assert chosen("second") == ["second", "other"]
    assert chosen("second", "other") == ["second", "other"]
    assert chosen("gps") == ["gps", "flatten", "second", "other"]
    assert {"gps", "flatten", "second", "other"} <= set(chosen("all", "second"))


def test_a_file_without_a_method_is_named(tmp_path):
    (tmp_path / "broken.py").write_text("x = 1")
    with pytest.raises(ConfigurationError, match="defines no method"):
        registry.methods([tmp_path / "broken.py"])


def test_a_class_without_behaviour_is_refused(tmp_path):
    path = tmp_path / "lazy.py"
    path.write_text(
        "from benchmark.api import MethodInfo\nclass Lazy:\n    info = MethodInfo(name='lazy', title='Lazy')\n"
    )
    with pytest.raises(ConfigurationError, match="neither 'canonicalise' nor 'describe'"):
        registry.methods([path])["lazy"].create()


@pytest.mark.parametrize(
    ("base", "ways"),
    [
        ("non-metric-mds", ["rtol=1e-3", "rtol=.001", " rtol = 0.0010 ", "max_iterations=100.0", ""]),
        ("constrained-mds", ["first_pull=1", "first_pull=1.00"]),
        ("learned", ["smoothing=0", "smoothing=-0", "jump=none", "training_seed=0"]),
    ],
)
def test_every_way_to_write_the_defaults_is_the_method_itself(base, ways):
    known = registry.methods()
    names = [base, *(f"{base}[{way}]" for way in ways)]
    assert [registry.variant(name, known) for name in names] == [known[base]] * len(names)
    assert [spec.name for spec in registry.select(names, known)] == [base]


def test_every_way_to_write_a_variant_is_one_method():
    known = registry.methods()
    ways = ["max_iterations=7,start=classic", "start=classic,max_iterations=7", "start = classic , max_iterations=7.0"]
    ways += [f"start=classic,max_iterations=+7,rtol={rtol}" for rtol in ("1e-3", "0.001")]
    (spec,) = registry.select([f"least-squares-mds[{way}]" for way in ways], known)
    assert spec.name == "least-squares-mds[start=classic,max_iterations=7]"
    assert spec.title == "Least Square MDS (start=classic, max_iterations=7)"
    assert spec.parameters == {"start": "classic", "max_iterations": 7}
    again = registry.variant(spec.name, known)
    assert [registry.variant(f"least-squares-mds[{way}]", known) for way in ways] == [again] * len(ways)
    assert pickle.loads(pickle.dumps(again)) == again  # noqa: S301


PARAMETERS = """
from dataclasses import dataclass
from typing import ClassVar
from benchmark.api.contracts import MethodInfo

@dataclass(frozen=True, kw_only=True)
class Plain:
    info: ClassVar[MethodInfo] = MethodInfo(name="plain", title="Plain")
    factor: float = 1
    levels: tuple = (1, 2)
    mode: "NotImported" = None

    def __post_init__(self):
        if self.factor < 0:
            raise ValueError("factor is negative")

    def canonicalise(self, shape):
        return shape.form(shape.mesh.vertices)
"""
