"""The call's process: `python -m app.call SOCKET SEATS`, started by CallLink; settings come through
the socket."""

import asyncio
import gc
import json
import logging
import select
import signal
import socket
import sys

from app.call.live import protocol
from app.call.live.protocol import CallSettings
from sensors.types import InputError

START_S = 30.0


def main() -> None:
    """Take part; what goes wrong is told through the socket."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the loop, which then ends us
    logging.disable(logging.CRITICAL)  # garbage from the network is counted, not logged
    end = socket.socket(fileno=int(sys.argv[1]))
    if not select.select([end], [], [], START_S)[0]:
        raise SystemExit(1)
    fields = json.loads(end.recv(protocol.MAX_PACKET)[1:])
    settings = CallSettings(**fields | {"ice_servers": tuple(fields["ice_servers"])})
    try:
        from app.call.live.service import Service
        from app.call.table.seats import Seats
        from app.call.wire.packet import basis_of
        from render.decoder.decoder import Decoder
        from sensors.clock import MonotonicClock

        coding = Decoder.load().coding
        basis = basis_of(coding.frame, coding.to_code)
        service = Service(end, Seats(int(sys.argv[2])), basis, MonotonicClock())
        gc.collect()
        gc.freeze()
        asyncio.run(service.run(settings))
    except ImportError as error:
        _fail(end, f"call: expected its packages, got {error}; run: pip install livedrive[call]")
    except (InputError, OSError) as error:
        _fail(end, str(error))


def _fail(end: socket.socket, problem: str) -> None:
    end.send(protocol.ERROR + problem.encode())
    raise SystemExit(2)


if __name__ == "__main__":
    main()
