"""Truth for the learned part: what light each vertex sees, for many people and expressions.

Written to one npz a batch of people, so that a stopped run goes on where it was.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from render.gl.contexts import create_context
from render.gl.occlusion import Occlusion
from render.training.data import expressions, people
from render.training.fitting.resume import write
from render.training.geometry.assembly import Assembly
from render.types import Floats

BATCH = 10  # people a file


@dataclass(frozen=True)
class Truth:
    """Samples; the first of each person is the neutral face."""

    seeds: NDArray[np.int64]  # [N]
    rig: Floats  # [N, R] with the person's own strength
    gaze: Floats  # [N, 2, 3]
    seen: NDArray[np.uint8]  # [N, V, 2] shares of sky and key light, 0..255

    def rows(self, seeds: range) -> "Truth":
        """The samples of some people."""
        which = np.isin(self.seeds, np.array(seeds))
        return Truth(self.seeds[which], self.rig[which], self.gaze[which], self.seen[which])


def run(
    assembly: Assembly, out: Path, seeds: range, poses: int, take: Path | None, held_out: bool
) -> Truth:
    """Make what is missing, return everything."""
    frames = expressions.real_take(take, assembly.face.rig_names, held_out)
    context = create_context()
    occlusion = Occlusion(context, assembly.solid)
    files = []
    for start in tqdm(range(seeds.start, seeds.stop, BATCH), desc="light", unit="batch"):
        path = out / f"light_{start}.npz"
        files.append(path)
        if not path.exists():
            batch = range(start, min(start + BATCH, seeds.stop))
            parts = [_person(assembly, occlusion, seed, poses, frames) for seed in batch]
            arrays = {k: np.concatenate([p[k] for p in parts]) for k in parts[0]}
            write(path, lambda draft, arrays=arrays: np.savez(draft, **arrays))  # pyright: ignore[reportArgumentType] (stub: any name may be allow_pickle)
    context.close()
    loaded = [np.load(path, allow_pickle=False) for path in files]
    fields = ("seeds", "rig", "gaze", "seen")
    return Truth(*(np.concatenate([z[name] for z in loaded]) for name in fields))


def _person(
    assembly: Assembly, occlusion: Occlusion, seed: int, poses: int, frames: Floats
) -> dict[str, NDArray]:
    person = people.draw(assembly.face, seed)
    rest = assembly.posing.rest(people.neutral(assembly.face, person))
    rng = np.random.default_rng((seed, 78))
    rigs, gazes, seen = [], [], []
    for index in range(poses + 1):
        if index == 0:
            rig, gaze = np.zeros(len(assembly.names), np.float32), expressions.gaze(0, 0)
        else:
            rig, gaze = expressions.draw(rng, assembly.names, frames)
            rig[: len(person.gains)] *= person.gains
        vertices = assembly.posing.pose(rig, gaze, rest)
        light = occlusion(vertices, assembly.normals(vertices), columns=2)
        rigs.append(rig)
        gazes.append(gaze)
        seen.append(np.rint(light * 255).astype(np.uint8))
    return {
        "seeds": np.full(poses + 1, seed),
        "rig": np.array(rigs),
        "gaze": np.array(gazes),
        "seen": np.array(seen),
    }
