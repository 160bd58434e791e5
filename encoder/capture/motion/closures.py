"""When lips meet and when the lower lip touches the teeth, and the curves that make them do it.

Part of the motion rules: between an open mouth (rules.py) and the mesh (contacts.py).
"""

import numpy as np

from encoder.capture.motion.channels import (
    JAW_OPEN,
    MOUTH_CLOSE,
    RIG_INDEX,
    RIG_NAMES,
    SPEECH_COLUMNS,
)
from encoder.capture.motion.contacts import SHUT_MM, SLOPE_MM, LipGeometry
from encoder.capture.motion.gestures import TOUCH_POSE
from encoder.capture.motion.style import Style
from encoder.capture.speech.phones import Phone

# Millimetres that one unit of a channel opens the inner lips of the rig's mean face.
_OPENING_MM = {
    "jawOpen": 28.9,
    "mouthFunnel": 10.8,
    "mouthLowerDown_L": 2.9,
    "mouthLowerDown_R": 2.9,
    "mouthUpperUp_L": 3.5,
    "mouthUpperUp_R": 3.5,
}
RAMP_S = 0.075  # lips close and part within this, 100-350 mm/s
JAW_STEP = 0.27  # most change of jawOpen a frame: 234 mm/s
GAP_STEP_MM = 11.5  # most change of the lips' gap a frame: 345 mm/s
_TOUCH = np.zeros(len(RIG_NAMES), np.float32)
for _name, _weight in TOUCH_POSE.items():
    _TOUCH[RIG_INDEX[_name]] = _weight


def closing_weight(curves: np.ndarray) -> np.ndarray:
    """[..., 53] -> [...] the `mouthClose` that just shuts lips which the other channels opened."""
    opening_mm = sum(mm * curves[..., RIG_INDEX[name]] for name, mm in _OPENING_MM.items())
    return np.asarray(opening_mm / SLOPE_MM)


def holds(
    phones: list[Phone], names: tuple[str, ...], times: np.ndarray, taken: np.ndarray
) -> np.ndarray:
    """[H, 2] begin and end of the contact that each of `names` holds, in seconds.

    A plosive lets go at its burst, a nasal or fricative near its end. Where no frame falls into
    the hold, the nearest one that is not `taken` [T] by another contact is taken in.
    """
    free = np.where(taken, 1e3, 0.0)
    holds = []
    for phone in phones:
        if phone.name in names:
            share = 0.55 if phone.name in ("p", "b") else 0.8
            begin, end = phone.start - 0.012, phone.start + share * (phone.end - phone.start)
            nearest = times[np.argmin(np.abs(times - 0.5 * (begin + end)) + free)]
            holds.append((min(begin, nearest), max(end, nearest)))
    return np.array(holds).reshape(-1, 2)


def contact(holds: np.ndarray, every: np.ndarray, times: np.ndarray) -> np.ndarray:
    """[T] 0..1: 1 in `holds` [H, 2], raised cosines around them.

    Between two of `every` contact they are shorter, so that even a short vowel opens the mouth.
    """
    contact = np.zeros(len(times))
    for begin, end in holds:
        before = np.min(begin - every[:, 1], initial=1.0, where=every[:, 1] < begin)
        after = np.min(every[:, 0] - end, initial=1.0, where=every[:, 0] > end)
        close_s, open_s = np.clip((0.6 * before, 0.6 * after), RAMP_S / 2, RAMP_S)
        outside = np.maximum((begin - times) / close_s, (times - end) / open_s)
        contact = np.maximum(contact, 0.5 + 0.5 * np.cos(np.pi * np.clip(outside, 0, 1)))
    return contact


def _slew(curve: np.ndarray, step: float) -> np.ndarray:
    """[T] limited to `step` a frame, in both directions of time, by lowering only."""
    out = curve.astype(np.float32).tolist()
    for k in range(1, len(out)):
        out[k] = min(out[k], out[k - 1] + step)
    for k in range(len(out) - 2, -1, -1):
        out[k] = min(out[k], out[k + 1] + step)
    return np.array(out, np.float32)


def with_contacts(
    curves: np.ndarray,  # [T, 53] open mouth, with any emotion
    close: np.ndarray,  # [T] 0..1
    touch: np.ndarray,  # [T] 0..1
    style: Style,
    lips: LipGeometry | None,
) -> np.ndarray:
    """Blend to the touch pose, raise the jaw a little, and let mouthClose shut the lips."""
    held = (touch >= 1) & (close < 1)
    close = np.where(held, 0, close)
    touch = np.where(held, 1, np.minimum(touch, 1 - close))[:, None].astype(np.float32)
    columns = list(SPEECH_COLUMNS)
    curves[:, columns] += touch * (_TOUCH[columns] - curves[:, columns])
    free = curves.copy()
    curves[:, JAW_OPEN] *= 1 - 0.2 * close
    for channel in (
        "mouthFunnel",
        *(f"mouth{n}_{s}" for n in ("LowerDown", "UpperUp") for s in "LR"),
    ):
        curves[:, RIG_INDEX[channel]] *= 1 - 0.9 * close
    for side in "LR":
        curves[:, RIG_INDEX[f"mouthPress_{side}"]] += style.press * style.lips * close
    curves[:, JAW_OPEN] = _slew(curves[:, JAW_OPEN], JAW_STEP)
    if lips is None:
        curves[:, MOUTH_CLOSE] = close * closing_weight(curves)
        return curves
    weight = close.astype(np.float32)
    gap = lips.gap_mm(curves)
    wanted = np.minimum(gap, (1 - weight) * lips.gap_mm(free) + weight * SHUT_MM)
    wanted = _slew(wanted, GAP_STEP_MM)
    busy = wanted < gap - 1e-3
    if busy.any():
        curves[busy, MOUTH_CLOSE] = lips.closed(curves[busy], wanted[busy])
    return curves
