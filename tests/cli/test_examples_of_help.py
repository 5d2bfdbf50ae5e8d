"""Each verb has an example in its help, whose words the verb knows."""

import shlex

import pytest
import typer

from benchmark.cli.examples import EXAMPLES, example_of
from tests.verbs import VERBS, call


def paths(commands, before=()):
    """Yield the words of each verb, with those of the group around it."""
    for name, command in commands.items():
        if hasattr(command, "commands"):
            yield from paths(command.commands, (*before, name))
        else:
            yield (*before, name)


@pytest.mark.parametrize("path", list(paths(VERBS)), ids=" ".join)
def test_the_help_of_a_verb_ends_with_an_example_that_it_understands(path):
    example = example_of(f"python -m benchmark {' '.join(path)}")
    *_, title, last = call(*path, "--help").splitlines()
    assert (title, last.strip()) == ("Example:", example)  # on one line, so that it can be copied
    words = shlex.split(example)[3:]
    assert tuple(words[: len(path)]) == path
    command = VERBS[path[0]]
    for name in path[1:]:
        command = command.commands[name]
    values, *_ = command.make_parser(typer.Context(command)).parse_args(words[len(path) :])
    assert [parameter.name for parameter in command.params if parameter.required] == [
        parameter.name
        for parameter in command.params
        if parameter.required and values.get(parameter.name)
    ]


@pytest.mark.parametrize("path", [(), ("data",), ("models",), *paths(VERBS)], ids=" ".join)
def test_the_help_of_a_verb_fits_80_columns_and_breaks_no_word(path):
    lines = call(*path, "--help").splitlines()
    assert [line for line in lines if len(line) > 80 or line.rstrip().endswith("-")] == []


def test_no_example_is_of_a_verb_that_is_gone():
    assert EXAMPLES.keys() == {" ".join(path) for path in paths(VERBS)}
