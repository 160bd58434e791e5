"""Ten emotions: the facial action units of each, and how the voice changes with it.

The paper's second data set has ten labels per subject (section 6.1); the names and the rules here
are ours. Speech synthesis uses the voice's factors, motion/emotion.py adds the channels to a face.
"""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Emotion:
    """Rig channels at full strength, 0..1 (both sides where no side is named), and factors on the
    voice of a neutral talker."""

    channels: dict[str, float] = field(default_factory=dict)
    tempo: float = 1.0
    pitch: float = 1.0
    tone: float = 1.0  # pitch range
    energy: float = 1.0
    mouth: float = 1.0  # size of mouth movements


EMOTIONS: dict[str, Emotion] = {
    "neutral": Emotion(),
    "happy": Emotion(  # AU 6 + 12
        {"mouthSmile": 0.6, "cheekSquint": 0.55, "eyeSquint": 0.3, "browOuterUp": 0.15},
        1.06, 1.14, 1.3, 1.1, 1.05,
    ),
    # Who frowns or stretches the lips lowers the lower one: with the upper lip as it was, only
    # lower teeth would show while they speak.
    "sad": Emotion(  # AU 1 + 4 + 15
        {"browInnerUp": 0.6, "browDown": 0.15, "mouthFrown": 0.55, "eyeBlink": 0.15,
         "mouthShrugLower": 0.2, "mouthUpperUp": 0.15},
        0.82, 0.9, 0.6, 0.7, 0.75,
    ),
    "angry": Emotion(  # AU 4 + 5 + 7 + 23: a stare under low brows, unlike disgusted
        {"browDown": 1.0, "eyeSquint": 0.45, "eyeWide": 0.35, "noseSneer": 0.5, "mouthPress": 0.3,
         "mouthFrown": 0.15, "jawForward": 0.3, "mouthLowerDown": 0.15},
        1.1, 1.1, 1.4, 1.4, 1.15,
    ),
    "afraid": Emotion(  # AU 1 + 2 + 4 + 5 + 20
        {"browInnerUp": 0.9, "browOuterUp": 0.3, "browDown": 0.2, "eyeWide": 0.85,
         "mouthStretch": 0.5, "mouthUpperUp": 0.2},
        1.12, 1.22, 1.1, 0.9, 0.9,
    ),
    "surprised": Emotion(  # AU 1 + 2 + 5 + 26: the jaw drops, unlike excited
        {"browInnerUp": 0.85, "browOuterUp": 0.85, "eyeWide": 0.75, "jawOpen": 0.16,
         "mouthFunnel": 0.12},
        1.0, 1.25, 1.5, 1.15, 1.15,
    ),
    "disgusted": Emotion(  # AU 9 + 10 + 15
        {"noseSneer": 0.75, "mouthUpperUp": 0.3, "browDown": 0.4, "cheekSquint": 0.3,
         "mouthFrown": 0.3},
        0.92, 0.95, 0.9, 1.0, 0.95,
    ),
    "excited": Emotion(  # the broadest smile, under raised brows
        {"browInnerUp": 0.35, "browOuterUp": 0.6, "eyeWide": 0.5, "mouthSmile": 0.75,
         "cheekSquint": 0.5, "mouthUpperUp": 0.15},
        1.18, 1.25, 1.6, 1.25, 1.25,
    ),
    "bored": Emotion(  # half-shut lids, a mouth drawn aside and down
        {"eyeBlink": 0.42, "browDown": 0.1, "browInnerUp": 0.1, "mouthFrown": 0.25,
         "mouthShrugLower": 0.35, "mouthUpperUp": 0.12, "mouthLeft": 0.12},
        0.8, 0.92, 0.45, 0.75, 0.65,
    ),
    "pained": Emotion(  # AU 4 + 6 + 7 + 9 + 20 + 43: screwed up eyes
        {"browDown": 0.7, "browInnerUp": 0.4, "cheekSquint": 0.8, "eyeSquint": 0.8, "eyeBlink": 0.2,
         "noseSneer": 0.35, "mouthStretch": 0.4, "mouthUpperUp": 0.15},
        0.88, 1.08, 1.1, 0.95, 0.9,
    ),
    "doubtful": Emotion(  # one brow up, mouth to the side
        {"browOuterUp_L": 0.7, "browInnerUp_L": 0.35, "browDown_R": 0.45, "mouthLeft": 0.2,
         "mouthPress": 0.2, "eyeSquint": 0.2},
        0.92, 1.0, 1.1, 0.95, 0.9,
    ),
}  # fmt: skip
LABELS: tuple[str, ...] = tuple(name for name in EMOTIONS if name != "neutral")
