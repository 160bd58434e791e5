"""What to type after a stage of training."""

from shlex import join, quote

from app.train.settings import Stage, TrainSettings

TRAIN: dict[Stage, Stage] = {
    "audio": "diffusion", "diffusion": "distill", "distill": "contact", "contact": "gaze",
    "gaze": "eyes", "eyes": "multimodal", "multimodal": "emotion", "emotion": "listen",
    "listen": "voice-activity",
}  # fmt: skip
EVALUATE: dict[Stage, str] = {
    "regression": "eval speech DATA", "voice-activity": "eval rest", "wide-eyes": "eval eyes",
    "peers": "eval speech DATA --peers DATA/peers",
}  # fmt: skip
STARTING = ("emotion", "listen", "voice-activity")  # these extend the shipped chain unless told
WEIGHED = ("voice-activity", "wide-eyes")  # what judges these takes a folder of weights


def next_command(settings: TrainSettings) -> str:
    """The command that goes on with what this one made."""
    stage, data = settings.stage, quote(str(settings.data))
    if settings.leave_out:
        return f"livedrive eval speech {data} --leave-one-out --mocap DIR"
    if settings.variant != "none":
        words = "eval emotion DATA" if stage == "emotion" else "eval speech DATA --ablations"
        return f"livedrive {words.replace('DATA', data)}"
    if stage in TRAIN:
        words = ["train", TRAIN[stage], "--data", str(settings.data)]
        words += ["--preset", settings.preset] if settings.preset != "default" else []
        if settings.out and TRAIN[stage] in STARTING:
            words += ["--start", str(settings.out)]
        if TRAIN[stage] == "listen":
            words += ["--out", "FOLDER"]
        elif settings.out:
            words += ["--out", str(settings.out)]
        return f"livedrive {join(words)}"
    if stage == "prior":
        words = ["eval", "prior", "--face", str(settings.face)]
        words += ["--take", str(settings.take)] if settings.take else []
        words += ["--weights", str(settings.out)] if settings.out else []
        return f"livedrive {join(words)}"
    words = EVALUATE[stage].replace("DATA", data)
    own = stage in WEIGHED and settings.out
    return f"livedrive {words}" + (f" --weights {quote(str(settings.out))}" if own else "")
