"""The direct path and the contact head in the stage "listen", and what their parts are charged for.

The parts are the network of the mouth, what hears voices, and the contact head (listen.py).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from encoder.audio.config import AudioEncoderConfig
from encoder.capture.speech.phones import LIP_CLOSING, PHONE_INDEX
from encoder.denoiser.config import LIPS, MOUTH
from encoder.denoiser.contact import Contact
from encoder.denoiser.direct import Direct
from encoder.denoiser.model import Denoiser
from encoder.training import touches
from encoder.training.mouth import Mouth
from encoder.training.stages.contact import fold_scale, new_head
from encoder.training.stages.listen_config import ListenConfig
from encoder.training.streams.lip_lines import LipLines
from encoder.training.streams.pieces import SpokenPieces, phone_weights

SAMPLES = 20_000  # frames that scales are measured on
Batch = tuple[Tensor, ...]  # as SpokenPieces draws it


@dataclass(frozen=True)
class Listener:
    """The direct path and the contact head in training, and the frozen chain before them."""

    direct: Direct
    contact: Contact
    student: Denoiser
    mouth: Mouth
    scale: tuple[Tensor, Tensor]  # mean and spread of log-odds and of their sigmoids
    lines: LipLines
    share: Tensor  # [MOUTH, MOUTH]: what is the blocks', the rest is the path's
    mix: Tensor  # [MOUTH, MOUTH]: gains
    rarity: Tensor  # [P + 1] weight of a frame by its phone; the last: not known

    @property
    def parts(self) -> dict[str, dict[str, nn.Module]]:
        """What each part trains."""
        path, voice = self.direct, ("hear", "voice")
        mouth = {name: module for name, module in path.named_children() if name not in voice}
        heard = {name: path.get_submodule(name) for name in voice}
        return {"mouth": mouth, "voice": heard, "contact": {"contact": self.contact}}

    def mouth_losses(self, batch: Batch, config: ListenConfig) -> dict[str, Tensor]:
        """Of the network alone, without the blocks and the lines."""
        heard, _, truth, phones, _, there = batch
        dropped = functional.dropout(self._seen(heard), config.drop_heard)
        said = self.direct.said(dropped, config.drop)
        off = self.mouth.vertices(said - truth) * there[..., None]
        spans = self.mouth.spans(said - truth) * there[..., None]
        count, rare = there.sum(), self.rarity[phones][..., None]
        result = {
            "shape": (off.square() * rare).sum() / count,
            "velocity": off.diff(dim=1).square().sum() / count,
            "span": (spans.square() * rare).sum() / count,
            "tongue": self._tongue(said - truth, phones, there),
        }
        rolls = said @ self.mouth.roll, truth @ self.mouth.roll
        result |= touches.tucking(*rolls, phones, there, self.rarity)
        return _with_total(result, config)

    def voice_losses(self, batch: Batch, config: ListenConfig) -> dict[str, Tensor]:
        heard, _, _, _, voiced, there = batch
        plain = self._seen(heard)[..., : heard.shape[-1]]
        odds = self.direct.voiced(functional.dropout(plain, config.drop_voice))[..., 0]
        sides = [there * (voiced == side) for side in (0, 1)]
        off = functional.binary_cross_entropy_with_logits(odds, voiced.clamp(0), reduction="none")
        rest, voice = ((off * side).sum() / side.sum().clamp(min=1) for side in sides)
        return _with_total({"voice": rest + config.heard_weight * voice}, config)

    def contact_losses(self, batch: Batch, config: ListenConfig) -> dict[str, Tensor]:
        """Behind the path, frozen and without dropout, before the head leaves alone lips that are
        far apart: it would push against that, and lips of made speech end 2 % farther from the
        truth."""
        heard, own, truth, phones, _, there = batch
        seen = self._seen(heard)
        plain = seen[..., : heard.shape[-1]]
        with torch.no_grad():
            lined = self.lines.beside(self.direct.said(seen), seen)
            mixed = lined + (own - lined) @ self.share
            voice = self.direct.voiced(plain).sigmoid()
            shown = voice * (mixed @ self.mix)
            x0 = self.student.standardise(self.mouth.codes(shown))
        moved = (voice * self.contact.wanted_mm(self.contact.gap_mm(x0), plain))[..., 0]
        gaps = self.mouth.gap(shown) + moved, moved, self.mouth.gap(truth)
        return _with_total(touches.meeting(*gaps, phones, there, self.rarity), config)

    def _seen(self, heard: Tensor) -> Tensor:
        """Log-odds [B, T, D] -> these and their sigmoids, standardised [B, T, 2 D]."""
        return (torch.cat([heard, heard.sigmoid()], -1) - self.scale[0]) / self.scale[1]

    def _tongue(self, error: Tensor, phones: Tensor, there: Tensor) -> Tensor:
        """Mean squared error of the raised tongue, where phones tell what it does."""
        known = there * (phones >= 0)
        off = (error @ self.mouth.tongue).square().sum(-1)
        return (off * known).sum() / known.sum().clamp(min=1)


def _with_total(losses: Mapping[str, Tensor], config: ListenConfig) -> dict[str, Tensor]:
    """The same and their weighted sum; "shape" and "voice", the first of their parts, have 1."""
    weights = {"shape": 1.0, "voice": 1.0}
    total = sum(
        (weights.get(name) or getattr(config, f"{name}_weight")) * value
        for name, value in losses.items()
    )
    return {**losses, "total": total}  # type: ignore[dict-item]


def new_listener(pieces: SpokenPieces, student: Denoiser, config: ListenConfig) -> Listener:
    """An untrained Listener, which changes nothing."""
    mouth = pieces.mouth
    every = max(len(pieces.frames.heard) // SAMPLES, 1)
    heard = torch.from_numpy(pieces.frames.heard[::every].astype(np.float32))
    seen = torch.cat([heard, heard.sigmoid()], -1)
    scale = seen.mean(0), seen.std(0) + 1e-2
    direct = Direct(heard.shape[1], student.config.expression_dim, config.hidden)
    contact = new_head(student, mouth.face, config.contact, heard.shape[1])
    truth = torch.from_numpy(pieces.truth[::every])
    share = mouth.stretched(truth, config.shares[:2], config.shares[2])
    mix = config.gain * mouth.stretched(truth, (1.0, config.width_gain))
    rarity = torch.from_numpy(phone_weights(pieces.frames.phones, config.balance))
    lines = LipLines.of(pieces, scale, config.lines)
    return Listener(direct, contact, student, mouth, scale, lines, share, mix, rarity)


@torch.no_grad()
def finish(listener: Listener, config: ListenConfig, told: Tensor) -> None:
    """In place: turn heads trained on standardised features and the mouth's numbers into the
    student's. told [3, D]: rows that take the log-odds of p, b and m out of what is heard."""
    direct, (mean, spread) = listener.direct, listener.scale
    dim = direct.hear.in_features
    listener.lines.fold(direct)
    for layer in (direct.listen, direct.straight):
        fold_scale(layer, mean, spread)
    for layer in (direct.hear, listener.contact.listen):
        fold_scale(layer, mean[:dim], spread[:dim])
    listener.contact.closures.copy_(told)
    slope, offset = config.gate
    direct.voice.weight.mul_(slope)
    direct.voice.bias.mul_(slope).add_(offset)
    shared = listener.share @ listener.mix
    said = listener.mix - shared
    for layer in (direct.move, direct.straight):
        layer.weight.copy_(said.T @ layer.weight)
        layer.bias.copy_(said.T @ layer.bias)
    student = listener.student
    read, write = (torch.from_numpy(a) for a in (listener.mouth.read, listener.mouth.write))
    direct.read.copy_(student.expression_std[:, None] * read)
    direct.rest.copy_(student.expression_mean @ read)
    direct.write.copy_(write / student.expression_std)
    direct.share.copy_(shared)
    assert direct.share.shape == (MOUTH, MOUTH)


def closures(phones: AudioEncoderConfig, heard: int) -> Tensor:  # [3, heard]
    """Rows that take the log-odds of p, b and m out of what is heard, the mean of a tick's newest
    features."""
    rows, newest = torch.zeros(LIPS, heard), phones.features_a_tick
    for row, name in zip(rows, LIP_CLOSING, strict=True):
        row[PHONE_INDEX[name] : newest * phones.feature_dim : phones.feature_dim] = 1 / newest
    return rows
