"""What a user sets of what is sent: gains of channels, and one line where they are wrong."""

import json
from pathlib import Path

import numpy as np
import pytest

from app.drive.sink import FrameResult
from app.face.arkit import ARKIT_NAMES
from app.sinks.protocols.face import FaceReader
from render.decoder.decoder import Decoder
from sensors.types import InputError


def test_gains_stretch_and_clamp_a_channel(
    tmp_path: Path, decoder: Decoder, results: list[FrameResult]
) -> None:
    gains = tmp_path / "gains.json"
    gains.write_text(json.dumps({"jawOpen": {"gain": 2, "high": 0.5}, "mouthPucker": {"low": 0.2}}))
    jaw, pucker = ARKIT_NAMES.index("jawOpen"), ARKIT_NAMES.index("mouthPucker")
    for result in results:
        plain = FaceReader(decoder)(result.driven).arkit
        shaped = FaceReader(decoder, gains)(result.driven).arkit
        assert shaped[jaw] == pytest.approx(min(2 * plain[jaw], 0.5))
        assert shaped[pucker] == pytest.approx(max(plain[pucker], 0.2))
        others = np.delete(np.arange(52), [jaw, pucker])
        np.testing.assert_array_equal(shaped[others], plain[others])


@pytest.mark.parametrize(
    "text",
    [
        "not json",
        '{"jawOpn": {"gain": 1}}',
        '{"jawOpen": {"grain": 1}}',
        '{"jawOpen": {"low": 1, "high": 0}}',
        '{"jawOpen": {"gain": NaN}}',
        '{"jawOpen": 2}',
    ],
)
def test_a_wrong_gains_file_is_one_line(tmp_path: Path, decoder: Decoder, text: str) -> None:
    path = tmp_path / "gains.json"
    path.write_text(text)
    with pytest.raises(InputError, match="expected"):
        FaceReader(decoder, path)
