"""Stage 3: distil the teacher into a student that denoises in ONE step (paper section 4.2).

L_distill pulls the student's single prediction to the teacher's iterated one (guidance included);
L_DMD pushes its samples towards where the teacher finds them likelier than the student does; L_geom
keeps the motion of the truth, and the mouth is trained on the truth itself. tau is drawn from pi, a
mixture of K Gaussians whose weights beta move in four updates from four steps to tau = N (appendix,
after Chadebec et al. 2024).
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from encoder.denoiser.diffusion import Guidance, Schedule, conditioned_on, ddim_taus, sample_ddim
from encoder.denoiser.model import Denoiser, headless
from encoder.nn import checkpoint
from encoder.training import loop, parallel
from encoder.training.checkpoints import check_hears, load_denoiser
from encoder.training.distribution import dmd_loss, mouth_error
from encoder.training.geometry import TrainingFace
from encoder.training.presets import Presets
from encoder.training.stages.diffusion import TRUTH, fold_gaze, geometry_losses
from encoder.training.streams.streams import Streams
from encoder.training.streams.whitening import Whitening
from encoder.training.timesteps import LAST_PHASE, draw_tau


@dataclass(frozen=True, kw_only=True)
class DistillConfig:
    streams: Path
    teacher: Path  # diffusion checkpoint, without suffix
    output: Path
    run: loop.RunSettings
    start: Path | None = None  # an earlier student to go on from, instead of the teacher
    without: tuple[str, ...] = ()  # talkers whose tracked motion is left out
    steps: int = 560
    batch: int = 16
    frames: int = 100
    rate: float = 4e-4
    # K = 40 of the paper costs 40 teacher passes a sample; 6 fit the default into CPU hours
    ddim_steps: int = 6
    pool: int = 8  # batches of teacher samples held at a time
    reuse: int = 5  # times each sample is used before new ones are drawn
    update_share: float = 0.08  # of the steps between updates of beta (2K of 25K in the paper)
    # measured: 1.5 moves the lips more and with better timing than 1.0 (closures as often)
    guidance: Guidance = Guidance(weight=1.5)
    dmd_weight: float = 0.05
    # the student is its own fake score; once all draws are at tau = N it forgets the smaller ones
    dmd_to_end: bool = False
    velocity_weight: float = 0.1
    jitter_weight: float = 0.02
    jitter_normalised: bool = True
    spread_weight: float = 0.4  # the lips move as far as the truth's, and rest as still
    contact_weight: float = 4.0  # and touch where the truth's touch
    truth_weight: float = 4.0  # of the mouth: rest and closures stay the truth's
    sync_weight: float = 0.0  # per mm of lip sync: |error| of the lips' width and of their opening
    # False: the teacher's answer pulls all but the mouth, which is the truth's alone. So a student
    # that hears by new features keeps the lids and brows of one that hears by old ones
    teacher_mouth: bool = True
    # the paper's is of the whole face; asked of lids, it pulls blinks to their mean: few are left
    geometry_of: Literal["mouth", "face"] = "mouth"


preset = Presets(
    DistillConfig,
    {
        "debug": {"steps": 2, "batch": 2, "frames": 12, "ddim_steps": 4, "pool": 2},
        "default": {},
        "paper": {
            "steps": 25_000,
            "rate": 1e-5,
            "ddim_steps": 40,
            "pool": 100,
            "reuse": 1,
            "guidance": Guidance(weight=1.0),
            "dmd_weight": 1.0,
            "dmd_to_end": True,
            "truth_weight": 0.0,
            "spread_weight": 0.0,
            "velocity_weight": 1.0,
            "contact_weight": 0.0,
            "geometry_of": "face",
        },
    },
)


def phase_at(step: int, config: DistillConfig) -> int:
    """Number of updates of beta before this step."""
    return min(int(step / max(config.update_share * config.steps, 1)), LAST_PHASE)


def iterate(
    teacher: Denoiser,
    x: Tensor,  # [B, T, 256] at `tau`
    tau: int,
    audio: Tensor,
    gaze: Tensor,
    schedule: Schedule,
    config: DistillConfig,
) -> Tensor:
    """E_orig^iter: DDIM from `tau` down, guided -> x0 [B, T, 256]."""
    taus = [tau, *(t for t in ddim_taus(schedule.num_steps, config.ddim_steps) if t < tau)]
    model = conditioned_on(teacher, audio, gaze)
    return sample_ddim(model, x, taus, schedule=schedule, guidance=config.guidance)


Sample = tuple[Tensor, int, Tensor, Tensor, Tensor, Tensor, Tensor]


class Pools:
    """Teacher samples for each step; a pool is made at its first step, or on resuming."""

    def __init__(
        self,
        teacher: Denoiser,
        streams: Streams,
        whitening: Whitening,
        schedule: Schedule,
        config: DistillConfig,
    ) -> None:
        self.teacher, self.streams, self.whitening = teacher, streams, whitening
        self.schedule = schedule
        self.config, self.ranks = config, parallel.join(config.run.device)
        self.key: tuple[int, int] | None = None
        self.samples: list[Sample] = []

    def at(self, step: int, rng: np.random.Generator) -> Sample:
        key = (phase_at(step, self.config), step // (self.config.pool * self.config.reuse))
        if key != self.key:
            self.key, self.samples = key, list(self._make(*key))
        return self.samples[rng.integers(len(self.samples))]

    def _make(self, phase: int, turn: int) -> Iterator[Sample]:
        """Batches (x_tau, tau, codes, white audio, gaze, weight, teacher's x0)."""
        config, schedule = self.config, self.schedule
        indices = tqdm(
            range(config.pool), desc=f"teacher, beta {phase}", mininterval=2, leave=False,
            disable=not self.ranks.leads,
        )  # fmt: skip
        for index in indices:
            seeds = [config.run.seed, phase, turn, index, self.ranks.rank]
            rng = np.random.default_rng(seeds)
            drawn = self.streams.draw(config.batch, config.frames, rng)
            codes, audio, gaze, weight = (tensor.to(config.run.device) for tensor in drawn)
            audio = self.whitening(audio)
            tau = draw_tau(phase, schedule.num_steps, rng)
            noise = torch.tensor(rng.standard_normal(codes.shape, dtype=np.float32)).to(codes)
            batch_tau = torch.full((len(codes),), tau, device=codes.device)
            x = schedule.q_sample(self.teacher.standardise(codes), batch_tau, noise)
            if tau == schedule.num_steps:
                x = noise  # what the live path starts from
            target = iterate(self.teacher, x, tau, audio, gaze, schedule, config)
            yield x, tau, codes, audio, gaze, weight, target


def losses(
    student: Denoiser,
    teacher: Denoiser,
    sample: Sample,
    schedule: Schedule,
    face: TrainingFace,
    config: DistillConfig,
) -> dict[str, Tensor]:
    x, tau, codes, audio, gaze, weight, target = sample
    z = student(x, torch.full((len(x),), tau, device=x.device), audio, gaze)
    if not config.teacher_mouth:
        shift = face.mouth(codes - student.unstandardise(target)) / student.expression_std
        target = target + shift
    result = {"distill": (z - target).square().mean()}
    total = result["distill"]
    if config.truth_weight:
        result["truth"] = mouth_error(student, z, codes, weight, face)
        total = total + config.truth_weight * result["truth"]
    shown, wanted = student.unstandardise(z), codes
    if config.geometry_of == "mouth":
        shown, wanted = face.mouth(shown), face.mouth(wanted)
    parts, geometry = geometry_losses(shown, wanted, face, config)
    total = total + geometry
    if config.sync_weight:
        result["sync"] = (face.spans(shown) - face.spans(wanted)).abs().sum(-1).mean()
        total = total + config.sync_weight * result["sync"]
    if config.dmd_weight:
        result["dmd"] = dmd_loss(student, teacher, z, audio, gaze, schedule)
        total = total + config.dmd_weight * result["dmd"]
    return {**result, **parts, "total": total}


def run(config: DistillConfig, face: TrainingFace) -> dict[str, float]:
    """Distil and write the student with its card; returns the smoothed losses."""
    ranks = parallel.join(config.run.device)
    streams = Streams.load(config.streams, face, config.without)
    teacher, card = load_denoiser(config.teacher, "diffusion", "student")
    first = config.start or config.teacher  # the paper's student starts as the teacher
    begun, begun_card = load_denoiser(first, "diffusion", "student")
    check_hears(config.teacher, card, streams.about)
    check_hears(first, begun_card, streams.about)
    student = headless(begun)
    whitening = Whitening.of(streams.features[streams.allowed])
    for model in (teacher, student):
        whitening.fold(fold_gaze(model, inverse=True), inverse=True).to(config.run.device)
    whitening = whitening.to(config.run.device)
    teacher.requires_grad_(False)
    schedule = Schedule(teacher.config.num_steps)
    pools = Pools(teacher, streams, whitening, schedule, config)
    forward = torch.compile(losses) if config.run.compile else losses
    without_dmd = config if config.dmd_to_end else replace(config, dmd_weight=0.0)

    def step_losses(step: int, rng: np.random.Generator) -> dict[str, Tensor]:
        now = config if phase_at(step, config) < LAST_PHASE else without_dmd
        return forward(student, teacher, pools.at(step, rng), schedule, face, now)

    metrics, curve = loop.train(
        "distill", {"student": student}, step_losses, steps=config.steps, rate=config.rate,
        run=config.run,
    )  # fmt: skip
    if ranks.leads:
        facts = {
            "kind": "student",
            "config": asdict(student.config),
            "data": streams.about["sources"],
            "audio_sha256": streams.about["audio_sha256"],
            "truth": TRUTH,
            "teacher": {key: card.get(key) for key in ("steps", "seed", "metrics", "sha256")},
            "guidance": asdict(config.guidance),
            "ddim_steps": config.ddim_steps,
            "without": config.without,
            "steps": config.steps,
            **config.run.card(metrics, curve),
        }
        fold_gaze(whitening.fold(student))
        checkpoint.save(config.output, checkpoint.quantised(student.state_dict()), facts)
    parallel.wait(ranks)
    return metrics
