"""The moving head as files of Gaussians: a folder of PLY or of glTF, named by frame index."""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from app.drive.sink import FrameResult, RunInfo
from render.decoder.decoder import EXPRESSION_DIM, Decoder
from render.decoder.identity import Identity
from render.types import AHEAD, Gaussians
from sensors.types import FPS, InputError

MUCH_BYTES = 200e6  # larger outputs are announced before they are written


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
        """Tell how much it will be; raises InputError where the disk has no room for it."""
        self._folder.mkdir(parents=True, exist_ok=True)
        rest = np.zeros(EXPRESSION_DIM, np.float32)
        _, gaussians = self._decoder.decode(rest, AHEAD, self._identity)
        try:
            with TemporaryDirectory(dir=self._folder) as spare:
                path = Path(spare) / f"rest{self._suffix}"
                self._save(path, gaussians)
                size = path.stat().st_size
        except OSError as error:  # a full disk; the spare folder is gone when it is told
            raise OSError(error.errno, error.strerror, str(self._folder)) from None
        files = FPS * 60 // self._every if info.frames is None else -(-info.frames // self._every)
        what = f"{files} files of {size / 1e6:.1f} MB, {files * size / 1e9:.2f} GB"
        if info.frames is None:
            what += " a minute"
        elif files * size > shutil.disk_usage(self._folder).free:
            raise InputError(
                f"{self._folder}: expected room for {what}, got a disk with less; "
                f"try --every {30 * self._every}"
            )
        if files * size > MUCH_BYTES:
            print(f"livedrive: {self._folder}: {what}; --every sets how many", file=sys.stderr)

    def on_frame(self, result: FrameResult) -> None:
        driven = result.driven
        if driven.index % self._every == 0:
            _, gaussians = self._decoder.decode(
                driven.expression, driven.gaze, self._identity, driven.head, driven.breath
            )
            self._save(self._folder / f"frame_{driven.index:06d}{self._suffix}", gaussians)

    def close(self) -> None:
        pass
