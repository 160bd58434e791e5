"""Memory that the call's process shares with every renderer: the partners and their ticks.

    call -> Seats -> window, page, pictures: each asks its own FaceTrack for the pose of its moment

Nobody waits: the writer overwrites the oldest tick, a reader takes what it finds whole.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from app.call.media.face import FaceTrack
from app.call.wire.agreement import MAX_PEOPLE
from app.call.wire.packet import Tick
from app.process import memory
from sensors.types import NS, SAMPLE_RATE

SLOTS = 16  # ticks of a partner
TICK = np.dtype(
    [
        ("number", "<i8"),  # of posting, from 1; 0 while it is written
        ("index", "<i8"),
        ("due", "<i8"),  # media, see FaceTrack
        ("came_ns", "<i8"),
        ("expression", "<f4", (256,)),
        ("gaze", "<f4", (2, 3)),
        ("head_mm", "<f4", (3,)),
        ("head_wxyz", "<f4", (4,)),
        ("breath", "<f4"),
    ],
    align=True,
)
SEAT = np.dtype(
    [
        ("identity", "S32"),  # empty: nobody sits here
        ("name", "S160"),  # UTF-8
        ("avatar", "S160"),  # a name
        ("file", "S400"),  # an avatar's file that was sent and checked, or nothing
        ("level", "<f4"),  # of the voice
        ("posted", "<i8"),
        ("anchor", "<f8", (2,)),  # media, and media samples a sample of ours ...
        ("anchor_ns", "<i8"),  # ... at this moment of our clock
        ("behind_ms", "<f8"),  # told by a reader: see FaceTrack
        ("ticks", TICK, (SLOTS,)),
    ],
    align=True,
)
STATUS = np.dtype([("lines", "S2000"), ("may_record", "?")])  # lines for the screen, UTF-8


class Seats:
    """The memory, made here or opened by its handle."""

    def __init__(self, handle: str | None = None) -> None:
        size = SEAT.itemsize * (MAX_PEOPLE - 1) + STATUS.itemsize
        self._block = memory.attach(handle, size) if handle else memory.create(size)
        self.handle, buffer = self._block.handle, self._block.buffer
        self.rows = np.frombuffer(buffer, SEAT, MAX_PEOPLE - 1)
        self._status: Any = np.frombuffer(buffer, STATUS, 1, SEAT.itemsize * (MAX_PEOPLE - 1))

    @property
    def lines(self) -> list[str]:
        """What the screen shows of the call."""
        return self._status["lines"][0].decode(errors="ignore").splitlines()

    @lines.setter
    def lines(self, lines: list[str]) -> None:
        self._status["lines"][0] = "\n".join(lines).encode()[:2000]

    @property
    def may_record(self) -> bool:
        """Everybody agreed."""
        return bool(self._status["may_record"][0])

    @may_record.setter
    def may_record(self, agreed: bool) -> None:
        self._status["may_record"][0] = agreed

    def take(self, identity: str, name: str, avatar: str, file: str = "") -> None:
        """Give `identity` a seat or update its name; nothing where all are taken."""
        seat = self._seat(identity)
        if seat is None:
            free = [row for row in self.rows if not row["identity"]]
            if not free:
                return
            seat = free[0]
            seat["posted"], seat["anchor_ns"], seat["ticks"]["number"] = 0, 0, 0
            seat["behind_ms"] = 0
        seat["name"], seat["avatar"] = name.encode(), avatar.encode()
        seat["file"] = file.encode()
        seat["identity"] = identity.encode()

    def leave(self, identity: str) -> None:
        seat = self._seat(identity)
        if seat is not None:
            seat["identity"] = b""

    def post(self, identity: str, tick: Tick, due: int, now_ns: int) -> None:
        seat = self._seat(identity)
        if seat is None:
            return
        number = int(seat["posted"]) + 1
        slot = seat["ticks"][number % SLOTS]
        slot["number"] = 0
        slot["index"], slot["due"], slot["came_ns"] = tick.index, due, now_ns
        slot["expression"], slot["gaze"] = tick.expression, tick.gaze
        slot["head_mm"], slot["head_wxyz"] = tick.head_mm, tick.head_wxyz
        slot["breath"] = tick.breath
        slot["number"] = seat["posted"] = number

    def hear(self, identity: str, anchor: tuple[int, float, float], level: float) -> None:
        """Post the timeline (Timeline.anchor) and the voice level of `identity`."""
        seat = self._seat(identity)
        if seat is not None:
            seat["anchor_ns"], seat["level"] = 0, level
            seat["anchor"] = anchor[1:]
            seat["anchor_ns"] = anchor[0]

    def behind_ms(self) -> dict[str, float]:
        """Each face's lag behind its sound where it was drawn last."""
        rows = [row for row in self.rows if row["identity"]]
        return {row["identity"].decode(): float(row["behind_ms"]) for row in rows}

    def close(self) -> None:
        self._block.close()

    def _seat(self, identity: str) -> Any:
        found = [row for row in self.rows if row["identity"] == identity.encode()]
        return found[0] if found else None


@dataclass(frozen=True, eq=False)
class Sitter:
    """A partner as drawn at one moment."""

    identity: str
    name: str
    avatar: str
    file: str  # of the avatar, where one was sent
    tick: Tick
    presence: float  # 0 gone .. 1 here
    level: float  # of the voice


class SeatReader:
    """Turns what is in the memory into poses; each reader has one."""

    def __init__(self, seats: Seats) -> None:
        self.seats = seats
        self.faces: dict[str, FaceTrack] = {}
        self._taken: dict[str, int] = {}  # number of the newest tick
        self._anchors: dict[str, tuple[int, float, float]] = {}  # the newest that was whole

    def sitters(self, now_ns: int) -> list[Sitter]:
        """Everybody whose face is known, in the order of their seats."""
        found: list[Sitter] = []
        for row in self.seats.rows:
            identity = row["identity"].decode()
            anchor = self._anchor(identity, row)
            if not identity or anchor is None:
                continue
            face = self.faces.setdefault(identity, FaceTrack())
            self._push(identity, row, face)
            anchor_ns, media, rate = anchor
            media += (now_ns - anchor_ns) / NS * SAMPLE_RATE * rate
            shown = face.pose(media, now_ns)
            row["behind_ms"] = face.behind_ms
            if shown is not None:
                name, avatar, file = (
                    row[k].decode(errors="ignore") for k in ("name", "avatar", "file")
                )
                level = float(row["level"])
                found.append(
                    Sitter(identity, name, avatar, file, shown.tick, shown.presence, level)
                )
        return found

    def _anchor(self, identity: str, row: Any) -> tuple[int, float, float] | None:
        """Of the partner's timeline; the one before it while the next is written, which is often:
        it is written a hundred times a second."""
        anchor_ns, (media, rate) = int(row["anchor_ns"]), row["anchor"].tolist()
        if anchor_ns and anchor_ns == int(row["anchor_ns"]):
            self._anchors[identity] = anchor_ns, media, rate
        elif not row["posted"]:  # the seat was taken anew
            self._anchors.pop(identity, None)
        return self._anchors.get(identity)

    def _push(self, identity: str, row: Any, face: FaceTrack) -> None:
        last = self._taken.get(identity, 0)
        numbers = row["ticks"]["number"].copy()
        if numbers.max() < last:  # they had left: the count began anew
            last = 0
        for number in np.sort(numbers[numbers > last]):
            slot = row["ticks"][number % SLOTS].copy()
            if slot["number"] != number or row["ticks"][number % SLOTS]["number"] != number:
                continue
            tick = Tick(
                index=int(slot["index"]),
                expression=slot["expression"],
                gaze=slot["gaze"],
                head_mm=slot["head_mm"],
                head_wxyz=slot["head_wxyz"],
                breath=float(slot["breath"]),
            )
            face.push(tick, int(slot["due"]), int(slot["came_ns"]))
            last = int(number)
        self._taken[identity] = last
