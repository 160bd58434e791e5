"""What `replay` and `run` share: who is driven and how, what is drawn, what is written or sent."""

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from app.compose.settings import (
    DriveSettings,
    FileSettings,
    HeadMode,
    NetworkSettings,
    XrMode,
)
from app.sinks import table
from app.terminal import confirm, outputs
from app.terminal.arguments import File, Port, check_host, optional
from render.decoder.learned import avatar_files
from render.types import DENSITY, SHARED_DENSITY, Density
from sensors.types import LOOPBACK, InputError


@dataclass(kw_only=True)
class DriveOptions:
    """Options of every command that drives the head."""

    video: File = None
    """Write a video with sound, e.g. out.mp4."""
    pictures: File = None
    """Write PNG pictures into this folder."""
    every: int = 30
    """Write every n-th frame as picture, PLY or glTF."""
    motion: File = None
    """Write codes, gaze, blendshapes and vertices, e.g. out.npz."""
    arkit: File = None
    """Write a Live Link Face table, e.g. out.csv."""
    ply: File = None
    """Write the Gaussians into this folder as PLY files."""
    gltf: File = None
    """Write the Gaussians into this folder as glTF files."""
    report: File = None
    """Write timings and settings, e.g. out.json."""
    window: bool = False
    """Show the head in a window; F1 lists its keys."""
    xr: Annotated[
        tuple[Literal["auto", "headless"], ...] | None,
        optional(
            "[auto|headless]",
            "Show the head life-size in an OpenXR headset and follow its pose; headless: follow "
            "the pose only, while another program uses the display.",
        ),
    ] = None
    virtual_camera: Annotated[str | None, optional("DEVICE|auto")] = None
    """Act as a webcam for video calls: a v4l2loopback device like /dev/video10, or auto."""
    background: str = "studio"
    """Background: studio, grey, white, green, transparent or #rrggbb."""
    avatar: str = "ben"
    """Avatar to drive: a name from livedrive avatar list, or FILE.safetensors."""
    gaussians: Literal["auto", "16k", "32k", "65k"] = "auto"
    """Gaussians of the head without hair; auto: 65k, with --web, with --xr and in calls 32k, and
    fewer where this computer would draw a live picture of so many too late."""
    emotion: Annotated[str | None, optional("NAME[:INTENSITY]")] = None
    """Emotion that the face shows while speaking: happy, sad:0.7, happy:0.5+surprised:0.3,
    neutral. A replay shows the recorded one unless this is given."""
    clip: File = None
    """Folder of a CLIP model; with it, --emotion understands other words, too."""
    listen: Port = None
    """UDP port on this machine for OSC messages such as /livedrive/emotion happy:0.7."""
    condition: Literal["auto", "gaze", "eyes"] = "auto"
    """What drives the upper face: synthesised gaze or the eye cameras; auto: cameras if any."""
    weights: File = None
    """Folder of networks that you trained (livedrive train --out); default: the shipped ones."""
    size: Annotated[int, tyro.conf.arg(metavar="PX")] = 512
    """Width and height of the picture, in pixels."""
    seed: Annotated[int | None, optional("N")] = None
    """Seed of the diffusion noise and of the synthesised gaze; default: 0, or that of the session
    that is replayed."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where the networks run."""
    send: Annotated[
        tuple[str, ...],
        tyro.conf.arg(metavar="URL ...", help=f"Send the face to programs: {table.HELP}."),
    ] = ()
    gains: File = None
    """JSON of gains and limits for --send: {"jawOpen": {"gain": 1.4, "low": 0, "high": 0.9}}."""
    web: Port = None
    """Serve a web page with the live head, for browsers and headsets, e.g. --web 8443."""
    host: str = LOOPBACK
    """Address that --web listens on; other than on this machine alone (0.0.0.0: all networks) it
    uses https and a token."""

    @property
    def xr_mode(self) -> XrMode | None:
        """What follows --xr; auto if nothing does."""
        if self.xr is None:
            return None
        if len(self.xr) > 1:
            raise InputError(f"--xr: expected auto or headless, got {' '.join(self.xr)}; give one")
        return self.xr[0] if self.xr else "auto"

    def _density(self, in_call: bool) -> Density:
        if self.gaussians != "auto":
            return self.gaussians
        shared = in_call or self.web is not None or self.xr is not None
        return SHARED_DENSITY if shared else DENSITY

    def settings(
        self,
        *,
        realtime: bool,
        draw: bool,
        title: str,
        head: HeadMode = "auto",
        web_microphone: bool = False,
        web_head: bool = False,
        web_sound: bool = False,
        in_call: bool = False,
    ) -> DriveSettings:
        """These options as settings; raises InputError if they cannot be used."""
        check_host(self.host, self.web)
        avatar_files.path_of(self.avatar)
        outputs.check_distinct(
            {
                "--video": self.video,
                "--motion": self.motion,
                "--arkit": self.arkit,
                "--report": self.report,
            },
            {"--pictures": self.pictures, "--ply": self.ply, "--gltf": self.gltf},
        )
        outputs.check("--motion", self.motion, (".npz",))
        outputs.check("--arkit", self.arkit, (".csv",))
        outputs.check("--report", self.report, outputs.REPORTS)
        confirm.overwriting(
            [self.video, self.pictures, self.motion, self.arkit, self.ply, self.gltf, self.report]
        )
        return DriveSettings(
            avatar=self.avatar,
            gaussians=self._density(in_call),
            fewer=self.gaussians == "auto",
            emotion=self.emotion,
            clip=self.clip,
            listen=self.listen,
            condition=self.condition,
            head=head,
            weights=self.weights,
            seed=self.seed,
            device=self.device,
            realtime=realtime,
            draw=draw,
            size=self.size,
            background=self.background,
            virtual_camera=self.virtual_camera,
            window=self.window,
            xr=self.xr_mode,
            title=title,
            files=FileSettings(
                video=self.video,
                pictures=self.pictures,
                motion=self.motion,
                arkit=self.arkit,
                ply=self.ply,
                gltf=self.gltf,
                every=self.every,
            ),
            network=NetworkSettings(
                send=self.send,
                gains=self.gains,
                web=self.web,
                host=self.host,
                microphone=web_microphone,
                head=web_head,
                sound=web_sound,
            ),
        )
