"""The server's own TLS certificate: browsers of headsets on the same network allow WebXR only over TLS."""

from __future__ import annotations

import asyncio
import datetime
import ipaddress
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bodysense.errors import BodysenseError, missing_package
from bodysense.files import written_beside
from bodysense_live.protocols.links import address_toward

_DAYS = 397  # longest validity that browsers accept
_NAME = "bodysense"
_CERTIFICATE = "certificate.pem"
CHECK_INTERVAL = 60.0  # s between two looks at the files of a certificate


def lan_address() -> str:
    """Return this machine's address on the local network. Raises BodysenseError if it has none."""
    address = address_toward("192.0.2.1")
    if ipaddress.ip_address(address).is_loopback:
        raise BodysenseError("--lan: this machine is in no network; connect it, or leave --lan out")
    return address


def state_folder() -> Path:
    """Return the folder for files that are kept between runs."""
    configured = os.environ.get("XDG_STATE_HOME") or os.environ.get("LOCALAPPDATA")
    return (Path(configured) if configured else Path.home() / ".local" / "state") / "bodysense"


def own_certificate(folder: Path, addresses: Sequence[str]) -> tuple[Path, Path]:
    """Return certificate and key for addresses and names, as PEM files in a folder; created again if they do not fit.

    Raises BodysenseError for a folder that cannot be written to.
    """
    certificate, key = folder / _CERTIFICATE, folder / "key.pem"
    if not _fits(certificate, key, addresses):
        public, private = _create(addresses)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with written_beside(key) as beside:
                beside.touch(mode=0o600)
                beside.chmod(0o600)
                beside.write_bytes(private)
            with written_beside(certificate) as beside:
                beside.write_bytes(public)
        except OSError as error:
            raise BodysenseError(
                f"--lan: {folder} cannot be written to ({error.strerror}); give --certificate and --key"
            ) from None
    return certificate, key


def _fits(certificate: Path, key: Path, addresses: Sequence[str]) -> bool:
    from cryptography import x509

    if not key.is_file() or not certificate.is_file():
        return False
    try:
        found = x509.load_pem_x509_certificate(certificate.read_bytes())
        names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (ValueError, OSError, x509.ExtensionNotFound):
        return False
    covered = {str(one) for kind in (x509.IPAddress, x509.DNSName) for one in names.get_values_for_type(kind)}
    tomorrow = datetime.datetime.now(datetime.UTC) + datetime.timedelta(days=1)
    return set(addresses) <= covered and found.not_valid_after_utc > tomorrow


def _create(addresses: Sequence[str]) -> tuple[bytes, bytes]:
    """Return a self-signed certificate and its key, as PEM."""
    try:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import ec
    except ImportError as error:
        raise missing_package(error) from None
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, _NAME)])
    now = datetime.datetime.now(datetime.UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))  # a headset's clock may be late
        .not_valid_after(now + datetime.timedelta(days=_DAYS))
        .add_extension(x509.SubjectAlternativeName([_general(one) for one in addresses]), critical=False)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .sign(key, hashes.SHA256())
    )
    plain = serialization.NoEncryption()
    secret = key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, plain)
    return made.public_bytes(serialization.Encoding.PEM), secret


def _general(address: str):
    from cryptography import x509

    try:
        return x509.IPAddress(ipaddress.ip_address(address))
    except ValueError:
        return x509.DNSName(address)


async def follow_certificate(context: Any, certificate: Path, key: Path) -> None:
    """Load a certificate into a server's TLS context whenever its files change, and renew our own in time.

    Connections that are open stay open; new ones get the new certificate. A file that cannot be loaded is reported, and
    the one before stays in use.
    """
    loaded = _changed_at(certificate, key)
    while True:
        await asyncio.sleep(CHECK_INTERVAL)
        try:
            if certificate == state_folder() / _CERTIFICATE:
                own_certificate(certificate.parent, _addresses(certificate))
            now = _changed_at(certificate, key)
            if now != loaded:
                loaded = now
                context.load_cert_chain(certificate, key)
        except (OSError, ValueError, BodysenseError) as error:  # an SSLError is an OSError
            print(f"bodysense: --certificate {certificate} cannot be renewed ({error})", file=sys.stderr, flush=True)


def _changed_at(*paths: Path) -> tuple[int, ...]:
    """Return when files were changed, in ns; 0 for one that is missing."""
    return tuple(path.stat().st_mtime_ns if path.exists() else 0 for path in paths)


def _addresses(certificate: Path) -> tuple[str, ...]:
    """Return the addresses and names of a certificate of ours."""
    from cryptography import x509

    found = x509.load_pem_x509_certificate(certificate.read_bytes())
    names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    return tuple(str(one) for kind in (x509.IPAddress, x509.DNSName) for one in names.get_values_for_type(kind))


def check_pair(certificate: Path, key: Path) -> None:
    """Raise BodysenseError, naming the options, unless two files are a certificate and its key."""
    import ssl

    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key)
    except (ssl.SSLError, OSError) as error:
        why = getattr(error, "strerror", None) or getattr(error, "reason", None) or error
        raise BodysenseError(
            f"--certificate {certificate} --key {key}: {why}; give PEM files, a certificate and its own key"
        ) from None


def qr_code(address: str) -> str:
    """Return a QR code of an address, for a terminal."""
    import io

    try:
        import segno
    except ImportError as error:
        raise missing_package(error) from None
    out = io.StringIO()
    segno.make(address, error="m", micro=False).terminal(out=out, compact=True)
    return out.getvalue()
