"""Free words become labels: by a CLIP model in a folder, once; then from the small file."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from encoder.emotion.control import Emotions
from encoder.emotion.text import clip_embed, nearest_labels, understood
from sensors.types import InputError

LABELS = ("happy", "sad", "angry")


def embed(texts: Sequence[str]) -> np.ndarray:
    """Two words in three directions: proud is mostly happy, a little angry."""
    rows = {"happy": [1, 0, 0], "sad": [0, 1, 0], "angry": [0, 0, 1], "proud": [0.71, 0, 0.705]}
    found = np.array([next(v for k, v in rows.items() if k in text) for text in texts], np.float32)
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def test_a_text_becomes_a_mixture_of_the_nearest_labels_and_is_kept(tmp_path: Path) -> None:
    cache = tmp_path / "new" / "words.json"
    said = understood("Proud:0.5", LABELS, lambda: embed, cache)
    mixture = Emotions(LABELS, np.zeros((3, 1, 1), np.float32)).mixture(said)
    assert mixture[0] > mixture[2] > 0.1 and mixture[1] == 0
    assert mixture.sum() == pytest.approx(0.5, abs=0.002)
    assert understood("proud:0.5", LABELS, None, cache) == said  # the model is not needed again
    cache.write_text("{")  # a broken cache is no cache
    assert understood("proud", LABELS, None, cache) == "proud"
    assert understood("proud:0.5", LABELS, lambda: embed, cache) == said
    cache.write_text(json.dumps({"proud": {"furious": 1.0}}))  # of other labels
    assert understood("proud:0.5", LABELS, lambda: embed, cache) == said


def test_shares_never_exceed_the_whole() -> None:
    for seed in range(50):
        rows = np.random.default_rng(seed).standard_normal((4, 512)).astype(np.float32)
        rows /= np.linalg.norm(rows, axis=1, keepdims=True)
        assert sum(nearest_labels("x", LABELS, lambda _, rows=rows: rows).values()) <= 1


@pytest.mark.parametrize("words", ["happy", "sad:0.3", "neutral", "happy+proud", "proud", ""])
def test_known_words_need_no_model_and_unknown_ones_pass(words: str, tmp_path: Path) -> None:
    assert understood(words, LABELS, None, tmp_path / "words.json") == words


@pytest.mark.slow
def test_a_folder_without_a_model_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a folder with a CLIP model"):
        clip_embed(tmp_path / "none")
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(InputError, match="expected a CLIP model"):
        clip_embed(tmp_path)


@pytest.mark.slow
def test_a_clip_model_from_a_folder(tmp_path: Path) -> None:
    """A tiny one with random weights: it loads, and texts become unit rows."""
    pytest.importorskip("transformers")
    from transformers import CLIPTextConfig, CLIPTextModelWithProjection

    letters = [chr(c) for c in range(ord("a"), ord("z") + 1)]
    tokens = [*letters, *(f"{c}</w>" for c in letters), "<|startoftext|>", "<|endoftext|>"]
    (tmp_path / "vocab.json").write_text(json.dumps({t: i for i, t in enumerate(tokens)}))
    (tmp_path / "merges.txt").write_text("#version: 0.2\n")
    config = CLIPTextConfig(
        vocab_size=len(tokens), hidden_size=32, intermediate_size=32, projection_dim=512,
        num_hidden_layers=1, num_attention_heads=2, bos_token_id=52, eos_token_id=53,
        pad_token_id=53,
    )  # fmt: skip
    CLIPTextModelWithProjection(config).save_pretrained(tmp_path)
    rows = clip_embed(tmp_path)(["a happy face", "sad"])
    assert rows.shape == (2, 512) and np.allclose(np.linalg.norm(rows, axis=1), 1, atol=1e-5)
    assert not np.allclose(rows[0], rows[1])
