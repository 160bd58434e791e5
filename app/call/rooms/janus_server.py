"""Runs a Janus server: writes its configuration folder and starts its process.

Janus is a program of its own (Debian: apt-get install janus). It asks for a token signed with the
server's key and, to make a room, for a key derived from it.
"""

import hmac
import re
import shutil
import subprocess
from base64 import b64encode
from dataclasses import dataclass
from hashlib import sha1
from pathlib import Path
from urllib.parse import urlsplit

from app.call.wire.invite import ROOM, Invite
from app.call.wire.seal import derive
from sensors import files
from sensors.types import LOOPBACK, InputError

HEX, KEY = re.compile(r"[0-9a-f]{64}"), re.compile(r"[0-9a-f]{32}")
TOKEN_S = 12 * 3600  # that an invite lets people in
GENERAL = """general: {{
    configs_folder = "{folder}"
    plugins_folder = "{plugins}"
    transports_folder = "{transports}"
    loggers_folder = "{folder}/none"
    events_folder = "{folder}/none"
    admin_secret = "{admin_key}"
    token_auth = true
    token_auth_secret = "{token_secret}"
    session_timeout = 60
}}
media: {{ rtp_port_range = "{ports}" }}
nat: {{ {nat} }}
plugins: {{ disable = "{disabled}" }}
transports: {{ disable = "{other_transports}" }}
"""
WEBSOCKETS = """general: {{
    json = "compact"
    {scheme} = true
    {scheme}_port = {port}
    {scheme}_ip = "{host}"
}}
certificates: {{ {certificate} }}
"""
VIDEOROOM = """general: {{
    admin_key = "{admin_key}"
    lock_rtp_forward = true
    string_ids = true
}}
"""
OTHER_PLUGINS = ("audiobridge", "echotest", "nosip", "recordplay", "sip", "streaming", "textroom")

OTHER_TRANSPORTS = ("http", "rabbitmq", "pfunix", "mqtt", "nanomsg")


@dataclass(frozen=True, kw_only=True)
class ServerSettings:
    """How the server is reached."""

    key: str  # 32 hex digits; who has it may make rooms
    host: str = LOOPBACK
    port: int = 8188
    public_address: str = ""  # where a router passes the media ports on to this machine
    ports: str = "20000-20400"  # UDP, of the media
    certificate: Path | None = None  # PEM with the key behind it: wss instead of ws


def read_key(path: Path) -> str:
    """The key of a server; raises InputError where the file holds none."""
    key = files.read_bytes(path).strip().decode("ascii", "replace")
    if not KEY.fullmatch(key):
        raise InputError(
            f"call: expected the key of a server (32 hex digits) in {path}, got something else; "
            "give the file `key` in the folder of its livedrive call server"
        )
    return key


def admin_key(key: str) -> str:
    return derive(bytes.fromhex(key), "janus admin").hex()


def token(key: str, now_s: int) -> str:
    """Lets its bearer in until TOKEN_S from now."""
    secret = derive(bytes.fromhex(key), "janus tokens").hex().encode()
    data = f"{now_s + TOKEN_S},janus,janus.plugin.videoroom"
    return f"{data}:{b64encode(hmac.new(secret, data.encode(), sha1).digest()).decode()}"


def room_invite(server: str, room: str, secret: bytes, key: str, now_s: int) -> Invite:
    """The invite to a room on `server`, ws://HOST:PORT or wss://HOST:PORT#FINGERPRINT, as
    `livedrive call server` printed it. Raises InputError where it is neither."""
    try:
        url = urlsplit(server)
        port = url.port or 8188
    except ValueError:  # no address, or no port
        url, port = urlsplit(""), 0
    fingerprint = bytes.fromhex(url.fragment) if HEX.fullmatch(url.fragment) else b""
    scheme = "wss" if fingerprint else "ws"
    good = url.scheme == scheme and url.hostname and ROOM.fullmatch(room)
    if not good or not KEY.fullmatch(key):
        raise InputError(
            f"call: expected --room NAME, --server wss://HOST:PORT#FINGERPRINT and its --key "
            f"file, got room {room[:40]!r} on {server[:60]!r}; see livedrive call server"
        )
    passed = token(key, now_s)
    return Invite("room", url.hostname or "", port, secret, fingerprint, room, passed)


def write_configuration(folder: Path, settings: ServerSettings) -> Path:
    """The configuration files; returns the one to start with. Only their owner can read them."""
    folder.mkdir(parents=True, exist_ok=True)
    root = _plugins()
    secure = settings.certificate is not None
    fields = {
        "folder": folder.resolve(),
        "plugins": root / "plugins",
        "transports": root / "transports",
        "admin_key": admin_key(settings.key),
        "token_secret": derive(bytes.fromhex(settings.key), "janus tokens").hex(),
        "ports": settings.ports,
        "nat": f'nat_1_1_mapping = "{settings.public_address}"' if settings.public_address else "",
        "other_transports": ",".join(f"libjanus_{name}.so" for name in OTHER_TRANSPORTS),
        "disabled": ",".join(f"libjanus_{name}.so" for name in OTHER_PLUGINS),
        "scheme": "wss" if secure else "ws",
        "port": settings.port,
        "host": settings.host,
        "certificate": _certificate_lines(settings.certificate),
    }
    texts = {
        "janus.jcfg": GENERAL,
        "janus.transport.websockets.jcfg": WEBSOCKETS,
        "janus.plugin.videoroom.jcfg": VIDEOROOM,
    }
    for name, text in texts.items():
        files.write_text(folder / name, text.format(**fields), private=True)
    return folder / "janus.jcfg"


def start(folder: Path, settings: ServerSettings) -> subprocess.Popen[bytes]:
    """Janus, in a process of its own; InputError where it is not installed."""
    configuration = write_configuration(folder, settings)
    program = shutil.which("janus")
    assert program is not None
    return subprocess.Popen(
        [*_leash(), program, "-C", str(configuration.resolve()), "-F", str(folder.resolve()), "-o"],
        cwd=folder,  # where Janus makes a folder of its own
        stdin=subprocess.DEVNULL,
        stdout=files.create(folder / "janus.log").open("wb"),
        stderr=subprocess.STDOUT,
    )


def _leash() -> list[str]:
    """Words before the program: it ends with whoever started it, however that ends, and leaves no
    core file, which would hold the key."""
    words = ["setpriv", "--pdeathsig", "KILL"], ["prlimit", "--core=0"]
    return [word for command in words if shutil.which(command[0]) for word in command]


def _certificate_lines(path: Path | None) -> str:
    return f'cert_pem = "{path.resolve()}"\n cert_key = "{path.resolve()}"' if path else ""


def _plugins() -> Path:
    if shutil.which("janus") is None:
        raise InputError(
            "call: expected the Janus program for a room, got none; run: sudo apt-get install janus"
        )
    for root in (*Path("/usr/lib").glob("*/janus"), Path("/usr/lib/janus"), Path("/opt/janus/lib")):
        if (root / "plugins").is_dir():
            return root
    raise InputError("call: expected Janus' plugins in /usr/lib, got none; install janus again")
