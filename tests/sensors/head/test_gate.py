"""What a tracker claims and no head does: counted, dropped, said once."""

from dataclasses import replace
from math import radians

import pytest

from sensors import rotation
from sensors.head.gate import BURST, MAX_HZ, Reading, ReadingGate
from sensors.rotation import UNIT
from sensors.types import NS, HeadPacket

NAN, MS = float("nan"), NS // 1000
ORIGIN = (0.0, 0.0, 0.0)


def turned(degrees: float) -> Reading:
    return Reading(ORIGIN, rotation.from_angles((0.0, radians(degrees), 0.0)))


class Told(list[str]):
    def __call__(self, line: str) -> None:
        self.append(line)


@pytest.mark.parametrize(
    "bad",
    [
        Reading(ORIGIN, (0.0, 0.0, 0.0, 0.0)),
        Reading((NAN, 0.0, 0.0), UNIT),
        Reading(ORIGIN, (NAN, NAN, NAN, NAN)),
        Reading((0.0, 1e300, 0.0), UNIT),
        Reading(ORIGIN, (1e300, 1e300, 0.0, 0.0)),
    ],
)
def test_what_is_no_pose_is_dropped_and_said_once(bad: Reading) -> None:
    told = Told()
    gate = ReadingGate("vmc://:1", told)
    passed = [gate(bad if k % 2 else turned(0), k * 10 * MS) for k in range(20)]
    assert [p is None for p in passed] == [bool(k % 2) for k in range(20)]
    assert gate.counts.bad == gate.counts.poses == 10
    assert len(told) == 1 and "\n" not in told[0]


def test_a_jump_is_left_out_until_it_lasts() -> None:
    told = Told()
    gate = ReadingGate("t", told)
    turns = [0.0] * 10 + [90.0] + [0.0] * 10 + [90.0] * 40
    passed = [gate(turned(turn), k * 10 * MS) for k, turn in enumerate(turns)]
    assert passed[10] is None and passed[11] is not None  # one wild pose
    assert all(p is None for p in passed[21:46]) and passed[46] is not None  # after 250 ms
    assert gate.counts.jumps == 26 and len(told) == 1


def test_a_quick_turn_is_no_jump() -> None:
    gate = ReadingGate("t", Told())
    for k in range(20):  # 700 degrees a second
        assert gate(turned(7.0 * k), k * 10 * MS)


def test_poses_that_come_at_once_after_a_stall_are_judged_by_the_senders_clock() -> None:
    gate = ReadingGate("t", Told())
    for k in range(10):
        assert gate(replace(turned(0), device_s=5 + k * 0.016), k * 16 * MS)
    for k in range(1, 8):  # 900 degrees a second for a tenth of one
        assert gate(replace(turned(15.0 * k), device_s=5.144 + k * 0.016), 256 * MS + k)
    assert gate(replace(turned(195), device_s=NAN), 256 * MS + 9) is None
    assert gate(replace(turned(195), device_s=1e3), 256 * MS + 9) is None
    assert gate.counts.jumps == 2


def test_a_flood_is_cut_down() -> None:
    told = Told()
    gate = ReadingGate("t", told)
    kept = sum(gate(turned(0), k * NS // 20_000) is not None for k in range(20_000))
    assert kept <= MAX_HZ + BURST and gate.counts.flooded == 20_000 - kept and len(told) == 1


def test_the_sender_clock_smooths_arrivals_and_never_goes_back_or_ahead() -> None:
    gate = ReadingGate("t", Told())
    delays = [3, 9, 1, 30, 2, 5, 1, 8] * 40
    packets: list[HeadPacket] = []
    arrivals: list[int] = []
    at_ns = 0
    for k, delay in enumerate(delays):
        device_s = 500.0 + k / 60 if k < 200 else 3.0 + k / 60  # set anew in the middle
        at_ns = max(at_ns, NS + k * NS // 60 + delay * MS)
        packet = gate(Reading(ORIGIN, UNIT, device_s), at_ns)
        assert packet is not None
        packets.append(packet)
        arrivals.append(at_ns)
    times = [p.t_ns for p in packets]
    assert times == sorted(times)
    assert all(t <= arrival for t, arrival in zip(times, arrivals, strict=True))
    even = [b - a for a, b in zip(times[8:190], times[9:190], strict=False)]
    assert max(abs(step - NS // 60) for step in even) < MS
    assert gate.counts.clock_jumps == 1


def test_a_sender_that_starts_anew_is_met_at_once() -> None:
    """Red before: its poses counted as a second old, and the head eased away."""
    gate = ReadingGate("t", Told())
    for start_ns, device_s in ((NS, 100.0), (9 * NS, 0.0)):
        for k in range(120):
            at_ns = start_ns + k * NS // 60
            packet = gate(Reading(ORIGIN, UNIT, device_s + k / 60), at_ns)
            assert packet and at_ns - packet.t_ns < MS


@pytest.mark.parametrize("device_s", [NAN, float("inf"), 1e300, None])
def test_a_clock_that_is_none_leaves_the_arrival(device_s: float | None) -> None:
    packet = ReadingGate("t", Told())(Reading(ORIGIN, UNIT, device_s), 5 * NS)
    assert packet and packet.t_ns == 5 * NS
