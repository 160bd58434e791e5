"""A checkpoint in fairseq's layout, imported, against a plain reading of the published network."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor
from torch.nn import functional

from encoder.audio.config import PRESETS, AudioEncoderConfig
from encoder.audio.wav2vec_import import import_wav2vec, read_fairseq
from sensors.types import InputError

WIDTH = 16
SMALL = replace(
    PRESETS["paper"],
    layers=tuple((WIDTH, kernel, stride) for _, kernel, stride in PRESETS["paper"].layers),
    first_norm="frozen",
)


def fairseq_tensors(config: AudioEncoderConfig) -> dict[str, Tensor]:
    """Random weights under the names that fairseq's wav2vec writes."""
    generator = torch.Generator().manual_seed(0)
    tensors, channels = {}, 1

    def norm(name: str) -> None:
        tensors[f"{name}.weight"] = 1 + 0.2 * torch.randn(WIDTH, generator=generator)
        tensors[f"{name}.bias"] = 0.2 * torch.randn(WIDTH, generator=generator)

    def conv(name: str, channels: int, kernel: int) -> None:
        weight = torch.randn(WIDTH, channels, kernel, generator=generator)
        tensors[f"{name}.weight"] = weight / (channels * kernel) ** 0.5

    for i, (_, kernel, _) in enumerate(config.layers):
        conv(f"feature_extractor.conv_layers.{i}.0", channels, kernel)
        norm(f"feature_extractor.conv_layers.{i}.2")
        channels = WIDTH
    for i, (kernel, _) in enumerate(config.context):
        name = f"feature_aggregator.conv_layers.{i}.1"
        conv(name, WIDTH, kernel)
        tensors[f"{name}.bias"] = 0.1 * torch.randn(WIDTH, generator=generator)
        norm(f"feature_aggregator.conv_layers.{i}.3")
    tensors["wav2vec_predictions.project_to_steps.weight"] = torch.zeros(WIDTH, WIDTH, 1, 12)
    return tensors


def plain_wav2vec(tensors: dict[str, Tensor], x: Tensor) -> Tensor:
    """The published network: unpadded convolutions, norms over the whole clip. x [T] -> [n, C]."""
    y = x[None, None]
    for i, stride in enumerate((5, 4, 2, 2, 2, 1, 1)):
        name = f"feature_extractor.conv_layers.{i}"
        y = functional.conv1d(y, tensors[f"{name}.0.weight"], stride=stride)
        weight, bias = tensors[f"{name}.2.weight"], tensors[f"{name}.2.bias"]
        y = functional.relu(functional.group_norm(y, 1, weight, bias))
    y = (y.abs() + 1).log()
    for i, kernel in enumerate(range(2, 14)):
        name = f"feature_aggregator.conv_layers.{i}"
        z = functional.pad(y, (kernel - 1, 0), mode="replicate")
        z = functional.conv1d(z, tensors[f"{name}.1.weight"], tensors[f"{name}.1.bias"])
        weight, bias = tensors[f"{name}.3.weight"], tensors[f"{name}.3.bias"]
        y = (functional.relu(functional.group_norm(z, 1, weight, bias)) + y) * 0.5**0.5
    return y[0].T


def sound(seconds: float) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    x = torch.randn(int(16_000 * seconds), generator=generator)
    return 0.1 * x * (1 + torch.sin(torch.arange(len(x)) / 1500))


def test_equals_the_published_network_where_statistics_agree() -> None:
    """Ours: feature j ends at sample 160 (j + 1); theirs: feature k ends at 160 k + 465, so a clip
    with 305 samples put in front has the same grid. Frozen whole-clip statistics differ from
    theirs only by the start (29 ms of extractor, 0.8 s of aggregator), hence the loose bound.
    """
    x = sound(40.0)
    tensors = fairseq_tensors(SMALL)
    encoder = import_wav2vec(tensors, x[None], SMALL)
    with torch.no_grad():
        ours = encoder(x[None, :, None])[0]
        theirs = plain_wav2vec(tensors, torch.cat([torch.zeros(305), x]))
    assert len(ours) == len(theirs) == 4000
    error = (ours[100:] - theirs[100:]).norm() / theirs[100:].norm()
    assert error < 0.01, f"relative L2 {error:.4f}"
    shifted = (ours[101:] - theirs[100:-1]).norm() / theirs[101:].norm()
    assert shifted > 20 * error  # one feature late would be seen


def test_reads_the_file_and_rejects_others(tmp_path: Path) -> None:
    path = tmp_path / "wav2vec_small.pt"
    tensors = fairseq_tensors(SMALL)
    torch.save({"args": argparse.Namespace(arch="wav2vec"), "model": tensors}, path)
    assert read_fairseq(path).keys() == tensors.keys()
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(InputError, match="expected a fairseq wav2vec checkpoint"):
        read_fairseq(path)
    del tensors["feature_aggregator.conv_layers.3.1.weight"]
    with pytest.raises(InputError, match="context_convs.3.weight"):
        import_wav2vec(tensors, sound(2.0)[None], SMALL)


def test_real_size_has_the_published_parameters() -> None:
    with torch.device("meta"):
        from encoder.audio.encoder import AudioEncoder

        encoder = AudioEncoder(PRESETS["paper"])
    assert round(sum(p.numel() for p in encoder.parameters()) / 1e6, 1) == 29.4
