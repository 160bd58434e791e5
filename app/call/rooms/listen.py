"""Listens for a partner, with a certificate made for this call alone, and makes the invite."""

import asyncio
import hashlib
import ssl
import tempfile
from pathlib import Path

from app.call.rooms.direct import DirectHost
from app.call.rooms.room import Events, LineSettings
from app.call.wire.invite import Invite
from sensors import files


async def host_direct(
    listen: tuple[str, int],
    told: str,  # the address that the invite names
    secret: bytes,
    events: Events,
    line: LineSettings,
) -> tuple[DirectHost, asyncio.Task[None], Invite]:
    """Listening already, with a certificate made for this call alone."""
    tls, fingerprint = _certificate()
    room = DirectHost(listen, tls, events, line)
    task = asyncio.create_task(room.run())
    await asyncio.wait([task, room.port], return_when=asyncio.FIRST_COMPLETED)
    if task.done():
        task.result()
    return room, task, Invite("direct", told, room.port.result(), secret, fingerprint)


def _certificate() -> tuple[ssl.SSLContext, bytes]:
    """For TLS, made now and kept nowhere; and what the invite says of it."""
    tls = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    with tempfile.TemporaryDirectory() as folder:  # the only way into an SSLContext is a file
        path = Path(folder) / "certificate.pem"
        fingerprint = write_certificate(path)
        tls.load_cert_chain(path)
    return tls, fingerprint


def write_certificate(path: Path) -> bytes:
    """A new certificate with its key, for its owner alone; returns its SHA-256."""
    from aiortc.rtcdtlstransport import generate_certificate
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    key = ec.generate_private_key(ec.SECP256R1())
    certificate = generate_certificate(key)
    pem = serialization.Encoding.PEM
    private = serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    data = certificate.public_bytes(pem) + key.private_bytes(pem, *private)
    files.write_bytes(path, data, private=True)
    return hashlib.sha256(certificate.public_bytes(serialization.Encoding.DER)).digest()
