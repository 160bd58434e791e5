"""Random changes of spectra: vocal tract, microphone, room, line and level.

The audio encoder's input is log spectra, so voices and rooms are changed on power spectra, a batch
at a time. Noise and other voices are added to the sound before (heard.py).
"""

import numpy as np
import torch
from torch import Tensor

from encoder.audio.spectrum import Spectrum

WARPS = np.linspace(0.85, 1.17, 17)  # of the vocal tract's length
PLAIN = 8  # index of no warp


def banks(spectrum: Spectrum) -> Tensor:  # [warps, bins, bands]
    return torch.from_numpy(np.stack([spectrum.config.bank(w) for w in WARPS])).float()


def augmented(power: Tensor, spectrum: Spectrum, banks: Tensor, rng: np.random.Generator) -> Tensor:
    """Power [B, N, bins] of noisy sound -> log spectra [B, N, bands], each row changed at
    random."""
    count = len(power)

    def some(share: float, values: np.ndarray, other: float) -> Tensor:  # [B, 1]
        return torch.from_numpy(np.where(rng.random(count) < share, values, other)).float()[:, None]

    octave = torch.from_numpy(np.log2(spectrum.config.hz() / 1000)).float()
    gain_db = _drawn(rng, -4, 4, count) * octave
    for _ in range(2):
        centre, width = _drawn(rng, -3, 3, count), _drawn(rng, 0.4, 1.5, count)
        gain_db = gain_db + _drawn(rng, -8, 8, count) * (-(((octave - centre) / width) ** 2)).exp()
    gain_db = gain_db * some(0.6, np.ones(count), 0.0)
    high = some(0.35, rng.uniform(np.log2(3.3), 3, count), 5.0)  # octaves over 1 kHz
    low = some(0.35, rng.uniform(-4, -1.5, count), -9.0)
    gain_db = gain_db - 36 * (octave - high).relu() - 24 * (low - octave).relu()
    power = power * (10 ** (gain_db / 10))[:, None]
    tail = some(0.35, 10 ** (rng.uniform(-14, -3, count) / 10), 0.0)
    power = power + _smeared(power, rng.uniform(8, 45, count)) * tail[..., None]
    lost = some(0.2, 10 ** (-rng.uniform(22, 40, count) / 10), 0.0)  # to a codec
    power = power + lost[..., None] * power.mean(-1, keepdim=True)
    warp = np.where(rng.random(count) < 0.35, PLAIN, rng.integers(len(WARPS), size=count))
    bands = torch.bmm(power, banks[torch.from_numpy(warp)])
    off = some(0.4, rng.normal(0, 1, count), 0.0)  # a gain that has not settled
    return spectrum.scaled(bands, peaks(spectrum, bands) + off[..., None])


def peaks(spectrum: Spectrum, bands: Tensor) -> Tensor:  # [B, N, bands] -> [B, N, 1]
    nothing = bands.new_zeros(len(bands), 1)
    return spectrum.gain(bands, nothing, nothing)[1]


def _drawn(rng: np.random.Generator, low: float, high: float, count: int) -> Tensor:  # [B, 1]
    return torch.from_numpy(rng.uniform(low, high, (count, 1))).float()


def _smeared(power: Tensor, hops: np.ndarray) -> Tensor:
    """Reverberation: exponential tails of `hops` [B] after every hop of [B, N, bins]."""
    place = torch.arange(power.shape[1])
    lag = (place[:, None] - place[None]).float()
    decay = torch.from_numpy(hops).float()[:, None, None]
    return torch.where(lag > 0, (-lag / decay).exp() / decay, 0.0) @ power
