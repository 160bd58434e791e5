"""The web server's process, started by WebSink."""

import errno
import json
import logging
import socket
from datetime import UTC, datetime

from app.process import child
from app.process.channel import Channel
from app.web.info import ServerInfo
from app.web.link import STATUS
from sensors.types import LOOPBACK, InputError


def main() -> None:
    """Serve; errors at the start are reported through the socket."""
    fields, _, end = child.begin()
    assert end is not None
    logging.disable(logging.CRITICAL)  # garbage from clients is their affair
    info = ServerInfo(**fields)
    try:
        from app.web.server import WebServer

        child.run(WebServer(info, end, datetime.now(UTC).timestamp()).run())
        end.close()
    except ImportError as error:
        problem = f"web: expected aiohttp and cryptography, got {error}; "
        _fail(end, problem + "run: pip install livedrive[web]")
    except InputError as error:
        _fail(end, str(error))
    except OSError as error:
        what = error.strerror or str(error)
        where, cure = f"{info.host}:{info.port}", "choose another port"
        if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
            cure = f"choose an address of this machine, e.g. --host {LOOPBACK} or 0.0.0.0"
        _fail(end, f"web: expected to listen at {where}, got: {what}; {cure}")


def _fail(end: Channel, problem: str) -> None:
    end.send(STATUS + json.dumps({"error": problem}).encode())
    raise SystemExit(2)


if __name__ == "__main__":
    main()
