"""The web server's process: `python -m app.web DESCRIPTOR INFO`, started by WebSink."""

import asyncio
import json
import logging
import signal
import socket
import sys

from app.web.info import ServerInfo
from app.web.link import STATUS
from sensors.types import InputError


def main() -> None:
    """Serve; what goes wrong at the start is told through the socket."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the loop, which then ends us
    logging.disable(logging.CRITICAL)  # garbage from clients is their affair
    end = socket.socket(fileno=int(sys.argv[1]))
    info = ServerInfo(**json.loads(sys.argv[2]))
    try:
        from app.web.server import WebServer

        asyncio.run(WebServer(info, end).run())
    except ImportError as error:
        problem = f"web: expected aiohttp and cryptography, got {error}; "
        _fail(end, problem + "run: pip install livedrive[web]")
    except InputError as error:
        _fail(end, str(error))
    except OSError as error:
        what = error.strerror or str(error)
        where = f"{info.host}:{info.port}"
        _fail(end, f"web: expected to listen at {where}, got: {what}; choose another port")


def _fail(end: socket.socket, problem: str) -> None:
    end.send(STATUS + json.dumps({"error": problem}).encode())
    raise SystemExit(2)


if __name__ == "__main__":
    main()
