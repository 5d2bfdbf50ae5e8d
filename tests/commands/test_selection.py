"""What a selection of records says where there is none."""

import pytest

from benchmark.commands.selection import RecordSelection, further_options
from benchmark.defaults import DATA_VARIABLE, DEFAULT_SCORER, RESULTS
from benchmark.errors import ConfigurationError
from tests.report.records import record


def test_a_table_of_robustness_without_results_is_refused():
    with pytest.raises(ConfigurationError, match="belongs to table robustness"):
        RecordSelection(tables=["robustness"]).views([record("gps")])


@pytest.mark.parametrize(
    ("data_root", "words"),
    [(None, []), ("elsewhere", ["--data-root", "elsewhere"]), ("known", [])],
)
def test_a_command_to_copy_names_a_folder_of_data_that_the_environment_does_not(
    monkeypatch, data_root, words
):
    monkeypatch.setenv(DATA_VARIABLE, "known")
    assert further_options(RESULTS, DEFAULT_SCORER, 0, data_root) == words
