"""Synthesised gaze, frame by frame: a seeded random walk through the gaze graph.

Where: before the denoiser, as its condition and as the decoder's gaze, when no eye camera says
where the eyes look (paper section 4.1.3). Causal, and a function of (seed, state) only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.eyes.gaze_graph import JOINT_FRAMES, STRIDE, GazeGraph
from encoder.nn import philox


@dataclass(frozen=True)
class WalkState:
    """Where the walk is; a value."""

    node: int
    frame: int  # frames of the node already shown
    previous: int  # node left behind, -1 at the start: its last frames fade into the first ones
    count: int  # nodes entered so far


class GazeWalk:
    """step(state) -> gaze [2, 3] unit vectors and lid opening; a function of (seed, state)."""

    def __init__(self, graph: GazeGraph, seed: int) -> None:
        self.graph, self.seed = graph, seed
        weight = np.arange(1, JOINT_FRAMES + 1) / (JOINT_FRAMES + 1)
        self._fade = (weight * weight * (3 - 2 * weight)).astype(np.float32)

    def init_state(self) -> WalkState:
        return WalkState(int(self._draw(0) * len(self.graph.gaze)), 0, -1, 0)

    def near(self, gaze: NDArray[np.float32], state: WalkState) -> WalkState:
        """gaze [2, 3] -> a walk that goes on from the node which begins nearest to it."""
        cosine = (self.graph.gaze[:, 0] * gaze).sum((1, 2))
        return WalkState(int(cosine.argmax()), 0, -1, state.count + 1)

    def step(self, state: WalkState) -> tuple[NDArray[np.float32], float, WalkState]:
        graph = self.graph
        node, frame, previous, count = state.node, state.frame, state.previous, state.count
        if frame == STRIDE:
            previous, node, frame, count = node, self._next(node, count + 1), 0, count + 1
        gaze, lid = graph.gaze[node, frame], float(graph.lids[node, frame])
        if previous >= 0 and frame < JOINT_FRAMES:
            fade = self._fade[frame]
            gaze = fade * gaze + (1 - fade) * graph.gaze[previous, STRIDE + frame]
            gaze = gaze / np.linalg.norm(gaze, axis=-1, keepdims=True)
            lid = float(fade) * lid + (1 - float(fade)) * float(
                graph.lids[previous, STRIDE + frame]
            )
        return gaze.astype(np.float32), lid, WalkState(node, frame + 1, previous, count)

    def _next(self, node: int, count: int) -> int:
        first, last = self.graph.first_edge[node], self.graph.first_edge[node + 1]
        reached = np.cumsum(self.graph.chances[first:last])
        place = int(np.searchsorted(reached, self._draw(count) * reached[-1], side="right"))
        return int(self.graph.successors[first + min(place, int(last - first) - 1)])

    def _draw(self, count: int) -> float:
        return float(philox.generator(self.seed, 0, 0, 2, count).random())


def synthesise(graph: GazeGraph, frames: int, seed: int) -> NDArray[np.float32]:
    """A whole walk at once: gaze [frames, 2, 3]."""
    walk = GazeWalk(graph, seed)
    state, rows = walk.init_state(), []
    for _ in range(frames):
        gaze, _, state = walk.step(state)
        rows.append(gaze)
    return np.array(rows, np.float32).reshape(frames, 2, 3)
