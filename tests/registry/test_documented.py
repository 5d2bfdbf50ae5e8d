"""Parameters in plain words, from docstrings."""

from baselines.constrained_mds import ConstrainedMDS
from benchmark.registry.documented import describe_parameters, plain


class Base:
    """A base.

    Parameters
    ----------
    width
        How wide, as ``"a"``
        or ``"b"``.
    height : int
        Of the base.
    """


class Derived(Base):
    r"""Another.

    Parameters
    ----------
    height, depth
        Factor :math:`\lambda` of :class:`benchmark.api.Shape`.

    Notes
    -----
    wrong
        No parameter.
    """


def test_each_parameter_has_one_plain_line_of_the_nearest_class():
    assert describe_parameters(Derived) == {
        "height": "Factor lambda of Shape.",
        "depth": "Factor lambda of Shape.",
        "width": 'How wide, as "a" or "b".',
    }


def test_a_method_of_the_suite_describes_all_its_parameters():
    found = describe_parameters(ConstrainedMDS)
    assert found.keys() == {"first_pull", "last_pull", "cascades", "iterations"}
    assert not any("`" in text or ":" in text for text in found.values())


def test_text_without_markup_stays():
    assert plain("a  b\nc") == "a b c"
