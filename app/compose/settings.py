"""Settings of a run, as frozen values: commands fill them from options, `build` reads them."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from app.drive import background
from render.types import DENSITY, Density
from sensors.types import LOOPBACK, InputError

MAX_SIZE = 4096  # px
MAX_SEED = 1 << 63
WantedCondition = Literal["auto", "gaze", "eyes"]
Device = Literal["auto", "cpu", "cuda"]
HeadMode = Literal["auto", "synth", "track", "still"]
HEAD_MODE, CONDITION, SEED = "head", "condition", "seed"  # of a run, in the card of its session
XrMode = Literal["auto", "headless"]
HEAD_MODES = ("auto", "synth", "still")  # words of --head; anything else is a tracker
Switch = Literal["auto", "on", "off"]
WORN = ("headphone", "headset", "earphone", "earbud", "airpod", "beyond", "index", "quest")


@dataclass(frozen=True, kw_only=True)
class FileSettings:
    """The files that a run writes; None: not written."""

    video: Path | None = None
    pictures: Path | None = None  # folder of PNG
    motion: Path | None = None  # npz
    arkit: Path | None = None  # CSV
    ply: Path | None = None  # folder
    gltf: Path | None = None  # folder
    every: int = 30  # frames from one picture, PLY or glTF to the next

    def __post_init__(self) -> None:
        if self.every < 1:
            raise InputError(f"--every: expected 1 or more, got {self.every}; try --every 30")

    @property
    def written(self) -> list[Path]:
        """The paths that were asked for."""
        paths = (self.video, self.pictures, self.motion, self.arkit, self.ply, self.gltf)
        return list(dict.fromkeys(path for path in paths if path))  # PLY and glTF may share one


@dataclass(frozen=True, kw_only=True)
class NetworkSettings:
    """Network settings; by default nothing is sent and no port is opened."""

    send: tuple[str, ...] = ()  # URLs of app/sinks/table.py
    gains: Path | None = None  # JSON of gains and limits for `send`
    web: int | None = None  # port of the page, 0..65535
    host: str = LOOPBACK  # address that the page is served at
    microphone: bool = False  # the run listens to the page's microphone
    head: bool = False  # ... and to its headset
    sound: bool = False  # the page plays the partners of a call

    def __post_init__(self) -> None:
        if self.web is not None and not 0 <= self.web <= 65535:
            raise InputError(f"--web: expected a port in 0..65535, got {self.web}; try --web 8443")
        if self.sound and self.web is None:
            raise InputError("--speaker web: expected the page of --web, got none; add --web 8443")


@dataclass(frozen=True, kw_only=True)
class DriveSettings:
    """Who is driven, by what, and where the result goes. Raises InputError at values that cannot
    be used."""

    avatar: str = "ben"
    gaussians: Density = DENSITY
    fewer: bool = False  # ... where this computer would draw so many too late for a live picture
    emotion: str | None = None  # words; None: those of the source
    clip: Path | None = None  # folder of a CLIP model, for other words
    listen: int | None = None  # UDP port for OSC messages that set the emotion
    condition: WantedCondition = "auto"
    head: HeadMode = "auto"  # what moves it; still: nothing but speech and eyes move the face
    weights: Path | None = None  # folder of the networks; None: the shipped ones
    seed: int | None = None  # of all that is drawn at random; None: 0, or as recorded
    device: Device = "auto"  # of the networks
    realtime: bool = False  # at the pace of the clock
    draw: bool = False  # also where no file or camera needs a picture
    size: int = 512  # px, width and height of the picture
    background: str = "studio"
    virtual_camera: str | None = None  # a v4l2loopback device, or "auto"
    window: bool = False
    xr: XrMode | None = None  # in an OpenXR headset; headless: its poses alone
    title: str = "live"  # of the window
    files: FileSettings = field(default_factory=FileSettings)
    network: NetworkSettings = field(default_factory=NetworkSettings)

    def __post_init__(self) -> None:
        if not 64 <= self.size <= MAX_SIZE or self.size % 2:
            raise InputError(
                f"--size: expected an even number in 64..{MAX_SIZE}, got {self.size}; "
                "try --size 512"
            )
        if self.seed is not None and not 0 <= self.seed < MAX_SEED:
            raise InputError(f"--seed: expected 0 or more, got {self.seed}; try --seed 0")
        if self.listen is not None and not 0 <= self.listen <= 65535:
            raise InputError(
                f"--listen: expected a port in 0..65535, got {self.listen}; try --listen 9002"
            )
        if self.emotion is not None and not self.emotion.strip():
            raise InputError(
                f"--emotion: expected an emotion, got {self.emotion!r}; try --emotion neutral"
            )
        transparent = background.fill(self.background) == background.FILLS["transparent"]
        if transparent and (self.files.video or self.virtual_camera):
            raise InputError(
                "--background: expected a colour, as videos and cameras have no alpha, "
                "got 'transparent'; try --background green"
            )

    @property
    def needs_picture(self) -> bool:
        return self.draw or bool(self.files.video or self.files.pictures or self.virtual_camera)


@dataclass(frozen=True, kw_only=True)
class LiveSettings:
    """Which sensors are opened."""

    mic: str | None = None  # a name or part of it, "none", or "web"; None: the system's default
    eyes: tuple[str, ...] = ()  # SPECs of sensors/cameras/spec.py
    head: str = "auto"  # a SPEC of sensors/head/spec.py, "xr", "web", or one of HEAD_MODES
    seconds: float | None = None  # end by itself after so much sound

    @property
    def head_mode(self) -> HeadMode:
        modes: dict[str, HeadMode] = {"auto": "auto", "synth": "synth", "still": "still"}
        return modes.get(self.head, "track")

    def __post_init__(self) -> None:
        if self.seconds is not None and not 0 < self.seconds < float("inf"):
            raise InputError(
                f"--seconds: expected more than 0, got {self.seconds}; try --seconds 10"
            )


@dataclass(frozen=True, kw_only=True)
class SoundSettings:
    """What is done to the microphone's sound; auto: on unless the loudspeaker is worn."""

    echo: Switch = "auto"
    noise: Switch = "auto"

    def is_on(self, switch: Switch, speaker: str | None) -> bool:
        worn = speaker == "none" or any(word in (speaker or "").lower() for word in WORN)
        return switch == "on" or (switch == "auto" and not worn)
