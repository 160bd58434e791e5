"""`livedrive eval KIND`: what was trained, judged on what it never saw."""

from dataclasses import dataclass
from typing import Annotated

import tyro
from tyro.conf import subcommand

from app.eval_ab import EvalAb
from app.eval_emotion import EvalEmotion
from app.eval_eyes import EvalEyes
from app.eval_prior import EvalPrior
from app.eval_speech import EvalSpeech


@dataclass(kw_only=True)
class Eval:
    """Judge the trained networks: speech | eyes | emotion | ab | prior."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[EvalSpeech, subcommand("speech")]
        | Annotated[EvalEyes, subcommand("eyes")]
        | Annotated[EvalEmotion, subcommand("emotion")]
        | Annotated[EvalAb, subcommand("ab")]
        | Annotated[EvalPrior, subcommand("prior")]
    ]

    def run(self) -> None:
        self.command.run()
