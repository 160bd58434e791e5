"""Gaze from nothing: a walk through a graph of gaze sequences (paper appendix, "Gaze Synthesis").

A node is w_g = 45 frames of gaze. An edge leads from a node to every node whose first w_f = 10
frames are close, in position and velocity, to the last 10 frames of the first; only the largest
strongly connected component is kept, so a walk (gaze_walk.py) never ends. `livedrive train gaze`
builds the graph from the capture stage's rule-made gaze, so the walk is rule-made, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sensors import files
from sensors.types import InputError

NODE_FRAMES, JOINT_FRAMES = 45, 10  # w_g, w_f
STRIDE = NODE_FRAMES - JOINT_FRAMES  # so a node's own continuation is a node, at distance 0
THRESHOLD = 1.5  # of the normalised distance
FORMAT = 1
GRAPH = Path(__file__).parent / "gaze_graph.npz"
_ARRAYS = ("format", "gaze_xy", "lids", "first_edge", "successors", "chances")
_FULL = 32767  # int16 for 1.0


@dataclass(frozen=True, eq=False)
class GazeGraph:
    """Nodes and, for each, where the walk may go: edges first_edge[n] .. first_edge[n + 1]."""

    gaze: NDArray[np.float32]  # [N, 45, 2, 3] unit vectors, left eye first
    lids: NDArray[np.float32]  # [N, 45] opening, 0 shut .. 1 open
    first_edge: NDArray[np.int32]  # [N + 1]
    successors: NDArray[np.int32]  # [E]
    chances: NDArray[np.float32]  # [E] probabilities that sum to 1 at each node

    def save(self, path: Path) -> None:
        """One npz; gaze as int16 x and y, of which z follows because eyes look forward."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with files.replacing(path) as draft:
            np.savez_compressed(
                draft,
                format=np.array(FORMAT),
                gaze_xy=np.rint(self.gaze[..., :2] * _FULL).astype(np.int16),
                lids=np.rint(self.lids * 255).astype(np.uint8),
                first_edge=self.first_edge,
                successors=self.successors.astype(np.uint16),
                chances=self.chances.astype(np.float16),
            )

    @staticmethod
    def load(path: Path = GRAPH) -> GazeGraph:
        """Read and check; a missing or damaged file is an InputError of one line."""
        remedy = "restore the file or run `livedrive train gaze`"
        try:
            data = files.load_npz(path)
            missing = [name for name in _ARRAYS if name not in data]
            if missing or int(data["format"]) != FORMAT:
                raise InputError(
                    f"gaze graph {path}: expected format {FORMAT} with {', '.join(_ARRAYS)}, "
                    f"got another (missing: {', '.join(missing) or 'none'}); {remedy}"
                )
            xy = data["gaze_xy"].astype(np.float64) / _FULL
            z = np.sqrt(np.maximum(1 - (xy**2).sum(-1, keepdims=True), 0))
            gaze = np.concatenate([xy, z], -1)
            gaze /= np.linalg.norm(gaze, axis=-1, keepdims=True)
            lids = data["lids"].astype(np.float32) / np.float32(255)
            first, successors = data["first_edge"], data["successors"].astype(np.int32)
            chances = data["chances"].astype(np.float64)
        except (OSError, ValueError, TypeError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(
                f"gaze graph {path}: expected a readable npz file, got {error}; {remedy}"
            ) from error
        if len(first) != len(gaze) + 1 or first[-1] != len(successors):
            raise InputError(
                f"gaze graph {path}: expected edges for {len(gaze)} nodes, got "
                f"{len(first) - 1}; {remedy}"
            )
        sums = np.add.reduceat(chances, first[:-1])
        chances = (chances / np.repeat(sums, np.diff(first))).astype(np.float32)
        return GazeGraph(gaze.astype(np.float32), lids, first, successors, chances)


def distances(nodes: NDArray[np.float32]) -> NDArray[np.float32]:
    """nodes [N, 45, 2, 3] -> [N, N]: the appendix's distance of an edge from row to column.

    Position and velocity differences of the w_f frames that meet, summed; both divided by the
    standard deviation of the gaze vector over the whole graph.
    """
    flat = nodes.reshape(len(nodes), NODE_FRAMES, 6).astype(np.float64)
    flat = flat / np.sqrt(flat.reshape(-1, 6).var(0).sum())
    last, first = flat[:, STRIDE:], flat[:, :JOINT_FRAMES]
    total = np.zeros((len(nodes), len(nodes)))
    for end, start in ((last, first), (np.diff(last, axis=1), np.diff(first, axis=1))):
        for t in range(end.shape[1]):
            gap = end[:, None, t] - start[None, :, t]
            total += np.sqrt((gap * gap).sum(-1))
    return total.astype(np.float32)


def build(
    gaze: NDArray[np.float32],  # [T, 2, 3] unit vectors
    lids: NDArray[np.float32],  # [T] opening
    threshold: float = THRESHOLD,
) -> GazeGraph:
    """Cut the source into nodes, join what fits, keep the largest strongly connected component."""
    import networkx as nx

    count = (len(gaze) - JOINT_FRAMES) // STRIDE
    if count < 2:
        raise InputError(
            f"gaze graph: expected at least {2 * STRIDE + JOINT_FRAMES} frames of gaze, got "
            f"{len(gaze)}; capture more"
        )
    index = np.arange(count)[:, None] * STRIDE + np.arange(NODE_FRAMES)
    nodes, node_lids = gaze[index], lids[index]
    distance = distances(nodes)
    graph = nx.DiGraph()
    graph.add_edges_from(zip(*(a.tolist() for a in np.nonzero(distance < threshold)), strict=True))
    kept = sorted(max(nx.strongly_connected_components(graph), key=len, default=set()))
    place = {node: k for k, node in enumerate(kept)}
    first_edge, successors = [0], list[int]()
    for node in kept:
        successors += sorted(place[n] for n in graph.successors(node) if n in place)
        first_edge.append(len(successors))
    if not successors:
        raise InputError(
            f"gaze graph: expected nodes closer than {threshold}, got none; raise the threshold"
        )
    first = np.array(first_edge, np.int32)
    after = np.array(successors, np.int32)
    return GazeGraph(
        nodes[kept].astype(np.float32), node_lids[kept].astype(np.float32), first, after,
        even_chances(first, after),
    )  # fmt: skip


def even_chances(
    first_edge: NDArray[np.int32],  # [N + 1]
    successors: NDArray[np.int32],  # [E]
    rounds: int = 200,
) -> NDArray[np.float32]:  # [E]
    """Chances under which a long walk visits every node about equally often (Sinkhorn).

    With equal chances at each node it would dwell where many edges meet: its fixations came out
    longer and its glances rarer than in the source.
    """
    num = len(first_edge) - 1
    rows = np.repeat(np.arange(num), np.diff(first_edge))
    chances = np.ones(len(successors))
    for _ in range(rounds):
        chances /= np.bincount(successors, chances, num)[successors]
        chances /= np.bincount(rows, chances, num)[rows]
    return chances.astype(np.float32)
