"""The training stages of eyes and gaze, with what they need of the capture stage (DESIGN 2)."""

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from app.train import Train
    from encoder.training.loop import Run

GAZE_MINUTES = 16.0
TALKING = 0.7  # share of the graph's source in which the person speaks
TURN_S = 4.0  # seconds from one change between speaking and silence to the next


def gaze_source(minutes: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Rule-made gaze [T, 2, 3] and lid opening [T] of somebody who speaks most of the time."""
    from encoder.capture.channels import RIG_INDEX
    from encoder.capture.upper_face import upper_face
    from sensors.types import FPS

    rng = np.random.default_rng(seed)
    frames, turn = int(minutes * 60 * FPS), int(TURN_S * FPS)
    speaks = rng.random(frames // turn + 1) < TALKING
    level = np.repeat(speaks, turn)[:frames] * np.float32(0.5)
    rig, gaze = upper_face(level, rng)
    blink = [rig[:, RIG_INDEX[f"eyeBlink_{side}"]] for side in "LR"]
    return gaze.astype(np.float32), (1 - np.mean(blink, axis=0)).astype(np.float32)


def run_eye_stage(command: "Train", run: "Run") -> None:
    """gaze: build the gaze graph. eyes: the eye encoder. multimodal: the student that sees."""
    from encoder import gaze_graph
    from encoder.inference import STUDENTS, WEIGHTS

    out = command.out or WEIGHTS
    steps: dict[str, Any] = {} if command.steps is None else {"steps": command.steps}
    if command.stage == "gaze":
        graph = gaze_graph.build(*gaze_source(GAZE_MINUTES, command.seed))
        graph.save(command.out / "gaze_graph.npz" if command.out else gaze_graph.GRAPH)
        print(f"{len(graph.gaze)} nodes with {len(graph.successors)} edges")
    elif command.stage == "eyes":
        from encoder.training import eyes

        config = eyes.preset(
            command.preset, pictures=command.data, output=out / "eyes", run=run, **steps
        )
        eyes.run(config)
    else:
        from app.training_face import face
        from encoder.training import multimodal

        config = multimodal.preset(
            command.preset,
            streams=command.data / "streams.npz",
            student=(command.start or WEIGHTS) / STUDENTS["gaze"],
            eyes=out / "eyes",
            output=out / STUDENTS["eyes"],
            run=run,
            **steps,
        )
        multimodal.run(config, face())
