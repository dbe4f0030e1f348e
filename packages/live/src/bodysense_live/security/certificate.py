"""The server's own TLS certificate: browsers of headsets on the same network allow WebXR only over TLS."""

from __future__ import annotations

import datetime
import ipaddress
import os
from collections.abc import Sequence
from pathlib import Path

from bodysense.errors import BodysenseError, missing_package
from bodysense.files import written_beside
from bodysense_live.protocols.links import address_toward

_DAYS = 397  # longest validity that browsers accept
_NAME = "bodysense"


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
    certificate, key = folder / "certificate.pem", folder / "key.pem"
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
