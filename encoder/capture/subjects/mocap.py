"""Tracked and solved faces as subjects: talking-head labels (GRID) and solved captures (FACEGOOD).

GRID labels are a face tracker's ARKit weights at 25 FPS. Only the mouth is taken: the tracker's
blinks also rise when a person looks down, so lids, gaze and brows stay rule-made. What is done to
the curves is in tracked.py. FACEGOOD curves are solved at 30 FPS and start with their sound.
"""

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np
import soundfile
import soxr

from encoder.capture.made import Take, phone_labels, take
from encoder.capture.motion.articulation import articulated, in_sync, tongue
from encoder.capture.motion.channels import JAW_OPEN, RIG_INDEX, RIG_NAMES
from encoder.capture.motion.contacts import LipGeometry
from encoder.capture.motion.rules import frame_times
from encoder.capture.motion.style import Style
from encoder.capture.motion.upper_face import upper_face
from encoder.capture.speech.align import EnglishAligner
from encoder.capture.speech.phones import pack_phones
from encoder.capture.subjects import tracked
from encoder.capture.subjects.tracked import JAW_LOUD
from sensors.types import FPS, SAMPLE_RATE, SAMPLES_PER_FRAME, InputError

_ALIGNMENT_RATE = 25_000
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


class SpokenSpan(NamedTuple):
    """What is said in a clip, and from when to when."""

    start_s: float
    end_s: float
    text: str


def _words(folder: Path) -> dict[str, SpokenSpan]:
    """Clip -> its words."""
    spans = {}
    for line in (folder / "alignments.tsv").read_text().splitlines()[1:]:
        clip, _, intervals = line.partition("\t")
        rows = [part.split() for part in intervals.split(";") if part.strip()]
        spoken = [(int(a), int(b), word) for a, b, word in rows if word not in ("sil", "sp")]
        if spoken:
            start, end = spoken[0][0] / _ALIGNMENT_RATE, spoken[-1][1] / _ALIGNMENT_RATE
            spans[clip] = SpokenSpan(start, end, " ".join(word for _, _, word in spoken))
    return spans


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


def grid_takes(
    folder: Path,
    speaker: str,
    lips: LipGeometry | None,
    seed: tuple[int, ...],
    *,
    completed: bool = True,  # False: nothing but what was tracked, to judge by
    last: int | None = None,  # of the speaker's clips, so many from the end
) -> Iterator[Take]:
    """One speaker's clips; those without a face, or whose lips do not follow their sound, are left
    out. A one-speaker folder keeps its last 50 clips for tests.
    """
    folder, rng = Path(folder), np.random.default_rng(seed)
    data = _labels(folder)
    weights, names = data["weights"], [str(name) for name in data["names"]]
    clips, fps = [str(clip) for clip in data["clips"]], int(data["fps"])
    speakers = [str(s) for s in data["speakers"]]
    spans = _words(folder)
    chosen = [i for i, name in enumerate(speakers) if name == speaker]
    test = {clips[i] for i in chosen[-50:]} if len(set(speakers)) == 1 else set[str]()
    curves, aligner = tracked.speaker_curves(weights[chosen], names), EnglishAligner()
    takes = [
        (clips[i], read_audio(folder / "audio" / f"{clips[i]}.ogg"), curve)
        for i, curve in list(zip(chosen, curves, strict=True))[-last if last else None :]
        if clips[i] in spans and not np.isnan(curve).any()
    ]
    for clip, audio, curve in takes:
        split = "test" if clip in test else "train"
        said = aligner.align(audio, spans[clip].text)
        rig = tracked.spoken(tracked.at_ticks(curve, fps, len(audio)), spans[clip][:2])
        if said is not None:
            if not in_sync(rig, said, Style()):
                continue
            rig = articulated(rig, said, Style(), lips) if completed else rig
        moved = tongue(said, len(rig), Style()) if said else None
        upper, gaze = upper_face(np.clip(rig[:, JAW_OPEN] / JAW_LOUD, 0, 1), rng, reading=True)
        heard = phone_labels(said, len(rig)) if said else np.full(len(rig), -1)
        yield take(
            audio, rig + upper, gaze, heard, tongue=moved, truth="tracked", kind="grid",
            voice=f"grid-{speaker}", split=split, spans=pack_phones(said) if said else None,
        )  # fmt: skip


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
        rig = tracked.at_ticks(facegood_rig(curves, names), FPS, len(audio))
        for start in range(0, len(rig) - 150, 600):
            piece = rig[start : start + 600]
            sound = audio[start * SAMPLES_PER_FRAME : (start + len(piece)) * SAMPLES_PER_FRAME]
            level = np.clip(piece[:, JAW_OPEN] / JAW_LOUD, 0, 1)
            upper, gaze = upper_face(level, rng)
            yield take(
                sound, piece + upper, gaze, np.full(len(piece), -1),
                truth="tracked", voice="facegood", kind="facegood",
                split="test" if path.stem == FACEGOOD_TEST else "train",
            )  # fmt: skip


def facegood_rig(curves: np.ndarray, names: list[str]) -> np.ndarray:
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
