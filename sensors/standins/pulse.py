"""A PulseAudio server of our own with a loopback microphone, which can be unplugged and killed.

Flow: `play` -> null sink "speaker" -> source "mic" -> PortAudio -> Microphone.
"""

import os
import subprocess
import time
from pathlib import Path

import numpy as np
import psutil
from numpy.typing import NDArray

from sensors.types import SAMPLE_RATE

START_S = 20.0


class PulseServer:
    """Keeps its socket and state in `folder`; nothing of the user's own sound is touched."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._process: subprocess.Popen[bytes] | None = None
        self._clients: list[subprocess.Popen[bytes]] = []
        folder.mkdir(parents=True, exist_ok=True)
        folder.chmod(0o700)

    @property
    def environment(self) -> dict[str, str]:
        """What clients need to find this server and no other."""
        return {
            "PULSE_SERVER": f"unix:{self._folder}/native",
            "PULSE_RUNTIME_PATH": str(self._folder),
            "PULSE_STATE_PATH": str(self._folder),
            "PULSE_COOKIE": str(self._folder / "cookie"),
        }

    def start(self) -> None:
        """Start the server with its microphone plugged in."""
        socket = f"module-native-protocol-unix auth-anonymous=1 socket={self._folder}/native"
        words = ["pulseaudio", "-n", "--daemonize=no", "--exit-idle-time=-1", "--disable-shm=yes"]
        words += ["--use-pid-file=no", "--realtime=no", "--high-priority=no", "-L", socket]
        (self._folder / "native").unlink(missing_ok=True)
        self._process = subprocess.Popen(
            words, env=os.environ | self.environment, stderr=subprocess.DEVNULL
        )
        deadline = time.monotonic() + START_S
        while self._pactl("info").returncode:
            if self._process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError("pulseaudio does not start; is the package installed?")
            time.sleep(0.05)
        self.plug()

    def plug(self) -> None:
        null_sink = "sink_name=speaker rate=48000 format=s16le channels=1 channel_map=mono"
        null_sink += " norewinds=yes"  # else it sleeps for two seconds first, unlike hardware
        source = "source_name=mic master=speaker.monitor channels=1 channel_map=mono remix=no"
        self._check("load-module", "module-null-sink", *null_sink.split())
        self._check("load-module", "module-remap-source", *source.split())
        # An idle null sink wakes every two seconds; this silence keeps it at 10 ms, like hardware.
        words = "pacat --playback --raw --channels=1 --device=speaker --latency-msec=10"
        self._spawn(f"exec {words} --rate={SAMPLE_RATE} </dev/zero 2>/dev/null")

    def unplug(self) -> None:
        self._check("unload-module", "module-remap-source")
        self._check("unload-module", "module-null-sink")

    def stall(self) -> None:
        assert self._process is not None
        psutil.Process(self._process.pid).suspend()

    def go_on(self) -> None:
        assert self._process is not None
        psutil.Process(self._process.pid).resume()

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        self._process = None

    def play(
        self,
        samples: NDArray[np.int16],  # [n] 48 kHz mono
        repeat: int = 1,
    ) -> subprocess.Popen[bytes]:
        """Play into the microphone; returns at once."""
        raw = self._folder / "play.raw"
        raw.write_bytes(samples.astype("<i2").tobytes())
        words = f"pacat --playback --raw --format=s16le --rate={SAMPLE_RATE} --channels=1"
        words += " --channel-map=mono --latency-msec=200 --device=speaker"
        feed = f"for k in $(seq {repeat}); do cat '{raw}'; done | exec {words}"
        return self._spawn(feed)

    def close(self) -> None:
        for client in self._clients:
            if client.poll() is None:
                for process in psutil.Process(client.pid).children(recursive=True):
                    process.kill()
                client.kill()
            client.wait()
        self._clients.clear()
        if self._process is not None:
            self.go_on()
        self.kill()

    def _spawn(self, command: str) -> subprocess.Popen[bytes]:
        environment = os.environ | self.environment
        client = subprocess.Popen(["sh", "-c", command], env=environment, start_new_session=True)
        self._clients = [c for c in self._clients if c.poll() is None] + [client]
        return client

    def _check(self, *words: str) -> None:
        done = self._pactl(*words)
        if done.returncode:
            raise RuntimeError(f"pactl {' '.join(words)}: {done.stderr.decode().strip()}")

    def _pactl(self, *words: str) -> "subprocess.CompletedProcess[bytes]":
        return subprocess.run(
            ["pactl", *words], env=os.environ | self.environment, capture_output=True, timeout=20
        )
