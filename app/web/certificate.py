"""A certificate for https, made on first use: XR and microphones are for secure pages only.

It is signed by itself, so the browser warns once; the key never leaves the user's folder.
"""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path

from sensors import files, folders

DAYS = 365
NAMES_FILE, KEY_FILE = "web_certificate.pem", "web_key.pem"


def folder() -> Path:
    """Where certificate, key and token are kept."""
    return folders.config()


def ensure(where: Path, hosts: Sequence[str], now_s: float) -> tuple[Path, Path]:
    """Paths of certificate and key, made anew where missing, expired or for other hosts."""
    hosts = [name for host in hosts if (name := _in_ascii(host))]
    certificate, key = where / NAMES_FILE, where / KEY_FILE
    if not (files.check_regular(key).exists() and _is_good(certificate, hosts, now_s)):
        where.mkdir(parents=True, exist_ok=True)
        names_pem, key_pem = _make(hosts, now_s)
        files.write_bytes(key, key_pem, private=True)
        files.write_bytes(certificate, names_pem, private=True)
    return certificate, key


def _is_good(path: Path, hosts: Sequence[str], now_s: float) -> bool:
    from cryptography import x509

    try:
        found = x509.load_pem_x509_certificate(files.read_bytes(path))
        names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (OSError, ValueError, x509.ExtensionNotFound):
        return False
    known = {str(name.value) for name in names}
    return set(hosts) <= known and now_s < found.not_valid_after_utc.timestamp()


def _make(hosts: Sequence[str], now_s: float) -> tuple[bytes, bytes]:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import NameOID

    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "livedrive")])
    start = datetime.fromtimestamp(now_s, UTC)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(start - timedelta(days=1))
        .not_valid_after(start + timedelta(days=DAYS))
        .add_extension(x509.SubjectAlternativeName([_general_name(h) for h in hosts]), False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), True)
        .sign(key, hashes.SHA256())
    )
    pem, plain = serialization.Encoding.PEM, serialization.NoEncryption()
    private = key.private_bytes(pem, serialization.PrivateFormat.PKCS8, plain)
    return certificate.public_bytes(pem), private


def _in_ascii(host: str) -> str:
    """As certificates name it; empty where they cannot."""
    try:
        return host.encode("idna").decode()
    except UnicodeError:
        return ""


def _general_name(host: str):  # noqa: ANN202
    from cryptography import x509

    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        return x509.DNSName(host)
