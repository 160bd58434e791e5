"""The trial of a room from outside: its scene in a network of its own, and what must hold of it."""

import json
import shutil
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from typing import Any

from app.terminal.thresholds import at_least, at_most
from sensors.types import InputError

REFUSED = {"wrong secret": "the secret of this room", "no token": "to be let in"}
BACK_BAR_S, TOGETHER, CONCEALED, KBPS, CPU_SHARE = 10.0, 0.99, 0.01, 160.0, 0.15


@dataclass(frozen=True, kw_only=True)
class RoomSettings:
    people: int
    seconds: float


def run_room(settings: RoomSettings) -> dict[str, Any]:
    """Run the scene; return its findings. InputError without Janus or network namespaces."""
    if shutil.which("janus") is None or shutil.which("unshare") is None:
        raise InputError(
            "call test --room: expected janus, unshare and ip (Linux), got only some of them; "
            "run: sudo apt-get install janus util-linux iproute2"
        )
    module = [sys.executable, "-m", "app.call.trial.room", json.dumps(asdict(settings))]
    command = ["unshare", "--net", "--map-root-user", *module]
    pipe = subprocess.PIPE
    with tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=errors, text=True)
        assert process.stdin and process.stdout
        try:
            said = process.stdout.read()
        finally:
            process.stdin.close()  # as when this process is killed: the scene ends
            status = process.wait()
        errors.seek(0)
        if status:
            raise OSError(f"call test --room: {errors.read()[-1500:]}")
    return json.loads(said.splitlines()[-1])


def metrics_of(found: dict[str, Any]) -> dict[str, Any]:
    """The report's `metrics` and `bars`, the worst of all pairs of people."""
    lines = [line for report in found["reports"] for line in report]
    worst = {
        "back_s": found["back_s"],
        "concealed": max(line["concealed_share"] for line in lines),
        "kbps": max(line["kbps"] for line in lines),
        "cpu_share": max(line["cpu_share"] for line in lines),
        "refused": max(line["refused"] for line in lines),
    }
    limits = {
        "back_s": BACK_BAR_S,
        "concealed": CONCEALED,
        "kbps": KBPS,
        "cpu_share": CPU_SHARE,
        "refused": 0,
    }
    bars = [at_most(f"room: {name}", worst[name], limit) for name, limit in limits.items()]
    bars.append(at_least("room: together", found["together"], TOGETHER))
    shut_out = sum(text in found["refused"].get(name, "") for name, text in REFUSED.items())
    bars.append(at_least("room: strangers_shut_out", shut_out, len(REFUSED)))
    figures = worst | {"met_s": found["met_s"], "together": found["together"]}
    figures["loss_of_the_lossy_leg"] = max(line["loss"] for line in found["reports"][1])
    return {"metrics": {f"room: {n}": round(v, 4) for n, v in figures.items()}, "bars": bars}
