"""The figures of `livedrive eval emotion`: models and test sets, what is shown, how the lips do."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from app.eval_emotion import FINE_TUNED, RULES, SHIPPED

if TYPE_CHECKING:
    from app.eval_emotion import EvalEmotion
    from encoder.denoiser import Denoiser
    from encoder.driver import Driver
    from encoder.emotion_evaluation import Told
    from encoder.zero_conv import ZeroConvs

Figures = dict[str, float]
Floats = Any  # NDArray[np.float32]
EVERY = {"upper": 20, "lower": 40}  # vertices looked at
INTENSITIES = (0.0, 0.25, 0.5, 0.75, 1.0)
HOLD_FRAMES = 30  # of each emotion, where they are switched
SWITCHED = 12  # takes in which they are


class Model(NamedTuple):
    student: "Denoiser"
    zero: "ZeroConvs"


@dataclass(frozen=True)
class Seen:
    """Confusion tables [labels, labels] of face, upper and lower face."""

    tables: dict[str, Floats]


class Judged(NamedTuple):
    figures: Figures
    seen: Seen


class Judgement:
    """All models of one evaluation on the same takes."""

    def __init__(self, command: "EvalEmotion") -> None:
        import torch

        from app.capture_face import lips
        from app.face_mesh import face_mesh
        from encoder import inference
        from render.decoder import Decoder

        torch.set_num_threads(1)
        self.command, self.missing = command, list[str]()
        self.weights = command.weights or inference.WEIGHTS
        self.mesh, self.decoder = face_mesh(command.avatar), Decoder.load()
        self.lips = lips()
        self.encoder, _, _ = inference.load_models(self.weights)
        self.regions = self._regions()
        self.models: dict[str, Model] = {}
        shipped = self.weights / "student"
        for name, student, folder in (
            (SHIPPED, shipped, self.weights),
            (FINE_TUNED, command.data / "fine-tune" / "student", command.data / "fine-tune"),
            ("without L_lip", shipped, command.data / "no-lip"),
        ):
            if name == SHIPPED or (folder / "emotion.json").is_file():
                self.models[name] = load_model(student, folder / "emotion")
            else:
                self.missing.append(name)

    def _regions(self) -> dict[str, Callable[[Floats], Floats]]:
        """Codes [..., 256] -> vertices [..., V, 3] mm from rest, of the face and its halves."""
        sets = self.decoder.regions
        lower = np.setdiff1d(sets["narrow_face"], sets["upper_face"])
        members = {"upper": sets["upper_face"], "lower": lower}

        def moved(chosen: Floats) -> Callable[[Floats], Floats]:
            linear = self.decoder.moves(chosen)
            return lambda codes: (codes @ linear).reshape(*codes.shape[:-1], -1, 3)

        halves = {name: v[:: EVERY[name]] for name, v in members.items()}
        both = np.concatenate(list(halves.values()))
        return {"face": moved(both)} | {name: moved(v) for name, v in halves.items()}

    def sets(self) -> "dict[str, list[Told]]":
        from encoder import emotion_evaluation as told

        geometry, command = self.lips, self.command
        found = {
            "acted voice": told.acted(command.data, geometry, command.seed),
            "neutral voice": told.neutral(command.data, geometry, command.segments, command.seed),
            "real voice": told.tracked(command.data, geometry, command.segments, command.seed),
        }
        self.told = found
        return {name: takes for name, takes in found.items() if takes}

    def figures(self, takes: "list[Told]") -> dict[str, Judged]:
        """Row by row: each take in its own emotion, or, where the voice is neutral, in all ten."""
        from encoder import emotion_evaluation as told
        from encoder.capture.emotion import LABELS
        from encoder.training.emotion_streams import ACTED_STRENGTH, SWELL

        asked = [(t, k) for t in takes for k in range(len(LABELS)) if t.label in (-1, k)]
        labels, segments = [label for _, label in asked], [take.segment for take, _ in asked]
        audio, gaze = self._inputs(segments)
        strength = ACTED_STRENGTH if takes[0].label >= 0 else 1.0
        draws = range(self.command.samples)
        plain = self.models[SHIPPED].student
        calm = [told.codes(plain, None, audio, gaze, labels, 0.0, s) for s in draws]
        truths = self.decoder.encode(np.stack([take.rigs for take, _ in asked]))
        own = np.stack([rows[1 + label] for rows, label in zip(truths, labels, strict=True)])
        phones = [segment.phones for segment in segments]
        order: dict[int, int] = {}
        numbers = [order.setdefault(id(segment.clip), len(order)) for segment in segments]
        # the neutral model on the same truth, and on the one that it was trained to show
        base = {
            prefix: told.lip_figures(calm, truth, phones, self.mesh)
            for prefix, truth in (("neutral", own), ("neutral_own", truths[:, 0]))
        }

        def judged(said: list[Floats]) -> Judged:
            figures, kept = told.lip_figures(said, own, phones, self.mesh)
            for prefix, (others, closures) in base.items():
                figures |= {f"{prefix}_{name}": value for name, value in others.items()}
                figures |= told.closures_lost(kept, closures, numbers, prefix)
            tables = {
                name: np.mean([told.confusion(row, truths[:, 1:], labels, r) for row in said], 0)
                for name, r in self.regions.items()
            }
            for name, table in tables.items():
                present = table.sum(1) > 0
                figures[f"accuracy_{name}"] = float(np.diag(table)[present].mean())
            return Judged(figures, Seen(tables))

        result: dict[str, Judged] = {}
        for name, model in self.models.items():
            felt = [told.codes(*model, audio, gaze, labels, SWELL * strength, s) for s in draws]
            result[name] = judged(felt)
        laid = [told.laid_over(self.decoder.rig(x), labels, strength, self.lips) for x in calm]
        result[RULES] = judged([self.decoder.encode(x) for x in laid])
        return result

    def _inputs(self, segments: "Sequence[Any]") -> tuple[Any, Any]:
        from encoder import evaluation

        audio = evaluation.features(segments, evaluation.whole(self.encoder))
        return audio, evaluation.true_gaze(segments)

    def live_figures(self) -> Figures:
        """Intensity and switching on the live path (as it ships: with int8)."""
        from encoder import inference

        driver = inference.load_driver(self.weights, "cpu")
        takes = {id(t.segment.clip): t for t in self.told["neutral voice"]}  # each once
        longest = sorted(takes.values(), key=lambda t: -t.segment.clip.num_frames)
        sounds = [sound_of(take) for take in longest[:SWITCHED]]
        return (
            self._intensity_figures(driver, sounds[0][: 1600 * 150])
            | self._switching_figures(driver, sounds)
            | {"emotion_cpu_ms_a_tick": emotion_cost_ms(driver, sounds[0])}
        )

    def _intensity_figures(self, driver: "Driver", sound: Floats) -> Figures:
        assert driver.emotions is not None
        face, seed = self.regions["face"], self.command.seed
        calm = drive(driver, sound, "", seed)
        monotone, halves, zero = 0, list[float](), 0.0
        for label in driver.emotions.labels:
            rows = [drive(driver, sound, f"{label}:{i}", seed) for i in INTENSITIES]
            zero = max(zero, float(np.abs(rows[0] - calm).max()))
            way = np.stack([(face(row) - face(calm))[15:].mean(0) for row in rows])
            end = way[-1] / np.linalg.norm(way[-1])
            along = (way * end).sum((1, 2))  # mm, along the full emotion
            monotone += bool((np.diff(along) > 0).all())
            halves.append(float(along[2] / along[-1]))
        return {
            "intensity_0_difference": zero,
            "intensity_monotone_share": monotone / len(driver.emotions.labels),
            "intensity_half_least": min(halves),
            "intensity_half_most": max(halves),
        }

    def _switching_figures(self, driver: "Driver", sounds: list[Floats]) -> Figures:
        """Largest moves while one emotion fades into another, and of the same speech without a
        fade: neutral, and at the same frames in either emotion (excited lips open faster)."""
        from encoder.emotion import FADE_FRAMES
        from encoder.emotion_evaluation import largest_moves

        assert driver.emotions is not None
        rng, seed, face = np.random.default_rng(self.command.seed), 0, self.regions["face"]
        neutral, fades, steady = list[Floats](), list[Floats](), list[Floats]()
        for sound in sounds:
            frames = len(sound) // 1600
            names = rng.choice(driver.emotions.labels, frames // HOLD_FRAMES + 1).tolist()
            before, now = (
                np.repeat(words, HOLD_FRAMES)[1:frames] for words in (["", *names[:-1]], names)
            )

            def moves(words: "str | list[str]", sound: Floats = sound) -> Floats:
                return largest_moves(drive(driver, sound, words, seed), face)

            held = {name: moves(name) for name in {"", *names}}
            fading = np.arange(1, frames) % HOLD_FRAMES < FADE_FRAMES
            fades.append(moves([names[0], *now.tolist()])[fading])
            neutral.append(held[""][FADE_FRAMES:])
            steady += [held[name][fading & ((before == name) | (now == name))] for name in held]
        most, usual, steadily = (float(np.concatenate(x).max()) for x in (fades, neutral, steady))
        return {
            "switching_jump_mm": most,
            "normal_jump_mm": usual,
            "steady_jump_mm": steadily,
            "switching_jump_over_normal": most / usual,
            "switching_jump_over_steady": most / steadily,
        }


def load_model(student: Any, emotion: Any) -> Model:
    from encoder import checkpoint
    from encoder.emotion import zero_convs
    from encoder.training.diffusion import load_denoiser

    zero = zero_convs(*checkpoint.load(emotion, "emotion"), emotion)
    return Model(load_denoiser(student, "student")[0], zero.eval())


def sound_of(take: "Told") -> Floats:  # [T * 1600] at 48 kHz, 20 s at most
    import soxr

    sound = np.asarray(take.segment.clip.audio[: 800 * 600], np.float32) / 32768
    return soxr.resample(sound, 24_000, 48_000)[: len(sound) // 800 * 1600]


def drive(driver: "Driver", sound: Floats, words: "str | list[str]", seed: int) -> Floats:
    """Codes [T, 256] of sound [T * 1600] with these words at every frame, or at each."""
    from dataclasses import replace

    from app.eval_live import frames

    state, rows = driver.init_state(seed), list[Floats]()
    for frame in frames(sound):
        now = words if isinstance(words, str) else words[frame.index]
        driven, state = driver.step(replace(frame, emotion=now), state)
        rows.append(driven.expression)
    return np.array(rows)


def emotion_cost_ms(driver: "Driver", sound: Floats, rounds: int = 4) -> float:
    """CPU time that a fading mixture adds to a tick: the least of several rounds, in turn."""
    names = [f"{a}:0.5+{b}:0.5" for a, b in (("happy", "sad"), ("angry", "bored"))]
    mixed = [names[(k // 10) % 2] for k in range(len(sound) // 1600)]
    spent: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(rounds):
        for feels in (False, True):
            start = time.process_time()
            drive(driver, sound, mixed if feels else "", 0)
            spent[feels].append((time.process_time() - start) / len(mixed) * 1000)
    return max(min(spent[True]) - min(spent[False]), 0.0)
