"""The training stages. Every ablation of the paper is one row of VARIANTS."""

import subprocess
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.terminal import confirm
from app.train import options
from app.train.settings import TrainSettings
from sensors import files
from sensors.types import InputError

if TYPE_CHECKING:
    from encoder.training.loop import RunSettings

# variant: overrides of each stage that it changes
VARIANTS: dict[str, dict[str, dict[str, Any]]] = {
    "none": {},
    # nothing left out, kept under --data beside the ablations
    "plain": {"distill": {}, "emotion": {}},
    "centred": {"audio": {"centred": True}, "diffusion": {}, "distill": {}, "regression": {}},
    "causal": {"audio": {}, "diffusion": {}, "distill": {}},  # `centred` is compared with it
    "offline": {"diffusion": {}},
    "no-velocity": {"diffusion": {"velocity_weight": 0.0}, "distill": {"velocity_weight": 0.0}},
    "no-jitter": {"diffusion": {"jitter_weight": 0.0}, "distill": {"jitter_weight": 0.0}},
    "plain-jitter": {
        "diffusion": {"jitter_normalised": False},
        "distill": {"jitter_normalised": False},
    },
    "lookahead": {"regression": {"lookahead": 5}, "contact": {}},  # 167 ms
    "no-dmd": {"distill": {"dmd_weight": 0.0}},
    "fine-tune": {
        "emotion": {"fine_tune": True, "rate": 5e-4, "lip_weight": 0.0, "calm_weight": 0.0}
    },
    "fine-tune-lip": {"emotion": {"fine_tune": True, "rate": 5e-4, "calm_weight": 0.0}},
    "no-lip": {"emotion": {"lip_weight": 0.0}},
}
OWN_AUDIO = ("centred", "causal")  # these hear by an audio encoder of their own
EXTENDING = ("emotion", "contact", "listen", "voice-activity")  # --start is what they extend


def run_stage(settings: TrainSettings) -> None:
    """Run one stage. The teacher, states and streams live in `data`, a variant in its folder."""
    overrides = _overrides(settings)
    options.check(settings)
    if settings.out:  # not after hours of training
        files.check_folder(settings.out, "--out", "choose another")
    if settings.stage == "landmarks":
        from app.train.landmarks import make

        make(settings.face, settings.out)
        return
    if settings.stage == "prior":
        _run_prior(settings)
        return
    import torch

    from encoder.training.loop import RunSettings, steps_done
    from encoder.training.parallel import local_device

    torch.set_num_threads(1)
    folder = settings.folder
    run = RunSettings(
        state=folder / f"{settings.name or settings.stage}_state",
        seed=settings.seed,
        resume=settings.resume,
        device=local_device(settings.device),
        precision=settings.precision,
        compile=settings.compile,
        note=(("command", _words(settings)), ("commit", _commit())),
    )
    if settings.resume:
        steps_done(run)  # refused before streams are made over those of another run
    else:
        confirm.overwriting([run.file], "add --resume to go on with it")
    if settings.stage == "audio":
        from encoder.training.stages import audio

        config = audio.preset(
            settings.preset, pack=settings.data, output=_audio(settings, folder), run=run,
            teacher=settings.teacher, **overrides,
        )  # fmt: skip
        audio.run(config)
    elif settings.stage in ("gaze", "eyes", "wide-eyes", "multimodal"):
        from app.train.eyes import run_eye_stage

        run_eye_stage(settings, run)
    elif settings.stage == "emotion":
        from app.train.emotion import run_emotion_stage

        run_emotion_stage(settings, run, overrides)
    elif settings.stage in ("listen", "voice-activity"):
        from app.train.listen import run_listen_stage

        run_listen_stage(settings, folder, run, overrides)
    else:
        _run_motion(settings, folder, run, overrides)


def _run_prior(settings: TrainSettings) -> None:
    from render.decoder.learned import weights_file
    from render.training import prior

    # what is kept between runs follows from all of these
    name = f"prior_{settings.preset}_{settings.seed}"
    if settings.take:
        name += f"_{sha256(files.read_bytes(settings.take)).hexdigest()[:8]}"
    prior.run(
        settings.face, settings.out or weights_file.FOLDER, settings.preset, settings.data / name,
        settings.take, settings.seed, settings.device,
    )  # fmt: skip


def _run_motion(
    settings: TrainSettings, folder: Path, run: "RunSettings", overrides: dict[str, Any]
) -> None:
    from app.face.losses import face
    from encoder.training.stages import contact, diffusion, distill

    if settings.stage == "peers":
        _run_peer(settings, run, overrides)
        return
    streams = _streams(settings, folder)
    if settings.stage == "contact":
        weights, name = _weights(settings), "student"
        if settings.leave_out:
            weights = folder
        elif settings.variant != "none":  # on the regression that this variant trained
            weights, name = folder, "regression"
        config = contact.preset(
            settings.preset, streams=streams, student=(settings.start or weights) / name,
            output=weights / name, run=run, **overrides,
        )  # fmt: skip
        contact.run(config, face())
        return
    if settings.stage == "distill":
        teacher = settings.data if settings.variant in ("plain", "no-dmd") else folder
        shipped = settings.variant == "none" and not settings.leave_out
        student = _weights(settings) if shipped else folder
        config = distill.preset(
            settings.preset, streams=streams, teacher=teacher / "teacher",
            output=student / "student", run=run, **overrides,
        )  # fmt: skip
        distill.run(config, face())
        return
    output = folder / "teacher"
    if settings.stage == "regression":
        output = folder / "regression"
        overrides["objective"] = "regression"
    if settings.variant == "offline":
        from dataclasses import replace

        named = diffusion.preset.named[settings.preset]
        sizes = named.get("denoiser", diffusion.DENOISERS["default"])
        overrides["denoiser"] = replace(sizes, causal=False)
    config = diffusion.preset(settings.preset, streams=streams, output=output, run=run, **overrides)
    diffusion.run(config, face())


def _run_peer(settings: TrainSettings, run: "RunSettings", overrides: dict[str, Any]) -> None:
    from app.face.losses import face
    from encoder.training.stages import peers

    assert settings.name is not None
    sizes = peers.sized(settings.name, settings.preset)
    config = peers.preset(
        settings.preset, streams=_streams(settings, settings.data), peer=sizes, run=run,
        output=settings.data / "peers" / settings.name, **overrides,
    )  # fmt: skip
    peers.run(config, face())


def _overrides(settings: TrainSettings) -> dict[str, Any]:
    """What the variant and the options change of the stage's preset."""
    stages = VARIANTS[settings.variant]
    if settings.variant != "none" and settings.stage not in stages:
        raise InputError(
            f"--variant {settings.variant}: expected one of the stages {', '.join(stages)}, got "
            f"{settings.stage}; other stages do not differ, train them without --variant"
        )
    overrides = dict(stages.get(settings.stage, {}))
    if settings.steps is not None:
        overrides["steps"] = settings.steps
    if settings.leave_out:
        overrides["without"] = settings.leave_out
    if settings.start is not None and settings.stage not in EXTENDING:
        names = {"audio": "audio", "diffusion": "teacher", "distill": "student"}
        overrides["start"] = settings.start / names.get(settings.stage, "regression")
    return overrides


def _weights(settings: TrainSettings) -> Path:
    from encoder.inference import WEIGHTS

    return settings.out or WEIGHTS


def _audio(settings: TrainSettings, folder: Path) -> Path:
    """Checkpoint of the audio encoder."""
    return (folder if settings.variant in OWN_AUDIO else _weights(settings)) / "audio"


def _streams(settings: TrainSettings, folder: Path) -> Path:
    """Features of the frozen audio encoder; made once for each audio checkpoint."""
    from encoder.training import parallel
    from encoder.training.streams import streams

    config = streams.StreamConfig(
        pack=settings.data,
        audio=_audio(settings, folder),
        output=(folder if settings.variant in OWN_AUDIO else settings.data) / "streams.npz",
        minutes=settings.minutes(streams.StreamConfig.minutes),
        seed=settings.seed,
    )
    ranks = parallel.join(settings.device)
    if ranks.leads and not streams.are_made(config, resumed=settings.resume):
        streams.run(config)
    parallel.wait(ranks)
    return config.output


def _words(settings: TrainSettings) -> str:
    words = f"livedrive train {settings.stage} --preset {settings.preset}"
    usual = TrainSettings(stage=settings.stage)
    for option in ("name", "variant", "steps", "stream_minutes", "precision", "seed"):
        if getattr(settings, option) != getattr(usual, option):
            words += f" --{option.replace('_', '-')} {getattr(settings, option)}"
    return words


def _commit() -> str:
    """The commit of the code that trains, for the card; "unknown" outside a checkout."""
    try:
        done = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return done.stdout.strip()
