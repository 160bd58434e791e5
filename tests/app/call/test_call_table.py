"""Seats in shared memory, and everybody in one cloud."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.call.media.face import end_of
from app.call.table.company import FALLBACK, OWN_SCALE, Company, Place, joined, placed, places
from app.call.table.seats import SeatReader, Seats
from app.call.wire.packet import Tick
from render.decoder import identity
from render.decoder.decoder import Decoder
from render.decoder.learned import avatar_files
from render.types import AHEAD, Gaussians, Shine
from sensors.types import HeadPose

S = 10**9


def tick(index: int) -> Tick:
    return Tick(index, np.full(256, index, np.float32), AHEAD)


def seated(*names: str) -> Seats:
    """Each has three ticks, and hears the middle one now (at 1 s)."""
    seats = Seats()
    for name in names:
        seats.take(name, name.upper(), "ada")
        for i in range(3):
            seats.post(name, tick(i), end_of(i, 0), S)
        seats.hear(name, (S, float(end_of(1, 0)), 1.0), 0.0)
    return seats


def test_a_reader_of_the_memory_sees_the_pose_of_its_moment() -> None:
    seats = seated("ann")
    reader = SeatReader(Seats(seats.handle))
    (sitter,) = reader.sitters(S)
    assert (sitter.name, sitter.avatar) == ("ANN", "ada")
    assert abs(sitter.tick.expression[0] - 1) < 1e-3
    (sitter,) = reader.sitters(S + S // 60)  # half a tick later
    assert abs(sitter.tick.expression[0] - 1.5) < 1e-2
    seats.leave("ann")
    assert reader.sitters(S) == []


def test_who_comes_back_is_seen_at_once() -> None:
    """Red before: a partner who had lost the connection had no face for as long as before."""
    seats = seated("ann")
    reader = SeatReader(seats)
    assert reader.sitters(S)
    seats.leave("ann")
    seats.take("ann", "ANN", "ada")
    seats.post("ann", tick(500), end_of(500, 0), 9 * S)
    seats.hear("ann", (9 * S, float(end_of(500, 0)), 1.0), 0.0)
    (sitter,) = reader.sitters(9 * S)
    assert sitter.tick.index == 500


def test_a_partner_stays_while_the_timeline_is_written() -> None:
    """Red before: once in a thousand looks it was being written, and the partner not drawn."""
    seats = seated("ann")
    reader = SeatReader(seats)
    assert reader.sitters(S)
    seats.rows[0]["anchor_ns"] = 0
    (sitter,) = reader.sitters(S)
    assert abs(sitter.tick.expression[0] - 1) < 1e-3
    seats.leave("ann")
    seats.take("ann", "ANN", "ada")
    assert reader.sitters(S) == []  # of the last time nothing is left


def test_the_eighth_finds_no_seat_and_lines_are_cut() -> None:
    seats = seated(*"abcdefgh")
    assert len(SeatReader(seats).sitters(S)) == 7
    seats.lines = ["x" * 5000, "y"]
    assert len(seats.lines[0]) == 2000
    seats.may_record = True
    assert Seats(seats.handle).may_record


def test_seats_do_not_overlap_and_the_speaker_is_largest() -> None:
    for count in range(2, 8):
        row = places([1.0] * count)
        across = [p.at_mm[0] for p in row]
        assert across == sorted(across, reverse=True)
        assert np.ptp(across) < 340
    assert places([1.25]) == [Place(1.0, 0.0, (0.0, 0.0, 0.0))]


def test_a_place_turns_moves_and_scales_rigidly() -> None:
    rng = np.random.default_rng(0)
    means = rng.standard_normal((50, 3)).astype(np.float32)
    quats = np.tile(np.array([1, 0, 0, 0], np.float32), (50, 1))
    ones = np.ones((50, 3), np.float32)
    cloud = Gaussians(means, quats, ones, ones[:, 0], ones)
    moved = placed(cloud, Place(0.5, 90.0, (10.0, 0.0, 0.0)), presence=0.25)
    assert np.allclose(moved.means[:, 1], means[:, 1] / 2, atol=1e-5)
    assert np.allclose(moved.means[:, 0] - 10, means[:, 2] / 2, atol=1e-5)
    assert np.allclose(moved.quats[0], [np.sqrt(0.5), 0, np.sqrt(0.5), 0], atol=1e-5)
    assert np.allclose(moved.scales, 0.5) and np.allclose(moved.opacities, 0.25)
    assert len(joined([cloud, moved])) == 100 and joined([cloud, moved]).shine is None
    shine = Shine(np.ones((20, 4), np.float32), ones[:20, 0], np.ones((4, 3), np.float32))
    both = joined([cloud, replace(cloud, shine=shine)]).shine
    assert both and not both.weights[:50].any() and both.weights[50:70].all()
    assert not both.weights[70:].any()


@pytest.mark.slow
def test_a_partner_names_no_file_of_this_machine(tmp_path: Path) -> None:
    decoder = Decoder.load(gaussians="16k")
    _, own = decoder.decode(np.zeros(256, np.float32), AHEAD, identity.load("ben"))
    mine = shutil.copy(avatar_files.path_of("ada"), tmp_path)
    shutil.copy(avatar_files.path_of("ada").with_suffix(".json"), tmp_path)
    seats, colors = seated("eve"), list[np.ndarray]()
    for avatar in (mine, FALLBACK, "ada"):
        seats.take("eve", "Eve", str(avatar))
        colors.append(Company(decoder, seats).around(own, S).colors)
    assert np.array_equal(colors[0], colors[1]) and not np.array_equal(colors[0], colors[2])


@pytest.mark.slow
def test_partners_are_drawn_and_the_own_head_is_small() -> None:
    decoder = Decoder.load(gaussians="16k")
    _, own = decoder.decode(np.zeros(256, np.float32), AHEAD, identity.load("ben"))
    assert Company(decoder, Seats()).around(own, S) is own
    seats = seated("ann", "tom")
    seats.take("tom", "Tom", "no such avatar")  # is drawn as somebody
    everybody = Company(decoder, seats).around(own, S)
    everybody.check()
    small = everybody.means[-len(own) :]
    assert np.allclose(np.ptp(small, 0), OWN_SCALE * np.ptp(own.means, 0), rtol=1e-3)
    assert len(everybody) > 2 * len(own)


@pytest.mark.slow
def test_a_partner_turns_the_head_and_breathes() -> None:
    decoder, who = Decoder.load(gaussians="16k"), identity.load("ada")
    _, own = decoder.decode(np.zeros(256, np.float32), AHEAD, identity.load("ben"))
    seats, still = Seats(), np.zeros(256, np.float32)
    head = HeadPose((3.0, 2.0, 1.0), (0.96, 0.0, 0.28, 0.0))
    seats.take("ann", "Ann", "ada")
    for i in range(3):
        pose = np.array(head.position, np.float32), np.array(head.quat, np.float32)
        seats.post("ann", Tick(i, still, AHEAD, *pose, 0.75), end_of(i, 0), S)
    seats.hear("ann", (S, float(end_of(1, 0)), 1.0), 0.0)
    _, wanted = decoder.decode(still, AHEAD, who, head, 0.75)
    ann = Company(decoder, seats).around(own, S).means[: len(wanted)]
    np.testing.assert_allclose(ann, wanted.means, atol=1e-2)
