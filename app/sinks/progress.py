"""A progress bar on the terminal."""

from app.drive.sink import FrameResult, RunInfo


class ProgressSink:
    def __init__(self, what: str = "driving") -> None:
        self._what = what

    def on_start(self, info: RunInfo) -> None:
        from tqdm import tqdm

        self._bar = tqdm(total=info.frames, unit="frame", desc=self._what, disable=None)

    def on_frame(self, result: FrameResult) -> None:
        self._bar.update()

    def close(self) -> None:
        self._bar.close()
