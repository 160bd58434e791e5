"""A camera on HTTP, with Python's own server: MJPEG as OpenIris sends it, and its failures.

python -m sensors.standins.mjpeg --rate 30 --jitter-ms 8     # prints its address
"""

import argparse
import sys
import threading
import time
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np

from sensors.standins.eye_pictures import eye_picture, film, jpeg, zero_middle
from sensors.types import LOOPBACK, NS

BOUNDARY = "123456789000000000000987654321"
FAULTS = (
    *("stall", "disconnect", "garbage", "zeroed", "wrong size", "half", "flood", "refuse"),
    "clock jump",  # the camera's own clock: an hour ahead
)


class MjpegServer:
    """Serves the film over and over. `fault` names what is wrong with it now."""

    def __init__(
        self,
        pictures: Sequence[bytes],  # JPEGs
        *,
        rate_hz: float = 30.0,
        jitter_ms: float = 0.0,  # each picture is late by up to so much
        chunked: bool = True,  # HTTP transfer coding, as ESP32 cameras use it
        seed: int = 0,
    ) -> None:
        self.pictures, self.rate_hz, self.jitter_ms = list(pictures), rate_hz, jitter_ms
        self.chunked, self.seed = chunked, seed
        self.fault = ""
        self.sent = 0
        self.closing = threading.Event()
        self._server = ThreadingHTTPServer((LOOPBACK, 0), _handler(self))
        self._server.daemon_threads = True
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.05,), daemon=True
        )
        self._thread.start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._server.server_address[1]}/"

    def close(self) -> None:
        self.closing.set()
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()

    def payload(self, k: int, rng: np.random.Generator) -> bytes:
        """JPEG k, damaged if the fault says so."""
        data = self.pictures[k % len(self.pictures)]
        if self.fault == "zeroed":
            return zero_middle(data)
        if self.fault == "half":
            return data[: len(data) // 2]
        if self.fault == "wrong size":
            return jpeg(eye_picture(k, 120, 90))
        if self.fault == "garbage":
            return rng.bytes(len(data))
        return data


def _handler(server: MjpegServer) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:  # noqa: N802  # the library's name
            if server.fault == "refuse":
                self.send_error(503)
                return
            self.close_connection = True
            self.send_response(200)
            self.send_header("Content-Type", f"multipart/x-mixed-replace;boundary={BOUNDARY}")
            if server.chunked:
                self.send_header("Transfer-Encoding", "chunked")
            self.end_headers()
            try:
                self._stream()
            except OSError:
                return  # the client has gone

        def _stream(self) -> None:
            rng = np.random.default_rng(server.seed)
            start_ns, k = time.monotonic_ns(), 0
            due_ns = start_ns
            while not server.closing.is_set():
                rate = server.rate_hz * (10 if server.fault == "flood" else 1)
                due_ns = max(due_ns + int(NS / rate), time.monotonic_ns() - NS)
                late_ns = int(rng.uniform(0, server.jitter_ms) * 1e6)
                _sleep_until(due_ns + late_ns)
                k += 1
                if server.fault == "stall":
                    continue
                if server.fault in ("disconnect", "refuse"):
                    return
                self._send_picture(server.payload(k, rng), due_ns, rng)
                server.sent += 1

        def _send_picture(self, data: bytes, t_ns: int, rng: np.random.Generator) -> None:
            if server.fault == "garbage":
                self._send(rng.bytes(2000) + data)
                return
            ahead_ns = 3600 * NS if server.fault == "clock jump" else 0
            head = (
                f"\r\n--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n"
                f"X-Timestamp: {(t_ns + ahead_ns) // NS}.{t_ns % NS // 1000:06d}\r\n\r\n"
            )
            self._send(head.encode())
            self._send(data)

        def _send(self, data: bytes) -> None:
            if server.chunked:
                data = f"{len(data):x}\r\n".encode() + data + b"\r\n"
            self.wfile.write(data)

        def log_message(self, format: str, *args: object) -> None:
            pass

    return Handler


def _sleep_until(t_ns: int) -> None:
    while (left_ns := t_ns - time.monotonic_ns()) > 0:
        time.sleep(left_ns / NS)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate", type=float, default=30.0)
    parser.add_argument("--jitter-ms", type=float, default=0.0)
    parser.add_argument("--size", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    words = parser.parse_args()
    pictures = film(60, words.size, words.size, noise=False)
    server = MjpegServer(pictures, rate_hz=words.rate, jitter_ms=words.jitter_ms, seed=words.seed)
    sys.stdout.write(server.url + "\n")
    sys.stdout.flush()
    try:
        sys.stdin.read()  # until the parent closes our input
    finally:
        server.close()


if __name__ == "__main__":
    main()
