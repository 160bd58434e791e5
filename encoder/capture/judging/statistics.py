"""Statistics of rule-made motion against published ranges.

Judges a data set, clip by clip, so memory stays small. Speech rates are over rule-made English;
contacts are measured on mesh vertices.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from encoder.capture.dataset import Clip
from encoder.capture.motion.channels import JAW_OPEN, RIG_INDEX, RIG_NAMES, SPEECH_COLUMNS
from encoder.capture.motion.rules import frame_times, loudness, speech_curves
from encoder.capture.motion.style import Style
from encoder.capture.speech.phones import LIP_CLOSING, PHONES, TEETH_TOUCHING, Phone
from sensors.types import FPS, SAMPLE_RATE

BLINK = RIG_INDEX["eyeBlink_L"]
LIDS = [RIG_INDEX[f"eyeBlink_{side}"] for side in "LR"]
# Fastest real motion: jaw 300 mm/s (10 a second in jawOpen), lips 400 mm/s, lids 0.05 s to shut.
MAX_SPEED = {"jaw": 10.0, "gap_mm": 400.0, "lid": 30.0}
STUCK_FRAMES = 90  # a speech channel that holds a value above 0.02 so long while someone speaks


@dataclass(frozen=True)
class Range:
    """A figure of the page and what it should lie between."""

    name: str
    value: float
    low: float
    high: float
    published: str

    @property
    def ok(self) -> bool:
        return self.low <= self.value <= self.high


@dataclass
class Tally:
    """Sums over clips; `bars` turns them into the page."""

    blinks: dict[str, list[float]] = field(
        default_factory=lambda: {"freeform": [0, 0], "sentence": [0, 0]}
    )
    gaps_mm: list[float] = field(default_factory=list)
    touches_mm: list[float] = field(default_factory=list)
    leads_ms: list[float] = field(default_factory=list)
    dwells_s: list[float] = field(default_factory=list)
    saccades: list[tuple[float, float]] = field(default_factory=list)  # degrees, ms
    partner: list[float] = field(default_factory=list)
    spectrum: np.ndarray = field(default_factory=lambda: np.zeros(129))
    speed: dict[str, float] = field(default_factory=lambda: dict.fromkeys(MAX_SPEED, 0.0))
    stuck: int = 0
    frames: int = 0


Gap = Callable[[np.ndarray], np.ndarray]  # [T, 53] -> [T] mm


def page(clips: Iterable[Clip], gap_mm: Gap, touch_mm: Gap) -> tuple[list[Range], Tally]:
    """The statistics of rule-made English clips. `gap_mm` is the widest lip gap and `touch_mm` the
    distance from lower lip to upper teeth, both on the decoder's vertices."""
    tally = Tally()
    for clip in clips:
        if clip.truth == "rules" and clip.kind in ("freeform", "sentence", "aligned"):
            _count(clip, gap_mm, touch_mm, tally)
    return bars(tally), tally


def _count(clip: Clip, gap_mm: Gap, touch_mm: Gap, tally: Tally) -> None:
    rig = clip.rig.astype(np.float32)
    gap = gap_mm(rig)
    times = frame_times(len(rig))
    minutes = len(rig) / FPS / 60
    tally.frames += len(rig)
    if clip.kind in tally.blinks:
        tally.blinks[clip.kind][0] += count_blinks(rig[:, BLINK])
        tally.blinks[clip.kind][1] += minutes
    tally.gaps_mm += _contacts(clip, LIP_CLOSING, times, gap)
    touching = _contact_frames(clip, TEETH_TOUCHING, times)
    if touching:
        every = np.unique(np.concatenate(touching))
        distance = np.full(len(rig), np.inf)
        distance[every] = touch_mm(rig[every])
        tally.touches_mm += [float(distance[frames].min()) for frames in touching]
    tally.leads_ms += _leads(clip, times, rig)
    tally.spectrum += jaw_spectrum(rig[:, JAW_OPEN], loudness_of(clip))
    step = np.abs(np.diff(rig, axis=0)) * FPS if len(rig) > 1 else np.zeros((1, len(RIG_NAMES)))
    found = {
        "jaw": step[:, JAW_OPEN].max(),
        "gap_mm": np.abs(np.diff(gap)).max(initial=0) * FPS,
        "lid": step[:, LIDS].max(),
    }
    for name, value in found.items():
        tally.speed[name] = max(tally.speed[name], float(value))
    tally.stuck += _stuck(rig, clip.phones > 0)
    if clip.kind == "freeform":
        _eyes(clip, tally)


def loudness_of(clip: Clip) -> np.ndarray:
    """[T] 0..1; a clip's sound is at 24 kHz, so each sample is taken twice."""
    return loudness(np.repeat(np.asarray(clip.audio, np.float32) / 32768, 2))


def count_blinks(lid: np.ndarray) -> int:
    """[T] -> closings by more than 0.3 within 5 frames."""
    lid = lid.astype(np.float32)
    if len(lid) < 7:
        return 0
    rise = lid[5:] - np.lib.stride_tricks.sliding_window_view(lid, 6)[:, :5].min(1) > 0.3
    starts = np.flatnonzero(rise[1:] & ~rise[:-1])
    return int(rise[0]) + len(starts)


def jaw_spectrum(jaw: np.ndarray, level: np.ndarray) -> np.ndarray:
    """[T] -> power [129] of 0-15 Hz, over windows of 64 frames in which somebody speaks."""
    total = np.zeros(129)
    for start in range(0, len(jaw) - 63, 32):
        piece = slice(start, start + 64)
        if (level[piece] > 0.1).mean() > 0.6:
            wave = (jaw[piece] - jaw[piece].mean()) * np.hanning(64)
            total += np.abs(np.fft.rfft(wave, 256)) ** 2
    return total


def _contact_frames(clip: Clip, names: tuple[str, ...], times: np.ndarray) -> list[np.ndarray]:
    """For each phone of `names` the frames from 60 ms before it to 30 ms after."""
    result = []
    for index, start, end in clip.spans:
        if PHONES[int(index)] in names:
            frames = np.flatnonzero((times > start - 0.06) & (times < end + 0.03))
            if len(frames):
                result.append(frames)
    return result


def _contacts(
    clip: Clip, names: tuple[str, ...], times: np.ndarray, value: np.ndarray
) -> list[float]:
    return [float(value[frames].min()) for frames in _contact_frames(clip, names, times)]


def _leads(clip: Clip, times: np.ndarray, rig: np.ndarray) -> list[float]:
    """Milliseconds from the mouth's first motion to the sound, after pauses of 0.25 s or more."""
    moving = rig[:, SPEECH_COLUMNS].max(1) > 0.012
    sounding = [(a, b) for i, a, b in clip.spans if PHONES[int(i)] != "pau"]
    result, last_end = [], -1.0
    for start, end in sounding:
        if start - last_end >= 0.35:
            before = (times > start - 0.2) & (times <= start + 0.1)
            moved = np.flatnonzero(before & moving)
            if len(moved) and moved[0] > 0 and not moving[moved[0] - 1]:
                result.append(1000 * (start - times[moved[0]]))
        last_end = end
    return result


def _stuck(rig: np.ndarray, speaking: np.ndarray) -> int:
    """How many speech channels hold one value for STUCK_FRAMES while somebody speaks."""
    if len(rig) < STUCK_FRAMES or speaking.mean() < 0.5:
        return 0
    windows = np.lib.stride_tricks.sliding_window_view(
        rig[:, SPEECH_COLUMNS], STUCK_FRAMES, axis=0
    )[::15]
    held = (np.ptp(windows, axis=-1) < 1e-3) & (windows.min(-1) > 0.02)
    return int(held.any(0).sum())


def _eyes(clip: Clip, tally: Tally) -> None:
    gaze = clip.gaze.astype(np.float32).mean(1)
    angles = np.degrees(
        np.stack([np.arctan2(gaze[:, 0], gaze[:, 2]), np.arcsin(np.clip(gaze[:, 1], -1, 1))], 1)
    )
    step = np.hypot(*np.diff(angles, axis=0).T) if len(angles) > 1 else np.zeros(0)
    moving = step > 0.6
    edges = np.flatnonzero(np.diff(np.concatenate([[False], moving, [False]]).astype(int)))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        size = float(np.hypot(*(angles[end] - angles[begin])))
        if size > 2:
            tally.saccades.append((size, (end - begin) * 1000 / FPS))
    for end, begin in zip(edges[1::2], [*edges[2::2]], strict=False):
        tally.dwells_s.append(float(begin - end) / FPS)
    tally.partner.append(float((np.hypot(*angles.T) < 4).mean()))


def bars(tally: Tally) -> list[Range]:
    hz = np.linspace(0, FPS / 2, 129)
    above = tally.spectrum * (hz > 1)  # below it: phrases, not syllables
    # the peak is that of the jaw's speed: its own spectrum falls with 1/f, in real faces too
    speed = above * hz**2
    rate = {kind: n / max(minutes, 1e-9) for kind, (n, minutes) in tally.blinks.items()}
    sizes, lengths = np.array(tally.saccades or [(0.0, 0.0)]).T
    leads = tally.leads_ms or [0.0]
    share = float(above[(hz >= 2) & (hz <= 7)].sum() / max(above.sum(), 1e-9))
    return [
        Range("blinks_per_min_talking", rate["freeform"], 20, 30, "26"),
        Range("blinks_per_min_reading", rate["sentence"], 4, 10, "4.5"),
        Range("jaw_power_2_7_hz_of_above_1_hz", share, 0.6, 1, "most of 2-7 Hz"),
        Range("jaw_speed_peak_hz", float(hz[speed.argmax()]), 3, 6, "3-6 Hz, syllables"),
        Range("closure_gap_worst_mm", max(tally.gaps_mm, default=0.0), -np.inf, 0.3, "contact"),
        Range("teeth_contact_worst_mm", max(tally.touches_mm, default=0.0), 0, 1.0, "contact"),
        Range("lip_lead_median_ms", float(np.median(leads)), 0, 100, "about 120 before apex"),
        Range("lip_lead_p95_ms", float(np.quantile(leads, 0.95)), 0, 134, "+ 1 frame of grain"),
        Range("stuck_channels", float(tally.stuck), 0, 0, "none"),
        Range("jaw_speed_per_s", tally.speed["jaw"], 0, MAX_SPEED["jaw"], "300 mm/s"),
        Range("lip_speed_mm_per_s", tally.speed["gap_mm"], 0, MAX_SPEED["gap_mm"], "400 mm/s"),
        Range("lid_speed_per_s", tally.speed["lid"], 0, MAX_SPEED["lid"], "shut in 50-100 ms"),
        Range("saccade_ms_at_10_deg", _length_at(sizes, lengths, 10), 33, 84, "49, frames of 33"),
        Range("dwell_median_s", float(np.median(tally.dwells_s or [0])), 0.3, 1.2, "0.3-1.2 s"),
        Range("looks_at_partner_talking", float(np.mean(tally.partner or [0])), 0.31, 0.55, "0.41"),
    ]  # fmt: skip


def _length_at(sizes: np.ndarray, lengths: np.ndarray, degrees: float) -> float:
    near = np.abs(sizes - degrees) < 3
    return float(lengths[near].mean()) if near.any() else 0.0


def style_ratio(subjects: int = 8, seed: int = 0) -> float:
    """How much further apart two subjects' mouths are than two repeats of one, for the same words.

    Root mean square difference over the speech channels, with a voice of steady loudness.
    """
    rng = np.random.default_rng(seed)
    names = rng.choice(PHONES[1:], 80)
    ends = 0.3 + np.cumsum(rng.uniform(0.05, 0.13, len(names)))
    phones = [Phone("pau", 0, 0.3)]
    phones += [Phone(str(n), e - 0.08, e) for n, e in zip(names, ends, strict=True)]
    sound = 0.3 * np.sin(np.arange(int((ends[-1] + 0.3) * SAMPLE_RATE)) * 0.02)
    said = np.empty((subjects, 2), object)
    for k in range(subjects):
        style = Style.draw(np.random.default_rng([seed, k]))
        for repeat in range(2):
            own = np.random.default_rng([seed, k, repeat])
            said[k, repeat] = speech_curves(phones, sound, style, own).rig[:, SPEECH_COLUMNS]
    same = [_apart(said[k, 0], said[k, 1]) for k in range(subjects)]
    others = [_apart(said[j, 0], said[k, 1]) for j in range(subjects) for k in range(j)]
    return float(np.mean(others) / np.mean(same))


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(((a - b) ** 2).mean()))
