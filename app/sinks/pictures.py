"""PNG pictures of every n-th frame, named by frame index."""

from pathlib import Path

from app.drive.background import straight_alpha
from app.drive.sink import FrameResult, RunInfo
from sensors import files
from sensors.types import InputError


class PictureSink:
    def __init__(self, folder: Path, every: int, transparent: bool = False) -> None:
        """With `transparent` the pictures were drawn over black and keep their alpha."""
        if every < 1:
            raise InputError(f"--every: expected 1 or more frames, got {every}; try --every 30")
        self._folder, self._every, self._transparent = folder, every, transparent

    def on_start(self, info: RunInfo) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)

    def on_frame(self, result: FrameResult) -> None:
        from PIL import Image

        index = result.driven.index
        if result.picture is not None and index % self._every == 0:
            pixels = result.picture[..., :3]
            if self._transparent:
                pixels = straight_alpha(result.picture)
            picture = Image.fromarray(pixels)
            path = self._folder / f"frame_{index:06d}.png"
            with files.replacing(path, private=True, durable=False) as draft:
                picture.save(draft)

    def close(self) -> None:
        pass
