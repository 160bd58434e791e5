"""A head of any topology takes the face model's: similarity, shapes of known people, then a
smooth rest of the displacement.

Non-rigid ICP in two parts. The shapes of the shipped people keep lids, lips and what a scan does
not show plausible; what they leave is a displacement whose bending is punished less and less.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csc_array, diags_array, eye_array
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree

from render.avatars import alignment
from render.avatars.alignment import Doubles, Pose
from render.avatars.maker import Maker
from render.avatars.surface_scan import Scan
from render.decoder import identity
from render.decoder.learned import avatar_files
from render.decoder.mesh_parts import SKIN_VERTICES
from render.types import Floats, Ints
from sensors.types import InputError

EYES_MM = 5.0  # height above which what is no skin belongs to an eye
ATTACHED = 14062  # with the insides of mouth and sockets, which hang on them
REACH_MM = (25.0, 8.0)  # pairs farther apart do not count: at first, at the end
AGREE = 0.5  # cosine between normals of a pair
ROUNDS = 25  # with the shapes
PRIOR = 10.0  # weight of the shares of known people, in pairs that are 1 mm apart
PLACES = 3000  # of the skin that the shapes are fitted at
BENDING = (3000.0, 300.0, 60.0, 20.0)  # weights, one after the other
ROUNDS_EACH = 4
CALM = 20.0  # how much more lids and lips resist bending
EDGE_MM = 4.0  # from the line between the lips
RIDGE = 1e-4
SYMMETRIC = {"SymmetricMode": True}  # and positive: no pivots are sought, in half the time
SIZE_SHARE = 0.05  # a deviation of the size of a head
LANDMARK = 30.0  # weight of one
MAX_LEFT_MM = 2.5  # mean distance of the face that is still a fit
MIN_FACE = 0.6  # of the face that the scan must show

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Fit:
    geometry: Floats  # [V, 3] mm, upright, in the face model's topology
    scan: Scan  # moved to where the geometry is
    face_mm: float  # mean distance of the face from the scan


def register(maker: Maker, scan: Scan, landmarks: dict[str, Doubles], progress: Progress) -> Fit:
    """Raises InputError where no face is found, or the fit is too far from the scan."""
    template = maker.template.astype(np.float64)
    shapes = people(maker)
    places = landmark_vertices(maker)
    marks = np.array([places[name] for name in landmarks], np.int32)
    aims = np.array(list(landmarks.values()), np.float64).reshape(-1, 3)
    face, outer = visible(maker)
    progress("looking for the face", 0.0)
    if len(marks) >= 3:
        pose = alignment.similarity(template[marks], aims, scaled=True)
    else:
        normals = maker.normals(maker.template).astype(np.float64)
        pose, _ = alignment.find(template[face], normals[face], scan.points, scan.normals)
    scan, aims, known = scan.moved(pose), pose.undo(aims), template
    for k in range(ROUNDS):
        progress("shape", 0.2 + 0.4 * k / ROUNDS)
        reach = float(np.interp(k, (0, ROUNDS - 1), REACH_MM))
        step, known = _shape(maker, scan, known, shapes, outer, (marks, aims), reach)
        scan, aims = scan.moved(step), step.undo(aims)
    moved, tree, bend = np.zeros_like(known), KDTree(scan.points), _bending(maker)
    for k, weight in enumerate(BENDING):
        for j in range(ROUNDS_EACH):
            progress("surface", 0.6 + 0.4 * (k + j / ROUNDS_EACH) / len(BENDING))
            gap, share, _ = _pairs(maker, scan, tree, known + moved, outer, REACH_MM[1])
            rows, goal = np.r_[outer, marks], np.r_[moved[outer] + gap, aims - known[marks]]
            load = np.zeros(ATTACHED)
            np.add.at(load, rows, np.r_[share, np.full(len(marks), LANDMARK)])
            right = np.zeros((ATTACHED, 3))
            shares = np.r_[share, np.full(len(marks), LANDMARK)]
            np.add.at(right, rows, shares[:, None] * goal)
            system = csc_array(weight * bend + diags_array(load + RIDGE))
            moved[:ATTACHED] = splu(system, "MMD_AT_PLUS_A", 0.0, options=SYMMETRIC).solve(right)
    geometry = known + moved + attached(maker, moved)
    gap, share, _ = _pairs(maker, scan, tree, geometry, face, REACH_MM[1])
    seen = share > 0
    left = float(np.linalg.norm(gap[seen], axis=1).mean()) if seen.any() else np.inf
    if seen.mean() < MIN_FACE or left > MAX_LEFT_MM:
        raise InputError(
            f"scan: expected a face, got a surface that fits {seen.mean():.0%} of one, "
            f"{left:.1f} mm away; mark it with --landmarks FILE, or cut away all but the head"
        )
    progress("surface", 1.0)
    return Fit(geometry.astype(np.float32), scan, left)


def people(maker: Maker) -> Doubles:  # [K, V, 3] mm
    """How the shipped people differ from the mean face, and a head of another size."""
    heads = [identity.load(name).geometry for name in avatar_files.shipped()]
    differences = [head.astype(np.float64) - maker.template for head in heads]
    return np.stack([*differences, maker.template.astype(np.float64) * SIZE_SHARE])


def landmark_vertices(maker: Maker) -> dict[str, int]:
    """Vertices of the landmarks that a user may give; left is the subject's left."""
    template, posing = maker.template, maker.posing
    skin, lips = template[:SKIN_VERTICES], posing.mouth.upper
    found = {"nose_tip": int(skin[:, 2].argmax())}
    for name, line, sign in zip(("left", "right"), posing.lid_lines, (1, -1), strict=True):
        ends = line.upper[np.argsort(sign * template[line.upper, 0])]
        found[f"{name}_eye_inner"], found[f"{name}_eye_outer"] = int(ends[0]), int(ends[-1])
    found["mouth_left"] = int(lips[template[lips, 0].argmax()])
    found["mouth_right"] = int(lips[template[lips, 0].argmin()])
    low = (np.abs(skin[:, 0]) < 4) & (skin[:, 1] < template[lips, 1].mean() - 20)
    found["chin"] = int(np.flatnonzero(low)[skin[low, 2].argmax()])
    return found


def visible(maker: Maker) -> tuple[Ints, Ints]:
    """Vertices of the face, and of all the skin, that a scanner sees; where lips meet it sees a
    crease, which would pull them apart."""
    used = np.unique(maker.skin)
    outer = np.setdiff1d(used[used < SKIN_VERTICES], maker.regions["inner_mouth_lip_roll"])
    edges = [maker.posing.mouth.upper, maker.posing.mouth.lower]
    distance, _ = KDTree(maker.template[np.concatenate(edges)]).query(maker.template[outer])
    outer = outer[distance > EDGE_MM]
    return np.intersect1d(outer, maker.regions["narrow_face"]), outer


def _pairs(
    maker: Maker, scan: Scan, tree: KDTree, at: Doubles, rows: Ints, reach: float
) -> tuple[Doubles, Doubles, Doubles]:
    """Ways along the scan's normals onto it [n, 3], their weights [n], the normals [n, 3]."""
    normals = maker.normals(at.astype(np.float32))[rows]
    distance, nearest = tree.query(at[rows], distance_upper_bound=reach)
    found = np.isfinite(distance)
    nearest = np.where(found, nearest, 0)
    n = scan.normals[nearest]
    gap = ((scan.points[nearest] - at[rows]) * n).sum(1)
    alike = (normals * n).sum(1) > AGREE
    return n * gap[:, None], found * alike / (1 + (gap / (0.5 * reach)) ** 2), n


def _shape(
    maker: Maker, scan: Scan, known: Doubles, shapes: Doubles, outer: Ints,
    marks: tuple[Ints, Doubles], reach: float,
) -> tuple[Pose, Doubles]:  # fmt: skip
    """One round: the rigid motion and the shares of the people that fit the pairs best."""
    rows = outer[:: max(1, len(outer) // PLACES)]
    gap, weight, n = _pairs(maker, scan, KDTree(scan.points), known, rows, reach)
    design = np.concatenate(
        [np.cross(known[rows], n), n, np.einsum("kni,ni->nk", shapes[:, rows], n)], 1
    )
    basis = shapes[:, rows].reshape(len(shapes), -1).T
    shares = np.linalg.lstsq(basis, (known - maker.template)[rows].ravel(), rcond=None)[0]
    prior = np.r_[np.zeros(6), np.full(len(shapes), PRIOR)]
    system = design.T @ (weight[:, None] * design) + np.diag(prior + 1e-9)
    aim = design.T @ (weight * (gap * n).sum(1)) - prior * np.r_[np.zeros(6), shares]
    for v, goal in zip(*marks, strict=True):
        block = np.concatenate([-_cross(known[v]), np.eye(3), shapes[:, v].T], 1)
        system += LANDMARK * block.T @ block
        aim += LANDMARK * block.T @ (goal - known[v])
    move = np.linalg.solve(system, aim)
    step = Pose(1.0, alignment.rotation(move[:3]), move[3:6])
    return step, known + np.einsum("k,kni->ni", move[6:], shapes)


def _cross(v: Doubles) -> Doubles:  # [3] -> [3, 3]
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def _bending(maker: Maker) -> csc_array:  # [ATTACHED, ATTACHED]
    """The energy of bending of the skin, calmer at lids, lips and nostrils."""
    faces = maker.faces[(maker.faces < ATTACHED).all(1)]
    a, b = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).T
    one = np.ones(len(a))
    edges = csc_array(coo_array((one, (a, b)), (ATTACHED, ATTACHED)))
    edges = edges + edges.T
    edges.data[:] = 1
    around = np.asarray(edges.sum(1)).ravel()
    laplace = csc_array(eye_array(ATTACHED) - diags_array(1 / np.maximum(around, 1)) @ edges)
    calm = np.ones(ATTACHED)
    for name in ("eyelids", "lips", "inner_mouth_lip_roll"):
        calm[maker.regions[name]] = CALM
    members = maker.posing.mouth.members
    calm[members[members < ATTACHED]] = CALM
    return csc_array(laplace.T @ diags_array(calm) @ laplace)


def attached(maker: Maker, moved: Doubles) -> Doubles:  # [V, 3]
    """Eyeballs and teeth go with what is around them, as they are; lashes with their lids."""
    out, at = np.zeros_like(moved), maker.template
    skin = np.unique(maker.skin)
    skin = skin[skin < SKIN_VERTICES]
    rest = np.arange(ATTACHED, len(at))
    lips, lids = maker.regions["lips"], maker.regions["eyelids"]
    out[rest] = moved[lips].mean(0)  # gums, tongue, teeth
    high = rest[at[rest, 1] > EYES_MM]  # eyes and what lies on them
    for sign in (1, -1):
        side, own = high[sign * at[high, 0] > 0], lids[sign * at[lids, 0] > 0]
        out[side] = moved[own].mean(0)
    return out
