"""The call's process, started by CallLink."""

import gc
import logging
import shutil
from datetime import UTC, datetime

from app.call.live import protocol
from app.call.live.protocol import CallSettings
from app.process import child
from app.process.channel import Channel
from sensors.types import InputError


def main() -> None:
    """Run one end of a call; errors are reported through the socket."""
    given = child.begin()
    assert (end := given.end) is not None
    logging.disable(logging.CRITICAL)  # garbage from the network is counted, not logged
    given.info["ice_servers"] = tuple(given.info["ice_servers"])
    settings = CallSettings(**given.info)
    try:
        from app.call.live.service import Service
        from app.call.table.seats import Seats
        from app.call.wire.packet import basis_of
        from render.decoder.coding import Coding
        from sensors.clock import MonotonicClock

        coding = Coding.load()
        basis = basis_of(coding.frame, coding.to_code)
        date_s = int(datetime.now(UTC).timestamp())
        service = Service(end, Seats(given.memories[0]), basis, MonotonicClock(), date_s)
        gc.collect()
        gc.freeze()
        try:
            child.run(service.run(settings))
        finally:  # also where the loop, which made it, was killed
            shutil.rmtree(settings.avatars, ignore_errors=True)
        end.close()
    except ImportError as error:
        _fail(end, f"call: expected its packages, got {error}; run: pip install livedrive[call]")
    except (InputError, OSError) as error:
        _fail(end, str(error))


def _fail(end: Channel, problem: str) -> None:
    end.send(protocol.ERROR + problem.encode())
    raise SystemExit(2)


if __name__ == "__main__":
    main()
