"""What a selection of records says where there is none."""

import pytest

from benchmark.commands.selection import RecordSelection
from benchmark.errors import ConfigurationError
from tests.report.records import record


def test_a_table_of_robustness_without_results_is_refused():
    with pytest.raises(ConfigurationError, match="belongs to table robustness"):
        RecordSelection(tables=["robustness"]).views([record("gps")])
