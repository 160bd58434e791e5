"""What `run`, `call` and `record` share: which sensors are opened, and how they end."""

import signal
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from app.commands.options import DriveOptions
from app.compose.settings import DriveSettings, LiveSettings
from app.terminal.arguments import Amount, optional
from sensors.cameras import table
from sensors.head import spec as heads
from sensors.types import InputError

if TYPE_CHECKING:
    from sensors.live.source import LiveSource


@dataclass(kw_only=True)
class LiveOptions:
    """Options of the commands that read the sensors."""

    mic: Annotated[str | None, optional("NAME|none|web")] = None
    """Microphone: its name or part of it, see livedrive devices; none: silence; web: that of the
    --web page."""
    eyes: Annotated[
        tuple[str, ...],
        tyro.conf.arg(
            metavar="SPEC ...",
            help=f"One camera for both eyes, or left and right: {table.HELP}. After a #: eye=left, "
            "swap, mirror, turn=90, crop=X:Y:W:H, or profile=NAME.",
        ),
    ] = ()
    head: Annotated[
        str,
        tyro.conf.arg(
            metavar="SPEC|still|synth|auto",
            help=f"Where the head's pose comes from: {heads.HELP}; xr: the headset of --xr; web: "
            "one at the --web page; synth: made from speech; still: none; auto: a headset if there "
            "is one, else synth.",
        ),
    ] = "auto"
    seconds: Amount = None
    """Stop after this much sound."""

    def live_settings(self) -> LiveSettings:
        return LiveSettings(mic=self.mic, eyes=self.eyes, head=self.head, seconds=self.seconds)


@dataclass(kw_only=True)
class LiveDriveOptions(LiveOptions, DriveOptions):
    """Options of the commands that drive the head live."""

    headless: bool = False
    """Open no window."""

    def live_drive_settings(
        self, title: str, *, web_sound: bool = False, in_call: bool = False
    ) -> DriveSettings:
        """All options as settings; without --headless there is a window. `web_sound`: partners are
        heard at the page."""
        if self.headless and self.window:
            raise InputError("window: expected --headless or --window, got both; give one")
        self.window = not self.headless
        return self.settings(
            realtime=True,
            draw=False,
            title=title,
            head=self.live_settings().head_mode,
            web_microphone=self.mic == "web",
            web_head=self.head in ("auto", "web"),
            web_sound=web_sound,
            in_call=in_call,
        )


@contextmanager
def ends_on_signals(source: "LiveSource") -> Generator[list[int]]:
    """Ctrl-C, `kill` and a closed terminal end the source, so that everything is finished; a
    second one breaks off.

    Yields the list of signals that came.
    """
    came: list[int] = []

    def stop(number: int, _: Any) -> None:
        if came:
            raise KeyboardInterrupt
        came.append(number)
        source.stop()

    numbers = [signal.SIGINT, signal.SIGTERM]
    hang_up = getattr(signal, "SIGHUP", None)  # not there on Windows
    if hang_up and signal.getsignal(hang_up) != signal.SIG_IGN:  # ignored under `nohup`
        numbers.append(hang_up)
    before = {number: signal.signal(number, stop) for number in numbers}
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
