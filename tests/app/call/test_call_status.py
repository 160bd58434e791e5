"""What report and screen say of a partner's line."""

from collections.abc import Container
from dataclasses import replace

import numpy as np
import pytest

from app.call.core.call import GONE_NS, Call
from app.call.core.partner import Partner, PartnerCounts
from app.call.core.status import report_of, told_lines
from app.call.media.face import FaceTrack, end_of
from app.call.rooms.addresses import here
from app.call.rooms.room import BYE, HELLO
from app.call.table.seats import SeatReader, Seats
from app.call.trial.material import synthetic_material
from app.call.wire.agreement import MAX_PEOPLE, Hello
from app.call.wire.packet import Packer, Tick
from app.call.wire.seal import Keyring
from render.types import AHEAD
from sensors.types import NS

PULL, STEP_NS = 480, NS // 100
ANN, BEN = "aa" * 16, "bb" * 16


class Silence:
    """Stands in for Opus."""

    def decode(self, payload: bytes) -> np.ndarray:
        return np.zeros(PULL, np.float32)

    recover = decode

    def conceal(self) -> np.ndarray:
        return np.zeros(PULL, np.float32)

    def close(self) -> None: ...


def test_loss_is_what_never_came_in_any_order() -> None:
    counts = PartnerCounts()
    for counter in (10, 12, 11, 14, 19):
        counts.count("codes", counter, 100, NS)
        counts.count("voice", 5 * counter, 100, NS)
    assert counts.loss == 0.5
    assert counts.kbps(2 * NS) == 8 * 10 * 150 / 1e3


def heard(drawn_hz: int, never: Container[int] = (), late: Container[int] = ()) -> Partner:
    """Ann as Ben's end had her in ten seconds: ticks that `never` came, or half a second late;
    somebody draws her so often."""
    packer, keys, seats = Packer(synthetic_material(2, 0).basis), Keyring(bytes(16), ANN), Seats()
    ann = Partner(ANN, Keyring(bytes(16), BEN), packer, Silence())
    seats.take(ANN, "Ann", "ada")
    reader, codes = SeatReader(seats), dict[int, bytes]()
    for i in range(180):
        fields = packer.fields(Tick(i, np.zeros(256, np.float32), AHEAD))
        if i not in never:
            codes[(i + 1) * 10 // 3 + 1 + 50 * (i in late)] = packer.message([fields], i, 0)
    for step in range(600):
        now_ns = NS + step * STEP_NS

        def show(tick: Tick, due: int, now_ns: int = now_ns) -> None:
            seats.post(ANN, tick, due, now_ns)

        ann.packet("voice", keys.seal("voice", b"x", step), now_ns, show)
        if step in codes:
            ann.packet("codes", keys.seal("codes", codes[step]), now_ns, show)
        ann.pull(PULL, now_ns, now_ns)
        if ann.timeline.started:
            seats.hear(ANN, ann.timeline.anchor, 0.0)
            if drawn_hz and step % (100 // drawn_hz) == 0:
                reader.sitters(now_ns)
    return ann


@pytest.mark.parametrize("drawn_hz", [0, 1, 50])
def test_a_tick_that_nobody_drew_is_not_held(drawn_hz: int) -> None:
    """Red before: a window that drew once a second called half of the ticks held."""
    face = heard(drawn_hz).face
    assert face.held == 0 and face.due > 150


@pytest.mark.parametrize("drawn_hz", [0, 1, 50])
def test_a_tick_that_comes_too_late_or_never_is_held(drawn_hz: int) -> None:
    assert heard(drawn_hz, never=(100, 101, 150)).face.held == 3
    assert heard(drawn_hz, late=(100, 101)).face.held == 2


def test_a_late_face_is_behind_its_sound() -> None:
    face, seats = FaceTrack(), Seats()
    face.push(Tick(0, np.zeros(256, np.float32), AHEAD), end_of(0, 0), NS)
    for k in range(200):
        face.pose(float(end_of(0, 0) + 4800), NS + k)
    assert abs(face.behind_ms - 100) < 1
    for k in range(200):  # red before: held or gone, it went on to grow, by seconds
        face.pose(float(end_of(0, 0) + 480_000), NS + k)
    assert abs(face.behind_ms - 100) < 1
    seats.take("ann", "Ann", "ada")
    seats.post("ann", Tick(0, np.zeros(256, np.float32), AHEAD), end_of(0, 0), NS)
    seats.hear("ann", (NS, float(end_of(0, 0) + 4800), 1.0), 0.0)
    reader = SeatReader(Seats(seats.handle))
    for k in range(200):
        reader.sitters(NS + k)
    assert abs(seats.behind_ms()["ann"] - 100) < 1


class Meeting:
    """Ann's end, to which others say hello."""

    def __init__(self) -> None:
        self.told: list[str] = []
        self.now_ns, self.basis = 0, synthetic_material(2, 0).basis
        hello, keys = Hello(identity=ANN, name="Ann", basis=self.basis.number), bytes(16)
        say, see = self.told.append, lambda sight, now_ns: None
        self.call = Call(keys, hello, self.basis, say, see, lambda: self.now_ns)

    def comes(self, number: int, **state: object) -> None:
        identity = f"{number:032x}"
        hello = Hello(identity=identity, name=f"Ben {number}", basis=self.basis.number)
        self.call.events().message(identity, HELLO + replace(hello, **state).to_bytes())


def test_who_vanished_keeps_nobody_out() -> None:
    """Red before: after seven crashes of a partner nobody could come back."""
    meeting = Meeting()
    for number in range(2 * MAX_PEOPLE):
        meeting.comes(number)
        assert f"Ben {number} is here: y and Enter accept" in meeting.told
        meeting.now_ns += 2 * GONE_NS
        meeting.call.step()
    assert len(meeting.call.partners) == MAX_PEOPLE - 1 and "Ben 0 has left" in meeting.told
    for number in range(100, 100 + MAX_PEOPLE):
        meeting.comes(number)
    assert meeting.told[-1].endswith(f"expected {MAX_PEOPLE} people at most")


def test_the_report_names_who_vanished() -> None:
    """Red before: the name was empty, so nobody knew whose line it was."""
    meeting = Meeting()
    meeting.comes(1)
    meeting.now_ns = 2 * GONE_NS
    meeting.call.step()
    assert [line["name"] for line in report_of(meeting.call, {}).values()] == ["Ben 1"]


def test_the_delay_of_who_left_stays_what_it_was() -> None:
    """Red before: it was told as of the end of the call, by when it could be -250 ms."""
    meeting, ben = Meeting(), f"{1:032x}"
    meeting.now_ns = NS
    meeting.comes(1, origin_ns=1, now_ns=NS, echoes=((ANN, NS, NS),))
    timeline = meeting.call.partners[ben].timeline
    for step in range(100):
        timeline.arrived("face", 480.0 * step, NS + step * STEP_NS)
    assert timeline.target(2 * NS) is not None
    timeline.played(0.9 * 48_000, NS, 1.02)  # said 0.1 s before
    meeting.call.events().message(ben, BYE)
    meeting.now_ns = 60 * NS
    line = report_of(meeting.call, {})[ben]
    assert abs(line["mouth_to_ear_ms"] - 100) < 1e-3  # type: ignore[operator]


def test_another_version_is_told_in_words() -> None:
    """Red before: the line began with 32 digits."""
    meeting = Meeting()
    for _ in range(3):
        meeting.comes(1, version=2)
        meeting.comes(2, basis=1)
    assert len(meeting.told) == 2 and meeting.told[0].startswith("hello: expected version 1, got 2")
    assert meeting.told[1].startswith("Ben 2: expected face basis")


def test_consent_is_given_to_who_is_here() -> None:
    """Red before: who came after the first had left was heard and heard without a question."""
    meeting = Meeting()
    meeting.comes(1)
    meeting.call.change(accepted=True)
    meeting.comes(1, met=(ANN,))  # a second hello of the same, who is no other
    meeting.now_ns = 2 * GONE_NS
    meeting.call.step()
    meeting.comes(1)  # after a loss: the same
    assert meeting.call.hello.accepted
    meeting.comes(2)  # beside somebody
    assert meeting.call.hello.accepted
    for number in (1, 2):
        meeting.call.events().message(f"{number:032x}", BYE)
    meeting.comes(3)
    assert not meeting.call.hello.accepted
    assert meeting.told[-1] == "Ben 3 is here: y and Enter accept"


def test_a_terminal_says_what_a_window_shows() -> None:
    """Red before: in a call without a window nobody knew that it was being recorded."""
    meeting = Meeting()
    assert told_lines(meeting.call) == []
    meeting.comes(1)
    assert told_lines(meeting.call) == ["Ben 1, has not accepted yet"]
    meeting.comes(1, accepted=True, muted=True, records=True)
    assert told_lines(meeting.call) == ["Ben 1, muted, asks to record"]
    meeting.call.change(records=True, may_record=True)
    meeting.comes(1, accepted=True, records=True, may_record=True)
    assert told_lines(meeting.call) == ["RECORDING, everybody agreed", "Ben 1, records"]


@pytest.mark.parametrize(
    ("address", "found"),
    [
        ("127.0.0.1", "127.0.0.1"),
        ("localhost", "127.0.0.1"),
        ("203.0.113.7", ""),  # of a router
        ("0.0.0.0", ""),
        ("no.such.host.invalid", ""),
        ("..", ""),
    ],
)
def test_which_address_of_this_machine_is_meant(address: str, found: str) -> None:
    """Red before: with a router's address a call had neither voice nor face, and with one of this
    machine its port was open on all others."""
    assert here(address) == found
