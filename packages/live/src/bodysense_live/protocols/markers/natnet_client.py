"""A client of NatNet in a thread: it reads all datagrams that wait, so that frames never queue up."""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterable, Sequence

from bodysense_live.protocols.links import address_toward
from bodysense_live.protocols.markers.natnet import Multicast, NatnetConversation
from bodysense_live.protocols.markers.stream_frame import MarkerServerError, StreamFrame

_ALIVE = 0.5  # s between packets that keep the stream alive, or connect
_QUIET = 1.0  # s without a frame, after which the client connects again
_LARGEST = 1 << 16  # bytes of a datagram


class NatnetClient:
    """A client that runs until it is closed.

    Args:
        address: of the server.
        port: of its commands.
        take: called in the thread with the frames that arrived together.
        lose: called in the thread with the reason if frames stop, or do not come.
    """

    def __init__(
        self,
        address: str,
        port: int,
        take: Callable[[Sequence[StreamFrame]], None],
        lose: Callable[[str], None],
    ) -> None:
        self._server, self._take, self._lose = (address, port), take, lose
        self._conversation = NatnetConversation()
        self._sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM)]
        self._sockets[0].setblocking(False)
        self._sockets[0].bind(("", 0))
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="natnet", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Disconnect."""
        self._ended.set()
        self._thread.join()
        for sock in self._sockets:
            sock.close()

    def _run(self) -> None:
        next_packet, last_frame = 0.0, time.monotonic()
        while not self._ended.is_set():
            now = time.monotonic()
            if now >= next_packet:
                next_packet = now + _ALIVE
                is_quiet = now - last_frame > _QUIET
                if is_quiet:
                    self._lose("no frames" if self._conversation.version is not None else "no answer")
                # A server that was started anew does not know this client.
                begins = is_quiet or self._conversation.version is None
                self._send(self._conversation.begin() if begins else self._conversation.keep_alive())
                multicast = self._conversation.multicast
                if multicast is not None and len(self._sockets) == 1:  # the server sends to a group
                    with contextlib.suppress(OSError):  # tried again soon
                        self._sockets.append(_joined(multicast, self._server[0]))
            ready, _, _ = select.select(self._sockets, [], [], max(next_packet - now, 0))
            frames: list[StreamFrame] = []
            for sock in ready:
                frames += self._read(sock)
            if frames:
                last_frame = time.monotonic()
                self._take(frames)

    def _read(self, sock: socket.socket) -> list[StreamFrame]:
        """Return the frames in all datagrams that wait at a socket."""
        frames: list[StreamFrame] = []
        while True:
            try:
                data, sender = sock.recvfrom(_LARGEST)
            except OSError:  # all are read, or the server's machine refuses
                return frames
            if sender[0] != self._server[0]:
                continue
            try:
                received = self._conversation.receive(data)
            except MarkerServerError as error:
                self._lose(str(error))
                continue
            frames += received.frames
            self._send(received.replies)

    def _send(self, packets: Iterable[bytes]) -> None:
        for packet in packets:
            with contextlib.suppress(OSError):  # sent again soon
                self._sockets[0].sendto(packet, self._server)


def _joined(multicast: Multicast, address: str) -> socket.socket:
    """Return a UDP socket that receives what is sent to a group."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    sock.setblocking(False)
    try:
        sock.bind(("", multicast.port))
        group, own = socket.inet_aton(multicast.group), socket.inet_aton(address_toward(address))
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, struct.pack("4s4s", group, own))
    except OSError:
        sock.close()
        raise
    return sock
