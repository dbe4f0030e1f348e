"""OSCQuery: our OSC addresses as a JSON tree over HTTP, by which VRChat finds them and sends to them.

Source: the OSCQuery proposal (Vidvox) and VRChat's library for it. VRChat sends its tracking to every service whose
tree has `/tracking/vrsystem`. The answers contain no secrets, and requests cannot change anything.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote, urlsplit

from bodysense.errors import missing_package

_NO_ACCESS, _WRITE = 0, 2
_ATTRIBUTES = ("DESCRIPTION", "FULL_PATH", "ACCESS", "CONTENTS", "TYPE", "VALUE")
_TIMEOUT = 5.0  # s for a request
_MOST_CONNECTIONS = 32
_LONGEST_REQUEST = 8192  # bytes


@dataclass(frozen=True)
class OscAddress:
    """An accepted address: its OSC types and its description."""

    types: str
    description: str


@dataclass(frozen=True)
class OscService:
    """An announced receiver of OSC."""

    name: str
    host: str
    port: int  # UDP
    addresses: Mapping[str, OscAddress]

    def host_info(self) -> dict[str, Any]:
        """Return HOST_INFO: the port for OSC, and the supported attributes of OSCQuery."""
        known = {"ACCESS": True, "CLIPMODE": False, "RANGE": False, "TYPE": True, "VALUE": True}
        return {
            "NAME": self.name,
            "OSC_IP": self.host,
            "OSC_PORT": self.port,
            "OSC_TRANSPORT": "UDP",
            "EXTENSIONS": known,
        }

    def tree(self) -> dict[str, Any]:
        """Return the root node of all addresses."""
        root = _container("/")
        for address, description in self.addresses.items():
            node, path = root, ""
            *folders, last = address.strip("/").split("/")
            for folder in folders:
                path += f"/{folder}"
                node = node["CONTENTS"].setdefault(folder, _container(path))
            node["CONTENTS"][last] = {
                "DESCRIPTION": description.description,
                "FULL_PATH": address,
                "ACCESS": _WRITE,
                "TYPE": description.types,
            }
        return root

    def answer(self, target: str) -> tuple[int, Any]:
        """Return status and JSON of a GET; None for the JSON if a node lacks the requested attribute."""
        place = urlsplit(target)
        if "HOST_INFO" in (place.path.strip("/"), place.query):
            return 200, self.host_info()
        node: dict[str, Any] = self.tree()
        for part in filter(None, unquote(place.path).split("/")):
            inside = node.get("CONTENTS", {})
            if part not in inside:
                return 404, {"error": "no such address"}
            node = inside[part]
        if not place.query:
            return 200, node
        if place.query not in _ATTRIBUTES:
            return 400, {"error": f"attributes are {', '.join(_ATTRIBUTES)}"}
        return (200, {place.query: node[place.query]}) if place.query in node else (204, None)


def _container(path: str) -> dict[str, Any]:
    return {"DESCRIPTION": "", "FULL_PATH": path, "ACCESS": _NO_ACCESS, "CONTENTS": {}}


class OscQueryServer:
    """An HTTP server that answers one request per connection."""

    def __init__(self, service: OscService) -> None:
        try:
            import h11  # noqa: F401
        except ImportError as error:
            raise missing_package(error) from None
        self._service = service
        self._open = 0
        self._server: asyncio.Server | None = None

    async def start(self, bound: socket.socket) -> None:
        """Serve on a TCP socket."""
        self._server = await asyncio.start_server(self._serve, sock=bound, limit=_LONGEST_REQUEST)

    def close(self) -> None:
        """Stop serving."""
        if self._server is not None:
            self._server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._open += 1
        try:
            if self._open <= _MOST_CONNECTIONS:
                async with asyncio.timeout(_TIMEOUT):
                    await self._answer(reader, writer)
        except (OSError, TimeoutError):  # the client is gone, or silent
            return
        finally:
            self._open -= 1
            writer.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        import h11

        connection = h11.Connection(h11.SERVER, max_incomplete_event_size=_LONGEST_REQUEST)
        status, found = 400, {"error": "GET an address, or ?HOST_INFO"}
        with contextlib.suppress(h11.RemoteProtocolError, ValueError):  # not HTTP, or an invalid address
            while (event := connection.next_event()) is h11.NEED_DATA:
                connection.receive_data(await reader.read(_LONGEST_REQUEST))
            if isinstance(event, h11.ConnectionClosed):
                return
            if isinstance(event, h11.Request) and event.method == b"GET":
                status, found = self._service.answer(event.target.decode("latin-1"))
        body = b"" if found is None else json.dumps(found).encode()
        headers = [("Connection", "close"), ("Cache-Control", "no-store")]
        if found is not None:
            headers += [("Content-Type", "application/json"), ("Content-Length", str(len(body)))]
        for part in (h11.Response(status_code=status, headers=headers), h11.Data(data=body), h11.EndOfMessage()):
            writer.write(connection.send(part) or b"")
        await writer.drain()
