"""`livedrive eval KIND`: what was trained, judged on what it never saw."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional, arg, subcommand

from app.eval.emotion.settings import EmotionSettings
from app.eval.eyes.evaluate import EyesSettings
from app.eval.head import HeadSettings
from app.eval.photos import PhotosSettings
from app.eval.prior import PriorSettings
from app.eval.speech.rest import RestSettings
from app.eval.speech.settings import SpeechSettings
from app.terminal import confirm, outputs
from app.terminal.arguments import File, Seed
from sensors.types import InputError

WRITTEN = {"report": outputs.REPORTS, "picture": outputs.PICTURES, "plot": outputs.PLOTS}
FLAT = arg(name="")  # options of a settings value stand beside the others
# option of eval speech: those that do nothing without it
SPEECH_PARTNERS = {"leave_one_out": ("mocap", "strips"), "peers": ("films",)}


@dataclass(kw_only=True)
class EvalSpeech:
    """Evaluate audio encoder, teacher and student on held-out clips, silence and noise."""

    data: Positional[Path]
    """Data by `livedrive capture`; teacher and ablations are read from it, too."""
    settings: Annotated[SpeechSettings, FLAT] = field(default_factory=SpeechSettings)

    def run(self) -> None:
        self._check()
        if self.settings.leave_one_out and self.settings.strips:
            from app.eval.speech.strips import evaluate
        elif self.settings.leave_one_out:
            from app.eval.speech.leave_out import evaluate
        elif self.settings.peers:
            from app.eval.speech.baselines import evaluate
        elif self.settings.ablations:
            from app.eval.speech.ablations import evaluate
        else:
            from app.eval.speech.evaluate import evaluate

        evaluate(self.data, self.settings)

    def _check(self) -> None:
        for partner, options in SPEECH_PARTNERS.items():
            for option in options:
                if getattr(self.settings, option) and not getattr(self.settings, partner):
                    raise InputError(
                        f"--{option}: expected --{partner.replace('_', '-')} beside it, got none; "
                        f"add it, or leave --{option} away"
                    )


@dataclass(kw_only=True)
class EvalEyes:
    """Evaluate gaze, lids, blinks, lost cameras and the upper face."""

    settings: Annotated[EyesSettings, FLAT] = field(default_factory=EyesSettings)

    def run(self) -> None:
        from app.eval.eyes.evaluate import evaluate

        evaluate(self.settings)


@dataclass(kw_only=True)
class EvalHead:
    """Measure how lively the head is: motion, brows, blinks and breath over a session."""

    settings: Annotated[HeadSettings, FLAT] = field(default_factory=HeadSettings)

    def run(self) -> None:
        from app.eval.head import evaluate

        evaluate(self.settings)


@dataclass(kw_only=True)
class EvalEmotion:
    """Evaluate emotions on held-out subjects: recognised, in sync, smooth."""

    data: Positional[Path]
    """Data by `livedrive capture`; ablations are read from it, too."""
    settings: Annotated[EmotionSettings, FLAT] = field(default_factory=EmotionSettings)

    def run(self) -> None:
        from app.eval.emotion.evaluate import evaluate

        evaluate(self.data, self.settings)


@dataclass(kw_only=True)
class EvalAb:
    """Make a page for an A/B test: pairs of videos or pictures side by side, which is better?"""

    a: Positional[File] = None
    """Folder of videos or pictures of the first method, or of weights whose people are drawn."""
    b: Positional[File] = None
    """The same of the second; a pair has the same file name."""
    out: Path = Path("ab.html")
    """Page to write."""
    seed: Seed = 0
    """Seed of the order and of the sides."""
    count: tuple[Path, ...] = ()
    """Instead, without folders: count the votes in these files, which the page saved."""

    def run(self) -> None:
        from app.eval import ab

        if self.count:
            print(*ab.tally(self.count), sep="\n")
        elif self.a is None or self.b is None:
            got = "none" if self.a is None else "one"
            raise InputError(
                f"eval ab: expected two folders, or --count, got {got}; see: livedrive eval ab -h"
            )
        else:
            outputs.check("--out", self.out, (".html",))
            confirm.overwriting([self.out])
            ab.make_page(self.a, self.b, self.out, self.seed)


@dataclass(kw_only=True)
class EvalPrior:
    """Evaluate decoder and identity encoder on held-out people, expressions and views."""

    settings: Annotated[PriorSettings, FLAT] = field(default_factory=PriorSettings)

    def run(self) -> None:
        from app.eval.prior import evaluate

        evaluate(self.settings)


@dataclass(kw_only=True)
class EvalPhotos:
    """Evaluate avatars from photographs of held-out people."""

    settings: Annotated[PhotosSettings, FLAT] = field(default_factory=PhotosSettings)

    def run(self) -> None:
        from app.eval.photos import evaluate

        evaluate(self.settings)


@dataclass(kw_only=True)
class EvalRest:
    """Measure how far lips open in sounds that are no voice."""

    settings: Annotated[RestSettings, FLAT] = field(default_factory=RestSettings)

    def run(self) -> None:
        from app.eval.speech.rest import evaluate

        evaluate(self.settings)


@dataclass(kw_only=True)
class Eval:
    """Evaluate what was trained: speech | rest | eyes | head | emotion | ab | prior | photos."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[EvalSpeech, subcommand("speech")]
        | Annotated[EvalRest, subcommand("rest")]
        | Annotated[EvalEyes, subcommand("eyes")]
        | Annotated[EvalHead, subcommand("head")]
        | Annotated[EvalEmotion, subcommand("emotion")]
        | Annotated[EvalAb, subcommand("ab")]
        | Annotated[EvalPrior, subcommand("prior")]
        | Annotated[EvalPhotos, subcommand("photos")]
    ]

    def run(self) -> None:
        settings = getattr(self.command, "settings", None)
        for name, endings in WRITTEN.items():
            path = getattr(settings, name, None)
            outputs.check(f"--{name}", path, endings)
            confirm.overwriting([path])
        self.command.run()
