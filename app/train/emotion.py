"""The emotion stage with what it needs of the decoder and of the capture stage."""

from typing import TYPE_CHECKING, Any

from app.train.settings import TrainSettings

if TYPE_CHECKING:
    from encoder.training.loop import RunSettings

# region: every n-th vertex, and the weight of one
FACE_VERTICES = {
    "narrow_face": (24, 1.0), "upper_face": (24, 1.0), "brows": (12, 2.0), "eyelids": (10, 2.0),
    "lips": (6, 16.0),
}  # fmt: skip


def run_emotion_stage(
    settings: TrainSettings, run: "RunSettings", overrides: dict[str, Any]
) -> None:
    """Make the streams where there are none, then train. Variants lie in a folder of the data.

    --start FOLDER extends that folder's student, and goes on from its convolutions where it has
    some: so those of one student become another's in a third of the steps.
    """
    from app.face.geometry import lips
    from app.face.losses import face
    from encoder.inference import STUDENTS, WEIGHTS
    from encoder.training.stages import emotion
    from encoder.training.streams import emotion as emotion_streams
    from encoder.training.streams import streams

    weights = settings.out or WEIGHTS
    start = settings.start or WEIGHTS
    made = emotion_streams.EmotionStreamConfig(
        pack=settings.data,
        audio=start / "audio",
        output=settings.data / "emotion_streams.npz",
        minutes=settings.minutes(emotion_streams.EmotionStreamConfig.minutes),
        seed=settings.seed,
    )
    if not streams.are_made(made, resumed=settings.resume):
        emotion_streams.run(made, lips())
    known = start / "emotion"
    if settings.start and settings.variant == "none" and known.with_suffix(".json").is_file():
        overrides["start"] = known
    config = emotion.preset(
        settings.preset,
        streams=made.output,
        student=start / STUDENTS["gaze"],
        output=weights if settings.variant == "none" else settings.data / settings.variant,
        run=run,
        **overrides,
    )
    emotion.run(config, face(FACE_VERTICES))
