"""Real recordings as subjects: aligned speech, speech without text, and one's own takes.

Real voices get rule-made motion (pseudo-truth): by their text where there is one (`rules`), by
their loudness where there is none (`envelope`, only the jaw). Tracked faces are in mocap.py.
Folder of speech: `transcripts.tsv` (file, language, speaker, text) and sound files below it.
Folder of takes: NAME.wav beside NAME.csv (a Live Link Face take that began with the sound).
"""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from encoder.capture.made import Take, Talker, spoken_take, take
from encoder.capture.motion.channels import JAW_OPEN
from encoder.capture.motion.contacts import LipGeometry
from encoder.capture.motion.style import Style
from encoder.capture.motion.upper_face import upper_face
from encoder.capture.speech.align import EnglishAligner, align_by_espeak
from encoder.capture.speech.phones import Speech
from encoder.capture.speech.synthesis import Espeak
from encoder.capture.speech.voices import Voice
from encoder.capture.subjects import mocap
from encoder.capture.subjects.livelink import read_livelink
from sensors.types import FPS, SAMPLE_RATE, InputError

LICENCES = {
    "kathleen": "CC0 (rhasspy dataset-voice-kathleen)",
    "kerstin": "CC0 (rhasspy voice kerstin)",
    "librispeech": "CC BY 4.0 (LibriSpeech train-clean-100, Panayotov et al. 2015)",
    "ljspeech": "public domain",
    "vctk": "CC BY 4.0 (VCTK, Yamagishi et al.)",
    "grid": "CC BY 4.0 (GRID corpus, Cooke et al. 2006)",
    "facegood": "MIT (FACEGOOD-Audio2Face)",
}
LONGEST_S = 20.0


@dataclass(frozen=True)
class TranscriptLine:
    """A line of transcripts.tsv."""

    file: str
    language: str
    speaker: str
    text: str


def read_transcripts(folder: Path) -> list[TranscriptLine]:
    """Training lines of a speech folder."""
    path = Path(folder) / "transcripts.tsv"
    if not path.is_file():
        raise InputError(
            f"speech folder {folder}: expected a transcripts.tsv with the columns file, language, "
            "speaker, text, found none; write one or check --speech"
        )
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t", quoting=csv.QUOTE_NONE))
    wanted = ("file", "language", "speaker", "text")
    if not rows or any(name not in rows[0] for name in wanted):
        got = ", ".join(map(str, rows[0])) if rows else "an empty table"
        raise InputError(f"{path}: expected the columns {', '.join(wanted)}, got {got}; repair it")
    lines = [TranscriptLine(*(row[name] or "" for name in wanted)) for row in rows]
    return [line for line in lines if line.file.startswith("train/")]


def aligned_takes(
    folder: Path, lines: list[TranscriptLine], lips: LipGeometry | None, seed: tuple[int, ...]
) -> Iterator[Take]:
    """A real voice with its text -> phones -> rule-made motion; what does not align is left."""
    rng = np.random.default_rng(seed)
    speaker = lines[0].speaker
    who = Talker(Voice("real", speaker, lines[0].language, 1.0), Style.draw(rng), lips, "train")
    english = EnglishAligner() if lines[0].language.startswith("en") else None
    espeak = Espeak()
    for line in lines:
        audio = _sound(folder / line.file)
        if english is not None:
            phones = english.align(audio, line.text)
        else:
            phones = align_by_espeak(audio, line.text, line.language, espeak)
        if phones:
            speech = Speech(audio, phones)
            yield spoken_take(
                speech, who, rng, kind="aligned", text=line.text, voice=f"real-{speaker}"
            )


def envelope_takes(
    folder: Path, lines: list[TranscriptLine], seed: tuple[int, ...]
) -> Iterator[Take]:
    """Real voices without text: the jaw follows the loudness."""
    rng = np.random.default_rng(seed)
    for line in lines:
        audio = _sound(folder / line.file)
        rig = mocap.envelope_curves(audio)
        upper, gaze = upper_face(rig[:, JAW_OPEN] / 0.34, rng)
        yield take(
            audio, rig + upper, gaze, np.full(len(rig), -1),
            truth="envelope", voice=f"real-{line.speaker}", split="train", kind="envelope",
        )  # fmt: skip


def own_takes(folder: Path, seed: tuple[int, ...]) -> Iterator[Take]:
    """NAME.wav + NAME.csv pairs; lids, brows and mouth are the phone's, gaze is made."""
    rng, found = np.random.default_rng(seed), False
    for path in sorted(Path(folder).glob("*.csv")):
        sound = path.with_suffix(".wav")
        if not sound.is_file():
            raise InputError(
                f"{path}: expected its sound in {sound.name}, found none; put it there"
            )
        audio, motion = mocap.read_audio(sound), read_livelink(path)
        length_s, num_frames = len(audio) / SAMPLE_RATE, len(audio) * FPS // SAMPLE_RATE
        if length_s < motion.times[-1] - 0.5:
            raise InputError(
                f"{sound}: expected at least the {motion.times[-1]:.1f} s of its curves, got "
                f"{length_s:.1f} s; cut the take or find the whole sound"
            )
        found = True
        rig, tongue = motion.rig(num_frames)
        _, gaze = upper_face(rig[:, JAW_OPEN], rng)
        yield take(
            audio, rig, gaze, np.full(num_frames, -1), tongue=tongue,
            truth="tracked", voice=f"own-{path.stem}", kind="own",
        )  # fmt: skip
    if not found:
        raise InputError(f"takes folder {folder}: expected NAME.csv with NAME.wav, found none")


def _sound(path: Path) -> np.ndarray:
    return mocap.read_audio(path)[: int(LONGEST_S * SAMPLE_RATE)]
