from benchmark.plugins.registry import BUILT_IN, VARIANTS, methods, variant
from benchmark.protocols.tables import ONLY_NAMED
from tools.families import FAMILIES


def test_every_form_belongs_to_one_family():
    known = methods()
    shown = [variant(name, known) for names in FAMILIES.values() for name in names]
    forms = {name for name in BUILT_IN if known[name].info.family != "control" and not known[name].learns} - ONLY_NAMED
    assert {spec.base_name for spec in shown} == forms
    further = {known[name].with_parameters(each).name for name, variants in VARIANTS.items() for each in variants}
    assert further <= {spec.name for spec in shown}
    assert len({spec.name for spec in shown}) == len(shown)
