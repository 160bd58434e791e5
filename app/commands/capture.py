"""`livedrive capture`: the synthetic capture stage. Curves from encoder, pictures from render.

`capture DIR` makes or finishes a data set, `capture inspect DIR` shows one clip, `capture
statistics DIR` judges the motion against published values, `capture calibrate DIR` against real
motion, `capture session DIR` makes one session whose eyes, sound and motion are all ours. Truth is
rule-made but where real recordings are added.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import Literal

from tyro.conf import Positional

from app.terminal import confirm, outputs
from app.terminal.arguments import Amount, Count, File, Name, Number, Seed, Whole, check_taken
from sensors.types import InputError

# option: the actions that take it, "build" being that without a word
TAKEN_BY = {
    **dict.fromkeys(("preset", "subjects", "hours", "eyes", "wide_eyes"), ("build",)),
    **dict.fromkeys(("speech", "takes", "processes"), ("build",)),
    "mocap": ("build", "calibrate"),
    "picture": ("inspect", "statistics", "calibrate"),
    "report": ("statistics", "calibrate"),
    **dict.fromkeys(("subject", "clip", "video"), ("inspect",)),
    "avatar": ("inspect", "session"),
    **dict.fromkeys(("text", "voice", "seconds"), ("session",)),
}


@dataclass(kw_only=True)
class Capture:
    """Make training data, or look at it."""

    words: Positional[tuple[str, ...]]
    """DIR: make a data set there. inspect DIR: draw a clip. statistics DIR, calibrate DIR: compare
    it with real speech and motion. session DIR: make a session of --text."""
    preset: Literal["debug", "default", "full"] = "default"
    """How much to make."""
    subjects: Number = None
    """Number of rule-made subjects, instead of the preset's."""
    hours: Amount = None
    """Hours of all rule-made subjects together, instead of the preset's."""
    eyes: Whole = 0
    """Pairs of eye pictures to render, e.g. 40000."""
    wide_eyes: Whole = 0
    """Pairs of eye pictures from headsets of all kinds, for `train wide-eyes`, e.g. 12000."""
    speech: File = None
    """Folder of real speech with a transcripts.tsv, e.g. of LibriSpeech."""
    mocap: File = None
    """Folder of tracked faces with sound, see recordings/README.md."""
    takes: File = None
    """Folder of your own NAME.wav with NAME.csv (Live Link Face)."""
    seed: Seed = 0
    """Seed of everything that is drawn at random."""
    processes: Count = 2
    """Processes that share the work."""
    picture: File = None
    """inspect, statistics, calibrate: write a picture, e.g. p.png."""
    report: File = None
    """statistics, calibrate: write the metrics, e.g. r.json."""
    subject: Name = None
    """inspect: subject of the clip; default: the first."""
    clip: Whole = 0
    """inspect: number of the subject's clip."""
    video: File = None
    """inspect: also write the clip as a video, e.g. clip.mp4."""
    text: tuple[str, ...] = ()
    """session: sentences to speak."""
    voice: str = "slt"
    """session: Flite voice: slt, rms, awb or kal16."""
    avatar: str = "ben"
    """inspect, session: avatar to draw."""
    seconds: Amount = None
    """session: cut to this length."""

    def run(self) -> None:
        words = list(self.words)
        actions = {
            "inspect": self._inspect,
            "statistics": self._statistics,
            "calibrate": self._calibrate,
            "session": self._session,
        }
        name = words.pop(0) if words and words[0] in actions else "build"
        if len(words) != 1:
            raise InputError(
                f"capture: expected one folder after {name!r}, got {len(words)}; "
                "run livedrive capture -h"
            )
        check_taken(self, TAKEN_BY, name, "actions")
        actions.get(name, self._build)(Path(words[0]))

    def _inspect(self, folder: Path) -> None:
        from app.capture.inspect import InspectSettings, inspect

        picture = self.picture or Path("inspect.png")
        self._check_outputs(picture)
        settings = InspectSettings(
            picture=picture,
            video=self.video,
            subject=self.subject,
            clip=self.clip,
            avatar=self.avatar,
            seed=self.seed,
        )
        inspect(folder, settings)

    def _session(self, folder: Path) -> None:
        from app.capture.session import SessionSettings, make_session

        settings = SessionSettings(
            text=self.text,
            voice=self.voice,
            avatar=self.avatar,
            seconds=self.seconds,
            seed=self.seed,
        )
        make_session(folder, settings)

    def _statistics(self, folder: Path) -> None:
        from app.capture.report import statistics

        self._check_outputs(self.picture)
        statistics(folder, self.picture, self.report)

    def _calibrate(self, folder: Path) -> None:
        from app.capture.report import calibrate

        self._check_outputs(self.picture)
        calibrate(folder, self.mocap, self.seed, self.picture, self.report)

    def _check_outputs(self, picture: Path | None) -> None:
        outputs.check("--picture", picture, outputs.PLOTS)
        outputs.check("--video", self.video, outputs.VIDEOS)
        outputs.check("--report", self.report, outputs.REPORTS)
        confirm.overwriting([picture, self.video, self.report])

    def _build(self, folder: Path) -> None:
        import json

        from app.capture.build import build
        from encoder.capture.subjects.plans import PRESETS

        for name, path in (("speech", self.speech), ("mocap", self.mocap), ("takes", self.takes)):
            if path is not None and not path.is_dir():
                raise InputError(f"--{name}: expected a folder, got {path}; check the path")
        config = PRESETS[self.preset]
        config = replace(
            config,
            subjects=config.subjects if self.subjects is None else self.subjects,
            hours=config.hours if self.hours is None else self.hours,
            speech=self.speech,
            mocap=self.mocap,
            takes=self.takes,
            seed=self.seed,
        )
        if config.subjects < 1 or not 0 < config.hours < 10_000:
            raise InputError(
                f"capture: expected at least 1 subject and 0-10000 hours, got {config.subjects} "
                f"and {config.hours}; change --subjects or --hours"
            )
        made = build(folder, config, self.processes)
        if self.eyes:
            from app.capture.eyes import draw_pairs

            made |= draw_pairs(folder, self.eyes, self.seed, self.processes)
        if self.wide_eyes:
            from app.capture.wide_eyes import draw_wide_pairs

            made |= draw_wide_pairs(folder, self.wide_eyes, self.seed, self.processes)
        print(json.dumps(made, indent=1))
        print(f"next: livedrive capture statistics {quote(str(folder))}")
