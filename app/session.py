"""`livedrive session create | info | export`: sessions made of ordinary files, and back."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional, subcommand


@dataclass(kw_only=True)
class Create:
    """Make a session from a sound file, with or without two eye videos and a phone's motion."""

    folder: Positional[Path]
    """Folder to create."""
    audio: Path | None = None
    """Any sound file that libsndfile reads; it becomes 48 kHz mono."""
    livelink: Path | None = None
    """Live Link Face CSV that began with the sound: kept beside it as motion.npz."""
    eyes: tuple[Path, Path] | None = None
    """Video of the left and of the right eye."""
    codec: str = "ffv1"
    """ffv1 (lossless) or x264 (small)."""

    def run(self) -> None:
        import tempfile
        from datetime import UTC, datetime

        from app import session_motion
        from sensors import session
        from sensors.types import InputError

        if self.audio is None and self.livelink is None:
            raise InputError("session create: expected --audio or --livelink, got neither")
        created = datetime.now(UTC).isoformat(timespec="seconds")
        take = session_motion.read_take(self.livelink, self.audio) if self.livelink else None
        with tempfile.TemporaryDirectory() as spare:
            audio = self.audio
            if audio is None and take is not None:
                audio = session_motion.silence(Path(spare) / "silence.wav", take)
            made = session.create(
                self.folder, audio or "", self.eyes or (), created=created, eye_codec=self.codec
            )
        if take is not None:
            session_motion.write_motion(self.folder, take, int(made["frames"]))
        for warning in made.pop("warnings"):
            print(f"warning: {warning}")
        print(json.dumps(made, indent=2))
        print(f"next: livedrive replay {self.folder} --video out.mp4")


@dataclass(kw_only=True)
class Info:
    """Show what a session holds."""

    folder: Positional[Path]

    def run(self) -> None:
        from sensors import session

        print(json.dumps(session.info(self.folder), indent=2))


@dataclass(kw_only=True)
class Export:
    """Write both eyes side by side with the sound as one video."""

    folder: Positional[Path]
    out: Positional[Path]
    drop: Literal["audio", "eyes"] | None = None
    """Leave the voice or the eyes out."""

    def run(self) -> None:
        from sensors import session

        print(json.dumps(session.export(self.folder, self.out, drop=self.drop), indent=2))


@dataclass(kw_only=True)
class Session:
    """Sessions as files: create | info | export."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[Create, subcommand("create")]
        | Annotated[Info, subcommand("info")]
        | Annotated[Export, subcommand("export")]
    ]

    def run(self) -> None:
        self.command.run()
