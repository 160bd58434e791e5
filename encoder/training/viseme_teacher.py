"""The teacher of the audio encoder: a small causal viseme network, read from its ONNX file.

Used in training only, not shipped: model.onnx of sorche942/godot-openlipsync (MIT), after
KyuubiYoru/OpenLipSync (Apache-2.0), trained on LibriSpeech (CC BY 4.0).
"""

from pathlib import Path

import numpy as np
import soxr

from encoder.capture.speech.phones import PHONES
from sensors.types import InputError

VISEMES = (
    "sil", "PP", "FF", "TH", "DD", "kk", "CH", "SS", "nn", "RR", "aa", "E", "ih", "oh", "ou",
)  # fmt: skip
SOURCE = "godot-openlipsync (MIT), OpenLipSync (Apache-2.0), trained on LibriSpeech (CC BY 4.0)"
RATE, WINDOW, HOP, SIZE, BANDS = 16_000, 400, 160, 1024, 80
AGE_S = 0.0125  # a spectrum is centred in its window, half of which lies ahead
_PHONES = (
    "sil:pau hh|PP:p b m|FF:f v|TH:th dh|DD:t d|kk:k g ng|CH:ch jh sh zh|SS:s z|nn:n l|RR:r er|"
    "aa:aa ao ay ah|E:ae eh ey|ih:ih iy y ax|oh:ow oy uh|ou:aw uw w"
)
_VISEME = {
    phone: VISEMES.index(viseme)
    for viseme, _, phones in (row.partition(":") for row in _PHONES.split("|"))
    for phone in phones.split()
}
VISEME_OF_PHONE = np.array([_VISEME[phone] for phone in PHONES])


def _bank() -> np.ndarray:  # [513, 80], triangles of height 1 from 50 Hz to 8 kHz
    low, high = (2595 * np.log10(1 + f / 700) for f in (50, 8000))
    edges = 700 * (10 ** (np.linspace(low, high, BANDS + 2) / 2595) - 1)
    hz = np.linspace(0, RATE / 2, SIZE // 2 + 1)[:, None]
    up, down = (hz - edges[:-2]) / np.diff(edges)[:-1], (edges[2:] - hz) / np.diff(edges)[1:]
    return np.clip(np.minimum(up, down), 0, None)


class VisemeTeacher:
    def __init__(self, path: Path) -> None:
        from encoder.nn.onnx_session import session

        if not Path(path).is_file():
            raise InputError(f"--teacher {path}: expected the viseme network's file, found none")
        self.session = session(Path(path))
        self.bank, self.window = _bank(), np.hanning(WINDOW + 1)[:WINDOW]

    def spectra(self, sound: np.ndarray) -> np.ndarray:  # [n] at 16 kHz -> [T, 80] dB
        padded = np.pad(sound, WINDOW // 2)
        windows = np.lib.stride_tricks.sliding_window_view(padded, WINDOW)[::HOP] * self.window
        power = np.abs(np.fft.rfft(windows, SIZE)) ** 2 @ self.bank
        level = 10 * np.log10(np.maximum(power, 1e-10))
        return np.maximum(level, level.max() - 80).astype(np.float32)

    def probabilities(self, audio: np.ndarray, rate: int, times: np.ndarray) -> np.ndarray:
        """Sound [n] at `rate` -> viseme probabilities [T, 15]: the newest available at each of
        `times` [T], in seconds."""
        spectra = self.spectra(soxr.resample(audio.astype(np.float32), rate, RATE))
        (logits,) = self.session.run(["viseme_logits"], {"audio_features": spectra[None]})
        newest = np.floor((times - AGE_S) * RATE / HOP + 1e-6).astype(int)
        logits = logits[0, np.clip(newest, 0, len(spectra) - 1)]
        return 1 / (1 + np.exp(-logits.astype(np.float32)))
