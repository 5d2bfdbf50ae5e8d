import re
from importlib.resources import files
from pathlib import Path

ROOT = Path(__file__).parents[1]
BIBLIOGRAPHY = files("benchmark.reference").joinpath("references.bib").read_text(encoding="utf-8")


def test_entries_are_unique_and_closed():
    keys = re.findall(r"^@\w+\{(\w+),$", BIBLIOGRAPHY, re.MULTILINE)
    assert len(keys) == len(set(keys)) == BIBLIOGRAPHY.count("\n}\n")
    assert BIBLIOGRAPHY.count("{") == BIBLIOGRAPHY.count("}")


def cited_in_code(key: str) -> bool:
    """Return whether a component or a data set names an entry."""
    folders = [
        ROOT / name for name in ("baselines", "benchmark", "examples", "learned", "retrieval")
    ]
    sources = [path for of in folders for path in (*of.rglob("*.py"), *of.rglob("*.toml"))]
    return any(key in path.read_text(encoding="utf-8") for path in sources)


def test_every_source_is_cited_by_a_component_a_data_set_or_a_page():
    pages = " ".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md"))
    pages = " ".join(pages.split()).lower()
    lost = []
    for entry in filter(str.strip, BIBLIOGRAPHY.split("\n\n")):
        key = re.match(r"@\w+\{(\w+),", entry.lstrip())[1]
        title = re.search(r"title\s*= \{(.*)\}", entry)
        words = re.sub(r"[{}]", "", title[1] if title else "").lower()
        eprint = re.search(r"eprint\s*= \{(.*)\}", entry)
        is_on_page = (words and words in pages) or (eprint and eprint[1] in pages)
        if not (is_on_page or cited_in_code(key)):
            lost.append(key)
    assert lost == []
