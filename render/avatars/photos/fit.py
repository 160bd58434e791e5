"""One face, several photographs: shape, and for each photograph pose, lens and expression.

Robust least squares over the points of the detector (Gauss-Newton, damped). What is solved for
starts from what is likely: shapes of people, a lens between a phone's and a portrait's, no
expression. So a smile that one photograph shows does not become the face at rest.
"""

from dataclasses import dataclass

import numpy as np

from render.avatars.alignment import rotation
from render.avatars.maker import Maker
from render.avatars.photos.places import PointPlaces
from render.avatars.photos.shapes import HeadShapes
from render.types import Doubles, Ints

LENS_MM, LENS_SPREAD = 45.0, 0.35  # as of a 35 mm film, where it is not told; logarithmic spread
TOLD_SPREAD = 0.04
DIAGONAL_MM = 43.27  # of that film
EXPRESSION, AGAINST = 0.25, 0.03  # deviations of an activation; below zero
EYES = ("eyeLook",)  # turn the eyes, which have points of their own
NOISE_MM = 0.7  # of a point; its place spreads along the skin, which counts less (square root)
OUTLIER = 3.0  # deviations from which a point counts less
FACING = 0.15  # least cosine to the viewer of a point that counts
ALONE, TOGETHER = 12, 30  # rounds: poses alone, everything
DAMPING = 1e-3
# Weight of what is likely: the points of a face err together, so that each tells less than alone.
PRIOR = 8.0


@dataclass(frozen=True)
class PhotoView:
    """What one photograph shows of the face."""

    points: Doubles  # [468, 2] px
    size: tuple[int, int]  # px, width and height
    lens_mm: float | None = None  # as of a 35 mm film, where the file tells it


@dataclass
class PhotoCamera:
    """How one photograph was taken: x = turn p + offset, then focal_px x / z."""

    turn: Doubles  # [3, 3]
    offset: Doubles  # [3] mm
    focal_px: float
    expression: Doubles  # [R] activations of the rig

    def view(self, points: Doubles) -> Doubles:  # [n, 3] mm -> [n, 3] mm, z into the picture
        return points @ self.turn.T + self.offset

    def project(self, points: Doubles, size: tuple[int, int]) -> Doubles:  # [n, 3] -> [n, 2] px
        x = self.view(points)
        return self.focal_px * x[:, :2] / x[:, 2:] + np.array(size) / 2


@dataclass(frozen=True)
class FaceFit:
    """The face at rest, and the photographs."""

    shares: Doubles  # [K] of the modes, in deviations
    shots: list[PhotoCamera]
    left_mm: float  # mean distance of the points that count from where they should be


def fit(
    maker: Maker,
    places: PointPlaces,
    shapes: HeadShapes,
    views: list[PhotoView],
    prior: float = PRIOR,
) -> FaceFit:
    """What the views tell together; `prior`: less where points are exact."""
    rig, columns = expressions(maker, places)
    normals = maker.normals(shapes.mean.astype(np.float32)).astype(np.float64)
    facing = places.of(normals)
    sigma = np.sqrt(places.spread_mm + NOISE_MM**2).astype(np.float64)
    num_rig = maker.posing.basis.shape[1]  # pyright: ignore[reportGeneralTypeIssues] (stub: may be None)
    shares, shots = np.zeros(len(shapes.modes)), list[PhotoCamera]()
    lens = [np.log(_focal(view)) for view in views]
    for view in views:
        shots.append(_start(shapes.at, view, num_rig))
    left = 0.0
    for step in range(ALONE + TOGETHER):
        size = len(shares) if step >= ALONE else 0
        each = 7 + (len(columns) if step >= ALONE else 0)
        total = size + each * len(views)
        system, aim = np.zeros((total, total)), np.zeros(total)
        still = shapes.at + np.tensordot(shares, shapes.modes, 1)
        gaps: list[Doubles] = []
        for k, (view, shot) in enumerate(zip(views, shots, strict=True)):
            points = still + np.tensordot(shot.expression[columns], rig, 1)
            x = shot.view(points)
            px_per_mm = shot.focal_px / x[:, 2].mean()
            gap = (view.points - shot.project(points, view.size)) / px_per_mm
            towards = -x / np.linalg.norm(x, axis=1, keepdims=True)
            seen = ((facing @ shot.turn.T) * towards).sum(1) > FACING
            off = np.linalg.norm(gap, axis=1) / sigma
            weight = seen / sigma**2 / (1 + (off / OUTLIER) ** 2)
            gaps.append(np.linalg.norm(gap[seen], axis=1))
            moves = [_turns(x - shot.offset), np.tile(np.eye(3), (len(x), 1, 1)).transpose(2, 0, 1)]
            if step >= ALONE:
                moves += [shapes.modes @ shot.turn.T, rig @ shot.turn.T]
            rows = _seen_moves(np.concatenate(moves), x, shot.focal_px / px_per_mm)
            lens_row = (x[:, :2] / x[:, 2:] * shot.focal_px / px_per_mm)[None]
            design = np.concatenate([rows[:6], lens_row, rows[6:]])
            own = np.arange(size + k * each, size + k * each + 7)
            where = np.r_[own, np.arange(size), np.arange(own[-1] + 1, own[0] + each)]
            flat = design.reshape(len(design), -1)
            heavy = flat * np.repeat(weight, 2)
            system[np.ix_(where, where)] += heavy @ flat.T
            aim[where] += heavy @ gap.ravel()
            spread = LENS_SPREAD if view.lens_mm is None else TOLD_SPREAD
            system[own[6], own[6]] += 1 / spread**2
            aim[own[6]] += (lens[k] - np.log(shot.focal_px)) / spread**2
            if step >= ALONE:
                e = shot.expression[columns]
                stiff = np.where(e < 0, AGAINST, EXPRESSION) ** -2.0
                mine = np.arange(own[-1] + 1, own[0] + each)
                system[mine, mine] += stiff
                aim[mine] -= stiff * e
        if size:
            system[np.arange(size), np.arange(size)] += prior
            aim[:size] -= prior * shares
        system[np.diag_indices(total)] *= 1 + DAMPING
        move = np.linalg.solve(system + 1e-9 * np.eye(total), aim)
        shares = shares + (move[:size] if size else 0)
        for k, shot in enumerate(shots):
            own = move[size + k * each : size + (k + 1) * each]
            shot.turn = rotation(own[:3].clip(-0.3, 0.3)) @ shot.turn
            shot.offset = shot.offset + own[3:6]
            shot.focal_px *= float(np.exp(own[6].clip(-0.3, 0.3)))
            shot.expression[columns] += own[7:] if step >= ALONE else 0
        left = float(np.concatenate(gaps).mean())
    return FaceFit(shares, shots, left)


def expressions(maker: Maker, places: PointPlaces) -> tuple[Doubles, Ints]:
    """How the points move [R', 468, 3] with those activations that a photograph may show [R']."""
    names: list[str] = maker.rig_names
    columns = np.array([k for k, n in enumerate(names) if not n.startswith(EYES)], np.int32)
    index = (places.corners.reshape(-1, 1) * 3 + np.arange(3)).ravel()
    basis = maker.posing.basis[index].toarray()[:, columns]
    moves = basis.reshape(*places.corners.shape, 3, -1)
    return np.einsum("ncir,nc->rni", moves, places.weights).astype(np.float64), columns


def _focal(view: PhotoView) -> float:
    diagonal = float(np.hypot(*view.size))
    return (view.lens_mm or LENS_MM) / DIAGONAL_MM * diagonal


def _start(at: Doubles, view: PhotoView, num_rig: int) -> PhotoCamera:
    """From an affine camera."""
    middle, seen = at.mean(0), view.points.mean(0)
    affine = np.linalg.lstsq(at - middle, view.points - seen, rcond=None)[0].T  # [2, 3]
    u, spread, vt = np.linalg.svd(affine, full_matrices=False)
    turn = np.zeros((3, 3))
    turn[:2] = u @ vt
    turn[2] = np.cross(turn[0], turn[1])
    focal = _focal(view)
    away = focal / spread.mean()
    place = np.array([*((seen - np.array(view.size) / 2) * away / focal), away])
    return PhotoCamera(turn, place - turn @ middle, focal, np.zeros(num_rig))


def _turns(arm: Doubles) -> Doubles:  # [n, 3] -> [3, n, 3] moves for a turn about each axis
    return np.stack([np.cross(axis, arm) for axis in np.eye(3)])


def _seen_moves(moves: Doubles, x: Doubles, scale: float) -> Doubles:  # [m, n, 3] -> [m, n, 2]
    z = x[:, 2:]
    return scale * (moves[..., :2] - moves[..., 2:] * x[:, :2] / z) / z
