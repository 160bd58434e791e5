"""The state of the window, one value that the panels read and change."""

from dataclasses import dataclass, field

import numpy as np

from app.drive.background import FILLS, Fill, flat
from app.window.state.history import History
from app.window.state.interpolation import Interpolation
from app.window.state.shared import WindowInfo
from render.cameras import Orbit
from render.decoder.learned import avatar_files

Rgb = tuple[float, float, float]
TOAST_S = 4.0


@dataclass
class State:
    info: WindowInfo
    controls: np.void  # app.window.state.shared.CONTROLS: what the loop reads
    history: History = field(default_factory=History)
    motion: Interpolation = field(default_factory=Interpolation)
    orbit: Orbit = Orbit()
    background: str = "studio"  # a name of FILLS, or "custom"
    custom: Rgb = (0.25, 0.28, 0.45)
    mirror: bool = False
    panels: bool = True
    help: bool = False
    toast: str = ""
    toast_left_s: float = 0.0
    still_s: float = 0.0  # since the mouse moved
    recording: bool = False  # as the button was left
    recording_from: int = 0  # frame at which the recording began
    draw_ms: float = 0.0  # decoding and drawing one picture of the head, lately
    hz: float = 0.0  # pictures shown a second
    labels: list[str] = field(init=False)  # of info.avatars, for people

    def __post_init__(self) -> None:
        self.labels = [avatar_files.label(name) for name in self.info.avatars]

    @property
    def avatar(self) -> str:
        return self.info.avatars[int(self.controls["avatar"])]

    @property
    def label(self) -> str:
        """Of the avatar."""
        return self.labels[int(self.controls["avatar"])]

    @property
    def emotions(self) -> tuple[str, ...]:
        """What can be picked: the names, and a mixture that was told once."""
        words = bytes(self.controls["words"]).decode()
        return (*self.info.emotions, *([words] if words else []))

    @property
    def fill(self) -> Fill:
        """What lies behind the head."""
        return FILLS.get(self.background, (*self.custom, 1.0))

    def choose_background(self, name: str) -> None:
        """A name of FILLS or #rrggbb."""
        self.background = name if name in FILLS else "custom"
        if name not in FILLS:
            self.custom = flat(name)

    def next_background(self) -> None:
        names = [*FILLS]
        place = names.index(self.background) + 1 if self.background in names else 0
        self.background = names[place % len(names)]

    def next_emotion(self) -> None:
        """The next of the list; after the last one none."""
        count, now = len(self.info.emotions), int(self.controls["emotion"])
        self.controls["emotion"] = now + 1 if now + 1 < count else -1
        if count:
            now = int(self.controls["emotion"])
            self.say(f"Emotion: {self.info.emotions[now] if now >= 0 else 'none of its own'}")

    def more_emotion(self, step: float) -> None:
        self.controls["intensity"] = min(max(float(self.controls["intensity"]) + step, 0.0), 1.0)

    def say(self, text: str) -> None:
        """A line that shows for a moment."""
        self.toast, self.toast_left_s = text, TOAST_S
