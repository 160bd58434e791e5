"""`livedrive eval ab A B`: the paper's perceptual study as one HTML file.

A and B are folders of videos or pictures with the same names, or of weights: then everybody in
them is drawn, e.g. those of two versions. Each pair is shown once, in random order and with random
sides; the page keeps the votes in the browser and saves them as a JSON file, which
`eval ab --count votes.json ...` adds up.
"""

import base64
import hashlib
import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from sensors import files
from sensors.types import InputError

VIDEOS = {".mp4": "video/mp4", ".webm": "video/webm", ".png": "image/png", ".jpg": "image/jpeg"}
SIZE_PX = 1024


def make_page(a: Path, b: Path, out: Path, seed: int, size: int = SIZE_PX) -> None:
    """Write one HTML file that shows pairs of videos or pictures and asks which is better.

    Raises InputError where no names match, or both are one folder.
    """
    if a.resolve() == b.resolve():
        raise InputError(f"eval ab: expected two folders, got {a} twice; give another to compare")
    with TemporaryDirectory() as drawn:
        shown = [
            draw_people(folder, Path(drawn) / side, size)
            if (folder / "prior.safetensors").is_file()
            else folder
            for side, folder in (("a", a), ("b", b))
        ]
        pairs = find_pairs(shown[0], shown[1])
        flipped = np.random.default_rng(seed).random(len(pairs)) < 0.5
        order: list[int] = np.random.default_rng([seed, 1]).permutation(len(pairs)).tolist()
        trials = [_trial(pairs[i], bool(flipped[i])) for i in order]
    shown_pairs = json.dumps(trials)
    study = hashlib.sha256(shown_pairs.encode()).hexdigest()[:16]
    files.write_text(out, PAGE.replace("STUDY", study).replace("TRIALS", shown_pairs))
    pairs_made = "1 pair" if len(trials) == 1 else f"{len(trials)} pairs"
    print(f"wrote {out} with {pairs_made}; open it in a browser and save the votes")
    print("then: livedrive eval ab --count votes.json")


def draw_people(weights: Path, out: Path, size: int) -> Path:
    """Everybody in a folder of weights, calm from the side a little and smiling, as pictures in
    `out`, which is returned."""
    from PIL import Image

    from render.avatars import sheet
    from render.cameras import portrait
    from render.decoder import identity
    from render.decoder.decoder import Decoder
    from render.decoder.learned import avatar_files
    from render.splats.renderer import create_renderer

    out.mkdir()
    decoder, renderer = Decoder.load(weights, gaussians="65k"), create_renderer()
    for name in avatar_files.names(weights):
        who = identity.load(name, weights)
        for pose, yaw in (("neutral", 15.0), ("smile", 0.0)):
            renderer.draw(sheet.posed(decoder, who, pose), portrait(size, size, yaw_deg=yaw))
            picture = Image.fromarray(renderer.read_rgba()[..., :3])
            picture.save(out / f"{name}_{pose}.jpg", quality=95, subsampling=0)
    renderer.close()
    return out


def find_pairs(a: Path, b: Path) -> list[tuple[Path, Path]]:
    """Videos or pictures of the same name in both folders, sorted by name."""
    for folder in (a, b):
        if not folder.is_dir():
            raise InputError(f"eval ab: expected a folder {folder}, got none; check the path")
    names = [{p.name for p in folder.glob("*") if p.suffix.lower() in VIDEOS} for folder in (a, b)]
    both = sorted(names[0] & names[1])
    if not both:
        raise InputError(
            f"eval ab: expected files ({', '.join(VIDEOS)}) with the same names in {a} and {b}, "
            f"got {len(names[0])} and {len(names[1])} with no name in common; make them with "
            "livedrive replay --video, or give two folders of weights"
        )
    return [(a / name, b / name) for name in both]


def _trial(pair: tuple[Path, Path], flipped: bool) -> dict[str, str]:
    """One trial: file name, which of A and B is on each side, and both videos as data URLs."""
    shown = [("A", pair[0]), ("B", pair[1])]
    (left, left_path), (right, right_path) = reversed(shown) if flipped else shown
    return {
        "name": pair[0].name,
        "left": left,
        "right": right,
        "left_video": _inline(left_path),
        "right_video": _inline(right_path),
    }


def _inline(path: Path) -> str:
    return (
        f"data:{VIDEOS[path.suffix.lower()]};base64,{base64.b64encode(path.read_bytes()).decode()}"
    )


def tally(files: tuple[Path, ...]) -> list[str]:
    """Lines to print: votes for A and for B in all files, A's share with its 95 % interval, that of
    Wilson, which holds for few votes, too.

    Raises InputError where a file holds no votes.
    """
    votes: list[str] = []
    for path in files:
        try:
            chosen = [str(row["choice"]) for row in json.loads(path.read_text())["votes"]]
            if not chosen or not {*chosen} <= {"A", "B"}:
                raise KeyError("choice")
            votes += chosen
        except (ValueError, KeyError, TypeError) as error:
            got = "no JSON" if isinstance(error, ValueError) else "other JSON, or none"
            raise InputError(
                f"{path}: expected votes saved by the page, got {got}; save them again"
            ) from None
    first, second = votes.count("A"), votes.count("B")
    total, z2 = first + second, 1.96**2
    middle = (first + z2 / 2) / (total + z2)
    around = (z2 * (first * second / total + z2 / 4)) ** 0.5 / (total + z2)
    interval = f"{middle - around:.3f} to {middle + around:.3f}"
    return [f"A {first}  B {second}  A's share {first / total:.3f}, {interval} (95 %)"]


PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Which face is better?</title>
<style>
 body{font:16px system-ui;background:#16181c;color:#e8e8ea;margin:0;padding:2rem;text-align:center}
 video,img{width:44vw;max-width:1024px;border-radius:8px;background:#000}
 button{font:inherit;padding:.6rem 1.4rem;margin:.6rem;border:0;border-radius:6px}
 #count{color:#9a9aa4}
</style>
<h1 id="question"></h1>
<p id="count"></p>
<div><video id="left" controls></video> <video id="right" controls></video>
<img id="left_still" hidden alt=""> <img id="right_still" hidden alt=""></div>
<p><button id="play" onclick="play()">Play both in turn</button></p>
<p id="choices"><button onclick="vote('left')">Left</button>
<button onclick="vote('right')">Right</button></p>
<p><button id="back" onclick="undo()">Back</button>
<button onclick="save()">Save votes</button></p>
<script>
const trials = TRIALS, key = "livedrive-ab-STUDY";  // all files share one storage
const votes = JSON.parse(localStorage.getItem(key) || "[]");
const side = id => document.getElementById(id);
function show() {
  const t = trials[votes.length];
  side("count").textContent = t ? `${votes.length + 1} of ${trials.length}` : "Done. Thank you!";
  const still = t?.left_video.startsWith("data:image");
  for (const id of ["left", "right"]) {
    const source = t ? t[id + "_video"] : "";
    side(id).hidden = !t || still, side(id + "_still").hidden = !still;
    side(id).src = still ? "" : source, side(id + "_still").src = still ? source : "";
  }
  side("back").disabled = !votes.length;
  side("play").hidden = !t || still, side("choices").hidden = side("question").hidden = !t;
  side("question").textContent = "Which face looks more " +
    (still ? "like a living person?" : "natural and better in time with its voice?");
}
function play() {
  side("left").onended = () => side("right").play();
  side("right").pause();
  side("left").currentTime = side("right").currentTime = 0;
  side("left").play();
}
function vote(id) {
  const t = trials[votes.length];
  if (!t) return;
  votes.push({name: t.name, choice: t[id], side: id});
  keep();
}
function undo() {
  votes.pop();
  keep();
}
function keep() {
  localStorage.setItem(key, JSON.stringify(votes));
  show();
}
function save() {
  const a = document.createElement("a");
  a.href = URL.createObjectURL(new Blob([JSON.stringify({votes})], {type: "application/json"}));
  a.download = "votes.json";
  a.click();
}
show();
</script></html>
"""
