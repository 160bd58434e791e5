"""The judge of `call test` on sound and faces whose delays are known."""

import asyncio
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile

from app.call.trial import judge
from app.call.trial.beats import STALL, Beats
from app.call.trial.judge import Found
from app.call.trial.material import synthetic_material
from sensors.types import FPS, NS, SAMPLE_RATE

RECORDING = Path(__file__).parents[3] / "recordings" / "demo" / "audio.wav"
SPEECH = soundfile.read(RECORDING, dtype="float32")[0]
MATERIAL = replace(synthetic_material(12, 0), sound=np.tile(SPEECH, 2)[: 12 * SAMPLE_RATE])
SECONDS = 8
STILL = 3.0, 4.0  # seconds in which the card has nothing to play
BEFORE_MS, AFTER_MS = 50.0, 150.0


def found(face_ms: float, stalls_ns: list[int]) -> Found:
    """Heard and seen from second 1 on: 50 ms late, and 150 ms after the card stood still; the face
    is `face_ms` later than the sound."""
    t = 1 + np.arange(SECONDS * SAMPLE_RATE) / SAMPLE_RATE
    late = np.where(t < STILL[1], BEFORE_MS, AFTER_MS) / 1e3
    sound = MATERIAL.sound[np.rint((t - late) * SAMPLE_RATE).astype(int)]
    heard = np.where((t >= STILL[0]) & (t < STILL[1]), 0, sound).astype(np.float32)
    looks = 1 + np.arange(SECONDS * FPS) / FPS
    delay = np.where(looks < STILL[1], BEFORE_MS, AFTER_MS) + face_ms
    seen = judge._between(MATERIAL, (looks - delay / 1e3) * FPS - 1)
    report: dict[str, Any] = {"first_heard_ns": NS, "origin_ns": 0, "stalls_ns": stalls_ns}
    report |= {"late_ns": [], "concealed_ns": []}
    report["settings"] = {"start": 0}
    seen_ns = np.rint(looks * NS).astype(np.int64)
    return Found(report, heard, seen_ns, seen, np.zeros(0, int), np.zeros((0, 256), np.float32))


def lips(here: Found) -> np.ndarray:
    there = found(0, [])
    return judge.lips_ms(here, there, MATERIAL, judge.delays_ms(here, there, MATERIAL))


@pytest.mark.slow
def test_a_face_that_is_late_is_found_late() -> None:
    for late_ms in (12.0, -7.0):
        assert abs(np.median(lips(found(late_ms, []))) - late_ms) < 1


def together(
    late: Callable[[np.ndarray], np.ndarray], face: Callable[[np.ndarray], np.ndarray]
) -> Found:
    """Sound and face, each so many s late at each moment."""
    t = 1 + np.arange(SECONDS * SAMPLE_RATE) / SAMPLE_RATE
    looks = 1 + np.arange(SECONDS * FPS) / FPS
    heard = MATERIAL.sound[np.rint((t - late(t)) * SAMPLE_RATE).astype(int)]
    seen = judge._between(MATERIAL, (looks - face(looks)) * FPS - 1)
    return replace(found(0, []), heard=heard, seen=seen)


def always(t: np.ndarray) -> np.ndarray:
    return np.full(len(t), 0.05)


def later_for_a_second(t: np.ndarray) -> np.ndarray:
    return always(t) + 0.015 * ((t >= 5) & (t < 6))


def sooner_from_then_on(t: np.ndarray) -> np.ndarray:
    return np.where(t < 4.4, 0.21, 0.05)


@pytest.mark.slow
@pytest.mark.parametrize("late", [(always, later_for_a_second), (later_for_a_second, always)])
def test_one_second_of_15_ms_between_face_and_sound_is_found(late: tuple) -> None:
    """However smooth the track is that the judge looks for."""
    told = lips(together(*late))
    assert (np.abs(np.abs(told) - 15) < 2).sum() == 1
    assert (np.abs(told) < 3).sum() == len(told) - 1 >= SECONDS - 3


@pytest.mark.slow
def test_a_face_that_jumps_with_its_sound_is_not_blamed() -> None:
    """Red before: delays were drawn as a line through the jump, 22 ms in one second."""
    told = lips(together(sooner_from_then_on, sooner_from_then_on))
    assert len(told) >= SECONDS - 3 and np.abs(told).max() < 2


@pytest.mark.slow
def test_where_the_card_stood_still_there_is_nothing_to_be_late_to() -> None:
    """Red before: the delay was drawn as a line through the gap, and the face blamed for it."""
    stalls_ns = [round(s * NS) for s in np.arange(*STILL, 0.005)]
    told = lips(found(0, stalls_ns))
    assert len(told) >= SECONDS - 4 and np.abs(told).max() < 2


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.98, 1.012, 1.02])
def test_the_delay_is_found_while_it_adapts(speed: float) -> None:
    """Red before: within a window that is played 2 % slower the sound was not found, or elsewhere,
    and faces were judged by a line between what was found before and after."""
    t = 1 + np.arange(4 * SAMPLE_RATE) / SAMPLE_RATE
    late = 0.12 - (speed - 1) * (t - 1)
    position = (t - late) * SAMPLE_RATE
    heard = np.interp(position, np.arange(len(MATERIAL.sound)), MATERIAL.sound).astype(np.float32)
    here, there = replace(found(0, []), heard=heard), found(0, [])
    rows = judge.delays_ms(here, there, MATERIAL)
    truth_ms = np.interp(rows[:, 0] / NS, t, late) * 1e3
    assert len(rows) >= 12 and np.abs(rows[:, 1] - truth_ms).max() < 0.2


def test_what_a_starved_sound_card_lost_is_told_apart() -> None:
    """Whichever end's card was served late; a packet that is lost at any other time counts."""
    here, there = found(0, []), found(0, [])
    here.report["concealed_ns"] = [round(s * NS) for s in (1.5, 2.02, 3.2, 3.5)]
    assert judge.concealed_share(here, there) == (4 / (SECONDS * 100), 0)
    here.report["late_ns"] = [(2 * NS, round(2.015 * NS))]
    there.report["late_ns"] = [(3 * NS, round(3.015 * NS))]
    assert judge.concealed_share(here, there) == (2 / (SECONDS * 100), 2)


def test_what_the_person_of_a_trial_costs_is_counted_apart() -> None:
    """10 ms of CPU time for the trial and 40 ms for the call in each of three beats."""

    def burn(seconds: float) -> None:
        end_s = time.thread_time() + seconds
        while time.thread_time() < end_s:
            pass

    async def scene() -> tuple[Beats, list[int]]:
        beats, seen = Beats(time.monotonic_ns(), 3 * STALL), list[int]()

        def act(now: int, late_ns: int) -> None:
            seen.append(now)
            burn(0.01)
            beats.of_call(burn, 0.04)

        await beats.every(STALL, act, lambda now, then: seen.extend(range(now, then, STALL)))
        return beats, seen

    beats, seen = asyncio.run(scene())
    assert seen[:3] == [0, STALL, 2 * STALL]
    assert 0.008 < beats.trial_s < 0.036
