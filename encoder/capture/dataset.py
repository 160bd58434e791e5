"""The data pack: clips of audio with motion curves, in npz shards without pickle and a manifest.

Last stage of the capture, first of the training. A pack is a folder: `manifest.json` names the
shards and their clips; a shard holds the clips of one kind end to end.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import soxr

from encoder.capture.channels import RIG_NAMES
from sensors.types import SAMPLE_RATE, InputError

PACK_RATE = 24_000  # what the compact audio encoder hears
PACK_SAMPLES_PER_FRAME = 800
FORMAT_VERSION = 1
# Where a clip's curves come from: `rules` (made here), `tracked` (a face tracker on video, mouth
# only), `envelope` (only jawOpen, made from the loudness of real speech), `rest` (no speech).
TRUTHS = ("rules", "tracked", "envelope", "rest")


@dataclass(frozen=True, kw_only=True)
class Clip:
    audio: np.ndarray  # [800 T] int16, 24 kHz mono
    rig: np.ndarray  # [T, 53] float16, 0..1, frame k at the end of its 800 samples
    gaze: np.ndarray  # [T, 2, 3] float16, unit vectors, 0 = left eye
    phones: np.ndarray  # [T] int8, index in speech.PHONES; -1 where not known
    truth: str  # one of TRUTHS
    voice: str  # speaker or synthetic voice; splits never share one
    split: str = "train"  # or "test"

    @property
    def num_frames(self) -> int:
        return len(self.rig)


def make_clip(
    audio: np.ndarray, rig: np.ndarray, gaze: np.ndarray, phones: np.ndarray, **labels: str
) -> Clip:
    """audio [n] float at 48 kHz with its curves -> a clip of whole frames at 24 kHz."""
    audio_24k = soxr.resample(audio.astype(np.float32), SAMPLE_RATE, PACK_RATE)
    num_frames = min(len(audio_24k) // PACK_SAMPLES_PER_FRAME, len(rig))
    pcm = np.clip(audio_24k[: num_frames * PACK_SAMPLES_PER_FRAME], -1, 1) * 32767
    return Clip(
        audio=np.round(pcm).astype(np.int16),
        rig=rig[:num_frames].astype(np.float16),
        gaze=gaze[:num_frames].astype(np.float16),
        phones=phones[:num_frames].astype(np.int8),
        **labels,
    )


def write_shard(path: Path, clips: list[Clip]) -> dict[str, Any]:
    """Write one shard and return its manifest entry."""
    names = ("audio", "rig", "gaze", "phones")
    arrays: dict[str, Any] = {n: np.concatenate([getattr(c, n) for c in clips]) for n in names}
    np.savez(path, **arrays)
    rows = [
        {"frames": c.num_frames, "truth": c.truth, "voice": c.voice, "split": c.split}
        for c in clips
    ]
    return {"file": path.name, "clips": rows}


def write_manifest(folder: Path, shards: list[dict[str, Any]], sources: dict[str, str]) -> None:
    """Write the manifest last: a pack without one is unfinished. `sources`: name -> licence."""
    manifest = {
        "version": FORMAT_VERSION,
        "sample_rate": PACK_RATE,
        "rig_names": list(RIG_NAMES),
        "sources": sources,
        "shards": shards,
    }
    (folder / "manifest.json").write_text(json.dumps(manifest, indent=1))


def read_manifest(folder: Path) -> dict[str, Any]:
    path = Path(folder) / "manifest.json"
    if not path.is_file():
        raise InputError(
            f"data pack {folder}: expected a manifest.json, found none; "
            f"make one with livedrive capture {folder}"
        )
    manifest = json.loads(path.read_text())
    if manifest.get("version") != FORMAT_VERSION or manifest.get("rig_names") != list(RIG_NAMES):
        raise InputError(
            f"data pack {folder}: expected format {FORMAT_VERSION} with {len(RIG_NAMES)} rig "
            f"channels, got format {manifest.get('version')}; run livedrive capture {folder} again"
        )
    return manifest


def read_pack(folder: Path, split: str | None = None) -> list[Clip]:
    """All clips of a pack (of one split, if named), in memory."""
    clips: list[Clip] = []
    for shard in read_manifest(folder)["shards"]:
        with np.load(Path(folder) / shard["file"], allow_pickle=False) as data:
            arrays = {name: data[name] for name in ("audio", "rig", "gaze", "phones")}
        start = 0
        for row in shard["clips"]:
            frames = slice(start, start + row["frames"])
            samples = slice(*(PACK_SAMPLES_PER_FRAME * i for i in (frames.start, frames.stop)))
            start = frames.stop
            if split in (None, row["split"]):
                curves = {name: arrays[name][frames] for name in ("rig", "gaze", "phones")}
                labels = {name: row[name] for name in ("truth", "voice", "split")}
                clips.append(Clip(audio=arrays["audio"][samples], **curves, **labels))
    return clips
