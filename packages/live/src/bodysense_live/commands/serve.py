"""`bodysense serve`: the live server."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import tyro

from bodysense.cli.options import Reading
from bodysense.cli.ranges import Processes, Sessions
from bodysense.devices.simulated.device import DeviceName
from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.io.rigs.options import AS_FOUND
from bodysense_live.commands.serve_options import (
    access_of,
    address_of,
    named_of,
    playable_of,
    receiver_of,
    trackers_of,
    worn_of,
    writable_folder,
)

Addresses = Annotated[tuple[str, ...], tyro.conf.UseAppendAction]


def serve(
    host: str = "127.0.0.1",
    port: int = 8765,
    token: str | None = None,
    origin: Addresses = (),
    lan: bool = False,
    certificate: Path | None = None,
    key: Path | None = None,
    replay: Path | None = None,
    device: DeviceName | None = None,
    person: Path | None = None,
    save_person: Path | None = None,
    vmc_in: int | None = None,
    markers_in: int | None = None,
    device_names: Path | None = None,
    vmt: bool = False,
    vmt_host: str = "127.0.0.1",
    vmt_port: int = 39575,
    vmt_first: int = 0,
    vmt_hands: bool = False,
    vrchat: bool = False,
    vrchat_host: str = "127.0.0.1",
    vrchat_trackers: Annotated[str, tyro.conf.arg(metavar="PART,PART")] = "hip,feet",
    solarxr: bool = False,
    solarxr_port: int = 21110,
    slimevr: bool = False,
    slimevr_host: str = "0.0.0.0",
    slimevr_port: int = 6969,
    marker_set: str | None = None,
    vmc_out: Addresses = (),
    vrchat_out: Addresses = (),
    bridge: bool = False,
    allow_record: Path | None = None,
    seated: bool = False,
    recentre: bool = False,
    smoothing: float = 0.0,
    sessions: Sessions = 64,
    workers: Processes = 1,
    shared: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Serve the page and the WebSocket for live tracking; avatars by VMC and VRChat (docs/serve.md).

    Args:
        host: address to listen on; any but a loopback address needs a token, which is made if omitted.
        port: TCP port; 0 for any free port.
        token: what clients must present, at least 8 characters.
        origin: origin of a page on another server that may connect, such as http://localhost:5173. Repeatable.
        lan: admit headsets and phones of this network: encrypted, at an address that is printed with a QR code.
        certificate: PEM file of a certificate, in place of the one made for --lan.
        key: PEM file of its key.
        replay: recording (.npz, .jsonl), or with --device a motion (.bvh, AMASS .npz), played in real time.
        device: device that watches the body if the replay is a motion; the page then shows the true motion, too.
        person: person's file (.json) with the wearers' proportions and how trackers are worn.
        save_person: file (.json) for the wearer of the server's own inputs, written after each calibration; may be the
            file of --person, even if it does not exist yet.
        vmc_in: UDP port for headset, controllers and trackers by VMC (usually 39539).
        markers_in: UDP port for markers of gloves by OSC (usually 9123).
        device_names: JSON table of devices of VMC, SteamVR or SlimeVR: serial to point (docs/avatars.md).
        vmt: take headset and controllers from SteamVR and give it trackers, by its driver VMT (docs/runtimes.md).
        vmt_host: machine of SteamVR.
        vmt_port: UDP port for answers of VMT's driver.
        vmt_first: index of the first virtual device; others may use those below.
        vmt_hands: give SteamVR skeletal hands, too, as two virtual controllers.
        vrchat: find VRChat by OSCQuery, take head and wrists from it and give it trackers (docs/runtimes.md).
        vrchat_host: machine of VRChat.
        vrchat_trackers: trackers that VRChat is sent: a list of hip, feet, knees, chest, elbows.
        solarxr: take the headset of Monado or WiVRn, on Linux, and give them trackers and a body (docs/runtimes.md).
        solarxr_port: TCP port of this machine for SlimeVR's own programs; 0 for any free port.
        slimevr: take SlimeVR's trackers, which find this machine in the network (docs/runtimes.md).
        slimevr_host: address of this machine for SlimeVR's trackers; all addresses, if omitted.
        slimevr_port: UDP port for SlimeVR's trackers.
        marker_set: marker set of the gloves, a file or the name of a packaged set (docs/gloves.md); the person's file
            has hands that were calibrated with it.
        vmc_out: HOST:PORT of an avatar program that takes bones by VMC (usually port 39539). Repeatable.
        vrchat_out: HOST:PORT of a VRChat that takes trackers by OSC (usually port 9000). Repeatable.
        bridge: let pages of any origin send their bodies to those programs, with the token of the printed address.
        allow_record: folder for recordings that clients ask for; recording is off if omitted.
        seated: show the seated wearer of the server's own inputs as standing.
        recentre: use that wearer's first position and heading as the origin, facing +Z.
        smoothing: half-life in seconds, 0 to 0.5, of the smoothing of that wearer's body, which is as much later.
        sessions: maximum number of sessions in each process.
        workers: number of processes that share the port; one that ends is replaced.
        shared: address of a Valkey or Redis, such as redis://10.0.0.2:6379, by which workers, and several servers
            behind one address, resume one another's sessions.
        reading: properties of a replayed motion; --height is the wearers', inferred if omitted; --floor is of the
            world of VMC, SteamVR and VRChat, too.
    """
    from rich.console import Console

    from bodysense.body.person import Person
    from bodysense.cli.recordings import person_of
    from bodysense_live.certificate import qr_code
    from bodysense_live.launch import serve
    from bodysense_live.links import listen_tcp
    from bodysense_live.messages import LONGEST_HALF_LIFE, Settings
    from bodysense_live.safety import ANY_ORIGIN, Limits
    from bodysense_live.session_store import check_store
    from bodysense_live.settings import ServerSettings
    from bodysense_live.slimevr_link import SlimevrSettings
    from bodysense_live.solarxr_link import SolarxrSettings, runtime_folder
    from bodysense_live.vmc import VmcTrackers
    from bodysense_live.vmt_link import VmtSettings
    from bodysense_live.vrchat_link import VrchatSettings
    from bodysense_live.workers import serve_in_workers
    from bodysense_live.worn_trackers import read_trackers

    if save_person is not None:
        check_place(save_person)
    if not 0 <= smoothing <= LONGEST_HALF_LIFE:
        raise BodysenseError(f"--smoothing {smoothing:g}: give seconds, 0 to {LONGEST_HALF_LIFE:g}")
    others = (vmc_in, markers_in, vmc_out, vrchat_out, vmt, vrchat, slimevr, solarxr)
    if workers > 1 and others != (None, None, (), (), False, False, False, False):
        raise BodysenseError("--workers: UDP goes with one process only; leave --workers out")
    devices, joints = named_of(device_names, vmc_in is not None or vmt, slimevr)
    if bridge and not (vmc_out or vrchat_out or vmt or vrchat or solarxr):
        raise BodysenseError(
            "--bridge has nowhere to send to; give --vmc-out, --vrchat-out, --vrchat, --vmt or --solarxr"
        )
    parts = trackers_of(vrchat_trackers)
    access = access_of(host, token, (*origin, ANY_ORIGIN) if bridge else origin, lan, certificate, key)
    if person is not None and person == save_person and not person.exists():
        person = None  # written after the first calibration
    wearer = person_of(person, reading.height) or Person(height=reading.height)
    settings = ServerSettings(
        access=access,
        limits=replace(Limits(), sessions=sessions),
        allow_record=None if allow_record is None else writable_folder("--allow-record", allow_record),
        playable=playable_of(replay, device, reading, wearer),
        person=wearer,
        wearer=Settings(floor=reading.floor or 0.0, posture="seated" if seated else "standing", smoothing=smoothing),
        recentre=recentre,
        save_person=save_person,
        trackers={} if person is None else read_trackers(person),
        shared=None if shared is None else check_store(shared),
        vmc_in=vmc_in,
        vmc_trackers=VmcTrackers(devices),
        markers_in=markers_in,
        worn=worn_of(marker_set, markers_in, wearer),
        receivers=(
            *(receiver_of("vmc", address, parts) for address in vmc_out),
            *(receiver_of("vrchat", address, parts) for address in vrchat_out),
        ),
        vmt=VmtSettings(vmt_host, port=vmt_port, first=vmt_first, hands=vmt_hands, devices=devices) if vmt else None,
        vrchat=VrchatSettings(vrchat_host, parts=parts) if vrchat else None,
        solarxr=SolarxrSettings(runtime_folder(os.environ), solarxr_port) if solarxr else None,
        slimevr=SlimevrSettings(slimevr_host, slimevr_port, joints) if slimevr else None,
    )
    bound = listen_tcp("--port", access.host, port)
    address = address_of(access, bound.getsockname()[1], lan)

    def started() -> None:
        console = Console()
        console.print(f"bodysense serves at {address}", highlight=False, soft_wrap=True)
        if bridge:
            text = f"for a page elsewhere, under Settings, Send to a bridge: {address.replace('http', 'ws', 1)}"
            console.print(text, highlight=False, soft_wrap=True)
        if lan:
            print(qr_code(address))

    if workers == 1:
        serve(settings, [bound], lambda server: started())
    else:
        serve_in_workers(settings, bound, workers, started)
