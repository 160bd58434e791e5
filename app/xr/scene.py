"""What both eyes see: the driven head between its ticks, and whoever else is there.

ticks -> Interpolation -> decode -> Gaussians -> camera and lobes of each eye -> picture
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from app.drive import background
from app.window.state.interpolation import AT_REST, Interpolation
from app.xr.link import XrInfo
from app.xr.painter import Painter
from app.xr.place import eye_camera, in_front
from app.xr.runtimes.protocol import Eye, Session
from render.decoder import identity
from render.decoder.decoder import EXPRESSION_DIM, Decoder
from render.splats.renderer import wrap_context
from render.types import AHEAD, Doubles, Gaussians
from sensors import rotation
from sensors.types import InputError

if TYPE_CHECKING:
    from render.gl.contexts import GLContext

REST = (np.zeros(EXPRESSION_DIM, np.float32), AHEAD, AT_REST)


class Scene:
    """Decoder, identity and renderer; stays when sessions come and go."""

    def __init__(self, context: "GLContext", info: XrInfo, wanted: Callable[[], str]) -> None:
        """`wanted` tells, at any time, which avatar is to be drawn."""
        self.motion = Interpolation()
        self._decoder = Decoder.load(gaussians=info.gaussians)
        self._wanted, self._chosen = wanted, wanted()
        self._who = identity.load(self._chosen)
        self._company = None
        if info.seats is not None:
            from app.call.table.company import Company
            from app.call.table.seats import Seats

            self._company = Company(self._decoder, Seats(info.seats))
        self._background = background.flat(info.background)
        self._painter = Painter(context, wrap_context(context))
        self._place: Doubles | None = None
        self._placed_for = -1  # Session.recentred

    def take(self, ticks: Sequence[np.void]) -> None:
        for tick in ticks:
            moments = int(tick["t_ns"]), int(tick["posted_ns"])
            self.motion.push(*moments, tick["expression"], tick["gaze"], tick["head"])

    def draw(
        self, session: Session, eyes: tuple[Eye, Eye], now_ns: int, share: float = 1.0
    ) -> None:
        """Draw both pictures; `share` of their width and height, scaled up."""
        cloud = self.cloud(now_ns)
        if self._place is None or session.recentred != self._placed_for:
            self._place = in_front(eyes, self._who.eye_centers.mean(0))
            self._placed_for = session.recentred
        width, height = (max(round(share * length), 1) for length in session.size)
        for number, eye in enumerate(eyes):
            camera = eye_camera(eye, self._place, width, height, self._background)
            self._painter.paint(cloud, camera, session.target(number))

    def forget_place(self) -> None:
        """Stand in front of the wearer again: another session has another LOCAL space."""
        self._place = None

    def cloud(self, now_ns: int) -> Gaussians:
        """Everything there is to see at this moment, in the avatar's world."""
        if (wanted := self._wanted()) != self._chosen:
            self._chosen = wanted
            with suppress(InputError, OSError):  # the old one stays, as elsewhere
                self._who = identity.load(wanted)
        expression, gaze, head = self.motion.at(now_ns) or REST
        *numbers, breath = head.tolist()
        pose = rotation.checked(numbers[:3], numbers[3:])
        _, cloud = self._decoder.decode(expression, gaze, self._who, pose, breath)
        return self._company.around(cloud, now_ns) if self._company else cloud

    def close(self) -> None:
        self._painter.close()
