"""Ticks on the wire: what comes back, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from app.call.wire.packet import (
    HEADER,
    RIG_DIM,
    TICK_BYTES,
    Basis,
    MalformedError,
    Packer,
    Tick,
    basis_of,
)

ROWS = np.linalg.qr(np.random.default_rng(0).standard_normal((256, RIG_DIM)))[0].T
BASIS = Basis(ROWS.astype(np.float32), np.full(RIG_DIM, 40, np.float32))
PACKER = Packer(BASIS)
AHEAD = np.array([[0, 0, 1], [0, 0, 1]], np.float32)


def tick(index: int = 0, **given: object) -> Tick:
    rng = np.random.default_rng(index)
    code = (rng.uniform(-30, 30, RIG_DIM) @ BASIS.rows).astype(np.float32)
    return Tick(**({"index": index, "expression": code, "gaze": AHEAD} | given))  # type: ignore[arg-type]


def returned(sent: Tick) -> Tick:
    (got,), _ = PACKER.open(PACKER.message([PACKER.fields(sent)], sent.index, 0))
    return got


def test_three_ticks_fit_the_budget() -> None:
    assert TICK_BYTES <= 100
    message = PACKER.message([PACKER.fields(tick(i)) for i in (9, 8, 7)], 9, -480)
    ticks, offset = PACKER.open(message)
    assert [t.index for t in ticks] == [9, 8, 7] and offset == -480
    assert len(message) <= HEADER.size + 3 * 100
    for got in ticks:
        assert np.array_equal(got.expression, returned(tick(got.index)).expression)


unit = arrays(np.float64, 4, elements=st.floats(-1, 1, allow_subnormal=False)).filter(
    lambda q: np.linalg.norm(q) > 0.01
)


@given(
    arrays(np.float64, RIG_DIM, elements=st.floats(-40, 40, allow_subnormal=False)),
    arrays(np.float64, (2, 2), elements=st.floats(-45, 45, allow_subnormal=False)),
    arrays(np.float64, 3, elements=st.floats(-1000, 1000, allow_subnormal=False)),
    unit,
    st.integers(0, 2**32 - 1),
)
def test_a_tick_comes_back_within_half_a_step(
    code: np.ndarray,
    angles: np.ndarray,
    shift: np.ndarray,
    turn: np.ndarray,
    index: int,
) -> None:
    yaw, pitch = np.radians(angles).T
    gaze = np.stack([np.cos(pitch) * np.sin(yaw), np.sin(pitch), np.cos(pitch) * np.cos(yaw)], 1)
    breath = index % 101 / 100
    expression, shift = (code @ ROWS).astype(np.float32), shift.astype(np.float32)
    sent = Tick(index, expression, gaze, shift, turn, breath)
    got = returned(sent)
    assert np.abs(BASIS.rows @ got.expression - code).max() <= 0.51 * BASIS.steps.max()
    assert np.degrees(np.arccos(np.clip((got.gaze * gaze).sum(1), -1, 1))).max() < 0.1
    assert np.abs(got.head_mm - shift).max() <= 0.26
    same = abs(float(got.head_wxyz @ turn)) / np.linalg.norm(turn)
    assert 2 * np.degrees(np.arccos(min(same, 1))) < 0.15
    assert got.index == index and abs(got.breath - breath) <= 0.017


@given(st.binary(max_size=400))
def test_any_bytes_are_refused_or_finite(data: bytes) -> None:
    header = HEADER.pack(1, 1, PACKER.number, 7, 0)
    for packet in (data, header + data[:TICK_BYTES], header + (data * 90)[:TICK_BYTES]):
        try:
            ticks, _ = PACKER.open(packet)
        except MalformedError:
            continue
        for got in ticks:
            assert np.isfinite(got.expression).all() and np.isfinite(got.gaze).all()
            assert abs(np.linalg.norm(got.head_wxyz) - 1) < 1e-3
            assert np.allclose(np.linalg.norm(got.gaze, axis=1), 1, atol=1e-5)


@pytest.mark.parametrize("cut", [0, 1, HEADER.size - 1, HEADER.size, HEADER.size + 50])
def test_truncated_messages_are_refused(cut: int) -> None:
    message = PACKER.message([PACKER.fields(tick())], 0, 0)
    with pytest.raises(MalformedError):
        PACKER.open(message[:cut])
    with pytest.raises(MalformedError):
        PACKER.open(message + b"\0")


def test_a_message_cannot_hold_ticks_before_the_first() -> None:
    body = PACKER.fields(tick())
    with pytest.raises(MalformedError):
        PACKER.open(PACKER.message([body, body], 0, 0))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_nan_is_not_sent(bad: float) -> None:
    code, gaze = tick().expression.copy(), AHEAD.copy()
    code[3] = bad
    gaze[0, 0] = bad
    for one in (tick(expression=code), tick(gaze=gaze), tick(head_mm=np.full(3, bad))):
        with pytest.raises(MalformedError):
            PACKER.fields(one)
    with pytest.raises(MalformedError):
        PACKER.fields(tick(head_wxyz=np.zeros(4, np.float32)))


def test_what_reaches_too_far_is_cut_and_does_not_wrap() -> None:
    code = (np.full(RIG_DIM, 1e6) @ BASIS.rows).astype(np.float32)
    got = BASIS.rows @ returned(tick(expression=code)).expression
    assert np.allclose(np.abs(got).max(), 40, atol=0.1)
    assert np.array_equal(np.sign(got), np.sign(BASIS.rows @ code))
    far = returned(tick(head_mm=np.array([5000, -5000, 0], np.float32))).head_mm
    assert np.allclose(far, [1023.5, -1023.5, 0])


def test_another_basis_is_refused_by_name() -> None:
    other = Packer(Basis(BASIS.rows, BASIS.reach * 2))
    assert other.number != PACKER.number
    with pytest.raises(MalformedError, match="basis"):
        other.open(PACKER.message([PACKER.fields(tick())], 0, 0))


@pytest.mark.slow
def test_lips_stay_within_50_micrometres_and_a_whole_jaw_fits() -> None:
    from render.decoder.decoder import Decoder

    decoder = Decoder.load()
    coding = decoder.coding
    basis = basis_of(coding.frame, coding.to_code)
    packer = Packer(basis)
    lips = decoder.moves(decoder.regions["lips"])
    rng = np.random.default_rng(1)
    activations = np.concatenate([np.eye(RIG_DIM), rng.uniform(0, 0.4, (100, RIG_DIM))])
    codes = (activations @ coding.to_code).astype(np.float32)
    got = [packer.open(packer.message([packer.fields(tick(expression=c))], 0, 0)) for c in codes]
    errors = np.stack([ticks[0].expression for ticks, _ in got]) - codes
    moved = (errors @ lips).reshape(len(codes), -1, 3)
    assert np.linalg.norm(moved, axis=2).max() < 0.06  # .05 on recorded speech: call test


def test_known_ticks_are_not_read_again() -> None:
    message = PACKER.message([PACKER.fields(tick(i)) for i in (2, 1, 0)], 2, 0)
    whole, _ = PACKER.open(message)
    for known, left in (({0, 1}, [2]), ({1}, [2, 0]), ({0, 1, 2}, [])):
        new, _ = PACKER.open(message, known)
        assert [t.index for t in new] == left
        for t in new:
            np.testing.assert_array_equal(t.expression, whole[2 - t.index].expression)
