"""`bodysense serve`: the live server."""

from __future__ import annotations

import secrets
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from bodysense.cli.options import Reading
from bodysense.devices.simulated import DeviceName
from bodysense.errors import BodysenseError
from bodysense.rigs.options import AS_FOUND, ReadingOptions

if TYPE_CHECKING:
    from bodysense.body.person import Person
    from bodysense.serve.datagrams import Receiver
    from bodysense.serve.replay import Playable

Addresses = Annotated[tuple[str, ...], tyro.conf.UseAppendAction]


def serve(
    host: str = "127.0.0.1",
    port: int = 8765,
    token: str | None = None,
    origin: Addresses = (),
    replay: Path | None = None,
    device: DeviceName | None = None,
    person: Path | None = None,
    vmc_in: int | None = None,
    markers_in: int | None = None,
    device_names: Path | None = None,
    vmt: bool = False,
    vmt_host: str = "127.0.0.1",
    vmt_port: int = 39575,
    vmt_first: int = 0,
    vmt_hands: bool = False,
    vmc_out: Addresses = (),
    vrchat_out: Addresses = (),
    allow_record: Path | None = None,
    sessions: int = 64,
    workers: int = 1,
    reading: Reading = AS_FOUND,
) -> None:
    """Serve the page and the WebSocket for live tracking; avatars by VMC and VRChat (docs/serve.md).

    Args:
        host: Address to listen on. Any but this machine's own needs a token, which is made where none is given.
        port: TCP port; 0 takes any that is free.
        token: What clients must show, at least 8 characters.
        origin: Origin of a page elsewhere that may connect, as http://localhost:5173. Repeatable.
        replay: A recording (.npz, .jsonl), or with --device a motion (.bvh, AMASS .npz), played in real time.
        device: What watches the body, where the replay is a motion; the page then shows the truth, too.
        person: wearers' proportions and how trackers are worn, a person's file (.json).
        vmc_in: UDP port on which headset, controllers and trackers come in by VMC (its own is 39539).
        markers_in: UDP port on which markers of gloves come in by OSC (its own is 9123).
        device_names: Which point each device of VMC or SteamVR is, a .json table by serial (docs/avatars.md).
        vmt: Take headset and controllers from SteamVR and give it trackers, by its driver VMT (docs/runtimes.md).
        vmt_host: Machine of SteamVR.
        vmt_port: UDP port on which VMT's driver answers.
        vmt_first: Index of the first virtual device; others may use those below.
        vmt_hands: Give SteamVR skeletal hands, too, as two virtual controllers.
        vmc_out: HOST:PORT of an avatar program that takes bones by VMC (usually port 39539). Repeatable.
        vrchat_out: HOST:PORT of a VRChat that takes trackers by OSC (usually port 9000). Repeatable.
        allow_record: Folder for recordings that clients ask for; without it none are made.
        sessions: At most so many at a time, in each process.
        workers: Processes that share the port.
        reading: what a replayed motion does not say of itself; --height is the wearers', inferred if omitted.
    """
    from rich.console import Console

    from bodysense.body.person import Person
    from bodysense.cli.recordings import person_of
    from bodysense.serve.launch import listen, serve
    from bodysense.serve.safety import Access, Limits, is_loopback
    from bodysense.serve.settings import ServerSettings
    from bodysense.serve.tracked_devices import TrackedDevices, read_device_names
    from bodysense.serve.vmc_trackers import VmcTrackers
    from bodysense.serve.vmt_link import VmtSettings
    from bodysense.serve.workers import serve_in_workers

    if workers < 1:
        raise BodysenseError(f"--workers {workers}: give 1 or more")
    if workers > 1 and (vmc_in, markers_in, vmc_out, vrchat_out, vmt) != (None, None, (), (), False):
        raise BodysenseError("--workers: UDP goes with one process only; leave --workers out")
    if device_names is not None and vmc_in is None and not vmt:
        raise BodysenseError("--device-names is for devices of VMC or SteamVR; give --vmc-in or --vmt")
    devices = TrackedDevices() if device_names is None else TrackedDevices(read_device_names(device_names))
    if token is None and not is_loopback(host):
        token = secrets.token_urlsafe(16)
    wearer = person_of(person, reading.height) or Person(height=reading.height)
    settings = ServerSettings(
        access=Access(host, token, origin),
        limits=replace(Limits(), sessions=sessions),
        allow_record=None if allow_record is None else _folder(allow_record),
        playable=_playable(replay, device, reading, wearer),
        person=wearer,
        vmc_in=vmc_in,
        vmc_trackers=VmcTrackers(devices),
        markers_in=markers_in,
        receivers=tuple([*(_receiver("vmc", a) for a in vmc_out), *(_receiver("vrchat", a) for a in vrchat_out)]),
        vmt=VmtSettings(vmt_host, port=vmt_port, first=vmt_first, hands=vmt_hands, devices=devices) if vmt else None,
    )
    bound = listen(host, port)
    shown = f"[{host}]" if ":" in host else host
    address = f"http://{shown}:{bound.getsockname()[1]}/" + (f"?token={token}" if token is not None else "")

    def started() -> None:
        Console().print(f"bodysense serves at {address}", highlight=False, soft_wrap=True)

    if workers == 1:
        serve(settings, [bound], lambda server: started())
    else:
        serve_in_workers(settings, bound, workers, started)


def _folder(path: Path) -> Path:
    """A folder that can be written to."""
    import tempfile

    if not path.is_dir():
        raise BodysenseError(f"--allow-record {path}: no such folder; create it or choose another")
    try:
        with tempfile.TemporaryFile(dir=path):
            return path.resolve()
    except OSError as error:
        raise BodysenseError(f"--allow-record {path}: nothing can be written there ({error.strerror})") from None


def _receiver(protocol: Literal["vmc", "vrchat"], address: str) -> Receiver:
    from bodysense.serve.datagrams import Receiver

    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise BodysenseError(f"--{protocol}-out {address}: give HOST:PORT, as 127.0.0.1:39539")
    return Receiver(protocol, host.strip("[]"), int(port))


def _playable(file: Path | None, device: str | None, reading: ReadingOptions, wearer: Person) -> Playable | None:
    """What is replayed: a recording, or what a device tracks of a motion, with its truth."""
    from bodysense.body.person import Person
    from bodysense.capture.recording import is_recording, read_recording
    from bodysense.cli.recordings import load_clip
    from bodysense.devices.simulated import DEVICES, simulate
    from bodysense.serve.replay import Playable

    if file is None:
        if device is not None:
            raise BodysenseError("--device is for a motion that is replayed; give it with --replay")
        return None
    if not file.is_file():
        raise BodysenseError(f"--replay {file}: no such file")
    if is_recording(file):
        if device is not None:
            raise BodysenseError(f"--replay {file}: a recording; leave --device out")
        recording = read_recording(file)
        told = recording.told and reading.height is None
        return Playable(recording.observation, Person(recording.skeleton) if told else wearer)
    if device is None:
        raise BodysenseError(
            f"--replay {file}: not a recording; if it is a motion, say what watches it: --device headset_camera "
            f"or another of {', '.join(DEVICES)}"
        )
    clip = load_clip(file, reading)
    return Playable(simulate(clip, device), Person(clip.pose.skeleton), clip.pose)
