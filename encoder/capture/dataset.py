"""The data set: one folder a subject, a manifest, and readers that stream.

Last stage of the capture, first of the training. A subject's folder is a session (audio.wav,
written by the app) with `motion.npz` (curves, phones, texts) and `audio_24k.npy`, the same sound at
the rate of the compact encoder. Sound is mapped from disk, never loaded: memory stays small.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import soxr

from encoder.capture.motion.channels import RIG_NAMES, TONGUE_NAMES
from sensors import files
from sensors.types import SAMPLE_RATE, InputError

PACK_RATE = 24_000  # what the compact audio encoder hears
PACK_SAMPLES_PER_FRAME = 800
SEGMENT_FRAMES = 100  # the paper's clip length
FORMAT_VERSION = 2
# Where a clip's curves come from: `rules` (made here), `tracked` (a face tracker or a solved
# capture, mouth only), `envelope` (only jawOpen, made from the loudness of real speech), `rest` (no
# speech), `emotional` (made here, with one of the ten emotions).
TRUTHS = ("rules", "tracked", "envelope", "rest", "emotional")
_CURVES = ("rig", "tongue", "gaze", "phones")
_LABELS = ("truth", "voice", "split", "kind", "text", "emotion")


def _no_spans() -> np.ndarray:
    return np.zeros((0, 3), np.float32)


@dataclass(frozen=True, kw_only=True)
class Clip:
    audio: np.ndarray  # [800 T] int16, 24 kHz mono
    rig: np.ndarray  # [T, 53] float16, 0..1, frame k at the end of its 800 samples
    gaze: np.ndarray  # [T, 2, 3] float16, unit vectors, 0 = left eye
    phones: np.ndarray  # [T] int8, index in speech.PHONES; -1 where not known
    tongue: np.ndarray  # [T, 3] float16, 0..1, TONGUE_NAMES
    truth: str  # one of TRUTHS
    voice: str  # speaker or synthetic voice; splits never share one
    split: str = "train"  # or "test"
    kind: str = ""  # freeform, sentence, emotion, rest, language or the name of a real source
    text: str = ""
    emotion: str = "neutral"
    spans: np.ndarray = field(default_factory=_no_spans)  # [P, 3] phone, start s, end s in the clip

    @property
    def num_frames(self) -> int:
        return len(self.rig)

    def segments(self) -> Iterator[slice]:
        """Slices of 100 frames from the start; a shorter rest is left out."""
        for start in range(0, self.num_frames - SEGMENT_FRAMES + 1, SEGMENT_FRAMES):
            yield slice(start, start + SEGMENT_FRAMES)


def make_clip(
    audio: np.ndarray,
    rig: np.ndarray,
    gaze: np.ndarray,
    phones: np.ndarray,
    *,
    tongue: np.ndarray | None = None,
    spans: np.ndarray | None = None,
    **labels: str,
) -> Clip:
    """audio [n] float at 48 kHz with its curves -> a clip of whole frames at 24 kHz."""
    audio_24k = soxr.resample(audio.astype(np.float32), SAMPLE_RATE, PACK_RATE)
    num_frames = min(len(audio_24k) // PACK_SAMPLES_PER_FRAME, len(rig))
    pcm = np.clip(audio_24k[: num_frames * PACK_SAMPLES_PER_FRAME], -1, 1) * 32767
    if tongue is None:
        tongue = np.zeros((num_frames, len(TONGUE_NAMES)))
    return Clip(
        audio=np.round(pcm).astype(np.int16),
        rig=rig[:num_frames].astype(np.float16),
        gaze=gaze[:num_frames].astype(np.float16),
        phones=phones[:num_frames].astype(np.int8),
        tongue=tongue[:num_frames].astype(np.float16),
        spans=_no_spans() if spans is None else spans.astype(np.float32),
        **labels,
    )


def write_shard(path: Path, clips: list[Clip], **subject: Any) -> dict[str, Any]:
    """Write one subject's folder, clips end to end; return its manifest entry.

    The entry is also kept in the folder, written last: a folder without it is unfinished.
    """
    path.mkdir(parents=True, exist_ok=True)
    sound = BytesIO()  # numpy's own writing of an array tells neither a full disk nor the file
    np.save(sound, np.concatenate([c.audio for c in clips]))
    files.write_bytes(path / "audio_24k.npy", sound.getbuffer())
    arrays: dict[str, Any] = {n: np.concatenate([getattr(c, n) for c in clips]) for n in _CURVES}
    arrays["spans"] = np.concatenate([c.spans for c in clips])
    with files.replacing(path / "motion.npz") as draft:
        np.savez_compressed(draft, **arrays)
    rows = [
        {"frames": c.num_frames, "phones": len(c.spans)} | {n: getattr(c, n) for n in _LABELS}
        for c in clips
    ]
    entry = {"file": path.name, **subject, "clips": rows}
    text = json.dumps(entry, indent=1, ensure_ascii=False)
    files.write_text(path / "subject.json", text)
    return entry


def finished(path: Path) -> dict[str, Any] | None:
    """The entry of a finished subject's folder, else None."""
    card = path / "subject.json"
    return _json(card, f"remove {path}, and {_again(path)}") if card.is_file() else None


def _json(path: Path, cure: str) -> dict[str, Any]:
    try:
        return files.read_json(path)
    except ValueError as error:
        raise InputError(f"{path}: expected JSON, got {error}; {cure}") from error


def _again(subject: Path) -> str:
    return f"run livedrive capture {subject.parent} again, it goes on where it stopped"


def write_manifest(
    folder: Path, shards: list[dict[str, Any]], sources: dict[str, str], **made: Any
) -> None:
    """Write the manifest last: a set without one is unfinished. `sources`: name -> licence."""
    manifest = {
        "version": FORMAT_VERSION,
        "sample_rate": PACK_RATE,
        "rig_names": list(RIG_NAMES),
        "tongue_names": list(TONGUE_NAMES),
        "sources": sources,
        "made": made,
        "counts": counts(shards),
        "shards": [{k: v for k, v in shard.items() if k != "clips"} for shard in shards],
    }
    text = json.dumps(manifest, indent=1, ensure_ascii=False)
    files.write_text(folder / "manifest.json", text)


def counts(shards: list[dict[str, Any]]) -> dict[str, Any]:
    """What a set holds, for its manifest."""
    clips = [clip for shard in shards for clip in shard["clips"]]
    hours: dict[str, float] = {}
    for clip in clips:
        name = f"{clip['truth']} {clip['split']}"
        hours[name] = hours.get(name, 0.0) + clip["frames"] / 108_000
    return {
        "subjects": len(shards),
        "clips": len(clips),
        "segments": sum(clip["frames"] // SEGMENT_FRAMES for clip in clips),
        "hours": {name: round(value, 3) for name, value in sorted(hours.items())},
        "voices": len({clip["voice"] for clip in clips}),
        "texts": len({clip["text"] for clip in clips if clip["text"]}),
    }


def read_manifest(folder: Path) -> dict[str, Any]:
    path = Path(folder) / "manifest.json"
    if not path.is_file():
        raise InputError(
            f"data pack {folder}: expected a manifest.json, found none; "
            f"make one with livedrive capture {folder}"
        )
    manifest = _json(path, f"run livedrive capture {folder} again, which writes it anew")
    if manifest.get("version") != FORMAT_VERSION or manifest.get("rig_names") != list(RIG_NAMES):
        raise InputError(
            f"data pack {folder}: expected format {FORMAT_VERSION} with {len(RIG_NAMES)} rig "
            f"channels, got format {manifest.get('version')}; run livedrive capture {folder} again"
        )
    return manifest


def iter_pack(folder: Path, split: str | None = None) -> Iterator[Clip]:
    """All clips of a pack (of one split, if named), one subject after another."""
    for shard in read_manifest(folder)["shards"]:
        yield from read_shard(Path(folder) / shard["file"], split)


def read_shard(path: Path, split: str | None = None) -> Iterator[Clip]:
    """The clips of one subject; their sound stays on disk until it is read."""
    entry = finished(path)
    if entry is None:
        raise InputError(
            f"subject {path}: expected a finished subject.json, found none; {_again(path)}"
        )
    if split is not None and not any(row["split"] == split for row in entry["clips"]):
        return
    frames = sum(row["frames"] for row in entry["clips"])
    cure = f"remove {path}, and {_again(path)}"
    try:
        audio = np.load(path / "audio_24k.npy", mmap_mode="r", allow_pickle=False)
    except (EOFError, ValueError) as error:
        raise InputError(f"subject {path}: expected its sound, got {error}; {cure}") from error
    with files.arrays(path / "motion.npz", cure) as data:
        arrays = {name: data[name] for name in (*_CURVES, "spans")}
    if len(audio) != frames * PACK_SAMPLES_PER_FRAME or len(arrays["rig"]) != frames:
        raise InputError(
            f"subject {path}: expected {frames} frames of sound and motion, got "
            f"{len(audio) / PACK_SAMPLES_PER_FRAME:g} and {len(arrays['rig'])}; {cure}"
        )
    start = first_span = 0
    for row in entry["clips"]:
        frames = slice(start, start + row["frames"])
        spans = slice(first_span, first_span + row["phones"])
        start, first_span = frames.stop, spans.stop
        if split not in (None, row["split"]):
            continue
        samples = slice(*(PACK_SAMPLES_PER_FRAME * i for i in (frames.start, frames.stop)))
        curves = {name: arrays[name][frames] for name in _CURVES}
        labels = {name: row[name] for name in _LABELS}
        yield Clip(audio=audio[samples], spans=arrays["spans"][spans], **curves, **labels)


def read_pack(folder: Path, split: str | None = None) -> list[Clip]:
    """All clips of a pack: curves in memory (0.4 GB for 30 hours), sound mapped from disk."""
    return list(iter_pack(folder, split))
