"""The training stages that add the phonetic encoder to a chain, with the folders they need."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.train.settings import TrainSettings
from sensors.types import InputError

if TYPE_CHECKING:
    from encoder.training.loop import RunSettings


def run_listen_stage(
    settings: TrainSettings, folder: Path, run: "RunSettings", overrides: dict[str, Any]
) -> None:
    """listen: the whole chain hears phones. voice-activity: it learns what is no voice."""
    from encoder.inference import WEIGHTS

    weights = settings.out or WEIGHTS
    student = folder if settings.leave_out else weights
    if settings.stage == "voice-activity":
        from encoder.training.stages import voice_activity

        old = settings.start or (folder if settings.leave_out else WEIGHTS)
        heard = weights if settings.leave_out else old
        config = voice_activity.preset(
            settings.preset, pack=settings.data, audio=heard / "audio", chain=old,
            output=student, run=run, **overrides,
        )  # fmt: skip
        voice_activity.run(config)
        return
    from app.face.losses import face
    from encoder.training.stages import listen

    if settings.out is None and not settings.leave_out:
        raise InputError("train listen: expected a folder for the new chain; give --out FOLDER")
    config = listen.preset(
        settings.preset,
        pack=settings.data,
        phones=settings.phones / "audio" if settings.phones else WEIGHTS / "phones",
        old=settings.start or WEIGHTS,
        pair=weights / "audio",
        output=student,
        run=run,
        **overrides,
    )
    listen.run(config, face())
