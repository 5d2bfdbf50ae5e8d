import re
from importlib.resources import files

BIBLIOGRAPHY = files("benchmark.reference").joinpath("references.bib").read_text(encoding="utf-8")


def test_entries_are_unique_and_closed():
    keys = re.findall(r"^@\w+\{(\w+),$", BIBLIOGRAPHY, re.MULTILINE)
    assert len(keys) == len(set(keys)) == BIBLIOGRAPHY.count("\n}\n")
    assert BIBLIOGRAPHY.count("{") == BIBLIOGRAPHY.count("}")
