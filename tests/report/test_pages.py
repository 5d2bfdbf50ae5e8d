"""Pages of a report, and figures, from records alone and from stored forms."""

import io
import json
import re
import shutil
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from msgspec.structs import replace
from PIL import Image

from benchmark.errors import ConfigurationError
from benchmark.geometry.camera import FRONT
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.data_names import label_data_sets
from benchmark.pipeline.records import RankedShapes
from benchmark.protocols.tables import SYNTHETIC_HUMANS, TABLE_MEASURES
from benchmark.report.drawing import shaded
from benchmark.report.figures import (
    COLOURS,
    GREY,
    _ClassName,
    _positions,
    _write_names,
    class_means,
    first_records,
    forms_figure,
    map_figure,
    some_shapes,
)
from benchmark.report.forms import StoredForms
from benchmark.report.grids import figure_bytes, grid, write_figure
from benchmark.report.notes import table_notes
from benchmark.report.output import write_files
from benchmark.report.page_builder import TEMPLATES, label_of_table
from benchmark.report.pages import report_files
from benchmark.report.query_pages import Match, kept_pose, nearest_matches
from benchmark.report.sheets import frame_picture, mesh_picture, retrieved_picture
from benchmark.report.tables import table_views
from tests.report.records import by_class, failed, record
from tests.report.test_formats import HOSTILE
from tests.toy import rod
from tools.publish import portable, with_distances, write_thumbnails


def luminance(colour):
    red, green, blue = (
        ((int(colour[k : k + 2], 16) / 255 + 0.055) / 1.055) ** 2.4 for k in (1, 3, 5)
    )
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


class Facts(HTMLParser):
    """What a page has: elements by tag, the names of its anchors, and its text."""

    def __init__(self, text):
        super().__init__()
        self.found, self.text = [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data

    def values(self, name, *tags):
        return [
            attrs[name] for tag, attrs in self.found if name in attrs and (not tags or tag in tags)
        ]


def pages(folder, *records):
    write_files(folder / "report", report_files(folder, table_views(records)))
    return read(folder / "report")


def read(folder):
    found = {path.name: path.read_text() for path in folder.glob("*.html")}
    facts = {name: Facts(text) for name, text in found.items()}
    for name, page in facts.items():
        assert all(attrs.get("alt") for tag, attrs in page.found if tag == "img"), name
        assert all(attrs.get("aria-label") for tag, attrs in page.found if tag == "table"), name
        assert all(attrs.get("scope") for tag, attrs in page.found if tag == "th"), name
        assert not re.search(r"<th[^>]*></th>", found[name]), name
        assert len(set(page.values("id"))) == len(page.values("id"))
        if name != "play.html":
            assert sum(tag == "tr" for tag, _ in page.found) > 1  # no page is empty
        for link in (
            page.values("href")
            + page.values("src")
            + page.values("data", "object")
            + page.values("data-mesh")
        ):
            file, _, anchor = link.partition("#")
            is_here = link.startswith("data:image/svg+xml,") or (folder / file).is_file()
            assert is_here, link  # so that no network is needed
            assert not anchor or anchor in facts[file].values("id"), link
    return found


def test_records_alone_make_a_page_that_says_how_to_make_forms_and_has_the_classes_of_each_input(
    tmp_path,
):
    found = pages(
        tmp_path, record(), record("learned", input_="view"), failed("fell", "it <b>fell</b>")
    )
    assert found.keys() == {"index.html", "table-rods.html"}
    page = found["table-rods.html"]
    assert "it &lt;b&gt;fell&lt;/b&gt;" in page
    assert page.count("python -m benchmark run -d rods") == 1
    assert [page.count(f"<h2>Classes, {title}</h2>") for title in ("mesh", "view")] == [1, 1]
    of_view = page[page.index("Classes, view") :]
    assert re.findall(r'<th scope="row">(.*?)</th>.*?--part: (\d+)%">(.*?)<', of_view) == [
        ("Depth network, 128 px", "70", ".70")
    ]


def test_a_table_has_one_score_a_cell_with_what_it_is_sorted_by_its_interval_and_the_papers_score(
    tmp_path,
):
    labels = [f"s{k // 2}" for k in range(16)]
    text = pages(
        tmp_path, record("gps", [k / 16 for k in range(16)], dataset="tosca", labels=labels)
    )["table-III-tosca.html"]
    row = re.search(r"<tr>(?:(?!<tr).)*>GPS<.*?</tr>", text, re.DOTALL)[0]
    cells = re.findall(r"<td ([^>]*)>([.\d]*)(.*?)</td>", row, re.DOTALL)
    assert [score for _, score, _ in cells] == [
        *[".71", ".52", ".72", ".76", ".47", ".50", ".60", ".70"],
        "",
        "1.5",
    ]
    assert cells[4][0] == 'class=" first" data-value="0.46875"'
    assert re.fullmatch(
        r'class="range form" title="DCG .70, nominal 95 %: .\d+ to .\d+; paper .76"', cells[8][0]
    )
    assert [svg.count('class="paper"') for *_, svg in cells] == [0] * 8 + [1, 0]
    assert cells[9][0] == 'class="first" data-value="1.5"'


def test_the_overview_has_a_column_for_each_table_and_the_best_of_each_block_is_bold(tmp_path):
    refused = record(
        "classic-mds", 0.8, dataset="humans-scanlike", unsupported=[("cat0", "too thin")]
    )  # is not best
    found = pages(
        tmp_path,
        record("gps", dataset="people[draw=0]"),
        *[record("skeleton", dataset=name) for name in SYNTHETIC_HUMANS],
        record("gps", dataset="humans-scanlike"),
        refused,
    )
    index = found["index.html"]
    assert re.findall(r'title="[^"]*">([^<]*)</a></th>', index) == [
        "people[draw=0]",
        "humans-scanlike",
    ]
    assert cells_of(index, "GPS") == [
        ("0", "other", ".23"),
        ("29", "", ".70"),
    ]  # two of three draws are missing
    assert cells_of(index, "Classic MDS") == [("", "", ""), ("29", "other", ".70")]
    assert cells_of(index, "Random order") == [("", "", ".57"), ("", "", ".57")]


def test_two_folders_of_one_name_have_columns_of_their_own_in_the_overview(tmp_path):
    rows = [
        record(
            "gps",
            dataset="scans",
            data={"name": "scans", "title": "scans", "source": "scans", "path": f"/{place}/scans"},
        )
        for place in ("a", "b")
    ]
    found = pages(tmp_path, *label_data_sets(rows))
    headings = re.findall(r'title="[^"]*">([^<]*)</a></th>', found["index.html"])
    assert headings == ["a/scans", "b/scans"]


def gallery_of(name, views=1):
    """Fields of a gallery of three shapes."""
    return {
        "gallery": name,
        "gallery_digest": "2",
        "input": "mesh",
        "data": {"name": name, "title": name, "source": f"../{name}"},
        "shapes": ["cat90", "dog90", "owl90"],
        "labels": ["cat", "dog", "owl"],
        "views": views,
    }


def test_a_folder_with_the_name_of_a_table_is_called_by_its_name_alone():
    data = {"name": "III", "title": "III", "source": "III", "path": "/data/III"}
    (view,) = table_views([record(dataset="III", data=data)])
    assert view.table.identifier == "III-folder"
    assert label_of_table(view) == "III"


@pytest.mark.parametrize(
    ("keeps", "ranked"), [(True, "the whole gallery"), (False, "the gallery without its own shape")]
)
def test_notes_say_whether_a_query_ranks_shapes_of_its_name(keeps, ranked):
    row = record("gps", fold="against a", against=gallery_of("a"), keeps_same_names=keeps)
    (view,) = table_views([row])
    assert f"Each query ranks {ranked}. " in " ".join(table_notes(view))


def test_a_set_against_two_galleries_has_a_column_for_each_in_the_overview(tmp_path):
    rows = [
        record("gps", fold=f"against {name}", against=gallery_of(name), keeps_same_names=True)
        for name in ("balls", "cones")
    ]
    found = pages(tmp_path, *rows)
    headings = re.findall(r'title="[^"]*">([^<]*)</a></th>', found["index.html"])
    assert headings == ["rods, against balls", "rods, against cones"]
    assert "Complete surfaces" in found["index.html"]
    assert "View against surfaces" not in found["index.html"]


@pytest.mark.parametrize(
    ("more", "command"),
    [
        ({"dataset": "rods"}, "run -d rods"),
        ({"dataset": "rods", "quick": True, "seed": 2}, "run -d rods --quick --seed 2"),
        ({"dataset": "rods", "scorer": "bbox"}, "run -d rods --scorer bbox"),
        ({"dataset": "animals", "stand_in_for": "tosca"}, "run -t III -d animals"),
        (
            {
                "data": {"name": "rods", "title": "rods", "source": "r", "path": "/my rods"},
                "fold": "against balls",
                "against": gallery_of("balls"),
            },
            "run -d &#39;/my rods&#39; --gallery ../balls --same-names",
        ),
        (
            {
                "fold": "against 3 cameras",
                "input_": "view",
                "against": gallery_of("rods", views=3),
            },
            "run -d rods --gallery-views 3",
        ),
    ],
)
def test_the_command_on_a_page_makes_the_forms_of_its_table(tmp_path, more, command):
    page = pages(tmp_path, record("gps", **more))["index.html"]
    assert f"<code>python -m benchmark {command} --results {tmp_path}</code>" in page


def test_the_command_on_a_page_does_not_name_the_default_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = pages(tmp_path / "results", record("gps", dataset="rods"))["index.html"]
    assert "<code>python -m benchmark run -d rods</code>" in page


def cells_of(text, title):
    row = re.search(rf'<th scope="row">{title}</th>(.*?)</tr>', text, re.DOTALL)[1]
    cells = re.findall(
        r'<td(?: data-value="[.\d]*" style="--part: (\d+)%" class="(\w*)")?>(.*?)</td>', row
    )
    return cells


def test_a_score_of_views_stands_in_the_column_of_views_or_says_so(tmp_path):
    labels = [f"s{k // 2}" for k in range(18)]
    surfaces = [
        record("gps", dataset="tosca", labels=labels),
        record("learned", dataset="tosca", input_="view", labels=labels),
    ]
    every = table_views([*surfaces, record("gps", dataset="animals", labels=labels)])
    alone = report_files(tmp_path, [view for view in every if view.table.identifier == "III"])[
        "index.html"
    ]
    for index, expected in (
        (alone, [".70 view", ""]),
        (pages(tmp_path, *surfaces)["index.html"], ["", ".70"]),
    ):
        assert [text for *_, text in cells_of(index, "Depth network, 128 px")] == expected
        assert [text for *_, text in cells_of(index, "GPS")].count(".70") == 1 + (index == alone)


def test_turned_views_are_columns_of_the_table_of_unturned_ones(tmp_path):
    labels = [f"s{k // 2}" for k in range(18)]
    gallery = record(dataset="tosca", labels=labels)
    ranked = RankedShapes(
        **{name: getattr(gallery, name) for name in RankedShapes.__struct_fields__}
    )
    titles = {
        "tosca": "TOSCA",
        "tosca[view-angle=3]": "TOSCA, view angle: largest angle in degrees 30",
    }
    common = {
        "fold": "against complete surfaces",
        "input_": "view",
        "labels": labels,
        "against": ranked,
    }
    rows = [
        record(dataset=name, data={"name": name, "title": title, "source": name}, **common)
        for name, title in titles.items()
    ]
    found = pages(tmp_path, *rows)
    assert found.keys() == {"index.html", "table-III-cross-tosca.html"}
    for page in found.values():
        assert re.findall(r'<a href="(.*?)" title="[^"]*">([^<]*)</a></th>', page) == [
            ("table-III-cross-tosca.html", "files named like TOSCA, unverified"),
            (
                "table-III-cross-tosca.html",
                "files named like TOSCA, unverified, cameras turned up to 30°",
            ),
        ]
    around = record(
        "identity", dataset="tosca", data=rows[0].data, **(common | {"fold": "against 12 cameras"})
    )
    index = pages(tmp_path, *rows, around)["index.html"]
    link = r'<a href="table-III-cameras-tosca.html" title="[^"]*">'
    assert re.search(f"{link}files named like TOSCA, unverified, 12 cameras</a></th>", index)


def test_hostile_names_are_text_on_pages_and_in_names_of_files(tmp_path):
    names = [
        name for name in HOSTILE if not re.search(r"[\x00-\x1f]", name)
    ]  # records refuse the others
    records = [
        made
        for name in names
        for made in (record(dataset=name, title=name), failed("fell", name, dataset=name))
    ]
    found = pages(tmp_path, *records)
    assert len(found) > len(names)
    assert all(re.fullmatch(r"[\w.-]+", path) for path in found)
    for text in found.values():
        assert not re.search(r"<(script>alert|img src=x|b>)", text)
        assert "\u202e" not in text


def test_stored_forms_and_distances_are_shown_and_rows_lead_to_them(results, tmp_path):
    views = table_views(results.records)
    files = report_files(results.folder, views)
    write_files(tmp_path, files)
    found = read(tmp_path)
    scores, forms, queries = (
        found[f"{views[0].stem}{kind}.html"] for kind in ("", "-forms", "-queries")
    )
    assert scores.count("-forms.html#") == 2
    assert scores.count("-queries.html#") == 3
    assert Facts(scores).values("alt", "img")[:2] == [
        "A form by GPS",
        "A form by Identity (no canonical form)",
    ]
    shapes = results.records[0].shapes
    said = Facts(forms).values("alt")
    assert len(said) == 3 * len(shapes)
    assert f"Form of {shapes[0]} by GPS" in said
    assert (
        len(re.findall(r"</button>(?:mirrored, )?\.\d\d apart</td>", forms)) == 2 * 2
    )  # of two classes by two methods
    pictures = [name for name in files if name.endswith(".webp")]
    # Queries that a method misses show its forms; how many there are depends on the scorer.
    of_missed = [name for name in pictures if "-near-" in name]
    assert all(name in queries for name in of_missed)
    others = set(pictures).difference(of_missed)
    sizes = Counter(Image.open(tmp_path / name).size for name in others)
    assert sizes == {(240, 240): 3 * len(shapes), (96, 96): len(shapes)}
    mesh = json.loads(
        (tmp_path / Facts(forms).values("data-mesh")[0]).read_text().partition(", ")[2][:-2]
    )
    assert (
        len(mesh["points"][0])
        == len(mesh["values"])
        == results.form(results.job("gps", "rods"), shapes[0]).n_vertices
    )
    assert queries.count("data-query") == len(shapes)


def test_published_rows_have_a_picture_of_a_form_though_none_is_stored(results, tmp_path):
    copy = shutil.copytree(results.folder, tmp_path / "copy")
    write_thumbnails(copy, results.records)
    shutil.rmtree(copy / "runs")
    files = report_files(copy, table_views(results.records))
    pictures = {name: data for name, data in files.items() if name.endswith(".webp")}
    assert pictures.keys() == {"pictures/rods-gps.webp", "pictures/rods-identity.webp"}
    assert {Image.open(io.BytesIO(data)).size for data in pictures.values()} == {(96, 96)}
    assert 'src="pictures/rods-gps.webp"' in files["index.html"]


def test_published_distances_make_the_page_of_queries_and_a_damaged_file_is_named(
    results, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr("tools.publish.WITH_DISTANCES", "rods")
    copy = shutil.copytree(results.folder, tmp_path / "copy")
    (view,) = table_views([with_distances(copy, portable(record)) for record in results.records])
    shutil.rmtree(copy / "runs")
    name, rows = f"{view.stem}-queries.html", re.compile(r"<tr id.*?</tr>", re.DOTALL)
    page, own = (report_files(folder, [view])[name] for folder in (copy, results.folder))
    assert rows.findall(page) == rows.findall(own)
    assert (
        len({*(copy / "records" / "distances").iterdir()}) == page.count("<button data-column") == 3
    )
    for path in (copy / "records" / "distances").iterdir():
        content = path.read_bytes()
        for damaged in (bytes([content[0] ^ 1, *content[1:]]), content[:-4], content[:-1], b""):
            path.write_bytes(damaged)
            assert report_files(copy, [view])[name].count("<button data-column") == 2
            assert f"skipped {path}: " in capsys.readouterr().err or len(damaged) % 4 == 0
        path.write_bytes(content)
    shutil.rmtree(copy / "records" / "distances")
    assert name not in report_files(copy, [view])


def test_a_sentence_above_a_table_says_which_row_leads_and_how_surely(tmp_path):
    values = {"gps": 0.9, "skeleton": 0.5, "classic-mds": 0.9}
    of_labels = lambda count: [f"s{k // 2}" for k in range(2 * count)]  # noqa: E731
    for count, says in (
        (9, "has the highest DCG, .70, but not significantly above any of the 2 others."),
        (3, "3 classes decide nothing here."),
    ):
        rows = [record(name, nn, labels=of_labels(count)) for name, nn in values.items()]
        assert says in pages(tmp_path / str(count), *rows)["index.html"]
    two = [record(name, labels=of_labels(9)) for name in ("gps", "skeleton")]
    assert "but not significantly above the other row." in pages(tmp_path / "2", *two)["index.html"]


def test_the_overview_names_rows_above_all_others_of_their_block_and_says_where_data_are_generated(
    tmp_path,
):
    def rows(dataset, scores, count=10):
        labels, title = (
            [f"s{k // 2}" for k in range(2 * count)],
            f"{dataset} (generated, {count} classes)",
        )
        for name, score in scores.items():
            of_query = {measure: [score] * len(labels) for measure in TABLE_MEASURES}
            facts = {
                "per_query": of_query,
                "scores": dict.fromkeys(TABLE_MEASURES, score),
                "labels": labels,
            }
            yield record(
                name,
                dataset=dataset,
                data={"name": dataset, "title": title, "source": dataset},
                **facts,
            )

    first = [*rows("rods", {"gps": 0.9, "skeleton": 0.5, "classic-mds": 0.5})]
    others = [
        *rows("balls", {"gps": 0.9, "skeleton": 0.9}),
        *rows("few", {"gps": 0.9, "skeleton": 0.0}, 3),
    ]
    index = pages(tmp_path, *first, *others)
    found = Facts(index["index.html"]).text
    assert (
        "Complete surfaces: GPS scores above all other canonical forms on rods (generated)."
        in found
    )
    assert "no method is shown to be better than all others of its block. To be" not in found
    none = pages(tmp_path / "none", *others)
    assert "On these data, no method is shown to be better" in Facts(none["index.html"]).text
    quick = [
        replace(each, gallery=f"{each.gallery} (quick)", data=replace(each.data, quick=True))
        for each in (*first, *others)
    ]
    of_quick = pages(tmp_path / "quick", *quick)
    assert ".90" in Facts(of_quick["index.html"]).text
    assert "On these data, no method is shown to be better" in Facts(of_quick["index.html"]).text


def test_refused_and_missed_queries_come_first_and_others_are_hidden(monkeypatch, tmp_path):
    labels = ["a", "a", "b", "b", "b"]
    matrix = np.array(
        [[0, 1, 2, 2, 2], [1, 0, 2, 2, 2], [9, 9, 0, 1, 2], [3, 9, 4, 0, 5], [9, 9, 2, 1, 0]],
        dtype=float,
    )
    refused = record(
        "refuses", labels=labels, input_="view", unsupported=[("b4", "too thin; feed it")]
    )
    stored = lambda folder, one: matrix[np.ix_(one.answered, one.answered)]  # noqa: E731
    monkeypatch.setattr("benchmark.report.query_pages.read_distances", stored)
    page = pages(
        tmp_path, record(labels=labels), record("learned", labels=labels, input_="view"), refused
    )
    page = page["table-rods-queries.html"]
    assert re.findall(r"(?:Mesh|View): \d of 5 queries fail", page) == [
        "Mesh: 1 of 5 queries fail",
        "View: 2 of 5 queries fail",
    ]
    order = re.findall(
        r'<tr id="[-\w]+"( class="fine")?><th scope="row"><button data-query="(\d)">', page
    )
    assert order[0] == ("", "3")
    assert order[5:7] == [("", "4"), ("", "3")]
    assert all(mark for mark, _ in order[1:5] + order[7:])
    row = re.search(r'data-query="4".*?</tr>', page[page.index("View") :], re.DOTALL)[0]
    assert re.findall(r"<td(.*?)>(.*?)</td>", row) == [
        (' class="refused" data-value="-1"', "– refused"),
        ("", "✓ .70"),
    ]
    assert re.findall("<li>(.*?)</li>", page) == ["<b>b4</b>: too thin; feed it (Refuses)"]
    data = json.loads(re.search(r"<script type=\"application/json\">(.*?)</script>", page)[1])
    ((title, near, forms),) = data["rows"]
    assert (title, forms) == ("GPS", {})  # no forms are stored
    assert near["3"] == [[0, 1, 0.75], [2, 2, 1.0], [4, 3, 1.25], [1, 4, 2.25]]


def test_matches_are_shapes_of_the_gallery_without_the_name_of_the_query():
    gallery = record(labels=["a", "a", "b", "b"])
    ranked = RankedShapes(
        **{name: getattr(gallery, name) for name in RankedShapes.__struct_fields__}
    )
    matrix = np.array([[0.0, 3, 2, 1], [5, 4, 0, 6]])
    for keeps, expected in (
        (False, [(3, 1, 0.333), (2, 2, 0.667), (1, 3, 1.0)]),
        (True, [(0, 1, None), (3, 2, None)]),
    ):
        found = nearest_matches(
            record(labels=["a", "b"], against=ranked, keeps_same_names=keeps), matrix
        )
        assert found[0][: len(expected)] == expected
        assert found[1] == [(2, 1, None), (1, 2, None), (0, 3, None), (3, 4, None)]


def test_how_often_a_wrong_match_has_the_pose_of_the_query_stands_beside_chance():
    poses = ["sits", "runs", "kneels"]
    shapes = [*(f"ann_{pose}" for pose in poses), *(f"bob_{pose}" for pose in (*poses, "naps"))]
    named = record(labels=["ann"] * 3 + ["bob"] * 4, shapes=shapes)
    # By number: 0 and 1 match the other person, in their pose and in another one; 4 matches its own
    # pose; 2 is right.
    nearest = {
        0: [Match(3, 1, 0.5)],
        1: [Match(5, 1, 0.5)],
        2: [Match(0, 1, 1.0)],
        3: [Match(4, 1, 1.0)],
        4: [Match(1, 1, 0.5)],
    }
    assert kept_pose(named, nearest) == pytest.approx([2 / 3, (1 / 4 + 1 / 4 + 1 / 3) / 3])
    assert kept_pose(named, {2: nearest[2]}) == []  # nothing fails
    assert kept_pose(record(), {0: [Match(4, 1, 0.5)]}) == []  # poses are numbers


def test_points_of_a_map_lead_to_their_queries(results, tmp_path):
    (view,) = table_views(results.records)
    write_files(tmp_path, report_files(results.folder, [view]))
    queries = Facts((tmp_path / f"{view.stem}-queries.html").read_text()).values("id")
    (chart,) = Facts((tmp_path / f"{view.stem}.html").read_text()).values("data", "object")
    links = re.findall(
        r'<a xlink:href="(.*?)#(.*?)" target="_top">', (tmp_path / chart).read_text()
    )
    assert len(links) == 3 * len(results.records[0].shapes)
    assert {file for file, _ in links} == {f"{view.stem}-queries.html"}
    assert {name for _, name in links} <= {*queries}


def test_the_first_of_the_class_of_a_query_is_listed_with_its_rank_where_it_is_late():
    matrix = np.array([[0.0, *range(9, 1, -1)], *np.zeros((8, 9))])
    found = nearest_matches(record(labels=["a", "a", *"bbbbbbb"]), matrix)
    assert found[0] == [
        (8, 1, 0.222),
        (7, 2, 0.333),
        (6, 3, 0.444),
        (5, 4, 0.556),
        (4, 5, 0.667),
        (1, 8, 1.0),
    ]


def test_text_has_a_contrast_of_four_and_a_half_in_both_schemes(tmp_path):
    pages(tmp_path, record())
    style = "".join((tmp_path / "report" / name).read_text() for name in ("style.css", "table.css"))
    schemes = re.findall(r"--(\w+): light-dark\((#\w{6}), (#\w{6})\)", style)
    checked = 0
    for scheme in ({name: of[place] for name, *of in schemes} for place in (0, 1)):
        for rule in re.findall(r"\{([^{}]*)\}", style):
            colours = dict(re.findall(r"(?<![-\w])(color|background): (?:var\(--)?([#\w]+)", rule))
            if text := colours.get("color"):
                pair = (
                    scheme.get(name, name) for name in (text, colours.get("background", "page"))
                )
                brightness = sorted(map(luminance, pair))
                assert (brightness[1] + 0.05) / (brightness[0] + 0.05) >= 4.5, rule
                checked += 1
    assert checked >= 16
    site = (
        Path(__file__).parents[2] / "docs/images/site.css"
    ).read_text()  # where the style of tables stands, too
    table = (tmp_path / "report" / "table.css").read_text()
    assert {
        name for name in re.findall(r"var\(--(\w+)\)", table) if f"--{name}:" not in site
    } == set()


def test_a_folded_overview_hides_rows_that_have_scores_in_hidden_columns_alone():
    def column(title, *, is_ablation=False):
        """Return a column of the overview, of a table with one column."""
        group = SimpleNamespace(title=title)
        table = SimpleNamespace(is_cross=False, is_ablation=is_ablation)
        chance = {title: {"DCG": 0.5}}
        view = SimpleNamespace(
            columns=[group], table=table, dataset=title, caption=title, chance=chance, marks={}
        )
        return title, title, view, group

    scored = SimpleNamespace(means={"DCG": 0.8}, is_rival=lambda: True)
    cell = SimpleNamespace(method="gps"), scored, False
    matrix = {
        "columns": [column("rods"), column("parts", is_ablation=True)],
        "groups": {"Complete surfaces": 2},
        "rows": {"Networks": {"in both": [cell, cell], "in the ablation": [None, cell]}},
    }
    page = TEMPLATES.get_template("matrix.html").render(matrix=matrix, can_fold=True)
    rows = re.findall(r'<tr( class="every")?><th scope="row">([^<]*)</th>', page)
    assert rows == [("", "in both"), (' class="every"', "in the ablation")]


def mixed(colour, page, share):
    """Mix a colour with that of a page."""
    parts = [
        share * int(colour[k : k + 2], 16) + (1 - share) * int(page[k : k + 2], 16)
        for k in (1, 3, 5)
    ]
    return "#" + "".join(f"{round(part):02x}" for part in parts)


def test_numbers_are_read_on_the_deepest_blue_and_dim_ones_stand_on_none(tmp_path):
    pages(tmp_path, record())
    style = "".join((tmp_path / "report" / name).read_text() for name in ("style.css", "table.css"))
    schemes = re.findall(r"--(\w+): light-dark\((#\w{6}), (#\w{6})\)", style)
    share = float(re.search(r"var\(--mark\) calc\(([.\d]+) \* var\(--part", style)[1])
    for scheme in ({name: of[place] for name, *of in schemes} for place in (0, 1)):
        deepest = mixed(scheme["mark"], scheme["page"], share)
        brightness = sorted(map(luminance, (scheme["text"], deepest)))
        assert (brightness[1] + 0.05) / (brightness[0] + 0.05) >= 4.5, deepest
    assert "background-color: transparent" in re.search(r"\.scores \.other \{(.*?)\}", style)[1]


def test_pages_of_400_shapes_are_small(tmp_path):
    labels = [f"s{k // 10}" for k in range(400)]
    records = [record(f"m{k}", k / 20, labels=labels) for k in range(12)]
    found = pages(tmp_path, *records)
    assert max(map(len, found.values())) < 1_000_000


# Figures
# ------------------------------------------------------------------------------------------------


def test_figures_have_fonts_that_publishers_take(results, tmp_path):
    view = table_views(results.records)[0]
    forms = StoredForms(results.folder)
    figures = [map_figure(view, forms), forms_figure(view, forms)]
    for number, figure in enumerate(figures):
        write_figure(figure, tmp_path / f"{number}.pdf")
        data = (tmp_path / f"{number}.pdf").read_bytes()
        assert b"/Type3" not in data
        assert b"CreationDate" not in data
    few = table_views(results.records, methods=["surface-area"])[0]
    with pytest.raises(ConfigurationError, match="no selected row of table rods has forms"):
        forms_figure(few, forms)


def test_figures_do_not_depend_on_settings_of_matplotlib(results):
    view, forms = table_views(results.records)[0], StoredForms(results.folder)

    def drawn():
        figures = [map_figure(view, forms), forms_figure(view, forms), grid([("a", [np.eye(2)])])]
        return [figure_bytes(figure, ".svg") for figure in figures]

    usual = drawn()
    settings = {
        "font.size": 30,
        "font.family": "serif",
        "lines.linewidth": 9,
        "image.interpolation": "bilinear",
        "savefig.facecolor": "red",
        "svg.fonttype": "none",
        "text.color": "red",
    }
    with mpl.rc_context(settings):
        assert drawn() == usual
        assert mpl.rcParams["font.size"] == settings["font.size"]


def test_colours_in_which_names_are_written_have_a_contrast_of_four_and_a_half_with_white():
    for colour in (*COLOURS, GREY):
        assert 1.05 / (luminance(colour) + 0.05) >= 4.5, colour


def test_networks_of_views_stand_beside_rows_of_complete_surfaces():
    view = table_views([record(), record("learned", input_="view")])[0]
    titles = ["GPS", "Depth network, 128 px, view"]
    assert list(class_means(view).index) == titles
    assert [row.title for row in first_records(view)] == titles


def test_classes_stand_from_the_hardest_to_the_easiest(monkeypatch):
    monkeypatch.setattr("benchmark.report.figures.MEASURE", "NN")
    values = {"owl": 0.25, "cat": 0.5, "dog": 1.0}
    rows = [record("gps", by_class(values))]
    means = class_means(table_views(rows)[0])
    assert list(means) == ["owl", "cat", "dog"]
    assert means.to_numpy().tolist() == [[0.25, 0.5, 1.0]]


def test_classes_are_those_of_all_folds_that_every_row_ranks_averaged_over_trainings():
    folds = {"fold 0": ["ann", "bob"] * 2, "fold 1": ["cat", "dog"] * 2}
    common = {"dataset": SYNTHETIC_HUMANS[0], "input_": "view"}
    rows = [
        record("gps", 0.5, fold=fold, labels=labels, **common) for fold, labels in folds.items()
    ]
    for name, score in (("learned", 0.5), ("learned[training_seed=1]", 0.7)):
        of_queries = rows[0].per_query | {"DCG": [score] * 4}
        rows.append(
            record(
                name,
                fold="fold 0",
                labels=folds["fold 0"],
                models=[],
                per_query=of_queries,
                **common,
            )
        )
    (view,) = table_views(rows, ["I-view"])
    means = class_means(view)
    assert sorted(means) == ["ann", "bob"]
    assert means.loc["Depth network, 128 px"].to_numpy() == pytest.approx([0.6, 0.6])
    assert sorted(class_means(table_views(rows[:2], ["I-view"])[0])) == ["ann", "bob", "cat", "dog"]


def test_below_eight_classes_a_score_has_no_interval_and_a_row_that_lacks_shapes_is_dim(tmp_path):
    few, many = ([f"s{k // 2}" for k in range(2 * n)] for n in (7, 8))
    assert "nominal 95 %:" not in pages(tmp_path, record(labels=few))["index.html"]
    lacks = record("identity", labels=many, unsupported=[("s00", "too thin")])
    text = pages(tmp_path, record(labels=many), lacks)["index.html"]
    assert "nominal 95 %:" in text
    rows = [
        re.search(rf"<tr>(?:(?!<tr).)*>{name}.*?</tr>", text, re.DOTALL)[0]
        for name in ("GPS", "Identity")
    ]
    assert [len(re.findall(r" other\b", row)) for row in rows] == [0, 4]


def test_a_map_has_shapes_apart_as_their_distances_say_and_a_ring_at_those_whose_match_is_wrong(
    monkeypatch,
):
    labels, places = (
        ["b", "a", "b", "a"],
        np.array([0.0, 9.0, 1.0, 2.4]),
    )  # the last one lies among the others
    apart = np.abs(places[:, None] - places)
    monkeypatch.setattr("benchmark.report.figures.read_distances", lambda folder, record: apart)
    (place,) = map_figure(table_views([record(labels=labels)])[0], StoredForms(None)).axes
    points, rings = place.collections[-1].get_offsets().data, place.lines[-1].get_xydata()
    assert rings.tolist() == points[[3]].tolist()
    between = np.linalg.norm(points[:, None] - points, axis=-1)
    assert between[0, 2] < between[2, 3] < between[0, 3] < between[3, 1] < between[0, 1]


def test_a_map_of_classes_with_long_names_has_room_for_its_points(monkeypatch):
    apart = np.abs(np.subtract.outer([0.0, 9.0, 1.0, 2.4], [0.0, 9.0, 1.0, 2.4]))
    monkeypatch.setattr("benchmark.report.figures.read_distances", lambda folder, record: apart)
    labels = [letter * 250 for letter in "abab"]
    figure = map_figure(table_views([record(labels=labels)])[0], StoredForms(None))
    assert figure_bytes(figure, ".svg")  # a warning of matplotlib is an error
    (place,) = figure.axes
    width = place.get_window_extent().width / figure.dpi
    assert width > 0.8 * figure.get_size_inches()[0]


def test_the_name_of_a_class_in_a_map_covers_no_point_that_has_room_beside_it():
    # The last point, of the class "b", lies where the name of the class "a" would stand.
    points = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 10.0], [1.01, 0.4]])
    place = Figure().subplots()
    _write_names(
        place, [_ClassName("a", 1.0, 0.0, "red"), _ClassName("b", 0.5, 10, "blue")], points
    )
    height = 0.055 * 10
    x, y = next(text.get_position() for text in place.texts if text.get_text() == "a")
    assert x == 1.0
    assert 0.6 * height < y - 0.4 < 2 * height


def test_a_figure_of_forms_has_a_column_a_method_and_a_row_a_pose(results, tmp_path):
    view, forms = table_views(results.records)[0], StoredForms(results.folder)
    figure = forms_figure(view, forms, ["thin0", "thin1", "thick0"])
    # GPS leaves the sign of an eigenfunction open. On a rod, rounding decides whether a form is the
    # mirror image of another one, and with a remark each of the two rows is .12 inches higher.
    has_remarks = any(place.texts for place in figure.axes)
    height = 2.29 if has_remarks else 2.05
    size = figure.get_size_inches().tolist()
    assert size == pytest.approx([5.1, height], abs=0.02)  # so three poses take less than 3
    heads = [place.get_title() for place in figure.axes[:6]]
    assert heads == [
        name
        for shape in ("thin", "thick")
        for name in (shape, "GPS", "Identity (no\ncanonical form)")
    ]
    assert len(figure.axes) == 2 * 6
    assert [len(place.images) for place in figure.axes[6:]] == [1, 1, 1, 0, 0, 0]
    write_figure(figure, tmp_path / "forms.png")
    picture = Image.open(tmp_path / "forms.png")
    assert picture.width == 300 * 5.1
    assert picture.getpixel((0, picture.height - 1))[3] == 0  # it is read on dark pages, too
    words = [place.title for place in figure.axes if place.get_title()]
    words += [text for place in figure.axes for text in place.texts]
    assert {text.get_bbox_patch().get_facecolor()[:3] for text in words} == {(1, 1, 1)}
    with pytest.raises(ConfigurationError, match="thin9"):
        forms_figure(view, forms, ["thin9"])


def test_forms_of_other_programs_are_drawn_too(results):
    job = results.job("gps", "rods")
    (of_gps,) = (each for each in results.records if each.key == job)
    other = replace(of_gps, method="external-other", title="Other", family="external")
    figure = forms_figure(table_views([other])[0], StoredForms(results.folder))
    assert [place.get_title() for place in figure.axes[:2]] == ["Shape", "Other"]


@pytest.mark.filterwarnings("error")
def test_a_map_of_one_shape_is_a_point():
    assert _positions(np.zeros((1, 1))).tolist() == [[0, 0]]


def test_pictures_without_words_stand_close_together():
    picture = np.zeros((4, 4))
    figure = grid([("", [picture, picture]), ("", [picture])], side=1.0)
    assert figure.get_size_inches().tolist() == [2.0, 2.0]


def test_the_nearer_of_two_surfaces_is_drawn():
    square = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], dtype=float)
    vertices = np.concatenate([square, square / 2 + [0, -1, 0]])  # a small one before a large one
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    picture = np.asarray(
        shaded(Mesh(vertices, faces), FRONT, 64, values=np.repeat([0.0, 1.0], 4))
    ).astype(int)
    middle, rim = picture[32, 32], picture[32, 8]
    assert middle[0] > middle[2]  # orange
    assert rim[2] > rim[0]  # blue
    assert picture[0, 0, 3] == 0


def test_some_shapes_of_some_classes_are_evenly_spaced():
    assert some_shapes(record(), 2, 3) == ["cat0", "cat1", "cat3", "owl8", "owl9", "owl11"]


def test_a_form_is_drawn_turned_as_its_shape_in_the_colours_of_its_parts():
    mesh = rod(0.1, 0.5)
    turned = mesh.with_vertices(mesh.vertices[:, [1, 2, 0]])
    picture, same = (
        mesh_picture(mesh, form).axes[1].images[0].get_array().astype(int)
        for form in (turned, mesh)
    )
    assert np.abs(picture - same).max() <= 2
    colours = picture.reshape(-1, 4)
    assert (colours[:, 2] > colours[:, 0] + 50).any()  # blue
    assert (colours[:, 0] > colours[:, 2] + 50).any()  # orange


def test_names_of_any_length_fit_above_retrieved_forms():
    name = "a-rather-long-class/standing-on-one-leg-and-waving"
    figure = retrieved_picture([("query\nnew.off", None), (f"1. {name}\nwoman-3\n.12", None)])
    figure.canvas.draw()
    side, tops = figure.bbox.width / 2, []
    for place in figure.axes:
        title = place.title.get_window_extent()
        assert title.width <= 1.05 * side  # letters are not equally wide
        tops.append(title.y1)
    assert max(tops) <= figure.bbox.height
    assert tops[0] == pytest.approx(tops[1], abs=2)


def test_the_object_in_a_depth_image_is_orange_and_its_surroundings_are_pale():
    depths = np.full((40, 30), 2.0)
    mask = np.zeros(depths.shape, dtype=bool)
    mask[10:30, 8:22] = True
    picture = (
        frame_picture(depths, mask, rod(0.1, 0.5), rod(0.1, 0.5)).axes[1].images[0].get_array()
    )
    colours = set(map(tuple, np.round(255 * picture.reshape(-1, 3)).astype(int).tolist()))
    assert {(238, 171, 113), (238, 238, 238)} <= colours
