"""The training stages of eyes and gaze, with what they need of the capture stage (DESIGN 2)."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
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


def train_gaze(output: Path, seed: int) -> None:
    """Build the gaze graph; its walk is then compared with its source by `livedrive eval eyes`."""
    from encoder.gaze_graph import build

    graph = build(*gaze_source(GAZE_MINUTES, seed))
    graph.save(output)
    print(f"{len(graph.gaze)} nodes with {len(graph.successors)} edges")


def train_eyes(preset: str, pictures: Path, output: Path, run: "Run") -> None:
    """Train the eye encoder on pictures that `livedrive capture` drew."""
    from encoder.training import eyes

    eyes.run(eyes.preset(preset, pictures=pictures, output=output, run=run))
