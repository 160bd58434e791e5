"""`livedrive session create | info | export`: sessions made of ordinary files, and back."""

import json
import shlex
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional, subcommand

from app.terminal.arguments import File, optional


@contextmanager
def seconds_bar(what: str) -> Generator[Callable[[float], object]]:
    """A progress bar in seconds of sound, on a terminal."""
    from tqdm import tqdm

    shape = "{desc}: {n:.0f} s of sound, {rate_fmt} [{elapsed}]"
    with tqdm(desc=what, unit="s", bar_format=shape, disable=None) as bar:
        yield bar.update


@dataclass(kw_only=True)
class CreateSession:
    """Make a session from a sound file, with or without two eye videos and a phone's motion."""

    folder: Positional[Path]
    """Folder to create."""
    audio: File = None
    """Sound file (wav, flac, ogg, mp3, m4a, ...) or video with sound; stored as 48 kHz mono."""
    livelink: File = None
    """Live Link Face CSV that starts with the sound; stored beside it as motion.npz."""
    eyes: tuple[Path, ...] = ()
    """Videos of the left and the right eye, or one with both side by side."""
    codec: Literal["ffv1", "x264"] = "ffv1"
    """Codec of the eye videos: ffv1 (lossless) or x264 (small)."""

    def run(self) -> None:
        import tempfile
        from datetime import UTC, datetime

        from app.capture import session_motion
        from sensors.session import files as session
        from sensors.types import InputError

        if self.audio is None and self.livelink is None:
            raise InputError(
                "session create: expected --audio or --livelink, got neither; try --audio x.wav"
            )
        created = datetime.now(UTC).isoformat(timespec="seconds")
        take = session_motion.read_take(self.livelink, self.audio) if self.livelink else None
        with tempfile.TemporaryDirectory() as spare:
            audio = self.audio
            if audio is None and take is not None:
                audio = session_motion.silence(Path(spare) / "silence.wav", take)
            with seconds_bar("writing") as update:
                made = session.create(
                    self.folder,
                    audio or "",
                    self.eyes,
                    created=created,
                    eye_codec=self.codec,
                    heard=self.audio is not None,
                    progress=update,
                )
        if take is not None:
            session_motion.write_motion(self.folder, take, int(made["frames"]))
        for warning in made.pop("warnings"):
            print(f"warning: {warning}")
        if not made["frames"]:
            print(f"warning: {audio}: shorter than one frame (1/30 s); nothing to replay")
        print(json.dumps(made, indent=2, ensure_ascii=False))
        if made["frames"]:
            words = ["livedrive", "replay", str(self.folder), "--video", "out.mp4"]
            print(f"next: {shlex.join(words)}")


@dataclass(kw_only=True)
class SessionInfo:
    """Print what a session holds."""

    folder: Positional[Path]
    """Folder of the session."""

    def run(self) -> None:
        from sensors.session import files as session

        print(json.dumps(session.info(self.folder), indent=2, ensure_ascii=False))


@dataclass(kw_only=True)
class ExportSession:
    """Write both eyes side by side with the sound as one video."""

    folder: Positional[Path]
    """Folder of the session."""
    out: Positional[Path]
    """Video to write, e.g. out.mkv."""
    drop: Annotated[Literal["audio", "eyes"] | None, optional("audio|eyes")] = None
    """Leave out the sound or the eyes."""

    def run(self) -> None:
        from app.terminal import confirm
        from sensors.session.export import export

        confirm.overwriting([self.out])
        with seconds_bar("exporting") as update:
            made = export(self.folder, self.out, drop=self.drop, progress=update)
        for warning in made.pop("warnings"):
            print(f"warning: {warning}")
        print(json.dumps(made, indent=2, ensure_ascii=False))


@dataclass(kw_only=True)
class Session:
    """Make, inspect and export sessions: create | info | export."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[CreateSession, subcommand("create")]
        | Annotated[SessionInfo, subcommand("info")]
        | Annotated[ExportSession, subcommand("export")]
    ]

    def run(self) -> None:
        self.command.run()
