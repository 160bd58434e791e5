"""Consent and mute follow from what both ends said last, and from nothing else."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.call.live import protocol
from app.call.live.link import CallLink
from app.call.live.protocol import CallSettings
from app.call.wire.agreement import (
    MAX_HELLO,
    Hello,
    clock_difference_ns,
    heard_by,
    is_fresh,
    may_receive,
    may_record,
    may_send,
    news,
    read_hello,
)
from app.call.wire.packet import MalformedError

ANN = Hello(identity="a" * 32, name="Ann", basis=7)
BEN = Hello(identity="b" * 32, name="Ben", basis=7)


def accepted(who: Hello, *met: Hello) -> Hello:
    return replace(who, accepted=True, met=tuple(m.identity for m in met))


def test_nothing_leaves_before_both_accepted() -> None:
    both = accepted(ANN, BEN), accepted(BEN, ANN)
    assert may_send(*[both[0], [both[1]]]) and may_receive(*both)
    for mine, theirs in [
        (ANN, both[1]),
        (both[0], BEN),
        (both[0], replace(both[1], accepted=False)),
    ]:
        assert not may_send(mine, [theirs]) and not may_receive(mine, theirs)
    assert not may_send(both[0], [])


def test_a_recorded_hello_of_an_earlier_call_opens_nothing() -> None:
    earlier = accepted(BEN, replace(ANN, identity="c" * 32))
    assert not is_fresh(ANN, earlier) and not may_send(accepted(ANN), [earlier])


def test_recording_needs_everybody() -> None:
    mine = replace(accepted(ANN, BEN), records=True)
    yes, no = replace(BEN, may_record=True), BEN
    assert may_record(mine, [yes]) and may_record(mine, [yes, yes])
    assert not may_record(mine, [yes, no]) and not may_record(mine, [])
    assert not may_record(replace(mine, records=False), [yes])


def test_who_comes_and_asks_is_told_with_the_keys_that_answer() -> None:
    """Red before: a terminal told that somebody was there, and not that this end had to accept."""
    mine = replace(ANN, met=(BEN.identity,))
    assert news(ANN, None, BEN) == ["Ben is here: y and Enter accept"]
    assert news(accepted(ANN), None, BEN) == ["Ben is here"] and news(mine, BEN, BEN) == []
    asks = replace(BEN, records=True)
    assert news(mine, BEN, asks) == ["Ben asks to record: r and Enter agree"]
    assert news(mine, asks, asks) == news(replace(mine, may_record=True), BEN, asks) == []
    offers = replace(BEN, parcel="f" * 64, parcel_bytes=12_000)
    assert news(accepted(ANN), None, offers)[1] == (
        "Ben offers an avatar's file, 12 kB: a and Enter take it"
    )


def test_heard_by_counts_those_who_say_so() -> None:
    assert heard_by(ANN, [replace(BEN, hears=(ANN.identity,)), BEN]) == 1


def test_clocks_are_compared_by_echoes() -> None:
    """Their clock is 5000 ahead; 30 there, 40 spent with them, 30 back."""
    theirs = replace(BEN, now_ns=5000 + 1070, echoes=((ANN.identity, 1000, 5000 + 1030),))
    assert clock_difference_ns(ANN, theirs, now_ns=1100) == (5000, 60)
    assert clock_difference_ns(ANN, BEN, now_ns=1100) is None


def test_a_hello_comes_back() -> None:
    mine = replace(
        accepted(ANN, BEN), name="Zoë", hears=(BEN.identity,), echoes=((BEN.identity, 1, -2),)
    )
    assert read_hello(mine.to_bytes()) == mine
    assert len(mine.to_bytes()) < MAX_HELLO / 2


def test_names_cannot_draw_on_the_terminal() -> None:
    evil = replace(ANN, name="\x1b[2J\nroot\u202e" + "x" * 500)
    name = read_hello(evil.to_bytes()).name
    assert name.isprintable() and len(name) <= 40


json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_subnormal=False)
    | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=10,
)


@given(st.binary(max_size=200) | json_values.map(lambda v: json.dumps(v).encode()))
def test_anything_else_is_refused_in_one_line(data: bytes) -> None:
    with pytest.raises(MalformedError) as caught:
        read_hello(data)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@given(st.sampled_from(sorted(asdict(ANN))), json_values)
def test_a_hello_with_one_wrong_field_is_refused_or_whole(field: str, value: object) -> None:
    given_fields = asdict(ANN) | {field: value}
    try:
        got = read_hello(json.dumps(given_fields).encode())
    except MalformedError:
        return
    assert [type(v) for v in asdict(got).values()] == [type(v) for v in asdict(ANN).values()]


def test_other_versions_floods_and_bombs_are_refused() -> None:
    with pytest.raises(MalformedError, match="update"):
        read_hello(json.dumps(asdict(ANN) | {"version": 99}).encode())
    with pytest.raises(MalformedError):
        read_hello(b"[" * 100_000)
    with pytest.raises(MalformedError):
        read_hello(b" " * (MAX_HELLO + 1))
    with pytest.raises(MalformedError):
        read_hello(json.dumps(asdict(ANN) | {"met": ["x"] * 9}).encode())


@pytest.mark.parametrize("time", [10**400, -(10**400), 2**63])
def test_times_that_no_float_takes_are_refused(time: int) -> None:
    """Red before: the call's process of whoever got one stopped to tell, and wrote no report."""
    for row in (["a" * 32, time, 1], ["a" * 32, 1, time]):
        with pytest.raises(MalformedError, match="64 bits"):
            read_hello(json.dumps(asdict(BEN) | {"echoes": [row]}).encode())


def test_a_mute_is_not_lost_behind_sound() -> None:
    """Red before: 2.4 s of stall sufficed, and the voice went on while all showed it as muted."""
    link = CallLink(CallSettings(name="a", avatar="ben"), print)
    theirs = link._theirs  # noqa: SLF001
    sound = protocol.pack_sound(0, 0, np.zeros(480, np.float32))
    for _ in range(400):
        link.post(sound)
    link.change(muted=True)
    kinds = [packet[:1] for packet in theirs.waiting()]
    link.post(sound)
    kinds += [packet[:1] for packet in theirs.waiting()]
    assert kinds.count(protocol.STATE) == 1 and not link.ended
    link.close()
