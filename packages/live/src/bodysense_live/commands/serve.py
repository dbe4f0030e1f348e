"""`bodysense serve`: the live server."""

from __future__ import annotations

import os
import secrets
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from bodysense.cli.options import Reading
from bodysense.devices.simulated.device import DeviceName
from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.io.rigs.options import AS_FOUND, ReadingOptions

if TYPE_CHECKING:
    from bodysense.body.glove_set import GloveSet
    from bodysense.body.person import Person
    from bodysense_live.datagrams import Receiver
    from bodysense_live.replay import Playable
    from bodysense_live.safety import Access
    from bodysense_live.tracked_devices import TrackedDevices

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
    sessions: int = 64,
    workers: int = 1,
    shared: Path | None = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Serve the page and the WebSocket for live tracking; avatars by VMC and VRChat (docs/serve.md).

    Args:
        host: Address to listen on. Any but this machine's own needs a token, which is made where none is given.
        port: TCP port; 0 takes any that is free.
        token: What clients must show, at least 8 characters.
        origin: Origin of a page elsewhere that may connect, as http://localhost:5173. Repeatable.
        lan: Let headsets and phones of this network in: encrypted, at an address that is printed with a QR code.
        certificate: PEM file of a certificate, in place of one that is made for --lan.
        key: PEM file of its key.
        replay: A recording (.npz, .jsonl), or with --device a motion (.bvh, AMASS .npz), played in real time.
        device: What watches the body, where the replay is a motion; the page then shows the truth, too.
        person: wearers' proportions and how trackers are worn, a person's file (.json).
        save_person: File (.json) for who VMC or SteamVR track, written after each calibration.
        vmc_in: UDP port on which headset, controllers and trackers come in by VMC (its own is 39539).
        markers_in: UDP port on which markers of gloves come in by OSC (its own is 9123).
        device_names: Which point each device of VMC, SteamVR or SlimeVR is, a .json table by serial (docs/avatars.md).
        vmt: Take headset and controllers from SteamVR and give it trackers, by its driver VMT (docs/runtimes.md).
        vmt_host: Machine of SteamVR.
        vmt_port: UDP port on which VMT's driver answers.
        vmt_first: Index of the first virtual device; others may use those below.
        vmt_hands: Give SteamVR skeletal hands, too, as two virtual controllers.
        vrchat: Find VRChat by OSCQuery, take head and wrists from it and give it trackers (docs/runtimes.md).
        vrchat_host: Machine of VRChat.
        solarxr: Take the headset of Monado or WiVRn, on Linux, and give them trackers and a body (docs/runtimes.md).
        solarxr_port: TCP port of this machine for SlimeVR's own programs; 0 takes any that is free.
        slimevr: Take SlimeVR's trackers, which find this machine in the network by themselves (docs/runtimes.md).
        slimevr_host: Address of this machine at which they are heard; all, if omitted.
        slimevr_port: UDP port at which they are heard.
        marker_set: Marker set of the gloves, a file or a packaged set's name (docs/gloves.md); the person's file holds
            hands that were calibrated with it.
        vmc_out: HOST:PORT of an avatar program that takes bones by VMC (usually port 39539). Repeatable.
        vrchat_out: HOST:PORT of a VRChat that takes trackers by OSC (usually port 9000). Repeatable.
        bridge: Let pages anywhere send their bodies, with the token of the address that is printed, to those programs.
        allow_record: Folder for recordings that clients ask for; without it none are made.
        seated: Whoever those inputs track is seated, and shown standing.
        recentre: Where they stand when they are first tracked, and face, is the middle, facing +Z.
        sessions: At most so many at a time, in each process.
        workers: Processes that share the port; one that ends is replaced, its wearers resume in another.
        shared: Folder by which several servers behind one address resume one another's sessions.
        reading: what a replayed motion does not say of itself; --height is the wearers', inferred if omitted;
            --floor is of the world of VMC, SteamVR and VRChat, too.
    """
    from rich.console import Console

    from bodysense.body.person import Person
    from bodysense.cli.recordings import person_of
    from bodysense_live.certificate import qr_code
    from bodysense_live.launch import serve
    from bodysense_live.links import listen_tcp
    from bodysense_live.messages import Settings
    from bodysense_live.safety import ANY_ORIGIN, Limits
    from bodysense_live.settings import ServerSettings
    from bodysense_live.slimevr_link import SlimevrSettings
    from bodysense_live.solarxr_link import SolarxrSettings, runtime_folder
    from bodysense_live.vmc import VmcTrackers
    from bodysense_live.vmt_link import VmtSettings
    from bodysense_live.vrchat_link import VrchatSettings
    from bodysense_live.workers import serve_in_workers

    if save_person is not None:
        check_place(save_person)
    if workers < 1:
        raise BodysenseError(f"--workers {workers}: give 1 or more")
    others = (vmc_in, markers_in, vmc_out, vrchat_out, vmt, vrchat, slimevr, solarxr)
    if workers > 1 and others != (None, None, (), (), False, False, False, False):
        raise BodysenseError("--workers: UDP goes with one process only; leave --workers out")
    devices, joints = _named(device_names, vmc_in is not None or vmt, slimevr)
    if bridge and not (vmc_out or vrchat_out or vmt or vrchat or solarxr):
        raise BodysenseError(
            "--bridge has nowhere to send to; give --vmc-out, --vrchat-out, --vrchat, --vmt or --solarxr"
        )
    origin = (*origin, ANY_ORIGIN) if bridge else origin
    access = _access(host, token, origin, lan, certificate, key)
    wearer = person_of(person, reading.height) or Person(height=reading.height)
    settings = ServerSettings(
        access=access,
        limits=replace(Limits(), sessions=sessions),
        allow_record=None if allow_record is None else _folder("--allow-record", allow_record),
        playable=_playable(replay, device, reading, wearer),
        person=wearer,
        wearer=Settings(floor=reading.floor or 0.0, posture="seated" if seated else "standing"),
        recentre=recentre,
        save_person=save_person,
        shared=None if shared is None else _folder("--shared", shared),
        vmc_in=vmc_in,
        vmc_trackers=VmcTrackers(devices),
        markers_in=markers_in,
        worn=_worn(marker_set, markers_in, wearer),
        receivers=tuple([*(_receiver("vmc", a) for a in vmc_out), *(_receiver("vrchat", a) for a in vrchat_out)]),
        vmt=VmtSettings(vmt_host, port=vmt_port, first=vmt_first, hands=vmt_hands, devices=devices) if vmt else None,
        vrchat=VrchatSettings(vrchat_host) if vrchat else None,
        solarxr=SolarxrSettings(runtime_folder(os.environ), solarxr_port) if solarxr else None,
        slimevr=SlimevrSettings(slimevr_host, slimevr_port, joints) if slimevr else None,
    )
    bound = listen_tcp("--port", access.host, port)
    address = _address(access, bound.getsockname()[1], lan)

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


def _named(table: Path | None, steamvr: bool, slimevr: bool) -> tuple[TrackedDevices, dict[str, str]]:
    """What a table says of devices by their serials, and of SlimeVR's trackers by theirs.

    Raises BodysenseError, naming the option, for devices of what is not there: VMC or SteamVR, SlimeVR.
    """
    from bodysense_live.slimevr_link import is_serial
    from bodysense_live.tracked_devices import TrackedDevices, read_device_names

    if table is not None and not steamvr and not slimevr:
        raise BodysenseError(
            "--device-names is for devices of VMC, SteamVR or SlimeVR; give --vmc-in, --vmt or --slimevr"
        )
    names = {} if table is None else read_device_names(table)
    joints = {serial.upper(): point for serial, point in names.items() if is_serial(serial.upper())}
    devices = {serial: point for serial, point in names.items() if not is_serial(serial.upper())}
    if joints and not slimevr:
        raise BodysenseError(f"--device-names {table}: {next(iter(joints))} is a SlimeVR tracker; give --slimevr")
    if devices and not steamvr:
        raise BodysenseError(
            f"--device-names {table}: {next(iter(devices))!r} is a device of VMC or SteamVR; give --vmc-in or --vmt"
        )
    return TrackedDevices(devices), joints


def _access(
    host: str, token: str | None, origin: Addresses, lan: bool, certificate: Path | None, key: Path | None
) -> Access:
    """Who may connect, and how. Raises BodysenseError, naming the options, for what does not go together."""
    from bodysense_live.certificate import check_pair, lan_address, own_certificate, state_folder
    from bodysense_live.safety import ANY_ORIGIN, Access, is_loopback

    if (certificate is None) != (key is None):
        raise BodysenseError("--certificate and --key: give both, a certificate and its own key")
    if lan and is_loopback(host):
        address = lan_address()
        host = "0.0.0.0"
        if certificate is None:
            certificate, key = own_certificate(state_folder(), (address, "localhost", "127.0.0.1"))
    if certificate is not None and key is not None:
        check_pair(certificate, key)
    if token is None and (ANY_ORIGIN in origin or not is_loopback(host)):
        token = secrets.token_urlsafe(16)
    return Access(host, token, origin, certificate, key)


def _address(access: Access, port: int, lan: bool) -> str:
    """Where the page is."""
    from bodysense_live.certificate import lan_address

    host = lan_address() if lan and access.host == "0.0.0.0" else access.host
    shown = f"[{host}]" if ":" in host else host
    scheme = "http" if access.certificate is None else "https"
    return f"{scheme}://{shown}:{port}/" + (f"?token={access.token}" if access.token is not None else "")


def _worn(marker_set: str | None, port: int | None, wearer: Person) -> GloveSet:
    """The marker set of gloves that come in; another than the standard one needs calibrated hands."""
    from bodysense.body.glove_set import read_set, standard_set

    if marker_set is None:
        return standard_set()
    if port is None:
        raise BodysenseError(f"--marker-set {marker_set}: for gloves that come in; give their port with --markers-in")
    worn = read_set(marker_set)
    known = [side for side, hand in wearer.hands.items() if hand.glove.markers == worn.names]
    if worn.names != standard_set().names and not known:
        raise BodysenseError(
            f"--marker-set {marker_set}: no hand is calibrated with it; do so first: bodysense track TAKE.c3d "
            f"--marker-set {marker_set} -o OUT.bvh --save-person ME.json, then serve --person ME.json"
        )
    return worn


def _folder(option: str, path: Path) -> Path:
    """A folder that can be written to."""
    import tempfile

    if not path.is_dir():
        raise BodysenseError(f"{option} {path}: no such folder; create it or choose another")
    try:
        with tempfile.TemporaryFile(dir=path):
            return path.resolve()
    except OSError as error:
        raise BodysenseError(f"{option} {path}: nothing can be written there ({error.strerror})") from None


def _receiver(protocol: Literal["vmc", "vrchat"], address: str) -> Receiver:
    from bodysense_live.datagrams import Receiver

    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise BodysenseError(f"--{protocol}-out {address}: give HOST:PORT, as 127.0.0.1:39539")
    return Receiver(protocol, host.strip("[]"), int(port))


def _playable(file: Path | None, device: str | None, reading: ReadingOptions, wearer: Person) -> Playable | None:
    """What is replayed: a recording, or what a device tracks of a motion, with its truth."""
    from bodysense.body.person import Person
    from bodysense.cli.recordings import load_clip
    from bodysense.devices.simulated.device import DEVICES, simulate
    from bodysense.io.recording import is_recording, read_recording
    from bodysense_live.replay import Playable

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
