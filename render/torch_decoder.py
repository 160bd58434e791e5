"""The decoder D of `render/decoder.py` in torch, for a GPU: one launch of a recorded graph a frame.

The same arithmetic to the last few bits. All results come back in one copy. On the CPU it is there
to be tested: the numpy decoder is the faster one.
"""

from functools import partial
from typing import Literal
from weakref import WeakKeyDictionary

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from render import decoder as plain
from render.decoder import EXPRESSION_DIM, Decoder
from render.identity import Identity
from render.posing import turn
from render.torch_posing import TorchPosing, TorchRest
from render.torch_surface import TorchBeard, TorchSurface
from render.types import FIELDS, Gaussians, Mesh

Floats = NDArray[np.float32]
TURNS = 2 * 9  # numbers of two rotations
WARM_UP = 3  # frames before a graph is recorded: torch allocates and chooses kernels in them


def on_device(decoder: Decoder, device: Literal["auto", "cpu", "cuda"]) -> "Decoder | TorchDecoder":
    """The decoder where it is to run: on a GPU only if asked for, as no GPU has run it yet."""
    return TorchDecoder(decoder, device) if device == "cuda" else decoder


class TorchDecoder:
    """Does what `Decoder.decode` does, on a device."""

    def __init__(self, decoder: Decoder, device: str) -> None:
        self._plain, self._device = decoder, torch.device(device)
        self._posing = TorchPosing(decoder.posing, self._device)
        self._people: WeakKeyDictionary[Identity, _Person] = WeakKeyDictionary()

    def decode(
        self,
        expression: Floats,  # [256]
        gaze: Floats,  # [2, 3] unit vectors, left eye first
        identity: Identity,
    ) -> tuple[Mesh, Gaussians]:
        """M, S <- D(x, g; Theta_id), in arrays of their own."""
        person = self._people.get(identity)
        if person is None:
            person = _Person(self._plain, self._posing, identity, self._device)
            self._people[identity] = person
        return person.decode(expression, gaze)


class _Person:
    """What follows from an identity, and the graph of a frame."""

    def __init__(
        self, decoder: Decoder, posing: TorchPosing, who: Identity, device: torch.device
    ) -> None:
        put = partial(torch.tensor, dtype=torch.float32, device=device)
        known = decoder.follows(who)
        self._faces, self._posing = decoder.faces, posing
        self._rest = TorchRest.of(who.rest, decoder.posing, device)
        self._surface = TorchSurface(decoder, who, known, device)
        self._to_rig, self._opacities = put(decoder.coding.to_rig), put(known.opacities)
        self._interior = torch.tensor(decoder.interior, device=device)
        behind, lids = decoder.eyes
        most = max(map(len, behind))  # the shorter list repeats its last
        rows = np.stack([np.pad(x, (0, most - len(x)), mode="edge") for x in behind])
        self._behind = torch.tensor(rows, device=device)
        self._lids = [torch.tensor(x, device=device) for x in lids]
        mirrored = np.array([(1, 1, 1), (-1, 1, 1)], np.float32)
        self._corneas = put(plain.CORNEA_MM * mirrored)
        self._shines = put(who.eye_centers + plain.CORNEA_RADIUS_MM * plain.HALF)
        self._fixed, self._beard = _fixed(who, device), TorchBeard(who.beard, device)

        total = len(known.opacities) + 2 + len(who.hair) + len(who.beard)
        self._shapes = [who.geometry.shape, *((total, *row) for row in FIELDS.values())]
        self._ends = np.cumsum([np.prod(shape) for shape in self._shapes])
        on_gpu = device.type == "cuda"
        self._given = torch.zeros(EXPRESSION_DIM + TURNS, pin_memory=on_gpu)
        self._input = torch.zeros(EXPRESSION_DIM + TURNS, device=device)
        self._got = torch.zeros(int(self._ends[-1]), pin_memory=on_gpu)
        self._step = self._recorded() if on_gpu else self._decoded

    @torch.no_grad()
    def _recorded(self):  # type: ignore[no-untyped-def]
        """`_decoded` as a graph: hundreds of small kernels are one launch."""
        stream = torch.cuda.Stream()
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            for _ in range(WARM_UP):
                self._decoded()
        torch.cuda.current_stream().wait_stream(stream)
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            output = self._decoded()

        def replay() -> Tensor:
            graph.replay()
            return output

        return replay

    @torch.no_grad()
    def decode(self, expression: Floats, gaze: Floats) -> tuple[Mesh, Gaussians]:
        given = self._given.numpy()
        given[:EXPRESSION_DIM] = expression
        given[EXPRESSION_DIM:].reshape(2, 3, 3)[:] = [turn(g) for g in gaze]
        self._input.copy_(self._given, non_blocking=True)
        self._got.copy_(self._step())
        flat = np.split(self._got.numpy().copy(), self._ends[:-1])
        vertices, *fields = (x.reshape(s) for x, s in zip(flat, self._shapes, strict=True))
        return Mesh(vertices, self._faces), Gaussians(*fields)

    def _decoded(self) -> Tensor:
        """`_input` -> everything end to end: vertices, then the fields of Gaussians."""
        code, turned = self._input[:EXPRESSION_DIM], self._input[EXPRESSION_DIM:].view(2, 3, 3)
        posing, lids = self._posing, self._posing.lids
        vertices = posing.pose(code @ self._to_rig, turned, self._rest)
        means, quats, scales, colors = self._surface.place(vertices, self._surface.seen(code))
        covers = torch.stack([colors[rows].mean(0) for rows in self._lids])
        eyes = self._behind
        colors[eyes] = lids.veil(vertices, means[eyes], covers, colors[eyes])
        opacities = self._opacities.clone()
        gap = posing.lines.gaps(vertices)[posing.mouth].max()
        opened = (gap - plain.MOUTH_SHUT_MM) / plain.MOUTH_OPENS_MM
        opacities[self._interior] *= opened.clamp(0, 1)
        shines = (turned @ self._corneas[..., None])[..., 0] + self._shines
        clears = plain.LID_CLEARS_MM - plain.LID_COVERS_MM
        shown = ((lids.bareness(vertices, shines) - plain.LID_COVERS_MM) / clears).clamp(0, 1)
        fixed = self._fixed
        grown, standing = self._beard.stand(vertices)
        parts = (
            vertices,
            *(means, shines, fixed["means"], grown),
            *(quats, fixed["quats"], standing),
            *(scales, fixed["scales"]),
            *(opacities, plain.HIGHLIGHT_OPACITY * shown, fixed["opacities"]),
            *(colors, fixed["colors"]),
        )
        return torch.cat([part.reshape(-1) for part in parts])


def _fixed(who: Identity, device: torch.device) -> dict[str, Tensor]:
    """What never changes of the two highlights, the hair, the beard, by the fields of Gaussians."""
    shines = {
        "means": np.zeros((0, 3)),
        "quats": np.array([(1, 0, 0, 0)] * 2),
        "scales": np.full((2, 3), plain.HIGHLIGHT_MM),
        "opacities": np.zeros(0),
        "colors": np.ones((2, 3)),
    }
    put = partial(torch.tensor, dtype=torch.float32, device=device)
    fixed = {k: np.concatenate([x, getattr(who.hair, k)]) for k, x in shines.items()}
    for name in ("scales", "opacities", "colors"):
        fixed[name] = np.concatenate([fixed[name], getattr(who.beard, name)])
    return {name: put(values) for name, values in fixed.items()}
