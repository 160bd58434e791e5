"""Eye pictures as real cameras take them, with where the eye lies in them: for `train wide-eyes`.

Three quarters of the people wear headsets of all kinds (`render.near_eye.wide_look`), the others
those of `Look.draw`. Files wide_NNN.npz hold left-like pictures, pair after pair; no_eyes.npz holds
pictures of anything else. `encoder.training.streams.wide_eyes` reads both.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from app.capture import eyes as usual
from app.capture.rendering import rendered
from sensors import files

if TYPE_CHECKING:
    from render.near_eye.look import Look

SIZE_PX = 192
USUAL_SHARE = 0.25  # of people in the headsets of `Look.draw`
DROOPY_SHARE, SQUINT_SHARE = 0.25, 0.2  # of people in others
OPEN_SHARE = 0.5  # of moments: most of what a camera sees
NO_EYES = 4000
Floats = NDArray[np.float32]


def draw_wide_pairs(folder: Path, count: int, seed: int, processes: int) -> dict[str, Any]:
    """Make files until `count` pairs exist, and the pictures of no eye."""
    from app.capture.no_eyes import no_eye

    per_file = usual.PEOPLE_A_FILE * usual.PAIRS_A_PERSON
    jobs = [(folder, k, (seed, 77, k)) for k in range(-(-count // per_file))]
    todo = [job for job in jobs if not _path(folder, job[1]).exists()]
    rendered(_file, todo, processes, "wide eyes")
    if not (folder / "no_eyes.npz").exists():
        rng = np.random.default_rng((seed, 78))
        _write(folder / "no_eyes.npz", {"pictures": [no_eye(rng, SIZE_PX) for _ in range(NO_EYES)]})
    return {"wide_eye_pairs": len(jobs) * per_file}


def _path(folder: Path, number: int) -> Path:
    return folder / f"wide_{number:03d}.npz"


_renderer: Any = None  # one GL context a process


def _file(job: tuple[Path, int, tuple[int, ...]]) -> None:
    global _renderer
    from render.decoder import identity
    from render.decoder.decoder import Decoder
    from render.decoder.learned import avatar_files
    from render.near_eye.camera import NearEye
    from render.near_eye.look import Look, varied
    from render.near_eye.wide_look import wide_look

    folder, number, seed = job
    rng = np.random.default_rng(seed)
    _renderer = _renderer or NearEye(Decoder.load(), size_px=SIZE_PX)
    people = [identity.load(name) for name in avatar_files.shipped()]
    rows: dict[str, list[Any]] = {}
    for person in range(usual.PEOPLE_A_FILE):
        look = Look.draw(rng)
        look = usual.dark_lashed(look, rng) if rng.random() < usual.DARK_SHARE else look
        wide = rng.random() >= USUAL_SHARE
        look = wide_look(look, rng) if wide else look
        wearer = _renderer.wear(varied(people, rng), look, rng)
        droop = rng.uniform(0.1, 0.5) if wide and rng.random() < DROOPY_SHARE else 0.0
        squint = rng.uniform(0, 0.8) if wide and rng.random() < SQUINT_SHARE else 0.0
        for _ in range(usual.PAIRS_A_PERSON):
            rig, gaze = _moment(droop, squint, rng)
            now = look.slipped(rng) if wide else look
            pair = _renderer.draw(wearer, rig, gaze, rng, now)
            _keep(rows, pair, rig, gaze, now, number * usual.PEOPLE_A_FILE + person, wide, rng)
    _write(_path(folder, number), rows)


def _keep(
    rows: dict[str, list[Any]], pair: Any, rig: Floats, gaze: Floats, look: "Look",
    subject: int, wide: bool, rng: np.random.Generator,
) -> None:  # fmt: skip
    """Both eyes as left ones, with their truth."""
    from render.near_eye.primitives import place_in_picture
    from render.near_eye.wide_look import AIM, PUPIL_MM, painted

    span = 2 * look.distance * np.tan(np.radians(look.view_deg) / 2)  # mm across, at AIM
    middle = place_in_picture(look, np.array(AIM, np.float32))
    for eye, side in enumerate((1, -1)):
        picture = pair.pictures[eye] if eye == 0 else pair.pictures[eye][:, ::-1]
        if wide:
            picture = painted(picture, np.random.default_rng(subject), rng)
        seen = gaze[eye] * np.array([side, 1, 1], np.float32)
        values = {
            "pictures": np.ascontiguousarray(picture), "gaze": seen[:2],
            "lids": pair.lids[eye], "rig": usual.upper_face(rig)[eye], "subject": subject,
            "frame": (*middle, span, look.roll_deg),
            "pupil": place_in_picture(look, PUPIL_MM * seen), "wide": wide,
        }  # fmt: skip
        for name, value in values.items():
            rows.setdefault(name, []).append(value)


def _moment(droop: float, squint: float, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """A face whose eyes do anything, mostly open: rig [53], gaze [2, 3]."""
    from encoder.capture.motion.channels import RIG_INDEX
    from encoder.capture.motion.upper_face import directions

    rig = np.zeros(len(RIG_INDEX), np.float32)
    gaze = usual.any_eyes(rig, rng)
    if rng.random() < OPEN_SHARE:
        for side in "LR":
            rig[RIG_INDEX[f"eyeBlink_{side}"]] = rng.uniform(0, 0.15)
        yaw = np.clip(rng.normal(0, 14), -35, 35)
        pitch = np.clip(rng.normal(-2, 10), -28, 24)
        fixation = np.array([[0.0, yaw, pitch, rng.uniform(350, 3000)]])
        gaze = directions(np.array([[yaw, pitch]]), fixation, 1)[0]
    elif rng.random() < 0.5:
        usual.blink(rig, min(rng.uniform(0.15, 1.25), 1))
    for side in "LR":
        lid, narrow = RIG_INDEX[f"eyeBlink_{side}"], RIG_INDEX[f"eyeSquint_{side}"]
        rig[lid] = droop + (1 - droop) * rig[lid]
        rig[narrow] = min(1, squint + rig[narrow])
    return rig, gaze


def _write(path: Path, rows: dict[str, list[Any]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    kinds = {"pictures": np.uint8, "wide": np.bool_, "subject": np.int32}
    arrays = {name: np.asarray(v, kinds.get(name, np.float32)) for name, v in rows.items()}
    with files.replacing(path) as unfinished:
        np.savez(unfinished, allow_pickle=False, **arrays)
