"""Forced alignment: text and a real recording -> timed phones, as pseudo-truth for real voices.

English by pocketsphinx and its bundled model (median error about 10 ms against synthetic truth);
other languages by speaking the text with espeak-ng and warping its sound onto the recording
(median 16-19 ms).
"""

import re

import numpy as np
import soxr
from scipy.fft import dct

from encoder.capture.speech.phones import Phone, Speech, from_festival
from encoder.capture.speech.synthesis import Espeak
from sensors.types import SAMPLE_RATE

_RATE = 16_000
_HOP_S = 0.01


class EnglishAligner:
    """pocketsphinx with its own acoustic model and dictionary; one per process."""

    def __init__(self) -> None:
        from pocketsphinx import Decoder

        self._make = lambda **settings: Decoder(samprate=_RATE, loglevel="FATAL", **settings)
        self._decoders = [self._make(), self._make(bestpath=False, beam=1e-80, wbeam=1e-60)]

    def align(self, audio: np.ndarray, text: str) -> list[Phone] | None:
        """audio [n] at 48 kHz; None if a word is unknown or no path was found."""
        words = [w.strip("'") for w in re.findall(r"[a-z']+", text.lower())]
        words = [w for w in words if w]
        if not words or any(self._decoders[0].lookup_word(w) is None for w in words):
            return None
        sound = soxr.resample(audio, SAMPLE_RATE, _RATE)
        pcm = np.clip(sound * 32767, -32768, 32767).astype(np.int16).tobytes()
        for decoder in self._decoders:
            try:
                return _align(decoder, pcm, " ".join(words))
            except RuntimeError:  # its second pass fails on some recordings
                continue
        return None


def _align(decoder, pcm: bytes, text: str) -> list[Phone]:
    decoder.set_align_text(text)
    decoder.start_utt()
    decoder.process_raw(pcm, full_utt=True)
    decoder.end_utt()
    decoder.set_alignment()  # a second pass, from words to phones
    decoder.start_utt()
    decoder.process_raw(pcm, full_utt=True)
    decoder.end_utt()
    phones = []
    for word in decoder.get_alignment():
        for phone in word:
            start = phone.start * _HOP_S
            name = from_festival(phone.name.lower())
            phones.append(Phone(name, start, start + phone.duration * _HOP_S))
    if not phones:
        raise RuntimeError("no path")
    return phones


def _cepstra(audio: np.ndarray) -> np.ndarray:
    """[n] at 48 kHz -> [T, 13] every 10 ms, each coefficient normalised over the recording."""
    sound = soxr.resample(audio, SAMPLE_RATE, _RATE)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(sound, 200), 400)[::160]
    power = np.abs(np.fft.rfft(windows * np.hanning(400), 512)) ** 2
    mel = np.linspace(0, 2595 * np.log10(1 + 4000 / 700), 28)
    edges = 700 * (10 ** (mel / 2595) - 1)
    hz = np.linspace(0, _RATE / 2, 257)[:, None]
    up, down = (hz - edges[:-2]) / np.diff(edges)[:-1], (edges[2:] - hz) / np.diff(edges)[1:]
    bands = np.log(power @ np.clip(np.minimum(up, down), 0, None) + 1e-8)
    cepstra = np.asarray(dct(bands, axis=1, norm="ortho"))[:, :13]
    return (cepstra - cepstra.mean(0)) / (cepstra.std(0) + 1e-6)


def warp(made: np.ndarray, real: np.ndarray) -> np.ndarray:
    """Cepstra [M, D] and [R, D] -> for each frame of `made` its frame in `real`, increasing.

    Steps (1,1), (1,2), (2,1): tempo between a half and the double.
    """
    cost = np.linalg.norm(made[:, None] - real[None], axis=-1)
    rows, columns = cost.shape
    total = np.full((rows, columns), np.inf)
    step = np.zeros((rows, columns), np.int8)
    total[0, : max(2, columns // 10)] = cost[0, : max(2, columns // 10)]
    shift = lambda row, by: np.concatenate([np.full(by, np.inf), row[:-by]])  # noqa: E731
    for i in range(1, rows):
        options = np.stack([
            shift(total[i - 1], 1), shift(total[i - 1], 2) + 0.3,
            (shift(total[i - 2], 1) if i > 1 else np.full(columns, np.inf)) + cost[i] * 0.5,
            total[i - 1] + 1.0 + 0.5 * cost[i],
        ])  # fmt: skip
        step[i] = options.argmin(0)
        total[i] = options.min(0) + cost[i]
    i, j = (
        rows - 1,
        int(total[-1, -max(2, columns // 10) :].argmin()) + columns - max(2, columns // 10),
    )
    where = np.zeros(rows)
    where[i] = j
    while i > 0:
        kind = step[i, j]
        if kind == 2 and i > 1:
            where[i - 1] = j - 0.5
            i, j = i - 2, j - 1
        else:
            i, j = i - 1, j - (1, 2, 0, 0)[kind]
        j = max(j, 0)
        where[i] = j
    return np.maximum.accumulate(where)


def align_by_espeak(audio: np.ndarray, text: str, language: str, espeak: Espeak) -> list[Phone]:
    """audio [n] at 48 kHz; espeak-ng's phones at the times where the recording sounds alike."""
    loud = np.flatnonzero(np.abs(audio) > 0.02 * np.abs(audio).max())
    begin, end = int(loud[0]), int(loud[-1]) + 1
    voiced_s = (end - begin) / SAMPLE_RATE
    made: Speech = espeak.speak(text, language, 165, formants=1.0)
    tempo = (len(made.audio) / SAMPLE_RATE) / voiced_s
    made = espeak.speak(text, language, int(np.clip(165 * tempo, 90, 300)))
    where = warp(_cepstra(made.audio), _cepstra(audio[begin:end]))
    at = np.arange(len(where)) * _HOP_S
    offset = begin / SAMPLE_RATE

    def moved(time: float) -> float:
        return offset + float(np.interp(time, at, where)) * _HOP_S

    phones = [Phone(p.name, moved(p.start), moved(p.end)) for p in made.phones]
    return [p for p in phones if p.end > p.start]
