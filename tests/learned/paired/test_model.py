"""A model on disk: what is tested is what was saved, and anything else is refused with the hint."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from safetensors.torch import load, save

from benchmark.api.learning import CARD, WEIGHTS, read_card
from benchmark.errors import ConfigurationError
from learned.paired.card import _KINDS, LARGEST, network_of
from learned.paired.model import load_model, predict
from learned.paired.network import build
from tests.learned.toy import TINY

JSON = st.none() | st.booleans() | st.integers() | st.text(max_size=5) | st.lists(st.text(max_size=3), max_size=2)

IMAGE = torch.linspace(0, 1, 32 * 32).reshape(1, 32, 32)


@pytest.fixture
def copied(trained: Path, tmp_path: Path) -> Path:
    """A model that may be damaged."""
    return Path(shutil.copytree(trained, tmp_path / "model"))


def edit_card(folder: Path, edit: Callable[[dict[str, Any]], object]) -> None:
    card = json.loads((folder / CARD).read_text())
    edit(card)
    (folder / CARD).write_text(json.dumps(card))


def replace_weights(folder: Path, content: bytes) -> None:
    """Put other weights into a folder whose card names their digest."""
    (folder / WEIGHTS).write_bytes(content)
    edit_card(folder, lambda card: card.update(digest=hashlib.sha256(content).hexdigest()))


def test_predictions_are_those_of_the_weights_on_disk(trained: Path) -> None:
    network = build(TINY, seed=7)
    stored = load((trained / WEIGHTS).read_bytes())
    assert {tensor.dtype for tensor in stored.values()} == {torch.float16}
    network.load_state_dict({name: tensor.float() for name, tensor in stored.items()})
    network.double()  # as networks predict, so that forms are the same on every processor
    loaded, card = load_model(trained)
    assert card == read_card(trained)
    with torch.no_grad():
        torch.testing.assert_close(predict(loaded, IMAGE), network(IMAGE[None].double())[0])


def test_a_folder_whose_model_was_replaced_is_read_again(copied: Path) -> None:
    before = load_model(copied)[0]
    other = {name: tensor.half() for name, tensor in build(TINY, seed=5).state_dict().items()}
    replace_weights(copied, save(other))
    after = load_model(copied)[0]
    assert after is not before
    assert not torch.equal(predict(after, IMAGE), predict(before, IMAGE))


def test_one_wrong_bit_of_the_weights_is_found(copied: Path) -> None:
    content = bytearray((copied / WEIGHTS).read_bytes())
    content[-1] ^= 1
    (copied / WEIGHTS).write_bytes(content)
    with pytest.raises(ConfigurationError, match="its card says .*; fetch the file again or train the model again"):
        load_model(copied)


@pytest.mark.parametrize("name", [WEIGHTS, CARD])
def test_a_missing_file_is_named(copied: Path, name: str) -> None:
    (copied / name).unlink()
    with pytest.raises(ConfigurationError, match=f"{name} cannot be read.*; train the model again"):
        load_model(copied)


@pytest.mark.parametrize("text", ["{", "", "[]", "{}", '{"digest": 3}', "\u00e9"])
def test_a_card_that_is_none(copied: Path, text: str) -> None:
    (copied / CARD).write_text(text, encoding="latin-1")
    with pytest.raises(ConfigurationError, match=f"{CARD} .*; train the model again"):
        load_model(copied)


@pytest.mark.parametrize(
    ("field", "value"),
    [("width", "16"), ("width", 0), ("width", 10**9), ("architecture", "attentive"), ("short_range", 1), ("name", 3)],
)
def test_a_network_that_nobody_could_build_is_refused(copied: Path, field: str, value: object) -> None:
    edit_card(copied, lambda card: card["configuration"].update({field: value}))
    with pytest.raises(ConfigurationError, match=rf"says 'configuration\.{field}' is .*; train the model again"):
        load_model(copied)


@pytest.mark.parametrize("field", [name for name in _KINDS if name != "digest"])
def test_every_field_of_a_card_is_there_and_of_its_kind(copied: Path, field: str) -> None:
    edit_card(copied, lambda card: card.update({field: None}))
    with pytest.raises(ConfigurationError, match="train the model again"):
        load_model(copied)
    edit_card(copied, lambda card: card.pop(field))
    with pytest.raises(ConfigurationError, match="train the model again"):
        load_model(copied)


@given(st.data())
def test_whatever_stands_on_a_card_is_taken_or_refused_by_name(trained: Path, data: st.DataObject) -> None:
    card = read_card(trained)
    inner, name = card, data.draw(st.sampled_from(sorted(card)))
    if isinstance(card[name], dict) and card[name] and data.draw(st.booleans()):
        inner, name = card[name], data.draw(st.sampled_from(sorted(card[name])))
    inner[name] = data.draw(JSON)
    try:
        network = network_of(card, trained)
    except ConfigurationError as error:
        assert error.hint == "train the model again"
    else:
        assert 1 <= network.resolution <= LARGEST


@pytest.mark.parametrize(("field", "settled", "other"), [("convolutions_per_block", 1, 2), ("group_norm", False, True)])
def test_a_card_of_version_2_may_name_what_is_settled_now(copied: Path, field: str, settled: Any, other: Any) -> None:
    edit_card(copied, lambda card: card["configuration"].update({field: settled}))
    load_model(copied)
    edit_card(copied, lambda card: card["configuration"].update({field: other}))
    with pytest.raises(ConfigurationError, match=f"another kind of network: {field}"):
        load_model(copied)


def test_weights_of_another_width_belong_to_another_configuration(copied: Path) -> None:
    edit_card(copied, lambda card: card["configuration"].update(width=16))
    with pytest.raises(ConfigurationError, match="belong to another configuration than 'tiny'"):
        load_model(copied)


def test_weights_that_are_not_safetensors_are_damaged(copied: Path) -> None:
    replace_weights(copied, b"PK\x03\x04 a pickle in a zip")
    with pytest.raises(ConfigurationError, match="is damaged: .*; train it again"):
        load_model(copied)
