"""Real talkers of a motion folder, followed by students that were not trained on them.

Between the folders (tracked talkers, DATA/leave_out) and what `livedrive eval speech
--leave-one-out` measures and draws.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sensors.types import InputError

if TYPE_CHECKING:
    from encoder.capture.made import Take
    from encoder.capture.speech.phones import Phone
    from encoder.driver import Driver

LONGEST_S = 30.0
Change = Callable[[np.ndarray], np.ndarray]  # [n] at 48 kHz


class Followed(NamedTuple):
    """A talker's clip: codes [T, 256], shown and tracked, and phones (empty: unknown)."""

    shown: np.ndarray
    tracked: np.ndarray
    phones: "Sequence[Phone]"


def tracked_folder(folder: Path | None) -> Path:
    """The folder itself; raise InputError where it is none."""
    if folder is None or not folder.is_dir():
        raise InputError(
            f"--leave-one-out: expected a folder of tracked faces, got {folder}; "
            "give --mocap FOLDER"
        )
    return folder


def drivers_of(data: Path, weights: Path | None) -> dict[str, "Driver"]:
    """Talker -> live driver whose student was trained without that talker, and with most others."""
    from encoder import inference
    from encoder.backends import create_backend
    from encoder.driver import Driver

    folders = [path.parent for path in (data / "leave_out").glob("*/student.json")]
    folders.sort(key=lambda folder: -folder.name.count("+"))
    found = {talker: folder for folder in folders for talker in folder.name.split("+")}
    if not found:
        raise InputError(
            f"--leave-one-out: expected students in {data / 'leave_out'}, found none; run "
            "livedrive train distill --leave-out grid-s2, and so on"
        )
    networks, _ = inference.load_networks(weights)
    result: dict[str, Driver] = {}
    for talker, folder in sorted(found.items()):
        config, student, card = inference.load_student(folder, "gaze")
        if card["audio_sha256"] != networks_sha256(weights):
            raise InputError(
                f"{folder}: expected a student of the audio encoder under evaluation, got one of "
                "another; train it again"
            )
        result[talker] = Driver(
            create_backend(replace(networks, config=config, denoiser=student)),
            config,
            mean=student["expression_mean"],
            std=student["expression_std"],
        )
    return result


def networks_sha256(weights: Path | None) -> str:
    from encoder import inference

    return json.loads(((weights or inference.WEIGHTS) / "audio.json").read_text())["sha256"]


def tracked_takes(folder: Path, talker: str, last: int | None = None) -> "Iterator[Take]":
    """Takes of a talker with tracked motion only, nothing completed by rules; `last`: so many from
    the end, those for tests among them."""
    from encoder.capture.subjects import mocap

    if talker == "facegood":
        yield from mocap.facegood_takes(folder / "facegood", (0,))
        return
    speaker = talker.removeprefix("grid-")
    for part in sorted(path.parent for path in folder.glob("*/labels.npz")):
        if speaker in mocap.grid_speakers(part):
            yield from mocap.grid_takes(part, speaker, None, (0,), completed=False, last=last)


def followed(driver: "Driver", takes: "list[Take]", change: Change | None = None) -> list[Followed]:
    """Drive the takes live, as they are or with their sound changed."""
    from app.eval.speech.live import drive
    from encoder.capture.speech.phones import unpack_phones
    from render.decoder.decoder import Decoder

    decoder, result = Decoder.load(), list[Followed]()
    for take in takes:
        count = min(take.clip.num_frames, int(LONGEST_S * 30))
        sound = take.audio[: count * 1600]
        shown = drive(driver, sound if change is None else change(sound), 0)
        codes = decoder.encode(take.clip.rig[:count].astype(np.float32))
        result.append(Followed(shown, codes, unpack_phones(take.clip.spans)))
    return result
