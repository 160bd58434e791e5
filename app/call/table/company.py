"""All heads of a call in one cloud: partners side by side, the speaker larger, the own head small.

All are one cloud of Gaussians, so that window, page, headset and pictures draw a call as they draw
one head.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.call.table.seats import SeatReader, Seats, Sitter
from render.decoder import identity
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.decoder.learned import avatar_files
from render.types import FIELDS, Gaussians, Shine
from sensors.types import HeadPose, InputError

SPACING_MM = 300.0  # from head to head
FIRST_MM = 340.0  # as wide as one head alone may be drawn
TURN_DEG = 14.0  # that a seat's neighbour is turned towards the middle
BACK_MM = 40.0  # that it sits farther back
SPEAKER = 1.25  # times as large
FOLLOW = 0.08  # of the way to the new speaker's size, a picture
SPEAKS = 0.01  # voice level
OWN_SCALE, OWN_AT_MM = 0.3, (112.0, -92.0, 60.0)  # lower right, in front
FALLBACK = "ben"
MAX_AVATARS = 16  # that are kept loaded
Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Place:
    """Placement of a head: turned about the vertical, scaled, moved."""

    scale: float
    turn_deg: float
    at_mm: tuple[float, float, float]


def places(sizes: list[float]) -> list[Place]:
    """A seat for each partner, left to right; `sizes` 1, or up to SPEAKER."""
    count = len(sizes)
    share = FIRST_MM / max(FIRST_MM, SPACING_MM * count)
    found: list[Place] = []
    for seat, size in enumerate(sizes):
        off = seat - (count - 1) / 2
        # Seen from the front the subject's left is on the right, so seats go from +x to -x.
        at = (-off * SPACING_MM * share, 0.0, -BACK_MM * abs(off) * share)
        scale = share * (size if count > 1 else 1.0)
        found.append(Place(scale, TURN_DEG * off, at))
    return found


def placed(gaussians: Gaussians, place: Place, presence: float = 1.0) -> Gaussians:
    """A copy where it belongs, `presence` times as opaque."""
    angle = np.radians(place.turn_deg)
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]], np.float32) * np.float32(
        place.scale
    )
    half = np.float32(np.cos(angle / 2)), np.float32(np.sin(angle / 2))
    w, x, y, z = gaussians.quats.T
    quats = np.stack(
        [
            half[0] * w - half[1] * y,
            half[0] * x + half[1] * z,
            half[0] * y + half[1] * w,
            half[0] * z - half[1] * x,
        ],
        1,
    )
    return Gaussians(
        means=(gaussians.means @ turn.T + place.at_mm).astype(np.float32),
        quats=quats,
        scales=gaussians.scales * np.float32(place.scale),
        opacities=gaussians.opacities * np.float32(presence),
        colors=gaussians.colors.copy(),
        shine=gaussians.shine,
    )


class Company:
    """Draws with one decoder; avatars are loaded when first needed."""

    def __init__(self, decoder: Decoder, seats: Seats) -> None:
        self._decoder, self._reader = decoder, SeatReader(seats)
        self._sizes: dict[str, float] = {}
        self._avatars: dict[str, Identity] = {}

    @property
    def lines(self) -> list[str]:
        """What the screen shows of the call."""
        return self._reader.seats.lines

    def around(self, own: Gaussians, now_ns: int) -> Gaussians:
        """Everybody; the own head alone while nobody else is there."""
        sitters = self._reader.sitters(now_ns)
        if not sitters:
            return own
        clouds: list[Gaussians] = []
        for sitter, place in zip(sitters, places(self._follow(sitters)), strict=True):
            tick, who = sitter.tick, self._avatar(sitter)
            x, y, z = tick.head_mm.tolist()
            a, b, c, d = tick.head_wxyz.tolist()
            head = HeadPose((x, y, z), (a, b, c, d))
            _, cloud = self._decoder.decode(tick.expression, tick.gaze, who, head, tick.breath)
            clouds.append(placed(cloud, place, sitter.presence))
        clouds.append(placed(own, Place(OWN_SCALE, 0.0, OWN_AT_MM)))
        return joined(clouds)

    def _follow(self, sitters: list[Sitter]) -> list[float]:
        """Enlarge the loudest and shrink the others, slowly."""
        loudest = max(sitters, key=lambda s: s.level)
        for sitter in sitters:
            goal = SPEAKER if sitter is loudest and sitter.level > SPEAKS else 1.0
            size = self._sizes.get(sitter.identity, 1.0)
            self._sizes[sitter.identity] = size + FOLLOW * (goal - size)
        return [self._sizes[s.identity] for s in sitters]

    def _avatar(self, sitter: Sitter) -> Identity:
        """The file that was sent and checked, or a name that is known here: a partner names no
        file of this machine."""
        name = sitter.file or sitter.avatar
        if name not in self._avatars:
            if len(self._avatars) >= MAX_AVATARS:
                self._avatars.clear()
            known = sitter.file or name in avatar_files.names()
            try:
                self._avatars[name] = identity.load(name if known else FALLBACK)
            except (InputError, OSError):  # a process that may not read it, or it went
                self._avatars[name] = identity.load(FALLBACK)
        return self._avatars[name]


def joined(clouds: list[Gaussians]) -> Gaussians:
    """One cloud; what a head mirrors stays on its own Gaussians, under the first one's lamps."""
    arrays = (np.concatenate([getattr(c, name) for c in clouds]) for name in FIELDS)
    return Gaussians(*arrays, shine=_shine(clouds))


def _shine(clouds: list[Gaussians]) -> Shine | None:
    shining = [cloud.shine for cloud in clouds if cloud.shine is not None]
    if not shining:
        return None
    count = sum(len(cloud) for cloud in clouds)
    weights, roughness = np.zeros((count, 4), np.float32), np.ones(count, np.float32)
    start = 0
    for cloud in clouds:
        if cloud.shine is not None:
            rows = slice(start, start + len(cloud.shine.weights))
            weights[rows], roughness[rows] = cloud.shine.weights, cloud.shine.roughness
        start += len(cloud)
    return Shine(weights, roughness, shining[0].lamps)
