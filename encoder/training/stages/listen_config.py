"""What the stage "listen" is told: files, shares, weights and steps."""

from dataclasses import dataclass
from pathlib import Path

from encoder.training import loop


@dataclass(frozen=True, kw_only=True)
class ListenConfig:
    pack: Path
    phones: Path  # the phonetic encoder, without suffix
    old: Path  # folder of the chain that learns to hear phones
    pair: Path  # where the old encoder and the phonetic one are written as one
    output: Path  # folder of the student
    run: loop.RunSettings
    without: tuple[str, ...] = ()  # talkers whose tracked motion is left out
    # of the mouth that the blocks' is: of how far lips are apart, how wide they are, and all else;
    # the more, the nearer to rule-made motion and to talkers whom the blocks know, and the more
    # other voices mislead (EXPERIMENTS.md, shares and gains)
    shares: tuple[float, float, float] = (0.1, 0.3, 0.5)
    # of both: a mean of predictions moves less than people do; how far lips open (p95, talkers
    # left out) | lip sync of made speech: 1.25 1.00 | 1.19 .95 | .4 % nearer
    gain: float = 1.19
    width_gain: float = 1.15  # of how wide the lips are, on top
    hidden: int = 256
    contact: int = 32
    # of how far lips are apart and of how wide they are, as straight lines say it (lip_lines.py)
    lines: tuple[float, float] = (0.2, 0.5)
    # slope and offset that the log-odds of a voice get after training: in doubt lips rest; r of
    # talkers left out, lost to babble | loud frames of a clean voice in which lips rest | keys, mm,
    # without the blocks: 2, -1.5 .779, .047 | .10 | .03; 1.5, -.5 .780, .049 | .05 | .22;
    # 1.5, 0 .781, .051 | .04 | .35; 2, .5 .781, .055 | .04 | .23;
    # with the phones of 11-28 r of lips and loudness: 1.5, -.6 .347; -.45 .350; -.3 .352
    gate: tuple[float, float] = (1.5, -0.35)
    drop: float = 0.4  # dropout: share of hidden units left out in a step of the mouth
    drop_heard: float = 0.2  # of what the mouth hears
    drop_voice: float = 0.3  # of what is heard of voices; without, keys become voices
    steps: int = 2400  # of the mouth
    voice_steps: int = 600
    contact_steps: int = 400
    batch: int = 48
    frames: int = 100
    rate: float = 2e-3  # of the mouth
    voice_rate: float = 1e-3  # with larger steps keys are heard as a voice
    contact_rate: float = 6e-3
    # how much more a rare phone weighs: power of its share; 0: r .01 lower, with babble .03
    balance: float = 0.4
    rules: float = 0.25  # weight of rule-made motion, against 1 of real talkers
    voice_rules: float = 3.0  # the same for what hears voices: made voices are many and clean
    rest: float = 0.3  # weight of what is no voice
    versions: int = 2  # of each clip, each with its own random microphone and room
    noises: int = 200  # clips of no voice beside the pack's
    velocity_weight: float = 0.3
    span_weight: float = 0.6  # of the lips' opening and width
    tongue_weight: float = 1.0
    heard_weight: float = 1.0  # of a missed voice; with 1.3 keys move lips .5 to .8 mm
    miss_weight: float = 20.0  # of lips that are not shut for p, b and m
    false_weight: float = 12.0  # of lips that are shut in what is said far from p, b and m
    loose_weight: float = 400.0  # of a lower lip that is not on the teeth for f and v
    tucked_weight: float = 100.0  # of one that is, elsewhere
    effort_weight: float = 1.0  # of what the contact head moves near p, b and m
    idle_weight: float = 8.0  # of what it moves elsewhere
