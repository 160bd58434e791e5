"""The moving head as files of Gaussians: a folder of PLY or of glTF, named by frame index."""

from collections.abc import Callable
from pathlib import Path

from app.drive.sink import FrameResult, RunInfo
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.types import Gaussians
from sensors.types import InputError


class CloudSink:
    """Writes the Gaussians of every n-th frame (1 to 2 MB each)."""

    def __init__(
        self,
        folder: Path,
        every: int,
        suffix: str,
        save: Callable[[Path, Gaussians], None],
        decoder: Decoder,
        identity: Identity,
    ) -> None:
        if every < 1:
            raise InputError(f"--every: expected 1 or more frames, got {every}; try --every 1")
        self._folder, self._every, self._suffix, self._save = folder, every, suffix, save
        self._decoder, self._identity = decoder, identity

    def on_start(self, info: RunInfo) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)

    def on_frame(self, result: FrameResult) -> None:
        driven = result.driven
        if driven.index % self._every == 0:
            _, gaussians = self._decoder.decode(
                driven.expression, driven.gaze, self._identity, driven.head, driven.breath
            )
            self._save(self._folder / f"frame_{driven.index:06d}{self._suffix}", gaussians)

    def close(self) -> None:
        pass
