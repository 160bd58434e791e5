"""What report and screen say of a partner's line."""

import numpy as np

from app.call.core.partner import PartnerCounts
from app.call.media.face import FaceTrack, end_of
from app.call.table.seats import SeatReader, Seats
from app.call.wire.packet import Tick
from render.types import AHEAD
from sensors.types import NS

TICK_NS = NS // 30


def test_loss_is_what_never_came_in_any_order() -> None:
    counts = PartnerCounts()
    for counter in (10, 12, 11, 14, 19):
        counts.count("codes", counter, 100, NS)
        counts.count("voice", 5 * counter, 100, NS)
    assert counts.loss == 0.5
    assert counts.kbps(2 * NS) == 8 * 10 * 150 / 1e3


def test_who_draws_a_face_tells_how_it_came() -> None:
    seats = Seats()
    reader = SeatReader(Seats(seats.handle))
    seats.take("ann", "Ann", "ada")
    for i in (0, 1, 2, 6, 7, 8):  # three ticks never come
        seats.post("ann", Tick(i, np.zeros(256, np.float32), AHEAD), end_of(i, 0), NS)
    for i in range(8):
        seats.hear("ann", (NS + i * TICK_NS, float(end_of(i, 0)), 1.0), 0.0)
        reader.sitters(NS + i * TICK_NS)
    seen = seats.seen()["ann"]
    assert (seen.due, seen.held) == (7, 3) and seen.behind_ms >= 0


def test_a_late_face_is_behind_its_sound() -> None:
    face = FaceTrack()
    face.push(Tick(0, np.zeros(256, np.float32), AHEAD), end_of(0, 0), NS)
    for k in range(200):
        face.pose(float(end_of(0, 0) + 4800), NS + k)
    assert abs(face.seen.behind_ms - 100) < 1
