"""The training stages of eyes and gaze, with what they need of the capture stage."""

from typing import TYPE_CHECKING, Any

import numpy as np

from app.train.settings import TrainSettings
from sensors.types import InputError

if TYPE_CHECKING:
    from encoder.training.loop import RunSettings

GAZE_MINUTES = 16.0
TALKING = 0.7  # share of the graph's source in which the person speaks
TURN_S = 4.0  # seconds from one change between speaking and silence to the next


def gaze_source(minutes: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Rule-made gaze [T, 2, 3] and lid opening [T] of somebody who speaks most of the time."""
    from encoder.capture.motion.channels import RIG_INDEX
    from encoder.capture.motion.upper_face import upper_face
    from sensors.types import FPS

    rng = np.random.default_rng(seed)
    frames, turn = int(minutes * 60 * FPS), int(TURN_S * FPS)
    speaks = rng.random(frames // turn + 1) < TALKING
    level = np.repeat(speaks, turn)[:frames] * np.float32(0.5)
    rig, gaze = upper_face(level, rng)
    blink = [rig[:, RIG_INDEX[f"eyeBlink_{side}"]] for side in "LR"]
    return gaze.astype(np.float32), (1 - np.mean(blink, axis=0)).astype(np.float32)


def run_eye_stage(settings: TrainSettings, run: "RunSettings") -> None:
    """gaze: build the gaze graph. eyes: the eye encoder. wide-eyes: the same for real cameras.
    multimodal: the student that sees.
    """
    from encoder.eyes import gaze_graph
    from encoder.inference import STUDENTS, WEIGHTS

    out = settings.out or WEIGHTS
    steps: dict[str, Any] = {} if settings.steps is None else {"steps": settings.steps}
    of_eyes = {"pictures": settings.data, "output": out / "eyes", "run": run, **steps}
    if settings.stage == "gaze":
        graph = gaze_graph.build(*gaze_source(GAZE_MINUTES, settings.seed))
        graph.save(settings.out / "gaze_graph.npz" if settings.out else gaze_graph.GRAPH)
        print(f"{len(graph.gaze)} nodes with {len(graph.successors)} edges")
    elif settings.stage == "eyes":
        from encoder.training.stages import eyes

        start = settings.start / "eyes" if settings.start else None
        eyes.run(eyes.preset(settings.preset, start=start, **of_eyes))
    elif settings.stage == "wide-eyes":
        from encoder.training.stages import wide_eyes

        start = (settings.start or WEIGHTS) / "eyes"
        wide_eyes.run(wide_eyes.preset(settings.preset, start=start, **of_eyes))
    else:
        from app.face.losses import face
        from encoder.training.stages import multimodal

        streams = settings.data / "streams.npz"
        if not streams.is_file():
            raise InputError(
                f"{streams}: expected the sound that `livedrive train diffusion` hears, got none; "
                "run that stage first"
            )
        config = multimodal.preset(
            settings.preset,
            streams=streams,
            student=(settings.start or WEIGHTS) / STUDENTS["gaze"],
            eyes=out / "eyes",
            output=out / STUDENTS["eyes"],
            run=run,
            **steps,
        )
        multimodal.run(config, face())
