"""Test sets of `livedrive eval emotion`: held-out segments with a truth for every emotion.

Three sets: acted takes (voice and truth of one emotion), neutral takes of rule-made subjects, and
real voices with tracked mouths to which emotions are added.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from encoder.capture.dataset import (
    PACK_SAMPLES_PER_FRAME,
    SEGMENT_FRAMES,
    Clip,
    finished,
    read_manifest,
    read_shard,
)
from encoder.capture.judging.emotion_truth import style_of, with_each_emotion
from encoder.capture.motion.contacts import LipGeometry
from encoder.capture.motion.style import Style
from encoder.emotion.labels import LABELS
from encoder.evaluation.rows import Segment, held_out_segments
from encoder.training.streams.emotion import ACTED_STRENGTH, with_emotion
from encoder.types import Floats
from sensors.types import FPS


@dataclass(frozen=True, eq=False)
class EmotionTruth:
    """A segment and the rigs [1 + labels, 100, 53] of its truth: neutral, then each label."""

    segment: Segment
    rigs: Floats
    label: int = -1  # acted; -1: the voice is neutral


def acted(pack: Path, lips: LipGeometry, seed: int) -> list[EmotionTruth]:
    """All segments of the acted takes of held-out subjects."""
    return [truth for clip, style in _made(pack) if clip.truth == "emotional"
            for truth in _truths(clip, style, lips, ACTED_STRENGTH, seed)]  # fmt: skip


def neutral(pack: Path, lips: LipGeometry, count: int, seed: int) -> list[EmotionTruth]:
    """The first two segments of each of up to `count` neutral takes of held-out subjects."""
    takes = [(_shortened(clip), style) for clip, style in _made(pack)
             if clip.truth == "rules" and clip.num_frames >= SEGMENT_FRAMES]  # fmt: skip
    chosen = sorted(np.random.default_rng(seed).permutation(len(takes))[:count])
    return [truth for clip, style in map(takes.__getitem__, chosen)
            for truth in _truths(clip, style, lips, 1.0, seed)]  # fmt: skip


def tracked(pack: Path, lips: LipGeometry, count: int, seed: int) -> list[EmotionTruth]:
    """Segments of held-out real voices; emotions are added to the tracked motion."""
    groups = held_out_segments(pack, count, seed).values()
    found = [s for group in groups for s in group if s.clip.truth == "tracked"]
    frames = min((len(s.phones) for s in found), default=0)  # GRID's recordings are short
    found = [Segment(s.clip, slice(s.frames.start, s.frames.start + frames)) for s in found]
    chosen = np.random.default_rng(seed).permutation(len(found))[:count]
    result = []
    for index in sorted(chosen):
        rig = found[index].rig
        # each has its own draw: one smile for all would be chance
        draws = [np.random.default_rng([seed, index]) for _ in LABELS]
        pairs = zip(LABELS, draws, strict=True)
        rows = [with_emotion(rig, label, 1.0, lips, rng) for label, rng in pairs]
        result.append(EmotionTruth(found[index], np.stack([rig, *rows])))
    return result


def _made(pack: Path) -> Iterator[tuple[Clip, Style]]:
    """Takes of rule-made test subjects, with the subject's style."""
    for shard in read_manifest(pack)["shards"]:
        folder = pack / shard["file"]
        entry = finished(folder)
        if entry and shard["file"].startswith("made_"):
            clips = list(read_shard(folder, "test"))
            style = style_of(entry["seed"], "test") if clips else Style()
            yield from ((clip, style) for clip in clips)


def _shortened(clip: Clip) -> Clip:
    """At most the first two segments: the rules are slow on long takes."""
    frames = min(clip.num_frames, 2 * SEGMENT_FRAMES)
    names = ("rig", "gaze", "phones", "tongue")
    parts = {name: getattr(clip, name)[:frames] for name in names}
    spans = clip.spans[clip.spans[:, 1] < frames / FPS]
    audio = clip.audio[: frames * PACK_SAMPLES_PER_FRAME]
    return replace(clip, audio=audio, spans=spans, **parts)


def _truths(
    clip: Clip, style: Style, lips: LipGeometry, strength: float, seed: int
) -> list[EmotionTruth]:
    motions = with_each_emotion(clip, style, lips, strength, seed)
    clip = replace(clip, gaze=motions[0].gaze[: clip.num_frames].astype(np.float16))
    rigs = np.stack([motion.rig[: clip.num_frames] for motion in motions])
    label = LABELS.index(clip.emotion) if clip.emotion in LABELS else -1
    parts = list(clip.segments()) or [slice(0, 0)]
    return [EmotionTruth(Segment(clip, part), rigs[:, part], label) for part in parts if part.stop]
