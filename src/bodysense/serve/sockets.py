"""Sockets that the server listens on; what cannot be had is said by the option that asks for it."""

from __future__ import annotations

import errno
import socket

from bodysense.errors import BodysenseError


def listen_tcp(option: str, host: str, port: int) -> socket.socket:
    """A TCP socket that clients can connect to. Raises BodysenseError, with the fix, without one."""
    found = _bound(option, host, port, socket.SOCK_STREAM)
    try:
        found.listen(128)
    except OSError as error:
        found.close()
        raise BodysenseError(_why(error, option, host, port)) from None
    return found


def listen_udp(option: str, host: str, port: int) -> socket.socket:
    """A UDP socket that packets come in at. Raises BodysenseError, with the fix, without one."""
    found = _bound(option, host, port, socket.SOCK_DGRAM)
    found.setblocking(False)
    return found


def _bound(option: str, host: str, port: int, kind: socket.SocketKind) -> socket.socket:
    if not 0 <= port <= 65535:
        raise BodysenseError(f"{option} {port}: ports are 0 (any that is free) to 65535")
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=kind)[0]
        found = socket.socket(family, kind)
    except OSError:
        raise BodysenseError(f"{option} {port}: {host}: no such host; give an address of this machine") from None
    try:
        if kind == socket.SOCK_STREAM:
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind(address)
    except OSError as error:
        found.close()
        raise BodysenseError(_why(error, option, host, port)) from None
    return found


def _why(error: OSError, option: str, host: str, port: int) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"{option} {port} is in use by another program; stop it or choose another {option} (0 takes any)"
    if error.errno == errno.EACCES:
        return f"{option} {port}: no permission to listen there; choose a {option} of 1024 or more"
    if error.errno == errno.EADDRNOTAVAIL:
        return f"{option} {port}: {host} is no address of this machine; give one of its own, or 0.0.0.0 for all"
    return f"{option} {port}: {host} cannot be listened on ({error.strerror}); choose another {option}"


def address_toward(host: str) -> str:
    """This machine's address as a host sees it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((host, 9))
        except OSError:
            return "127.0.0.1"
        return probe.getsockname()[0]
