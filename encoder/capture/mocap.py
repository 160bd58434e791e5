"""Import real recordings: talking-head video labels (GRID) and plain speech.

GRID labels are a face tracker's ARKit weights at 25 FPS. Only the mouth is taken: the tracker's
blinks also rise when a person looks down, so lids, gaze and brows stay rule-made.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import soundfile
import soxr

from encoder.capture.channels import (
    JAW_OPEN,
    MOUTH_CLOSE,
    RIG_INDEX,
    RIG_NAMES,
    SPEECH_COLUMNS,
    from_arkit,
)
from encoder.capture.dataset import Clip, make_clip
from encoder.capture.motion import closing_weight, frame_times, upper_face
from sensors.types import SAMPLE_RATE, SAMPLES_PER_FRAME, InputError

_ALIGNMENT_RATE = 25_000
_JAW_LOUD = 0.34  # every speaker's 98th percentile of jawOpen is scaled to this
# Channels whose tracker output says little about the lips (it drifts with the head)
_IGNORED = ("jawLeft", "jawRight", "mouthLeft", "mouthRight", "jawForward")


def read_audio(path: Path) -> np.ndarray:
    """[n] float32 mono at 48 kHz."""
    audio, rate = soundfile.read(path, dtype="float32", always_2d=True)
    return soxr.resample(audio.mean(1), rate, SAMPLE_RATE).astype(np.float32)


def _words(folder: Path) -> dict[str, tuple[float, float]]:
    """Clip -> seconds of the first word's start and the last word's end."""
    spans = {}
    for line in (folder / "alignments.tsv").read_text().splitlines()[1:]:
        clip, _, intervals = line.partition("\t")
        rows = [part.split() for part in intervals.split(";") if part.strip()]
        spoken = [(int(a), int(b)) for a, b, word in rows if word not in ("sil", "sp")]
        if spoken:
            spans[clip] = (spoken[0][0] / _ALIGNMENT_RATE, spoken[-1][1] / _ALIGNMENT_RATE)
    return spans


def _speaker_curves(weights: np.ndarray, names: list[str]) -> np.ndarray:
    """One speaker's [N, T, 52] weights -> [N, T, 53] with the neutral taken off and scaled."""
    curves = from_arkit(weights.reshape(-1, weights.shape[-1]).astype(np.float32), names)
    mouth = np.zeros_like(curves)
    columns = [c for c in SPEECH_COLUMNS if RIG_NAMES[c] not in _IGNORED]
    neutral = np.nanquantile(curves[:, columns], 0.12, axis=0)
    mouth[:, columns] = np.clip(curves[:, columns] - neutral, 0, 1)
    gain = _JAW_LOUD / max(float(np.nanquantile(mouth[:, JAW_OPEN], 0.98)), 0.05)
    mouth *= np.clip(gain, 0.5, 2.5)
    return mouth.reshape(*weights.shape[:2], len(RIG_NAMES))


def grid_clips(folder: Path, test: set[str], drop: set[str]) -> Iterator[Clip]:
    """Clips of a GRID folder; `test` and `drop` name speakers or clips. Clips without a face skip.

    Outside the words the mouth fades to rest: the tracker's open lips there are breathing.
    """
    folder = Path(folder)
    if not (folder / "labels.npz").is_file():
        raise InputError(f"GRID folder {folder}: expected labels.npz, found none; check the path")
    with np.load(folder / "labels.npz", allow_pickle=False) as data:
        weights, names = data["weights"], [str(name) for name in data["names"]]
        clips, fps = [str(clip) for clip in data["clips"]], int(data["fps"])
        speakers = [str(s) for s in data["speakers"]] if "speakers" in data else ["s1"] * len(clips)
    spans = _words(folder)
    for speaker in sorted(set(speakers) - drop):
        chosen = [i for i, name in enumerate(speakers) if name == speaker]
        curves = _speaker_curves(weights[chosen], names)
        for index, curve in zip(chosen, curves, strict=True):
            if clips[index] not in spans or np.isnan(curve).any():
                continue
            audio = read_audio(folder / "audio" / f"{clips[index]}.ogg")
            split = "test" if {speaker, clips[index]} & test else "train"
            yield _grid_clip(audio, curve, fps, spans[clips[index]], f"grid-{speaker}", split)


def _grid_clip(
    audio: np.ndarray,
    curve: np.ndarray,
    fps: int,
    span: tuple[float, float],
    voice: str,
    split: str,
) -> Clip:
    times = frame_times(len(audio) // SAMPLES_PER_FRAME)
    source = np.arange(len(curve)) / fps
    rig = np.stack([np.interp(times, source, column) for column in curve.T], 1)
    outside = np.maximum((span[0] - 0.12 - times) / 0.12, (times - span[1] - 0.12) / 0.15)
    inside = 0.5 + 0.5 * np.cos(np.pi * np.clip(outside, 0, 1))
    rig = (rig * inside[:, None]).astype(np.float32)
    rig[:, MOUTH_CLOSE] = np.minimum(rig[:, MOUTH_CLOSE], closing_weight(rig))
    upper, gaze = upper_face(rig[:, JAW_OPEN] / _JAW_LOUD, np.random.default_rng(len(audio)))
    phones = np.where(inside > 0, -1, 0)
    return make_clip(audio, rig + upper, gaze, phones, truth="tracked", voice=voice, split=split)


def envelope_curves(audio: np.ndarray) -> np.ndarray:
    """[n] speech at 48 kHz -> rule-made [T, 53]: only jawOpen, from the voiced-band loudness.

    Stands in for truth where real voices have none: it teaches who is speaking loudly, not what.
    """
    from scipy.signal import butter, sosfiltfilt

    num_frames = len(audio) // SAMPLES_PER_FRAME
    band = butter(2, (250, 3000), "bandpass", fs=SAMPLE_RATE, output="sos")
    power = sosfiltfilt(band, audio.astype(np.float64)) ** 2
    smooth = sosfiltfilt(butter(2, 9, fs=SAMPLE_RATE, output="sos"), power).clip(1e-10)
    last = np.minimum((frame_times(num_frames) * SAMPLE_RATE).astype(int), len(audio) - 1)
    level_db = 10 * np.log10(smooth[last])
    loud, floor = np.quantile(level_db, 0.97), np.quantile(level_db, 0.05)
    quiet = max(loud - 32, floor + 6)
    height = np.clip((level_db - quiet) / max(loud - quiet, 8), 0, 1.1)
    curves = np.zeros((num_frames, len(RIG_NAMES)), np.float32)
    curves[:, RIG_INDEX["jawOpen"]] = 0.34 * height**1.7
    return curves


def speech_clip(path: Path, voice: str, split: str = "train") -> Clip:
    """A recording of real speech without motion -> a clip whose jaw follows its loudness."""
    audio = read_audio(path)
    rig = envelope_curves(audio)
    upper, gaze = upper_face(rig[:, JAW_OPEN] / 0.34, np.random.default_rng(len(audio)))
    unknown = np.full(len(rig), -1)
    return make_clip(audio, rig + upper, gaze, unknown, truth="envelope", voice=voice, split=split)
