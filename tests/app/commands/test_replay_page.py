"""`livedrive replay SESSION --web`: waits for somebody, goes on over and over, takes keys."""

import asyncio
import subprocess
import sys
from pathlib import Path

import aiohttp
import pytest

from app.commands.replay import KEYS, _steer

WORDS = [sys.executable, "-c", "from app.main import main; main()", "replay"]


class Told:
    """What a playback was told."""

    def __init__(self) -> None:
        self.told: list[object] = []

    def stop(self) -> None:
        self.told.append("stop")

    def pause(self) -> None:
        self.told.append("pause")

    def jump(self, seconds: float) -> None:
        self.told.append(seconds)


def test_lines_steer_the_playback(capsys: pytest.CaptureFixture[str]) -> None:
    playback = Told()
    _steer(playback, ["p\n", "j 12.5\n", "j\n", "j -1\n", "j 1e999\n", "\n", "x\n", "q\n"])  # type: ignore[arg-type]
    assert playback.told == ["pause", 12.5, "stop"]
    assert capsys.readouterr().out.count(KEYS) == 5


@pytest.mark.slow
def test_the_page_is_waited_for_and_gets_more_than_the_session_holds(second: Path) -> None:
    run = subprocess.Popen(
        [*WORDS, str(second), "--web", "0"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    assert run.stdin and run.stdout
    lines: list[str] = []
    while not lines or not lines[-1].startswith("page at "):
        lines.append(run.stdout.readline())
        assert lines[-1], lines

    async def watch() -> set[int]:
        frames = set[int]()
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(lines[-1].split()[-1] + "json") as names,
            session.ws_connect(lines[-1].split()[-1] + "head", max_msg_size=0),
        ):
            async for message in names:
                frames.add(message.json()["frame"])
                if len(frames) > 40:
                    break
        return frames

    frames = asyncio.run(asyncio.wait_for(watch(), 120))
    assert min(frames) <= 1 and len(frames) > 40  # the session holds 30
    run.stdin.write("q\n")
    run.stdin.flush()
    output, _ = run.communicate(timeout=60)
    assert run.returncode == 0, output
    assert " frames (" in output and KEYS in "".join(lines) + output
