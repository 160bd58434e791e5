"""The web server's process, started by WebSink."""

import json
import logging
from datetime import UTC, datetime

from app.process import child
from app.process.channel import Channel
from app.web.info import ServerInfo
from app.web.link import STATUS
from sensors.listening import cannot_listen
from sensors.types import InputError


def main() -> None:
    """Serve; errors at the start are reported through the socket."""
    given = child.begin()
    assert (end := given.end) is not None
    logging.disable(logging.CRITICAL)  # garbage from clients is their affair
    info = ServerInfo(**given.info)
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
        if error.filename:  # of the certificate, its key or the token
            _fail(end, f"web: expected to use {error.filename}, got: {error.strerror}; check it")
        what = "--web" if info.page else f"--send ws://{info.host}:{info.port}"
        _fail(end, str(cannot_listen(what, info.host, info.port, error)))


def _fail(end: Channel, problem: str) -> None:
    end.send(STATUS + json.dumps({"error": problem}).encode())
    raise SystemExit(2)


if __name__ == "__main__":
    main()
