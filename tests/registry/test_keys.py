"""What a key of each kind may hold: modules that compute its result, and no text that speaks."""

from __future__ import annotations

import ast
from functools import cache

import pytest

from benchmark import code_digest
from benchmark.api.datasets import Entry
from benchmark.code_digest import FIRST_PARTY, ROOT, code_of, code_of_modules
from benchmark.commands.plan import plan
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.mesh_files import FORMATS, mesh_file_set
from benchmark.errors import ConfigurationError
from benchmark.pipeline.environment import PACKAGES
from benchmark.pipeline.prepared import PreparedShapes
from benchmark.registry import select, select_one
from benchmark.runs.tasks import STAGE_MODULES


def modules(names):
    """Return the paths of modules of the suite, one a line or several, as ``geometry: mesh
    cleaning``.
    """
    found = set()
    for line in names.strip().splitlines():
        package, _, members = line.strip().partition(": ")
        found |= {f"{package.replace('.', '/')}/{member}.py" for member in members.split()}
    return found


MESH = modules("""
    benchmark.geometry: bridging cleaning mesh preparation
    benchmark.pipeline: stages surfaces
""")
VIEW = modules("""
    benchmark.geometry: bridging camera cleaning depth mesh rasterise
    benchmark.pipeline: stages views
""")
FORM = modules("""
    benchmark.api: contracts
    benchmark.geometry: cleaning embedding geodesic_graph geodesics laplacian mesh
    benchmark.pipeline: forms stages
""")
KERNELS = modules("baselines._kernels: arap connectivity_surgery curve_skeleton few_rows spectrum")
#: Methods that begin from the forms of others, or use a function of theirs.
BASES = modules("baselines: classic_mds smacof")
NETWORK = FORM | modules("""
    benchmark.api: learning
    benchmark.geometry: bridging camera depth rasterise
    learned: code_network field field_network images methods models paper_network surface
""")
SIGNATURE = modules("""
    benchmark.api: scoring
    benchmark.geometry: mesh rasterise
    retrieval: cmbof features gradient_histograms pose scale_space views
""")
#: What compares signatures.
COMPARING = modules("retrieval: clock codebook")
RANKING = modules("""
    benchmark.api: scoring
    benchmark.geometry: mesh
    benchmark.pipeline: ranking stages
    retrieval: measures
""")
#: What makes meshes beside preparation: by a set of the suite.
MAKERS = {
    "people[draw=0]": modules("benchmark.datasets: bodies"),
    "humans-scanlike": modules("""
        benchmark.datasets: bodies scanning
        benchmark.geometry: preparation
    """),
    "animals": modules("""
        benchmark.api: datasets
        benchmark.datasets: animals bodies
        benchmark.geometry: camera
    """),
    "people[draw=0][noise=1]": modules("""
        benchmark.datasets: bodies surface_changes
        benchmark.geometry: camera preparation rasterise
    """),
}
READER = modules("""
    benchmark.formats: base polygons reading
    benchmark.geometry: mesh
""")
OF_TEXT = modules("benchmark.formats: ascii")


def of_suite(code):
    return {name for name in code if name.partition("/")[0] in FIRST_PARTY}


@cache
def components():
    return [component for component in select(["all"]) if not component.missing_packages()]


@pytest.mark.parametrize(("name", "makers"), MAKERS.items(), ids=MAKERS)
def test_a_prepared_shape_and_a_frame_hold_what_makes_and_prepares_meshes(name, makers):
    shapes = open_dataset(name)
    assert of_suite(PreparedShapes(shapes, "mesh").code) == makers | MESH
    assert of_suite(PreparedShapes(shapes, "view").code) == makers | VIEW


@pytest.mark.parametrize("extension", FORMATS)
def test_a_prepared_shape_of_a_file_holds_the_reader_of_its_format_alone(tmp_path, extension):
    entry = Entry("shape", "class", "0", tmp_path / f"shape{extension}")
    shapes = mesh_file_set(name="files", shapes=(entry,))
    of_format = {FORMATS[extension].module.replace(".", "/") + ".py"}
    code = of_suite(PreparedShapes(shapes, "mesh").code)
    assert code - OF_TEXT == MESH | READER | of_format


def test_the_key_of_a_file_is_that_of_its_own_format_whatever_lies_beside_it(tmp_path):
    entries = tuple(Entry(n, "class", n, tmp_path / n) for n in ("a.off", "b.obj", "c.stl"))
    alone, together = (
        PreparedShapes(mesh_file_set(name="files", shapes=shapes), "mesh")
        for shapes in (entries[:1], entries)
    )
    assert alone.key(entries[0]) == together.key(entries[0])
    assert len(together.code) > len(alone.code)


def test_a_form_holds_its_method_and_what_hands_it_the_shape():
    of_stage = code_of_modules([STAGE_MODULES["forms"]])
    for component in components():
        own = component.target.partition(":")[0]
        allowed = NETWORK if own == "learned.methods" else FORM | KERNELS | BASES
        code = of_suite(component.code() | of_stage)
        assert code <= allowed | {own.replace(".", "/") + ".py"}, component.name


def test_a_record_names_each_package_that_computes():
    only_read_or_write = {"msgspec", "pandas", "safetensors"}
    for component in components():
        packages = {name for name in component.code() if "/" not in name}
        assert packages - only_read_or_write <= {*PACKAGES}, component.name


def test_no_module_is_allowed_in_forms_that_is_in_none():
    used = set(of_suite(code_of_modules([STAGE_MODULES["forms"]])))
    for component in components():
        used |= of_suite(component.code())
    assert (FORM | KERNELS | BASES | NETWORK) - used == set()


def test_a_signature_holds_its_scorer_and_a_ranking_holds_the_measures():
    scorer = select_one("cm-bof", kind="scorer")
    assert of_suite(scorer.code()) == SIGNATURE | COMPARING
    assert of_suite(code_of(scorer.target, without=scorer.info.comparing)) == SIGNATURE
    assert of_suite(code_of_modules([STAGE_MODULES["records"]])) == RANKING


@pytest.mark.parametrize(
    ("module", "same_signatures"), [("retrieval/clock.py", True), ("retrieval/features.py", False)]
)
def test_an_edit_of_what_compares_ranks_again_by_the_same_signatures(
    rods, tmp_path, monkeypatch, module, same_signatures
):
    def record():
        return plan(rods, "identity", input="mesh", results=tmp_path).jobs[0].record

    def edited_code(*arguments):
        code = code_of(*arguments)
        return {name: "edited" if name == module else part for name, part in code.items()}

    before = record()
    monkeypatch.setattr(code_digest, "code_of", edited_code)
    after = record()
    assert after.key != before.key
    assert (after.files["signatures"] == before.files["signatures"]) == same_signatures


def test_what_a_plugin_says_that_compares_is_a_module_beside_it(tmp_path):
    plugin = tmp_path / "plugin.py"
    plugin.write_text("import matching\nimport words\n")
    for name in ("matching", "words"):
        (tmp_path / f"{name}.py").write_text("")
    assert code_of(str(plugin), without=["matching"]).keys() == {"plugin.py", "words.py"}
    with pytest.raises(ConfigurationError, match=r"plugin\.py says that 'match' compares"):
        code_of(str(plugin), without=["match"])


def test_the_code_of_a_plugin_is_that_of_the_names_that_it_imports(tmp_path):
    plugin = tmp_path / "plugin.py"
    plugin.write_text("from benchmark.api import Interval, MethodInfo, Shape, canonical_form\n")
    without = of_suite(code_of(str(plugin)))
    assert without == FORM - modules("""
        benchmark.geometry: embedding
        benchmark.pipeline: forms stages
    """)
    plugin.write_text("from benchmark.api import MethodInfo, oriented\n")
    assert of_suite(code_of(str(plugin))) == without | modules("benchmark.geometry: embedding")
    plugin.write_text("from benchmark.api import *\n")
    assert of_suite(code_of(str(plugin))) > without | modules("benchmark.api: learning scoring")


def test_what_python_offers_is_in_the_code_of_a_plugin_that_calls_it(tmp_path):
    plugin = tmp_path / "plugin.py"
    plugin.write_text("from benchmark import canonicalise\n")
    used = modules("benchmark.commands: canonicalise")
    assert of_suite(code_of(str(plugin))) > used | MESH
    plugin.write_text("import benchmark\n")
    assert of_suite(code_of(str(plugin))) > used | modules("benchmark.commands: retrieve")


COMPUTES = MESH | VIEW | FORM | KERNELS | BASES | READER.union(*MAKERS.values())
COMPUTES |= SIGNATURE | COMPARING
#: Texts with two blanks in code that computes: of files, notes of forms, descriptions of bodies in
#: keys, and a filter.
NOT_SPOKEN = {
    "ply format binary_little_endian 1.0 element vertex",
    "property double x property double y property double z element face",
    "property list uchar int vertex_indices end_header",
    "string or file could not be read",
    "contraction left a single joint",
    "contraction failed:",
    "with joints",
    "vertices,",
    "of",
    "x",
}


@pytest.mark.parametrize("name", sorted(COMPUTES))
def test_no_text_that_speaks_is_in_a_key(name):
    tree = ast.parse((ROOT / name).read_bytes())
    counted = [
        part
        for _, node in code_digest._definitions(tree.body)
        for part in code_digest._significant(node, {})
        if isinstance(part, str) and part.count(" ") > 1
    ]
    assert {" ".join(part.split()) for part in counted} <= NOT_SPOKEN


def test_the_packages_around_what_computes_only_pass_names_on():
    around = {(ROOT / name).parent / "__init__.py" for name in COMPUTES | NETWORK | RANKING}
    around.add(ROOT / "benchmark" / "__init__.py")
    for path in around:
        for node in ast.parse(path.read_bytes()).body:
            named = getattr(node, "name", "") or ast.unparse(getattr(node, "targets", [node])[0])
            is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            passes_on = isinstance(node, ast.Import | ast.ImportFrom)
            assert (
                passes_on or is_text or named in ("__all__", "__dir__", "__getattr__", "_OFFERED")
            )
