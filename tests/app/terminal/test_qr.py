"""The page's address as a QR code, read back by a reader that is not ours."""

import io

import numpy as np
import pytest
import segno

from app.terminal import qr

ADDRESS = "https://192.168.1.20:8443/?token=Zm9vYmFyYmF6cXV4Zm9vYmFyYmF6"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_gets_a_code_that_says_the_address(monkeypatch: pytest.MonkeyPatch) -> None:
    cv2 = pytest.importorskip("cv2")
    monkeypatch.setattr("sys.stdout", shown := Terminal())
    qr.show(ADDRESS)
    rows = [line for line in shown.getvalue().splitlines() if line]
    assert 15 < len(rows) < 30  # half blocks: it fits on a terminal
    matrix = np.array([list(row) for row in segno.make(ADDRESS, error="l", micro=False).matrix])
    picture = np.pad(255 * (1 - matrix.astype(np.uint8)), 4, constant_values=255)
    told, *_ = cv2.QRCodeDetector().detectAndDecode(picture.repeat(8, 0).repeat(8, 1))
    assert told == ADDRESS


def test_a_pipe_gets_none(capsys: pytest.CaptureFixture[str]) -> None:
    qr.show(ADDRESS)
    assert capsys.readouterr().out == ""
