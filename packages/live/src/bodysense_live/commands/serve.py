"""`bodysense serve`: the live server."""

from __future__ import annotations

from typing import Annotated

import tyro

from bodysense.cli.options import Reading
from bodysense.io.reading_options import AS_FOUND
from bodysense_live.commands.serve_options import (
    AccessOptions,
    InputOptions,
    LoadOptions,
    ProgramOptions,
    WearerOptions,
)


def serve(
    access: Annotated[AccessOptions, tyro.conf.OmitArgPrefixes] = AccessOptions(),
    wearer: Annotated[WearerOptions, tyro.conf.OmitArgPrefixes] = WearerOptions(),
    inputs: Annotated[InputOptions, tyro.conf.OmitArgPrefixes] = InputOptions(),
    programs: Annotated[ProgramOptions, tyro.conf.OmitArgPrefixes] = ProgramOptions(),
    load: Annotated[LoadOptions, tyro.conf.OmitArgPrefixes] = LoadOptions(),
    reading: Reading = AS_FOUND,
) -> None:
    """Serve the page and the WebSocket for live tracking; send bodies to avatars (docs/serve.md).

    Args:
        access: addresses to listen on, and clients that may connect.
        wearer: the wearer of the server's own inputs.
        inputs: recordings that the server plays, signals that it receives by UDP, and servers of markers.
        programs: programs that send trackers, or receive bodies (docs/runtimes.md).
        load: sessions, processes and recordings.
        reading: properties of a replayed motion or of --markers; --height is also that of wearers, inferred if omitted,
            and --floor also that of VMC, SteamVR and VRChat.
    """
    from rich.console import Console

    from bodysense_live.commands.serve_settings import address_of, settings_of
    from bodysense_live.processes.pool import serve_in_workers
    from bodysense_live.protocols.links import listen_tcp
    from bodysense_live.security.certificate import qr_code
    from bodysense_live.server.launch import serve

    settings = settings_of(access, wearer, inputs, programs, load, reading)
    bound = listen_tcp("--port", settings.access.host, access.port)
    address = address_of(settings.access, bound.getsockname()[1], access.lan)

    def started() -> None:
        console = Console()
        console.print(f"bodysense serves at {address}", highlight=False, soft_wrap=True)
        if access.bridge:
            text = f"for a page elsewhere, under Settings, Send to a bridge: {address.replace('http', 'ws', 1)}"
            console.print(text, highlight=False, soft_wrap=True)
        if access.lan:
            print(qr_code(address))

    if load.workers == 1:
        serve(settings, [bound], lambda server: started())
    else:
        serve_in_workers(settings, bound, load.workers, started)
