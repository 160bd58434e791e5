"""Files that a session or a profile of somebody else's holds: cards, timelines, whole folders."""

import json
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from app.bench.fuzz.fuzzer import Fuzzer
from sensors.types import InputError


def card(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    """Session cards with an eye calibration, eye calibrations and gains of a profile."""
    from app.sinks.protocols.face import read_gains
    from encoder.eyes.calibration import EyeCalibration
    from sensors.session import format as session_format

    eyes = EyeCalibration().to_json()
    made = session_format.new_card("2026", {"audio": "mic"}, {"eyes": eyes}, "ffv1", "PCM_16")
    text, path = json.dumps(made).encode(), folder / session_format.CARD_FILE
    profile, own = json.dumps(eyes).encode(), folder / "eyes.json"
    gains = json.dumps({"jawOpen": {"gain": 1.4, "low": 0, "high": 0.9}}).encode()
    readers = ((profile, own, EyeCalibration.load), (gains, folder / "gains.json", read_gains))

    def feed() -> None:
        with suppress(InputError):
            kind = fuzzer.pick(3)
            if kind < len(readers):
                data, file, read = readers[kind]
                file.write_bytes(fuzzer.mutate(data))
                read(file)
            else:
                path.write_bytes(fuzzer.mutate(text))
                session_format.read_card(folder)

    return feed


def timeline(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    from sensors.session import timeline as session_timeline
    from sensors.session.format import TIMELINE_FILE
    from sensors.types import HeadPose

    pose = HeadPose((0.0, 1.0, 2.0), (1.0, 0.0, 0.0, 0.0))
    entries = (
        session_timeline.AudioEntry(0, 0, 480, 0, False),
        session_timeline.EyeEntry(1, 0, 0, 0),
        session_timeline.EmotionEntry(2, "happy:0.7"),
        session_timeline.RequestEntry(2, "recentre"),
        session_timeline.HeadEntry(3, pose, True),
    )
    lines = b"".join(session_timeline.entry_line(entry) for entry in entries)
    path = folder / TIMELINE_FILE

    def feed() -> None:
        path.write_bytes(fuzzer.mutate(lines))
        with suppress(InputError):
            session_timeline.read_timeline(folder, closed=bool(fuzzer.pick(2)))

    return feed


def session(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    """Whole folders, half of them such that have to be repaired, replayed to the end."""
    from sensors.session.files import replay_frames
    from sensors.session.recording import Recording, RecordingWriter
    from sensors.standins.eye_pictures import eye_picture
    from sensors.types import AudioPacket, EyePacket

    whole, damaged = folder / "whole", folder / "damaged"
    with RecordingWriter(whole, created="") as writer:
        for k in range(4):
            writer.append(EyePacket(k * 33_000_000, k % 2, k // 2, eye_picture(k, noise=False)))
            writer.append(AudioPacket(k * 10**7, k * 480, np.zeros(480, np.float32)))
    files = {path.name: path.read_bytes() for path in sorted(whole.iterdir())}
    open_card = files["session.json"].replace(b'"closed": true', b'"closed": false')

    def feed() -> None:
        shutil.rmtree(damaged, ignore_errors=True)
        damaged.mkdir()
        for name, data in files.items():
            (damaged / name).write_bytes(data)
        if fuzzer.pick(2):
            (damaged / "session.json").write_bytes(open_card)
        name = sorted(files)[fuzzer.pick(len(files))]
        (damaged / name).write_bytes(fuzzer.mutate((damaged / name).read_bytes()))
        with suppress(InputError), Recording(damaged) as recording:
            for _ in replay_frames(recording):
                pass

    return feed
