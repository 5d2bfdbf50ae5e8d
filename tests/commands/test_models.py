"""``models fetch``: published models come from a folder or a server, whole and unchanged, or are
named.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from benchmark.commands import models
from benchmark.commands.models import fetch_models
from benchmark.protocols.models import MODELS_VARIABLE
from tests.verbs import call, refusal

#: What a server answers in place of a file: status, announced length, content.
Answers = dict[str, tuple[int, int | None, bytes]]

FILES = {
    f"{model}/{name}": f"{name} of {model}".encode()
    for model in ("people-fold-0/literal-seed0", "people-fold-0/literal-seed1", "animals/one")
    for name in ("weights.safetensors", "card.json")
}
FIRST = "people-fold-0/literal-seed0"


@pytest.fixture(autouse=True)
def target(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The folder of the models, where nothing is yet; the published ones are those above."""
    digests = {path: hashlib.sha256(content).hexdigest() for path, content in FILES.items()}
    monkeypatch.setattr(models, "published_files", lambda: digests)
    names = dict.fromkeys(path.rpartition("/")[0] for path in FILES)
    monkeypatch.setattr(models, "published_models", lambda: list(names))
    monkeypatch.setenv(MODELS_VARIABLE, str(tmp_path / "models"))
    return tmp_path / "models"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder with all models."""
    for path, content in FILES.items():
        file = tmp_path / "checkout" / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    return tmp_path / "checkout"


@pytest.fixture
def odd() -> Answers:
    """What the server answers for some files, instead of them."""
    return {}


@pytest.fixture
def server(odd: Answers) -> Iterator[str]:
    """The address of a server on this machine that has all models."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            path = self.path.removeprefix("/models/")
            content = FILES.get(path)
            status, length, body = 200, len(content or b""), content or b""
            if path in odd:
                status, length, body = odd[path]
            elif content is None:
                status = 404
            self.send_response(status)
            if length is not None:
                self.send_header("Content-Length", str(length))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            pass

    serving = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=serving.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{serving.server_port}/models"
    serving.shutdown()
    serving.server_close()
    thread.join()


def files_in(folder: Path) -> dict[str, bytes]:
    every = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in every}


def test_a_folder_and_a_server_give_the_same_models(checkout, server, target, monkeypatch):
    assert "3 models fetched into" in call("models", "fetch", "--from", checkout)
    assert files_in(target) == FILES
    monkeypatch.setenv(MODELS_VARIABLE, str(target.with_name("others")))
    assert "3 models fetched into" in call("models", "fetch", "--from", f"{server}/")
    assert files_in(target.with_name("others")) == FILES


def test_a_training_and_a_model_can_be_named_and_what_is_there_is_not_read_again(server, target):
    fetched = fetch_models(server, [FIRST])
    assert (fetched.fetched, fetched.present) == ((FIRST,), ())
    fetched = fetch_models(server, "people-fold-0")
    assert (fetched.fetched, fetched.present) == (("people-fold-0/literal-seed1",), (FIRST,))
    assert "animals" not in {path.name for path in target.iterdir()}


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        ((404, 0, b""), "the server answers 404"),
        ((200, 100, b"short"), "it ended after 5 of 100 bytes; fetch again"),
        ((200, None, b"short"), "weights.safetensors has SHA-256 f9b0078b5df5..., and the"),
        ((200, 4, b"fake"), "weights.safetensors has SHA-256 b5d54c39e666..., and the"),
    ],
)
def test_a_file_that_is_not_the_published_one_is_named_and_not_kept(
    server, odd, target, answer, reason
):
    odd[f"{FIRST}/weights.safetensors"] = answer
    said = call("models", "fetch", "--from", server, code=1)
    assert f"{FIRST}: " in said
    assert reason in said
    assert "2 models fetched" in said and "1 not fetched" in said
    assert FIRST not in {path.rpartition("/")[0] for path in files_in(target)}


def test_a_server_without_end_is_left(server, odd, target, monkeypatch):
    monkeypatch.setattr(models, "LARGEST_MODEL_FILE", 1000)
    odd[f"{FIRST}/weights.safetensors"] = (200, None, b"0" * 5000)
    problems = fetch_models(server, [FIRST]).problems
    assert "holds more than 1,000 bytes" in problems[FIRST]
    monkeypatch.setattr(models, "LARGEST_MODEL_FILE", 10_000)
    monkeypatch.setattr(models, "LONGEST_DOWNLOAD", 0.0)
    assert "takes more than 0 s" in fetch_models(server, [FIRST]).problems[FIRST]
    assert not target.exists()


def test_a_card_is_the_last_file_so_that_no_half_model_counts(server, odd, target):
    odd[f"{FIRST}/card.json"] = (500, 0, b"")
    assert "500" in fetch_models(server, [FIRST]).problems[FIRST]
    assert files_in(target).keys() == {f"{FIRST}/weights.safetensors"}
    odd.clear()
    assert fetch_models(server, [FIRST]).fetched == (FIRST,)


def test_another_file_in_its_place_stays(checkout, target):
    own = target / FIRST / "card.json"
    own.parent.mkdir(parents=True)
    own.write_bytes(b"trained here")
    said = call("models", "fetch", "--from", checkout, FIRST, code=1)
    assert "card.json is another file, which stays; remove it first" in said
    assert own.read_bytes() == b"trained here"


def test_what_is_no_source_is_refused(tmp_path, checkout):
    assert "is not a folder; name learned/models of a checkout" in refusal(
        "models", "fetch", "--from", tmp_path / "nothing"
    )
    assert "use http:// or https://" in refusal("models", "fetch", "--from", "file:///etc")
    assert "people-fold-0" in refusal("models", "fetch", "--from", checkout, "people-fold-7")
    call("models", "fetch", code=2)


def test_a_server_that_is_not_there_is_named():
    problems = fetch_models("http://127.0.0.1:9/models", ["animals"]).problems
    assert "Connection refused" in problems["animals/one"]


def test_a_folder_that_cannot_be_written_is_named(checkout, target, monkeypatch):
    target.write_text("a file")
    said = refusal("models", "fetch", "--from", checkout)
    assert f"name a folder of yours in {MODELS_VARIABLE}" in said


@pytest.mark.parametrize("place", ["people-fold-0", FIRST, f"{FIRST}/weights.safetensors"])
def test_what_stands_in_the_place_of_a_model_costs_no_other_one(checkout, target, place):
    odd = target / place
    odd.parent.mkdir(parents=True)
    if odd.suffix:
        odd.mkdir()
    else:
        odd.write_text("a file where a folder should be")
    said = call("models", "fetch", "--from", checkout, code=1)
    assert f"{FIRST}: " in said
    assert "remove" in said
    assert "animals" in {path.name for path in target.iterdir()}
    assert odd.exists()


def test_a_file_is_no_folder_of_models(checkout, target):
    target.write_text("")
    said = call("models", "fetch", "--from", checkout, code=2)
    assert f"{target} is not a folder" in said
