"""Head motion from speech, where no tracker says how the head is held.

Hadar, Steiner, Grant and Rose (1983, "Kinematics of head movements accompanying speech during
conversation"): a head moves in nine tenths of the time in which its owner speaks and in an eighth
of that in which he listens, in slow (below 1.8 Hz), ordinary (to 3.7 Hz) and rapid motion. Graf,
Cosatto, Strom and Huang (2002, "Visual prosody"): nods and tilts at accents, of 2 to 5 degrees,
and turns where phrases begin. On the GRID corpus (Cooke et al. 2006) the speed of a tracked head
follows loudness 80 to 160 ms later, which the springs below do. Guitton and Volle (1987) and
Freedman (2008): gaze shifts of more than about 15 degrees take the head with them, 50 to 100 ms
after the eyes.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign, exp, pi, radians

from encoder.alive import noise
from encoder.alive.prosody import Prosody
from sensors.types import FPS

Angles = tuple[float, float, float]  # rad: pitch down, yaw to the subject's left, roll

SPRING_HZ = (2.6, 1.8, 1.8)  # of a head that is made to nod, turn, tilt
NOD_FRAMES = 5  # for which an accent pushes the head
NOD, TILT, YAW = radians(8.5), radians(3.6), radians(4.0)  # that the strongest accent asks for
DRIFTS = ((47, 1.8, 2.8, 2.0), (21, 0.8, 1.2, 1.0), (9, 0.4, 0.5, 0.4))  # frames; degrees an axis
LISTENING = 0.35  # share of the drift while silent
TURN, LIFT = radians(4.5), radians(1.5)  # where a turn of speech begins
LOUD_NOD = radians(3.0)  # that loudness alone asks for
DEAD = radians(15.0)  # of a gaze shift, that the eyes do alone
HEAD_SHARE = 0.6  # of what is beyond
GAZE_HZ = 1.5
GAZE_DELAY = 2  # frames by which the head is behind the eyes
KINDS = range(10, 20)  # of noise


@dataclass(frozen=True)
class MotionState:
    """State between frames, a value."""

    angles: Angles = (0.0, 0.0, 0.0)
    speeds: Angles = (0.0, 0.0, 0.0)  # rad a frame
    push: Angles = (0.0, 0.0, 0.0)  # of the present accent
    pushed: int = 0  # frames it still pushes
    accents: int = 0
    turns: int = 0
    base: Angles = (0.0, 0.0, 0.0)  # where this turn of speech is held
    liveness: float = LISTENING
    gaze: tuple[tuple[float, float], ...] = ()  # (pitch down, yaw) of the last frames, rad
    gaze_angles: tuple[float, float] = (0.0, 0.0)  # what the head does for the eyes
    gaze_speeds: tuple[float, float] = (0.0, 0.0)


def step(
    frame: int,
    prosody: Prosody,
    gaze: tuple[float, float] | None,  # rad, pitch down and yaw, where it is synthesised
    seed: int,
    state: MotionState,
) -> tuple[Angles, Angles, MotionState]:
    """The head's angles, the part of them that is for the eyes, and the state after it."""
    push, pushed, accents = state.push, max(state.pushed - 1, 0), state.accents
    if prosody.accent > 0:
        side, tilt = noise.uniform(seed, KINDS[0], accents, 2)
        strength = prosody.accent
        push = (NOD * strength, YAW * side * strength, TILT * tilt * strength)
        pushed, accents = NOD_FRAMES, accents + 1
    base, turns = state.base, state.turns
    if prosody.begins:
        yaw, roll = noise.uniform(seed, KINDS[1], turns, 2)
        base, turns = (
            (-LIFT, copysign(TURN * (0.4 + 0.6 * abs(yaw)), yaw), 0.4 * TURN * roll),
            turns + 1,
        )
    elif prosody.ends:
        base = (0.0, 0.0, base[2] / 2)
    aim = 1.0 if prosody.speaking else LISTENING
    liveness = state.liveness + (aim - state.liveness) / (0.5 * FPS)

    angles, speeds = list[float](), list[float]()
    for axis in range(3):
        drift = sum(
            radians(drifts[1 + axis])
            * noise.wander(seed, KINDS[2 + axis], frame + 1000 * k, drifts[0])
            for k, drifts in enumerate(DRIFTS)
        )
        target = liveness * drift + base[axis] + (push[axis] if pushed else 0.0)
        if axis == 0:
            target += LOUD_NOD * (prosody.loudness - 0.4 * liveness)
        angle, speed = spring(target, state.angles[axis], state.speeds[axis], SPRING_HZ[axis])
        angles.append(angle)
        speeds.append(speed)

    seen = (*state.gaze, gaze or (0.0, 0.0))[-GAZE_DELAY - 1 :]
    follows = [
        spring(HEAD_SHARE * _beyond(wanted), at, speed, GAZE_HZ)
        for wanted, at, speed in zip(seen[0], state.gaze_angles, state.gaze_speeds, strict=True)
    ]
    for_eyes = (follows[0][0], follows[1][0])
    after = MotionState(
        angles=(angles[0], angles[1], angles[2]),
        speeds=(speeds[0], speeds[1], speeds[2]),
        push=push,
        pushed=pushed,
        accents=accents,
        turns=turns,
        base=base,
        liveness=liveness,
        gaze=seen,
        gaze_angles=for_eyes,
        gaze_speeds=(follows[0][1], follows[1][1]),
    )
    return after.angles, (for_eyes[0], for_eyes[1], 0.0), after


def spring(target: float, at: float, speed: float, hz: float) -> tuple[float, float]:
    """One frame of a critically damped spring, exact for a target that stays: place, speed."""
    omega = 2 * pi * hz / FPS
    decay, away = exp(-omega), at - target
    slope = speed + omega * away
    return target + (away + slope) * decay, (slope - omega * (away + slope)) * decay


def _beyond(angle: float) -> float:
    return copysign(max(abs(angle) - DEAD, 0.0), angle)
