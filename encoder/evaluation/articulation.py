"""What lips and teeth do for each class of phones, shown and tracked.

Used by `livedrive eval speech --leave-one-out`. A mouth is measured in mm on one avatar: opening,
width, protrusion, how far the lower lip is from the upper teeth, and how much of the teeth is seen.
Measures of a phone are means over its frames. Talkers are levelled first: what counts is how
classes differ.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.capture.speech.phones import LIP_CLOSING, Phone
from encoder.evaluation.metrics import OPEN_MM, SHUT_MM
from encoder.types import Doubles, Floats
from sensors.types import FPS

CLASSES: dict[str, tuple[str, ...]] = {
    "p b m": LIP_CLOSING,
    "f v": ("f", "v"),
    "th": ("th", "dh"),
    "s z": ("s", "z"),
    "sh ch": ("sh", "ch", "zh", "jh"),
    "t d n l": ("t", "d", "n", "l"),
    "k g": ("k", "g", "ng"),
    "w r": ("w", "r"),
    "i": ("iy", "ih", "ey", "y"),
    "a": ("aa", "ae", "ah", "aw", "ay", "eh"),
    "o": ("ao", "ow", "oy"),
    "u": ("uw", "uh"),
}
OPEN_VOWELS, NOT_SHUT = CLASSES["a"], ("t", "d", "k", "n", "s")
MEASURES = ("opening", "width", "protrusion", "tuck", "teeth")
# Lips' width of real people beyond their mean, mm: landmarks of GRID's main talker. Tracked curves
# know it badly, so that a mouth may differ from them and still be right.
PEOPLE_WIDTH_MM = {"s": 4.5, "iy": 3.8, "eh": 3.7, "w": -5.9, "ow": -3.3, "uw": -2.4}
SEEN_MM = 1.0  # of teeth, from which they are seen
FEWEST = 5  # phones of a class, below which it is left out


@dataclass(frozen=True, eq=False)
class MouthMotion:
    """A mouth over time: each [T] mm."""

    opening: Doubles  # of the inner lips; 0 where they press
    width: Doubles  # from corner to corner, beyond that at rest
    protrusion: Doubles  # of both lips' middle, forward of where they rest
    tuck: Doubles  # from the lower lip to the edge of the upper teeth; 0: it lies on them
    teeth: Doubles  # height of the teeth that is seen, see `teeth_seen_mm`

    def table(self) -> Doubles:  # [T, 5]
        return np.stack([getattr(self, name) for name in MEASURES], 1)


@dataclass(frozen=True, eq=False)
class SpokenClip:
    """A clip's mouth, shown and tracked, and its phones."""

    talker: str
    shown: MouthMotion
    tracked: MouthMotion
    phones: Sequence[Phone]


@dataclass(frozen=True, eq=False)
class Tokens:
    """Every phone of some clips but silence, one row each."""

    talkers: NDArray[np.str_]  # [N]
    names: NDArray[np.str_]  # [N]
    means: Doubles  # [N, 2, 5] mm: shown and tracked; MEASURES, mean over the phone's frames
    least: Doubles  # [N, 2] mm: the smallest opening


def teeth_seen_mm(
    upper_lip: Floats, lower_lip: Floats, upper_teeth: Floats, lower_teeth: Floats
) -> Doubles:  # each [T, C] -> [T]
    """Height of teeth seen from the front, mm, mean over C columns across the mouth.

    Each is a height, y up: the lowest of the upper lip, the highest of the lower lip, the edges of
    the upper and of the lower teeth. What lies between the lips is teeth but for the dark gap
    between both edges; where the upper teeth overlap the lower ones there is none.
    """
    top, bottom = np.asarray(upper_lip, np.float64), np.asarray(lower_lip, np.float64)
    gap = np.maximum(top - bottom, 0)
    dark = np.minimum(top, upper_teeth) - np.maximum(bottom, lower_teeth)
    return (gap - np.minimum(np.maximum(dark, 0), gap)).mean(1)


def tokens(clips: Sequence[SpokenClip]) -> Tokens:
    """The phones of all clips; one shorter than a frame is measured at the frame nearest to it."""
    talkers, names = list[str](), list[str]()
    means, least = list[Doubles](), list[Doubles]()
    for clip in clips:
        both = np.stack([clip.shown.table(), clip.tracked.table()], 1)  # [T, 2, 5]
        times = (np.arange(len(both)) + 1) / FPS
        for phone in clip.phones:
            middle = (phone.start + phone.end) / 2
            if phone.name == "pau" or middle > times[-1]:
                continue
            where = (times >= phone.start) & (times < phone.end)
            where[np.abs(times - middle).argmin()] = True
            talkers.append(clip.talker)
            names.append(phone.name)
            means.append(both[where].mean(0))
            least.append(both[where][..., 0].min(0))
    shape = (len(names), 2, len(MEASURES))
    return Tokens(
        np.array(talkers, np.str_), np.array(names, np.str_),
        np.array(means, np.float64).reshape(shape), np.array(least, np.float64).reshape(-1, 2),
    )  # fmt: skip


def levelled(said: Tokens) -> Doubles:  # [N, 2, 5]
    """Measures without what talkers, or labels of talkers, differ in throughout: the talkers' part
    of a sum of one number a talker and one a phone, by least squares."""
    who = said.talkers[:, None] == np.unique(said.talkers)
    parts = np.concatenate([who, said.names[:, None] == np.unique(said.names)], 1).astype(float)
    flat = said.means.reshape(len(parts), -1)
    own = parts[:, : who.shape[1]] @ np.linalg.lstsq(parts, flat)[0][: who.shape[1]]
    return (flat - own + own.mean(0)).reshape(said.means.shape)


def class_means(said: Tokens) -> dict[str, Doubles]:
    """Class -> [2, 2, 5]: mean and 95th percentile; shown and tracked; MEASURES."""
    if not len(said.names):
        return {}
    level, found = levelled(said), dict[str, Doubles]()
    for name, phones in CLASSES.items():
        rows = level[np.isin(said.names, phones)]
        if len(rows) >= FEWEST:
            found[name] = np.stack([rows.mean(0), np.quantile(rows, 0.95, axis=0)])
    return found


def contrasts(means: Mapping[str, Doubles]) -> dict[str, float]:
    """Spread of the classes' means (standard deviation), shown over tracked, and r of both."""
    result = dict[str, float]()
    table = np.stack([rows[0] for rows in means.values()])  # [classes, 2, 5]
    for column, name in enumerate(MEASURES):
        shown, tracked = table[..., column].T
        result[f"{name}_contrast"] = float(shown.std() / max(tracked.std(), 1e-6))
        if min(shown.std(), tracked.std()) > 1e-6:
            result[f"{name}_classes_r"] = float(np.corrcoef(shown, tracked)[0, 1])
    return result


def width_beside_people(said: Tokens) -> dict[str, float]:
    """Slope of the shown width's means over those of real people, for PEOPLE_WIDTH_MM's phones."""
    here = [phone for phone in PEOPLE_WIDTH_MM if (said.names == phone).sum() >= FEWEST]
    if len(here) < 3:
        return {}
    width = levelled(said)[:, :, MEASURES.index("width")]
    real = np.array([PEOPLE_WIDTH_MM[phone] for phone in here])
    result = dict[str, float]()
    for side, name in enumerate(("shown", "tracked")):
        means = [float(width[said.names == phone, side].mean()) for phone in here]
        result[f"width_over_people_{name}"] = float(np.polyfit(real, means, 1)[0])
    return result


def shares(said: Tokens) -> dict[str, float]:
    """Shares of phones: teeth seen in s and z, open vowels and t d k n s shown shut."""
    result = dict[str, float]()
    teeth = said.means[:, :, MEASURES.index("teeth")] >= SEEN_MM
    hissed = np.isin(said.names, CLASSES["s z"])
    if (hissed & teeth[:, 1]).any():
        result["teeth_seen"] = float(teeth[hissed & teeth[:, 1], 0].mean())
        result["teeth_seen_tracked"] = float(teeth[hissed, 1].mean())
    wide = np.isin(said.names, OPEN_VOWELS) & (said.least[:, 1] > OPEN_MM)
    if wide.any():
        result["false_closures"] = float((said.least[wide, 0] < SHUT_MM).mean())
    apart = np.isin(said.names, NOT_SHUT)
    if apart.any():
        shown, tracked = (said.least[apart] < SHUT_MM).mean(0)
        result["tongue_shut"], result["tongue_shut_tracked"] = float(shown), float(tracked)
    return result


def figures(said: Tokens) -> dict[str, float]:
    """All of the above as metrics: class/measure/side, and the shares and contrasts."""
    means = class_means(said)
    result = {
        f"{kind}/{measure}_{side}_{statistic}_mm": float(rows[k, i, j])
        for kind, rows in means.items()
        for j, measure in enumerate(MEASURES)
        for i, side in enumerate(("shown", "tracked"))
        for k, statistic in enumerate(("mean", "p95"))
    }
    if len(means) > 2:
        result |= contrasts(means)
    return result | shares(said) | width_beside_people(said)
