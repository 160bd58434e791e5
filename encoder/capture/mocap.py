"""Tracked and solved faces as subjects: talking-head labels (GRID) and solved captures (FACEGOOD).

GRID labels are a face tracker's ARKit weights at 25 FPS. Only the mouth is taken: the tracker's
blinks also rise when a person looks down, so lids, gaze and brows stay rule-made. Each speaker's
neutral is taken off and the jaw rescaled; two whose labels do not follow their sound are dropped
(those kept lag its energy by 0-1 label frames). FACEGOOD curves are solved at 30 FPS and start
with their sound; they come one frame late.
"""

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np
import soundfile
import soxr

from encoder.capture.align import EnglishAligner
from encoder.capture.channels import (
    JAW_OPEN,
    MOUTH_CLOSE,
    RIG_INDEX,
    RIG_NAMES,
    SPEECH_COLUMNS,
    from_arkit,
)
from encoder.capture.made import Take, phone_labels, take
from encoder.capture.motion import closing_weight, frame_times, upper_face
from encoder.capture.phones import Phone
from sensors.types import SAMPLE_RATE, SAMPLES_PER_FRAME, InputError

_ALIGNMENT_RATE = 25_000
_JAW_LOUD = 0.34  # every speaker's 98th percentile of jawOpen is scaled to this
# Channels whose tracker output says little about the lips (it drifts with the head)
_IGNORED = ("jawLeft", "jawRight", "mouthLeft", "mouthRight", "jawForward")
# GRID speakers of ../mocap: s4 always puckers and, like s33, its labels do not follow the sound.
GRID_DROPPED = ("s4", "s33")
GRID_TEST = ("s30",)
FACEGOOD_TEST = "1114_3_16"
# FACEGOOD's rig -> ours: {curve: {channel: weight}}; l and r curves map to both sides alike. Where
# two curves feed one channel they add up. The rest of its 116 curves hardly moves.
FACEGOOD_MAP: dict[str, dict[str, float]] = {
    "mouth_stretch_c": {"jawOpen": 0.75},
    "mouth_oh_c": {"mouthFunnel": 0.35, "mouthPucker": 0.25},
    "mouth_oo_c": {"mouthPucker": 0.6},
    "mouth_funnel_d": {"mouthFunnel": 0.3},
    "mouth_funnel_u": {"mouthFunnel": 0.3},
    "mouth_pucker": {"mouthPucker": 0.8},
    "mouth_lowerLipDepress": {"mouthLowerDown": 1.0},
    "mouth_upperLipRaise": {"mouthUpperUp": 1.0},
    "mouth_lipCornerPull": {"mouthSmile": 0.8},
    "mouth_lipStretch": {"mouthStretch": 0.8},
    "mouth_dimple": {"mouthDimple": 0.8},
    "mouth_suck_d": {"mouthRollLower": 0.8},
    "mouth_suck_u": {"mouthRollUpper": 0.8},
    "mouth_press": {"mouthPress": 0.8},
    "mouth_chinRaise_u": {"mouthShrugUpper": 0.6},
    "mouth_chinRaise_d": {"mouthShrugLower": 0.6},
    "nose_wrinkle": {"noseSneer": 0.8},
}


def read_audio(path: Path) -> np.ndarray:
    """[n] float32 mono at 48 kHz."""
    try:
        audio, rate = soundfile.read(path, dtype="float32", always_2d=True)
    except (soundfile.LibsndfileError, OSError):
        got = "something else" if Path(path).is_file() else "no such file"
        raise InputError(
            f"{path}: expected a sound file, got {got}; give a wav, flac or ogg"
        ) from None
    return soxr.resample(audio.mean(1), rate, SAMPLE_RATE).astype(np.float32)


class Spoken(NamedTuple):
    """What is said in a clip, and from when to when."""

    start_s: float
    end_s: float
    text: str


def _words(folder: Path) -> dict[str, Spoken]:
    """Clip -> its words."""
    spans = {}
    for line in (folder / "alignments.tsv").read_text().splitlines()[1:]:
        clip, _, intervals = line.partition("\t")
        rows = [part.split() for part in intervals.split(";") if part.strip()]
        spoken = [(int(a), int(b), word) for a, b, word in rows if word not in ("sil", "sp")]
        if spoken:
            start, end = spoken[0][0] / _ALIGNMENT_RATE, spoken[-1][1] / _ALIGNMENT_RATE
            spans[clip] = Spoken(start, end, " ".join(word for _, _, word in spoken))
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


def _labels(folder: Path) -> dict[str, np.ndarray]:
    """labels.npz of a GRID folder; raise InputError when it is none."""
    path = Path(folder) / "labels.npz"
    if not path.is_file():
        raise InputError(f"GRID folder {folder}: expected labels.npz, found none; check the path")
    try:
        with np.load(path, allow_pickle=False) as data:
            labels = dict(data)
    except (OSError, ValueError, BadZipFile):
        labels = {}
    missing = [name for name in ("weights", "names", "clips", "fps") if name not in labels]
    if missing:
        raise InputError(
            f"{path}: expected the arrays weights, names, clips and fps, missing "
            f"{', '.join(missing)}; copy the file again"
        )
    return {"speakers": np.array(["s1"] * len(labels["clips"])), **labels}


def grid_speakers(folder: Path) -> list[str]:
    """The speakers of a GRID folder; raise InputError when it is none."""
    return sorted({str(s) for s in _labels(folder)["speakers"]})


def grid_takes(folder: Path, speaker: str, seed: tuple[int, ...]) -> Iterator[Take]:
    """One speaker's clips; those without a face are left out. A one-speaker folder keeps its last
    50 clips for tests.

    Outside the words the mouth fades to rest: the tracker's open lips there are breathing.
    """
    folder, rng = Path(folder), np.random.default_rng(seed)
    data = _labels(folder)
    weights, names = data["weights"], [str(name) for name in data["names"]]
    clips, fps = [str(clip) for clip in data["clips"]], int(data["fps"])
    speakers = [str(s) for s in data["speakers"]]
    spans = _words(folder)
    chosen = [i for i, name in enumerate(speakers) if name == speaker]
    test = {clips[i] for i in chosen[-50:]} if len(set(speakers)) == 1 else set[str]()
    curves, aligner = _speaker_curves(weights[chosen], names), EnglishAligner()
    takes = [
        (clips[i], read_audio(folder / "audio" / f"{clips[i]}.ogg"), curve)
        for i, curve in zip(chosen, curves, strict=True)
        if clips[i] in spans and not np.isnan(curve).any()
    ]
    for clip, audio, curve in takes:
        split = "test" if clip in test or speaker in GRID_TEST else "train"
        said = aligner.align(audio, spans[clip].text)
        yield _grid_take(audio, curve, fps, spans[clip], said, f"grid-{speaker}", split, rng)


def _grid_take(
    audio: np.ndarray,
    curve: np.ndarray,
    fps: int,
    span: Spoken,
    said: list[Phone] | None,  # None: its words did not align
    voice: str,
    split: str,
    rng: np.random.Generator,
) -> Take:
    times = frame_times(len(audio) // SAMPLES_PER_FRAME)
    source = np.arange(len(curve)) / fps
    rig = np.stack([np.interp(times, source, column) for column in curve.T], 1)
    early, late = span.start_s - 0.12 - times, times - span.end_s - 0.12
    outside = np.maximum(early / 0.12, late / 0.15)
    inside = 0.5 + 0.5 * np.cos(np.pi * np.clip(outside, 0, 1))
    rig = (rig * inside[:, None]).astype(np.float32)
    rig[:, MOUTH_CLOSE] = np.minimum(rig[:, MOUTH_CLOSE], closing_weight(rig))
    upper, gaze = upper_face(np.clip(rig[:, JAW_OPEN] / _JAW_LOUD, 0, 1), rng, reading=True)
    heard = np.full(len(rig), -1) if said is None else phone_labels(said, len(rig))
    phones = np.where(inside > 0, heard, 0)
    return take(
        audio, rig + upper, gaze, phones, truth="tracked", voice=voice, split=split, kind="grid"
    )


def facegood_takes(folder: Path, seed: tuple[int, ...]) -> Iterator[Take]:
    """Clips NAME.flac + NAME.npy [T, 116] with names.txt; cut into pieces of 20 s."""
    folder, rng = Path(folder), np.random.default_rng(seed)
    names = (folder / "names.txt").read_text().split()
    for path in sorted(folder.glob("*.npy")):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # headers written by Python 2
            curves = np.load(path, allow_pickle=False).astype(np.float32)
        if curves.shape[1] != len(names):
            raise InputError(f"{path}: expected {len(names)} curves, got {curves.shape[1]}")
        audio = read_audio(path.with_suffix(".flac"))
        rig = _facegood_rig(curves, names)[1:]  # one frame late, and frame k is the end of tick k
        for start in range(0, len(rig) - 150, 600):
            piece = rig[start : start + 600]
            sound = audio[start * SAMPLES_PER_FRAME : (start + len(piece)) * SAMPLES_PER_FRAME]
            level = np.clip(piece[:, JAW_OPEN] / _JAW_LOUD, 0, 1)
            upper, gaze = upper_face(level, rng)
            yield take(
                sound, piece + upper, gaze, np.full(len(piece), -1),
                truth="tracked", voice="facegood", kind="facegood",
                split="test" if path.stem == FACEGOOD_TEST else "train",
            )  # fmt: skip


def _facegood_rig(curves: np.ndarray, names: list[str]) -> np.ndarray:
    """[T, 116] -> [T, 53] by FACEGOOD_MAP."""
    rig = np.zeros((len(curves), len(RIG_NAMES)), np.float32)
    for curve, channels in FACEGOOD_MAP.items():
        found = [
            n for n in names if n in (curve, f"{curve}_l", f"{curve}_r", f"{curve}l", f"{curve}r")
        ]
        value = curves[:, [names.index(n) for n in found]].mean(1)
        for channel, weight in channels.items():
            sides = [channel] if channel in RIG_INDEX else [f"{channel}_L", f"{channel}_R"]
            for side in sides:
                rig[:, RIG_INDEX[side]] += weight * value
    return np.clip(rig, 0, 1)


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
