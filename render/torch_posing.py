"""The mesh half of the decoder in torch: `render/posing.py` and `render/contact.py` for a GPU.

A GPU waits for every launch, so the mouth and both pairs of lids are one list here, and so are
both eyes. Loops that stop early when there is nothing to do run to their end: they then add zero.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from render import posing_kernels
from render.contact import PUSH_PASSES, VEILED_MM, Line
from render.posing import CLOSE_MARGIN, OVERSHOOT, SOFT_LIMIT, Posing, Rest


class TorchLines:
    """Lines along which two sides meet (`render.contact.Line`), end to end.

    They share no vertices, so none moves what another one measures.
    """

    def __init__(self, lines: tuple[Line, ...], device: torch.device) -> None:
        def joined(arrays: list[np.ndarray], lengths: list[int], dtype: torch.dtype) -> Tensor:
            starts = np.cumsum([0, *lengths[:-1]])
            rows = [a + s for a, s in zip(arrays, starts, strict=True)]
            return torch.tensor(np.concatenate(rows), dtype=dtype, device=device)

        columns, pairs = [len(x.columns) for x in lines], [len(x.upper) for x in lines]
        none = [0] * len(lines)
        firsts, betweens = zip(*(line.between for line in lines), strict=True)
        self._sides = joined([np.stack([x.upper, x.lower], 1) for x in lines], none, torch.long)
        self._nearest = joined([x.nearest for x in lines], pairs, torch.long)
        self._members = joined([x.members for x in lines], none, torch.long)
        self._first = joined(list(firsts), columns, torch.long)
        self._share = joined([x.share for x in lines], none, torch.float32)
        self._between = joined(list(betweens), none, torch.float32)
        self.columns = [slice(e - n, e) for n, e in zip(columns, np.cumsum(columns), strict=True)]

    def gaps(self, vertices: Tensor) -> Tensor:  # [V, 3] -> [C] mm
        heights = vertices[self._sides, 1]
        return (heights[:, 0] - heights[:, 1])[self._nearest].amin(1)

    def open(self, vertices: Tensor, by: Tensor) -> None:  # [V, 3] in place, [C] mm
        moved = torch.lerp(by[self._first], by[self._first + 1], self._between)
        vertices[self._members, 1] += self._share * moved

    def part(self, vertices: Tensor) -> None:
        """Undo crossings, in place."""
        for _ in range(PUSH_PASSES):
            self.open(vertices, (-self.gaps(vertices)).clamp(min=0))


class TorchLids:
    """The edges of the lids of both eyes as seen from the front."""

    def __init__(self, lines: tuple[Line, Line], device: torch.device) -> None:
        sides = [side for line in lines for side in (line.upper, line.lower)]
        members = np.zeros((4, max(map(len, sides))), np.int64)
        weights = np.zeros(members.shape, np.float32)
        for row, weight, side in zip(members, weights, sides, strict=True):
            row[: len(side)], weight[: len(side)] = side, 1
        self._members = torch.tensor(members.reshape(2, 2, -1), device=device)
        self._weights = torch.tensor(weights.reshape(2, 2, 1, -1), device=device)

    def edges(self, vertices: Tensor, x: Tensor) -> Tensor:  # [V, 3], [2, n] -> [2, 2, n] mm
        """Heights of each eye's upper and lower lid at places across it."""
        side = vertices[self._members][:, :, None]  # [2, 2, 1, P, 3]
        apart = side[..., 0] - x[:, None, :, None]
        near = self._weights / (apart.square() + float(posing_kernels.EDGE_MM2)).square()
        return (near * side[..., 1]).sum(-1) / near.sum(-1)

    def bareness(self, vertices: Tensor, points: Tensor) -> Tensor:  # [V, 3], [2, 3] -> [2] mm
        """How far inside its opening a point of each eye is; below zero: covered."""
        edges = self.edges(vertices, points[:, :1])[..., 0]
        y = points[:, 1]
        return torch.minimum(edges[:, 0] - y, y - edges[:, 1])

    def veil(
        self,
        vertices: Tensor,  # [V, 3] mm
        points: Tensor,  # [2, n, 3] mm behind the lids
        covers: Tensor,  # [2, 3] colour of the lids
        colors: Tensor,  # [2, n, 3]
    ) -> Tensor:  # [2, n, 3]
        """What the lids cover takes their colour."""
        stations, (near, far) = posing_kernels.STATIONS, map(float, VEILED_MM)
        left, right = points[..., 0].aminmax(dim=1, keepdim=True)
        step = (right - left) / (stations - 1)
        across = left + torch.arange(stations, device=points.device) * step
        edges = self.edges(vertices, across)
        place = (points[..., 0] - left) / step
        k = place.nan_to_num().clamp(0, stations - 2).long()
        part, k = place - k, k[:, None].expand(-1, 2, -1)
        edge = torch.lerp(edges.gather(2, k), edges.gather(2, k + 1), part[:, None])
        y = points[..., 1]
        outside = torch.maximum(y - edge[:, 0], edge[:, 1] - y)
        share = ((outside - near) / (far - near)).clamp(0, 1)
        return torch.lerp(colors, covers[:, None], share.nan_to_num()[..., None])


@dataclass(frozen=True)
class TorchRest:
    """One person at rest, see `render.posing.Rest`."""

    geometry: Tensor  # [V, 3] mm
    eye_centers: Tensor  # [2, 3] mm
    eyeballs: Tensor  # [2, n, 3] mm from these
    reach: Tensor  # [M] mm of both eyes' lids, and ...
    centers: Tensor  # [M, 3] mm ... the centre of their eye
    shut: Tensor  # [C] mm of all lines at full blinks; 0 for the mouth

    @classmethod
    def of(cls, rest: Rest, pose: Posing, device: torch.device) -> "TorchRest":
        counts = [len(reach) for reach in rest.reach]
        balls = [rest.geometry[m] - c for m, c in zip(pose.eyeballs, rest.eye_centers, strict=True)]
        parts = (
            *(rest.geometry, rest.eye_centers, np.stack(balls), np.concatenate(rest.reach)),
            np.repeat(rest.eye_centers, counts, 0),
            np.concatenate([np.zeros(len(pose.mouth.columns), np.float32), *rest.shut]),
        )
        return cls(*(torch.tensor(x, device=device) for x in parts))


class TorchPosing:
    """Shared by everyone; holds no state."""

    def __init__(self, pose: Posing, device: torch.device) -> None:
        starts, shapes, steps, unit = pose.shapes  # rounded as the numpy decoder's
        block = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
        count, num_rig = pose.basis.shape  # pyright: ignore[reportGeneralTypeIssues] (stub)
        moves = np.zeros((len(starts) - 1, num_rig, posing_kernels.WIDTH), np.float32)
        moves[block, shapes] = steps * unit
        moves = moves.transpose(0, 2, 1).reshape(-1, num_rig)[:count]
        self._basis = torch.tensor(np.ascontiguousarray(moves), device=device)
        self.lines = TorchLines((pose.mouth, *pose.lid_lines), device)
        self.lids = TorchLids(pose.lid_lines, device)
        self.mouth = self.lines.columns[0]
        of_lids, of_balls = np.concatenate(pose.lids), np.stack(pose.eyeballs)
        counts = [len(pose.mouth.columns), *(len(line.columns) for line in pose.lid_lines)]
        blinks = np.repeat([0, *pose.blinks], counts)  # the mouth's is multiplied by 0
        self._lid_rows, self._ball_rows, self._blinks = (
            torch.tensor(x, dtype=torch.long, device=device) for x in (of_lids, of_balls, blinks)
        )
        self._jaw = pose.jaw

    def pose(self, rig: Tensor, turned: Tensor, rest: TorchRest) -> Tensor:
        """rig [R], rotations of the eyes [2, 3, 3] -> vertices [V, 3] mm, head at rest."""
        rig = self._limited(rig)
        vertices = rest.geometry + (self._basis @ rig).view_as(rest.geometry)
        self.lines.open(vertices, rig[self._blinks].clamp(0, 1) * rest.shut)
        away = vertices[self._lid_rows] - rest.centers
        out = (rest.reach / away.norm(dim=1)).clamp(min=1)
        vertices[self._lid_rows] = rest.centers + away * out[:, None]
        self.lines.part(vertices)
        balls = rest.eyeballs @ turned.transpose(1, 2) + rest.eye_centers[:, None]
        vertices[self._ball_rows] = balls
        return vertices

    def _limited(self, rig: Tensor) -> Tensor:
        inside = rig.clamp(*SOFT_LIMIT)
        rig = inside + OVERSHOOT * torch.tanh((rig - inside) / OVERSHOOT)
        opened, closed = self._jaw
        rig[closed] = torch.minimum(rig[closed], rig[opened].clamp(min=0) + CLOSE_MARGIN)
        return rig
