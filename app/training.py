"""The encoder's training stages. Every ablation of the paper is one row of VARIANTS."""

import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sensors.types import InputError

if TYPE_CHECKING:
    from app.train import Train
    from encoder.training.loop import Run

# variant: settings of each stage that it changes
VARIANTS: dict[str, dict[str, dict[str, Any]]] = {
    "none": {},
    "centred": {"audio": {"centred": True}, "diffusion": {}, "distill": {}, "regression": {}},
    "offline": {"diffusion": {}},
    "no-velocity": {"diffusion": {"velocity_weight": 0.0}, "distill": {"velocity_weight": 0.0}},
    "no-jitter": {"diffusion": {"jitter_weight": 0.0}, "distill": {"jitter_weight": 0.0}},
    "plain-jitter": {
        "diffusion": {"jitter_normalised": False},
        "distill": {"jitter_normalised": False},
    },
    "lookahead": {"regression": {"lookahead": 5}, "contact": {}},  # 167 ms
    "no-dmd": {"distill": {"dmd_weight": 0.0}},
    "fine-tune": {"emotion": {"fine_tune": True, "rate": 5e-4}},
    "no-lip": {"emotion": {"lip_weight": 0.0}},
}


def run_stage(command: "Train") -> None:
    """Run one stage. The teacher, states and streams live in `data`, a variant in its folder."""
    import torch

    from encoder.training.loop import Run
    from encoder.training.parallel import local_device

    settings = _settings(command)
    torch.set_num_threads(1)
    folder = command.data if command.variant == "none" else command.data / command.variant
    run = Run(
        state=folder / f"{command.stage}_state",
        seed=command.seed,
        resume=command.resume,
        device=local_device(command.device),
        precision=command.precision,
        compile=command.compile,
        note=(("command", _words(command)), ("commit", _commit())),
    )
    if command.stage == "audio":
        from encoder.training import audio

        output, heads = _audio(command, folder)
        config = audio.preset(
            command.preset, pack=command.data, output=output, heads=heads, run=run, **settings
        )
        audio.run(config)
    elif command.stage in ("gaze", "eyes", "multimodal"):
        from app.eye_training import run_eye_stage

        run_eye_stage(command, run)
    elif command.stage == "emotion":
        from app.emotion_training import run_emotion_stage

        run_emotion_stage(command, run, settings)
    else:
        _run_motion(command, folder, run, settings)


def _run_motion(command: "Train", folder: Path, run: "Run", settings: dict[str, Any]) -> None:
    from app.training_face import face
    from encoder.training import contact, diffusion, distill

    streams = _streams(command, folder)
    if command.stage == "contact":
        weights, name = _weights(command), "student"
        if command.variant != "none":  # on the regression that this variant trained
            weights, name = folder, "regression"
        config = contact.preset(
            command.preset, streams=streams, student=(command.start or weights) / name,
            output=weights / name, run=run, **settings,
        )  # fmt: skip
        contact.run(config, face())
        return
    if command.stage == "distill":
        teacher = folder if command.variant != "no-dmd" else command.data
        student = _weights(command) if command.variant == "none" else folder
        config = distill.preset(
            command.preset, streams=streams, teacher=teacher / "teacher",
            output=student / "student", run=run, **settings,
        )  # fmt: skip
        distill.run(config, face())
        return
    output = folder / "teacher"
    if command.stage == "regression":
        output = folder / "regression"
        settings["objective"] = "regression"
    if command.variant == "offline":
        from dataclasses import replace

        sizes = diffusion.PRESETS[command.preset].get("denoiser", diffusion.DENOISERS["default"])
        settings["denoiser"] = replace(sizes, causal=False)
    config = diffusion.preset(command.preset, streams=streams, output=output, run=run, **settings)
    diffusion.run(config, face())


def _settings(command: "Train") -> dict[str, Any]:
    """What the variant and the options change of the stage's preset."""
    stages = VARIANTS[command.variant]
    if command.variant != "none" and command.stage not in stages:
        raise InputError(
            f"--variant {command.variant}: expected one of the stages {', '.join(stages)}, got "
            f"{command.stage}; other stages do not differ, train them without --variant"
        )
    settings = dict(stages.get(command.stage, {}))
    if command.steps is not None:
        settings["steps"] = command.steps
    if command.start is not None and command.stage not in ("emotion", "contact"):
        names = {"audio": "audio", "diffusion": "teacher", "distill": "student"}
        settings["start"] = command.start / names.get(command.stage, "regression")
    return settings


def _weights(command: "Train") -> Path:
    from encoder.inference import WEIGHTS

    return command.out or WEIGHTS


def _audio(command: "Train", folder: Path) -> tuple[Path, Path]:
    """Checkpoints of the audio encoder and of its heads."""
    if command.variant == "centred":
        return folder / "audio", folder / "audio_heads"
    return _weights(command) / "audio", command.data / "audio_heads"


def _streams(command: "Train", folder: Path) -> Path:
    """Features of the frozen audio encoder; made once for each audio checkpoint."""
    from encoder.training import parallel, streams

    audio, heads = _audio(command, folder)
    config = streams.StreamConfig(
        pack=command.data,
        audio=audio,
        heads=heads,
        output=(folder if command.variant == "centred" else command.data) / "streams.npz",
        minutes=command.stream_minutes or streams.StreamConfig.minutes,
        seed=command.seed,
    )
    ranks = parallel.join(command.device)
    if ranks.leads and not streams.are_made(config):
        streams.run(config)
    parallel.wait(ranks)
    return config.output


def _words(command: "Train") -> str:
    variant = f" --variant {command.variant}" if command.variant != "none" else ""
    return f"livedrive train {command.stage} --preset {command.preset}{variant}"


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
