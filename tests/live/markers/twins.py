"""Twins of the servers of optical systems. They send packets as the vendors document them, byte by byte.

They share no code with the clients: the numbers below are from the documentation of QTM's RT protocol, of NatNet's
bitstream and of Vicon's DataStream.
"""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from bodysense.geometry.rotation import quaternion_to_matrix

from .performer import BODIES, SUBJECT, Captured

Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # laboratory = Z_UP @ ours


class Twin:
    """A server that plays a capture in real time to its clients.

    Args:
        capture: what is sent.
        port: to listen on; 0 takes any.
        hidden: (frame) → (M,) bool, markers that are hidden in a frame.
        labelled: whether markers are named; else all are points without a name.
        bodies: whether rigid bodies are sent.
    """

    kind = socket.SOCK_STREAM

    def __init__(
        self,
        capture: Captured,
        port: int = 0,
        hidden: Callable[[int], np.ndarray] | None = None,
        labelled: bool = True,
        bodies: bool = True,
    ) -> None:
        self.capture, self.hidden, self.labelled = capture, hidden, labelled
        self.bodies: tuple[str, ...] = BODIES if bodies else ()
        self.use = list(range(len(capture.labels)))  # markers that are sent
        self.frame = 0
        self._socket = socket.socket(socket.AF_INET, self.kind)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.bind(("127.0.0.1", port))
        self.port = self._socket.getsockname()[1]
        self._ended = threading.Event()
        self._lock = threading.Lock()
        self._threads = [threading.Thread(target=run, daemon=True) for run in (self._listen, self._play)]

    def __enter__(self) -> Twin:
        if self.kind == socket.SOCK_STREAM:
            self._socket.listen()
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self._close()
        for thread in self._threads:
            thread.join(5)

    @property
    def names(self) -> list[str]:
        return [self.capture.labels[k] for k in self.use] if self.labelled else []

    def places(self, frame: int) -> np.ndarray:
        """Return the markers (M, 3) m of a frame, NaN where hidden, in our world."""
        place = self.capture.position[self.capture.index(frame)].copy()
        if self.hidden is not None:
            place[self.hidden(frame)] = np.nan
        return place[self.use]

    def packets(self, frame: int) -> list[bytes]:
        """Return what a client gets that connects at a frame: definitions and the frame."""
        raise NotImplementedError

    def _play(self) -> None:
        begun, first = time.monotonic(), self.frame
        while not self._ended.is_set():
            due = begun + (self.frame - first) / self.capture.rate
            wait = due - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            self._send(self.frame)
            self.frame += 1

    def _listen(self) -> None:
        raise NotImplementedError

    def _send(self, frame: int) -> None:
        raise NotImplementedError

    def _close(self) -> None:
        """Close connections."""


class StreamTwin(Twin):
    """A twin that sends by TCP."""

    def __init__(self, *args, **fields) -> None:
        super().__init__(*args, **fields)
        self._clients: list[socket.socket] = []  # that have asked for frames
        self._connected: list[socket.socket] = []

    def _listen(self) -> None:
        while not self._ended.is_set():
            try:
                client, _ = self._socket.accept()
            except OSError:
                return
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._connected.append(client)
            threading.Thread(target=self._guarded, args=(client,), daemon=True).start()

    def _guarded(self, client: socket.socket) -> None:
        with suppress(OSError, ConnectionError):
            self._serve(client)

    def _serve(self, client: socket.socket) -> None:
        raise NotImplementedError

    def _put(self, packet: bytes) -> None:
        with self._lock:
            for client in list(self._clients):
                try:
                    client.sendall(packet)
                except OSError:
                    self._clients.remove(client)

    def _close(self) -> None:
        for client in self._connected:
            with suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)
            client.close()


def exactly(client: socket.socket, count: int) -> bytes:
    """Return the next bytes of a connection."""
    data = b""
    while len(data) < count:
        more = client.recv(count - len(data))
        if not more:
            raise ConnectionError
        data += more
    return data


class QtmTwin(StreamTwin):
    """QTM: millimetres, +Z up."""

    versions = ("1.19", "1.25")

    def _serve(self, client: socket.socket) -> None:
        client.sendall(self._text(1, "QTM RT Interface connected"))
        while True:
            size, kind = struct.unpack("<II", exactly(client, 8))
            text = exactly(client, size - 8).rstrip(b"\0").decode()
            assert kind == 1, kind
            words = text.lower().split()
            if words[0] == "version":
                answer = self._text(1, f"Version set to {words[1]}")
                client.sendall(answer if words[1] in self.versions else self._text(0, "Version NOT supported"))
            elif words[0] == "getparameters":
                with self._lock:
                    client.sendall(self._text(2, self._xml()))
            elif words[0] == "streamframes":
                assert words[1:] == ["allframes", "3d", "3dnolabels", "6d"]
                self._clients.append(client)

    def _xml(self) -> str:
        labels = "".join(
            f"<Label><Name>{name}</Name><RGBColor>65280</RGBColor><Trajectory_Type>Measured</Trajectory_Type></Label>"
            for name in self.names
        )
        bodies = "".join(f"<Body><Name>{name}</Name><RGBColor>255</RGBColor></Body>" for name in self.bodies)
        return (
            '<?xml version="1.0"?>\n<QTM_Parameters_Ver_1.19><The_3D><AxisUpwards>+Z</AxisUpwards>'
            f"<CalibrationTime>2026.11.01 10:00:00</CalibrationTime><Labels>{len(self.names)}</Labels>{labels}</The_3D>"
            f"<The_6D><Bodies>{len(self.bodies)}</Bodies>{bodies}<Euler><First>Roll</First></Euler></The_6D>"
            "</QTM_Parameters_Ver_1.19>"
        )

    @staticmethod
    def _text(kind: int, text: str) -> bytes:
        return struct.pack("<II", len(text) + 9, kind) + text.encode() + b"\0"

    def _send(self, frame: int) -> None:
        self._put(self._data(frame))

    def packets(self, frame: int) -> list[bytes]:
        return [self._text(2, self._xml()), self._data(frame)]

    def _data(self, frame: int) -> bytes:
        place = 1000 * self.places(frame) @ Z_UP.T
        named = place if self.labelled else place[:0]
        unnamed = place[:0] if self.labelled else place[np.isfinite(place).all(axis=1)]
        at = self.capture.index(frame)
        matrix = Z_UP @ quaternion_to_matrix(self.capture.body_rotation[at]) @ Z_UP.T
        body = b"".join(
            struct.pack("<12f", *(1000 * Z_UP @ self.capture.body_position[at, k]), *matrix[k].T.ravel())
            for k in range(len(self.bodies))
        )
        parts = [
            (1, struct.pack("<Ihh", len(named), 0, 0) + named.astype("<f4").tobytes()),
            (2, struct.pack("<Ihh", len(unnamed), 0, 0)
             + b"".join(struct.pack("<3fI", *row, 1000 + k) for k, row in enumerate(unnamed))),
            (5, struct.pack("<Ihh", len(self.bodies), 0, 0) + body),
            (17, struct.pack("<I", 0)),  # a component that was not requested
        ]  # fmt: skip
        content = struct.pack("<QII", round(frame * 1e6 / self.capture.rate), frame, len(parts))
        content += b"".join(struct.pack("<II", 8 + len(part), kind) + part for kind, part in parts)
        return struct.pack("<II", 8 + len(content), 3) + content


class ViconTwin(StreamTwin):
    """Vicon's DataStream: millimetres, +Z up."""

    @staticmethod
    def _block(kind: int, content: bytes) -> bytes:
        return struct.pack("<II", kind, len(content)) + content

    @staticmethod
    def _name(text: str) -> bytes:
        return struct.pack("<I", len(text.encode())) + text.encode()

    def _packet(self, *blocks: bytes) -> bytes:
        return self._block(0x1A2B0001, b"".join(blocks))

    def _serve(self, client: socket.socket) -> None:
        have = (1, 2, 5, 6, 7, 9, 37, 39)
        client.sendall(self._packet(self._block(100001, struct.pack(f"<I{len(have)}I", len(have), *have))))
        while True:
            kind, size = struct.unpack("<II", exactly(client, 8))
            content = exactly(client, size)
            assert kind == 0x1A2B0001
            inner, length = struct.unpack_from("<II", content)
            if inner == 100001:
                count, *wanted = struct.unpack(f"<{length // 4}I", content[8 : 8 + length])
                assert count == len(wanted) and set(wanted) <= {*have, 100004}
            elif inner == 100002:
                assert content[8:] == b"\1"  # streaming
                with self._lock:
                    client.sendall(self.static_packet())
                self._clients.append(client)

    def _static(self) -> list[bytes]:
        """Return stream, axes and subjects."""
        names = self.names
        anna = struct.pack("<I", 1) + self._name(SUBJECT) + struct.pack("<I", 2)
        for key, name in ((1, "Root"), (2, "LowerBody")):
            anna += struct.pack("<II6f", key - 1, key, *6 * [0.0]) + self._name(name)
        anna += struct.pack("<I", len(names))
        anna += b"".join(struct.pack("<I", 10 + k) + self._name(name) for k, name in enumerate(names))
        anna += struct.pack("<I", 0)  # attachments
        subjects = [self._block(2, anna)]
        for k, name in enumerate(self.bodies):
            row = struct.pack("<I", 2 + k) + self._name(name) + struct.pack("<I", 1)
            row += struct.pack("<II6f", 0, 1, *6 * [0.0]) + self._name(name) + struct.pack("<II", 0, 0)
            subjects.append(self._block(2, row))
        stream = self._block(1, struct.pack("<q", round(135e6 / self.capture.rate)))
        return [stream, self._block(37, b"\0"), *subjects]

    def _dynamic(self, frame: int) -> list[bytes]:
        place = 1000 * self.places(frame) @ Z_UP.T
        seen = np.flatnonzero(np.isfinite(place).all(axis=1)).tolist()
        recon = [struct.pack("<d3d9dI", 7.0, *place[k], *9 * [0.0], k) for k in seen]
        if self.labelled:
            recon = [struct.pack("<II", 1, 10 + k) + row for k, row in zip(seen, recon, strict=True)]
        blocks = [self._block(5, struct.pack("<I", frame))]
        blocks.append(self._block(6 if self.labelled else 7, struct.pack("<I", len(recon)) + b"".join(recon)))
        at = self.capture.index(frame)
        matrix = Z_UP @ quaternion_to_matrix(self.capture.body_rotation[at]) @ Z_UP.T
        for k in range(len(self.bodies)):
            row = struct.pack("<3d9d", *(1000 * Z_UP @ self.capture.body_position[at, k]), *matrix[k].ravel())
            blocks.append(self._block(9, struct.pack("<III", 2 + k, 1, 1) + row))
        return blocks

    def static_packet(self) -> bytes:
        """Return a packet with the subjects and a frame."""
        return self._packet(*self._static(), *self._dynamic(self.frame))

    def announce(self) -> None:
        """Send the subjects anew, after a change."""
        self._put(self.static_packet())

    def packets(self, frame: int) -> list[bytes]:
        return [self.static_packet(), self._packet(*self._dynamic(frame))]

    def _send(self, frame: int) -> None:
        self._put(self._packet(*self._dynamic(frame)))


class NatnetTwin(Twin):
    """Motive by NatNet, unicast: metres, +Y up. A client that is silent for 5 s gets no more frames."""

    kind = socket.SOCK_DGRAM
    version: tuple[int, int] = (4, 1)

    def __init__(self, *args, **fields) -> None:
        super().__init__(*args, **fields)
        self._clients: dict[tuple[str, int], float] = {}
        self.has_changed = False  # the flag of the next frame

    @staticmethod
    def _name(text: str) -> bytes:
        return text.encode() + b"\0"

    def _listen(self) -> None:
        while not self._ended.is_set():
            try:
                data, client = self._socket.recvfrom(2048)
            except OSError:
                return
            if not data:  # the socket is shut down
                return
            message, size = struct.unpack_from("<HH", data)
            if message == 0:
                assert data[4:8] == b"Ping" and size == len(data) - 4
                self._clients[client] = time.monotonic()
                self._socket.sendto(self._info(), client)
            elif message == 4:
                self._clients[client] = time.monotonic()
                self._socket.sendto(self._definitions(), client)
            elif message == 10 and client in self._clients:
                self._clients[client] = time.monotonic()

    def _info(self) -> bytes:
        info = b"Motive".ljust(256, b"\0") + bytes((3, 1, 0, 0)) + bytes((*self.version, 0, 0))
        info += struct.pack("<QH?4B", 10**7, 1511, False, 239, 255, 42, 99)
        return struct.pack("<HH", 1, len(info)) + info

    def packets(self, frame: int) -> list[bytes]:
        return [self._info(), self._definitions(), self._data(frame)]

    def _sized(self, content: bytes) -> bytes:
        return struct.pack("<i", len(content)) + content if self.version >= (4, 1) else content

    def _rigid(self, key: int, name: str, markers: int = 3) -> bytes:
        row = self._name(name) + struct.pack("<ii3f", key, -1, 0, 0, 0)
        row += struct.pack("<4f", 0, 0, 0, 1) if self.version >= (4, 2) else b""
        row += struct.pack("<i", markers) + markers * struct.pack("<3f", 0, 0, 0) + markers * struct.pack("<i", 0)
        return row + (b"".join(self._name(f"Marker{k + 1}") for k in range(markers)) if self.version >= (4, 0) else b"")

    def _definitions(self) -> bytes:
        names = self.names
        rows = [(0, self._name("all") + struct.pack("<i", len(names)) + b"".join(map(self._name, names)))]
        if names:
            anna = self._name(SUBJECT) + struct.pack("<i", len(names)) + b"".join(map(self._name, names))
            rows.append((0, anna))
        plate = struct.pack("<i", 1) + self._name("A1") + 4 * 163 * b"\0" + struct.pack("<i", 1) + self._name("Fx")
        rows.append((3, plate))
        rows += [(1, self._rigid(50 + k, name)) for k, name in enumerate(self.bodies)]
        bones = b"".join(self._rigid(k + 1, name, 0) for k, name in enumerate(("Root", "Chest")))
        rows.append((2, self._name(SUBJECT) + struct.pack("<ii", 1, 2) + bones))
        rows.append((5, self._name("Camera 1") + struct.pack("<7f", *7 * [0.0])))
        content = struct.pack("<i", len(rows))
        content += b"".join(struct.pack("<i", kind) + self._sized(row) for kind, row in rows)
        return struct.pack("<HH", 5, len(content)) + content

    def _section(self, count: int, content: bytes) -> bytes:
        return struct.pack("<i", count) + self._sized(content)

    def _data(self, frame: int) -> bytes:
        place = self.places(frame)
        hidden = np.asarray(~np.isfinite(place).all(axis=1))
        place = np.nan_to_num(place, nan=0.25)  # a position that Motive guesses
        named = place if self.labelled else place[:0]
        rows = struct.pack("<i", len(named)) + named.astype("<f4").tobytes()
        sets = [self._name("all") + rows, *([self._name(SUBJECT) + rows] if self.labelled else [])]
        unnamed = place[:0] if self.labelled else place[~hidden]
        content = struct.pack("<i", frame) + self._section(len(sets), b"".join(sets))
        content += self._section(len(unnamed), unnamed.astype("<f4").tobytes())
        at = self.capture.index(frame)
        bodies = b""
        for k in range(len(self.bodies)):
            w, x, y, z = self.capture.body_rotation[at, k]
            bodies += struct.pack("<i7ffh", 50 + k, *self.capture.body_position[at, k], x, y, z, w, 0.0, 1)
        content += self._section(len(self.bodies), bodies)
        content += self._section(1, struct.pack("<ii", 1, 0))  # a skeleton without bones
        if self.version >= (4, 1):
            content += self._section(0, b"")  # assets
        markers = b"".join(
            struct.pack("<I3ffhf", 1 << 16 | k + 1, *named[k], 0.014, 1 if hidden[k] else 10, 0.0)
            for k in range(len(named))
        )
        markers += b"".join(struct.pack("<I3ffhf", 5000 + k, *row, 0.014, 16, 0.0) for k, row in enumerate(unnamed))
        content += self._section(len(named) + len(unnamed), markers)
        plate = struct.pack("<iiif", 1, 1, 1, 9.81)
        content += self._section(1, plate) + self._section(0, b"")
        content += struct.pack("<IId3Q", 0, 0, frame / self.capture.rate, 1, 2, 3)
        content += struct.pack("<II", 1, 2) if self.version >= (4, 1) else b""
        content += struct.pack("<hi", 2 if self.has_changed else 0, 0)
        self.has_changed = False
        return struct.pack("<HH", 7, len(content)) + content

    def _send(self, frame: int) -> None:
        packet = self._data(frame)
        for client, heard in list(self._clients.items()):
            if time.monotonic() - heard < 5:
                with suppress(OSError):
                    self._socket.sendto(packet, client)
