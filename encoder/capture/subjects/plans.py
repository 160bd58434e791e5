"""What a data set consists of: a list of subjects, each with its own seed, and how each is made.

The command `livedrive capture DIR` hands the plans to processes; the set is the same for any
number of them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from encoder.capture.made import Take, language_takes, subject_takes
from encoder.capture.motion.contacts import LipGeometry
from encoder.capture.speech import voices
from encoder.capture.speech.languages import TEXTS
from encoder.capture.speech.training_texts import TRAINING_TEXTS
from encoder.capture.subjects import mocap, real
from sensors.types import InputError

LINES_A_SUBJECT = 120  # of one real voice; each subject of it moves in another style
TEST_SHARE = 28 / 265  # as the paper


@dataclass(frozen=True, kw_only=True)
class Config:
    """What to make. Folders: speech with transcripts.tsv, tracked motion (*/labels.npz), takes."""

    subjects: int = 265
    hours: float = 8.0  # of the rule-made subjects together
    languages: int = 16  # at most; 12 are tested, 16 learned from
    speech: Path | None = None
    mocap: Path | None = None
    takes: Path | None = None
    seed: int = 0


PRESETS: dict[str, Config] = {
    "debug": Config(subjects=4, hours=0.03, languages=1),
    "default": Config(),
    "full": Config(hours=30.0),
}


@dataclass(frozen=True)
class Plan:
    """One subject to make. A plan and the code say everything about its numbers."""

    name: str  # of its folder
    kind: str  # made, language, aligned, envelope, grid, facegood or own
    seed: tuple[int, ...]
    split: str = "train"
    seconds: float = 0.0  # of a made subject
    folder: str = ""  # of real recordings
    key: str = ""  # language or speaker
    lines: tuple[real.TranscriptLine, ...] = ()


def plans(config: Config) -> list[Plan]:
    """All subjects of a set; real ones where folders are given."""
    seconds = config.hours * 3600 / max(config.subjects, 1)
    num_test = round(config.subjects * TEST_SHARE) if config.subjects > 1 else 0
    result = [
        Plan(
            f"made_{k:04d}", "made", (config.seed, 0, k),
            "test" if k >= config.subjects - max(num_test, 1) else "train", seconds,
        )
        for k in range(config.subjects)
    ]  # fmt: skip
    for k, language in enumerate(list(TEXTS)[: config.languages]):
        result.append(
            Plan(f"language_{language}", "language", (config.seed, 1, k), "test", key=language)
        )
    for k, language in enumerate(list(TRAINING_TEXTS)[: config.languages]):
        result.append(
            Plan(f"training_{language}", "language", (config.seed, 5, k), "train", key=language)
        )
    if config.speech:
        result += _speech_plans(config.speech, config.seed)
    if config.mocap:
        result += _mocap_plans(config.mocap, config.seed)
    if config.takes:
        result.append(Plan("own", "own", (config.seed, 4), folder=str(config.takes)))
    return result


def _speech_plans(folder: Path, seed: int) -> list[Plan]:
    """Speakers with texts in parts of LINES_A_SUBJECT; corpora of many speakers in one each."""
    groups: dict[tuple[str, str], list[real.TranscriptLine]] = {}
    for line in real.read_transcripts(folder):
        kind = "aligned" if line.text else "envelope"
        groups.setdefault((kind, Path(line.file).parent.name), []).append(line)
    result = []
    for (kind, name), lines in sorted(groups.items()):
        for part in range(0, len(lines), LINES_A_SUBJECT):
            cut = tuple(lines[part : part + LINES_A_SUBJECT])
            number = part // LINES_A_SUBJECT
            result.append(
                Plan(
                    f"{kind}_{name}_{number:02d}", kind, (seed, 2, len(result), number),
                    folder=str(folder), key=name, lines=cut,
                )
            )  # fmt: skip
    return result


def _mocap_plans(folder: Path, seed: int) -> list[Plan]:
    result = []
    for part in sorted(path.parent for path in folder.glob("*/labels.npz")):
        for speaker in mocap.grid_speakers(part):
            name = f"grid_{part.name}_{speaker}"
            result.append(Plan(name, "grid", (seed, 3, len(result)), folder=str(part), key=speaker))
    if (folder / "facegood" / "names.txt").is_file():
        result.append(Plan("facegood", "facegood", (seed, 3, 99), folder=str(folder / "facegood")))
    if not result:
        raise InputError(
            f"mocap folder {folder}: expected */labels.npz or facegood/names.txt, found neither; "
            "check --mocap"
        )
    return result


def takes(plan: Plan, lips: LipGeometry | None) -> Iterator[Take]:
    """Make one subject."""
    folder = Path(plan.folder)
    if plan.kind == "made":
        yield from subject_takes(plan.seconds, plan.split, lips, plan.seed)
    elif plan.kind == "language":
        yield from language_takes(plan.key, plan.split, lips, plan.seed)
    elif plan.kind == "aligned":
        yield from real.aligned_takes(folder, list(plan.lines), lips, plan.seed)
    elif plan.kind == "envelope":
        yield from real.envelope_takes(folder, list(plan.lines), plan.seed)
    elif plan.kind == "grid":
        yield from mocap.grid_takes(folder, plan.key, lips, plan.seed)
    elif plan.kind == "facegood":
        yield from mocap.facegood_takes(folder, plan.seed)
    else:
        yield from real.own_takes(folder, plan.seed)


def sources(made: list[Plan]) -> dict[str, str]:
    """Name -> licence of everything that a set was made from."""
    kinds = {plan.kind for plan in made}
    found = {
        name: licence for name, licence in voices.LICENCES.items() if name in voices.all_bases()
    }
    for kind in ("grid", "facegood"):
        if kind in kinds:
            found[kind] = real.LICENCES[kind]
    for plan in made:
        if plan.kind in ("aligned", "envelope"):
            found[plan.key] = real.LICENCES.get(plan.key, "not stated: see the speech folder")
    if "own" in kinds:
        found["own takes"] = "the user's"
    return found
