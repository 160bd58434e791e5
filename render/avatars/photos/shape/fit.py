"""One face, several photographs: shape, and for each photograph pose, lens and expression.

Robust least squares over the points of the detector (Gauss-Newton, damped). What is solved for
starts from what is likely: shapes of people, a lens between a phone's and a portrait's, no
expression. So a smile that one photograph shows does not become the face at rest.
"""

from dataclasses import dataclass

import numpy as np

from render.avatars.alignment import rotation
from render.avatars.maker import Maker
from render.avatars.photos.shape.places import PointPlaces
from render.avatars.photos.shape.point_shapes import PointShapes
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
MOST_TURN = 0.3  # rad, of one round; and of the lens, logarithmic
# Weight of what is likely, for each photograph: the points of a face err together, and alike in all
# photographs of it, so that each tells less than alone.
PRIOR = 4.0


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

    points: Doubles  # [468, 3] mm: where the places are
    shots: list[PhotoCamera]
    left_mm: float  # mean distance of the points that count from where they should be


def fit(
    maker: Maker,
    places: PointPlaces,
    shapes: PointShapes,
    views: list[PhotoView],
    prior: float = PRIOR,
) -> FaceFit:
    """What the views tell together; `prior`: see PRIOR, less where points are exact."""
    model = _Model.of(maker, places, shapes)
    num_rig = maker.posing.basis.shape[1]  # pyright: ignore[reportGeneralTypeIssues] (stub: may be None)
    shots = [_start(shapes.at, view, num_rig) for view in views]
    shares, gaps = np.zeros(len(shapes.modes)), list[Doubles]()
    for step in range(ALONE + TOGETHER):
        alone = step < ALONE
        size, each = (0, 7) if alone else (len(shares), 7 + len(model.columns))
        total = size + each * len(views)
        likely = prior * len(views)
        system, aim = likely * np.eye(total), np.zeros(total)
        aim[:size] = -likely * shares[:size]
        system[size:, size:] = 0
        still, gaps = shapes.of(shares), []
        for k, (view, shot) in enumerate(zip(views, shots, strict=True)):
            design, gap, weight = _linear(model, view, shot, still, alone)
            own = size + k * each + np.arange(each)
            where = np.r_[own[:7], np.arange(size), own[7:]]
            heavy = design * np.repeat(weight, 2)
            system[np.ix_(where, where)] += heavy @ design.T
            aim[where] += heavy @ gap.ravel()
            gaps.append(np.linalg.norm(gap[weight > 0], axis=1))
            stiff, pull = _likely(view, shot, model.columns[: each - 7])
            system[own[6:], own[6:]] += stiff
            aim[own[6:]] += stiff * pull
        system[np.diag_indices(total)] *= 1 + DAMPING
        move = np.linalg.solve(system + 1e-9 * np.eye(total), aim)
        shares[:size] += move[:size]
        for k, shot in enumerate(shots):
            own = move[size + k * each : size + (k + 1) * each]
            shot.turn = rotation(own[:3].clip(-MOST_TURN, MOST_TURN)) @ shot.turn
            shot.offset = shot.offset + own[3:6]
            shot.focal_px *= float(np.exp(own[6].clip(-MOST_TURN, MOST_TURN)))
            shot.expression[model.columns[: each - 7]] += own[7:]
    return FaceFit(shapes.of(shares), shots, float(np.concatenate(gaps).mean()))


@dataclass(frozen=True)
class _Model:
    """What every round needs of face and points."""

    modes: Doubles  # [K, 468, 3]
    rig: Doubles  # [R', 468, 3]
    columns: Ints  # [R'] of the rig
    facing: Doubles  # [468, 3] normals
    sigma: Doubles  # [468] mm

    @classmethod
    def of(cls, maker: Maker, places: PointPlaces, shapes: PointShapes) -> "_Model":
        rig, columns = expressions(maker, places)
        normals = maker.normals(maker.template).astype(np.float64)
        sigma = np.sqrt(places.spread_mm + NOISE_MM**2).astype(np.float64)
        return cls(shapes.modes, rig, columns, places.of(normals), sigma)


def _linear(
    model: _Model, view: PhotoView, shot: PhotoCamera, still: Doubles, alone: bool
) -> tuple[Doubles, Doubles, Doubles]:
    """How the points move with turn, offset, lens and, unless `alone`, modes and expression
    [m, 468 * 2], how they should [468, 2], both in mm, and the points' weights [468]."""
    x = shot.view(still + np.tensordot(shot.expression[model.columns], model.rig, 1))
    mm_per_px = x[:, 2].mean() / shot.focal_px
    flat = x[:, :2] / x[:, 2:]
    middle = np.array(view.size) / 2
    gap = (view.points - shot.focal_px * flat - middle) * mm_per_px
    towards = -x / np.linalg.norm(x, axis=1, keepdims=True)
    seen = ((model.facing @ shot.turn.T) * towards).sum(1) > FACING
    off = np.linalg.norm(gap, axis=1) / model.sigma
    weight = seen / model.sigma**2 / (1 + (off / OUTLIER) ** 2)
    moves = [_turns(x - shot.offset), np.tile(np.eye(3), (len(x), 1, 1)).transpose(2, 0, 1)]
    if not alone:
        moves += [model.modes @ shot.turn.T, model.rig @ shot.turn.T]
    scale = shot.focal_px * mm_per_px
    rows = _seen_moves(np.concatenate(moves), x, scale)
    design = np.concatenate([rows[:6], scale * flat[None], rows[6:]])
    return design.reshape(len(design), -1), gap, weight


def _likely(view: PhotoView, shot: PhotoCamera, columns: Ints) -> tuple[Doubles, Doubles]:
    """Weights of lens and activations, and the way to what is likely."""
    spread = LENS_SPREAD if view.lens_mm is None else TOLD_SPREAD
    rig = shot.expression[columns]
    stiff = np.where(rig < 0, AGAINST, EXPRESSION) ** -2.0
    lens = np.log(_focal(view) / shot.focal_px)
    return np.r_[spread**-2, stiff], np.r_[lens, -rig]


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
