"""fairseq wav2vec-large -> our AudioEncoder (paper section 4.3, appendix "audio encoders").

Only the feature extractor and the aggregator are used, 29.4 M parameters. fairseq normalises each
layer by the statistics of the whole clip, future included. Here those statistics are measured once
on calibration sound and frozen (layer 1 runs on the past), so the import needs some seconds of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from encoder.audio.config import PRESETS, AudioEncoderConfig
from encoder.audio.encoder import AudioEncoder, RunningNorm
from sensors.types import InputError


def read_fairseq(path: Path | str) -> dict[str, Tensor]:
    """The "model" tensors of a fairseq checkpoint file; nothing in it is executed."""
    import argparse
    import pickle

    try:
        with torch.serialization.safe_globals([argparse.Namespace]):
            checkpoint = torch.load(path, map_location="cpu", weights_only=True)
        tensors = checkpoint["model"]
    except (OSError, pickle.UnpicklingError, RuntimeError, KeyError, TypeError) as error:
        raise InputError(
            f"{path}: expected a fairseq wav2vec checkpoint (a dict with 'model'), got: "
            f"{str(error).splitlines()[0]}; download wav2vec_large.pt again"
        ) from error
    return dict(tensors)


def our_name(theirs: str) -> str | None:
    """feature_extractor.conv_layers.N = (conv 0, dropout 1, norm 2); the aggregator pads first:
    feature_aggregator.conv_layers.N = (pad 0, conv 1, dropout 2, norm 3)."""
    part, *rest = theirs.split(".")
    tables = {
        "feature_extractor": {"0": "convs", "2": "norms"},
        "feature_aggregator": {"1": "context_convs", "3": "context_norms"},
    }
    if part not in tables or len(rest) != 4 or rest[0] != "conv_layers":
        return None  # wav2vec_predictions: the training task, not used
    return f"{tables[part][rest[2]]}.{rest[1]}.{rest[3]}"


@torch.no_grad()
def import_wav2vec(
    tensors: Mapping[str, Tensor],
    calibration: Tensor,  # [B, T] 16 kHz sound, ideally minutes of speech
    config: AudioEncoderConfig = PRESETS["paper"],
) -> AudioEncoder:
    encoder = AudioEncoder(config).eval()
    target = encoder.state_dict()
    wanted = {name for name in target if name.endswith(("weight", "bias"))}
    named = {ours: tensor for name, tensor in tensors.items() if (ours := our_name(name))}
    odd = [n for n in wanted if n not in named or named[n].shape != target[n].shape]
    odd += [name for name in named if name not in wanted]
    if odd:
        raise InputError(
            f"wav2vec checkpoint: expected the layers of its config, got a difference at "
            f"{', '.join(sorted(odd)[:3])}; use wav2vec_large.pt"
        )
    encoder.load_state_dict({**target, **named})
    calibrate(encoder, calibration)
    return encoder


@torch.no_grad()
def calibrate(encoder: AudioEncoder, sound: Tensor) -> None:
    """Measure and freeze each norm's statistics, over channels and time, in the order of the flow.

    sound [B, T] at the encoder's rate. The same mode must make the features of training and live.
    """
    x = sound[:, None, : sound.shape[1] // encoder.block_size * encoder.block_size]
    for i, (conv, norm) in enumerate(encoder.layers()):
        y, _ = conv.step(x, conv.init_context(len(x)))
        if isinstance(norm, RunningNorm):
            norm.prior.copy_(torch.stack([y.mean(), y.square().mean()]))
            y, _ = norm.step(y, norm.init_statistics(len(x)))
        else:
            statistics = norm.state_dict()  # shares the norm's memory
            statistics["running_mean"].fill_(float(y.mean()))
            statistics["running_var"].fill_(float(y.var(correction=0)))
            y = norm(y)
        x = encoder.join(i, x, functional.relu(y))
