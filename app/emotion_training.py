"""The emotion stage with what it needs of the decoder and of the capture stage (DESIGN 2)."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from app.train import Train
    from encoder.training.loop import Run

# region: every n-th vertex, and the weight of one
FACE_VERTICES = {
    "narrow_face": (24, 1.0), "upper_face": (24, 1.0), "brows": (12, 2.0), "eyelids": (10, 2.0),
    "lips": (6, 16.0),
}  # fmt: skip


def run_emotion_stage(command: "Train", run: "Run", settings: dict[str, Any]) -> None:
    """Make the streams where there are none, then train. Variants lie in a folder of the data.

    --start FOLDER extends that folder's student, and goes on from its convolutions where it has
    some: so those of one student become another's in a third of the steps.
    """
    from app.capture_face import lips
    from app.training_face import face
    from encoder.inference import STUDENTS, WEIGHTS
    from encoder.training import emotion, emotion_streams, streams

    weights = command.out or WEIGHTS
    start = command.start or WEIGHTS
    made = emotion_streams.EmotionStreamConfig(
        pack=command.data,
        audio=start / "audio",
        output=command.data / "emotion_streams.npz",
        minutes=command.stream_minutes or emotion_streams.EmotionStreamConfig.minutes,
        seed=command.seed,
    )
    if not streams.are_made(made):
        emotion_streams.run(made, lips())
    known = start / "emotion"
    if command.start and command.variant == "none" and known.with_suffix(".json").is_file():
        settings["start"] = known
    config = emotion.preset(
        command.preset,
        streams=made.output,
        student=start / STUDENTS["gaze"],
        output=weights if command.variant == "none" else command.data / command.variant,
        run=run,
        **settings,
    )
    emotion.run(config, face(FACE_VERTICES))
