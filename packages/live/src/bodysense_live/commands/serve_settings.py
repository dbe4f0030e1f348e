"""Settings of a server from the options of `bodysense serve`, checked before anything is served."""

from __future__ import annotations

import os
import secrets
import tempfile
from dataclasses import fields, replace
from pathlib import Path
from typing import Literal
from urllib.parse import quote

from bodysense.body.hands.glove_set import GloveSet, read_set, standard_set
from bodysense.body.hands.hand import Side
from bodysense.body.person import Person
from bodysense.cli.recordings import load_clip, person_of
from bodysense.devices.simulated.device import DEVICES, simulate
from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.io.formats.recording import is_recording
from bodysense.io.markers.options import MarkerOptions
from bodysense.io.reading_options import ReadingOptions, given_options
from bodysense.sources.open import RecordingSource, open_source
from bodysense_live.commands.serve_options import (
    AccessOptions,
    InputOptions,
    LoadOptions,
    ProgramOptions,
    WearerOptions,
)
from bodysense_live.protocols.camera_link import CameraSettings
from bodysense_live.protocols.datagrams import Receiver
from bodysense_live.protocols.markers.marker_link import MarkerServer, parsed_address
from bodysense_live.protocols.markers.marker_log import check_log
from bodysense_live.protocols.robots.robot_link import RobotSettings
from bodysense_live.protocols.slimevr_link import SlimevrSettings, is_serial
from bodysense_live.protocols.solarxr.solarxr_link import SolarxrSettings, runtime_folder
from bodysense_live.protocols.steamvr.vmt_link import VmtSettings
from bodysense_live.protocols.vmc import VmcTrackers
from bodysense_live.protocols.vrchat import parts_of
from bodysense_live.protocols.vrchat_link import VrchatSettings
from bodysense_live.security.certificate import check_pair, lan_address, own_certificate, state_folder
from bodysense_live.security.safety import ANY_ORIGIN, Access, Limits, RecordingLimits, is_loopback
from bodysense_live.server.messages import LONGEST_HALF_LIFE, Settings
from bodysense_live.server.session_store import check_store
from bodysense_live.server.settings import ServerSettings
from bodysense_live.sessions.replay import Playable
from bodysense_live.sessions.tracked_devices import TrackedDevices, read_device_names
from bodysense_live.sessions.worn_trackers import read_trackers


def settings_of(
    access: AccessOptions,
    wearer: WearerOptions,
    inputs: InputOptions,
    programs: ProgramOptions,
    load: LoadOptions,
    reading: ReadingOptions,
) -> ServerSettings:
    """Return the settings of a server. Raises BodysenseError, naming the options, for a wrong combination."""
    if wearer.save_person is not None:
        check_place(wearer.save_person)
    if not 0 <= wearer.smoothing <= LONGEST_HALF_LIFE:
        raise BodysenseError(f"--smoothing {wearer.smoothing:g}: give seconds, 0 to {LONGEST_HALF_LIFE:g}")
    to, parts = programs, parts_of(programs.vrchat_trackers)
    check_chosen(to)
    receives = inputs.vmc_in is not None or inputs.markers_in is not None
    sends = bool(to.vmc_out or to.vrchat_out or to.vrchat or to.vmt or to.solarxr or to.robot)
    if load.workers > 1 and (receives or sends or to.slimevr):
        raise BodysenseError("--workers: UDP needs a single process; leave --workers out")
    if load.workers > 1 and inputs.camera is not None:
        raise BodysenseError("--workers: --camera needs a single process; leave --workers out")
    if inputs.landmarkers is not None and inputs.camera is None:
        raise BodysenseError(f"--landmarkers {inputs.landmarkers}: is for a webcam; give --camera, too")
    if load.workers > 1 and inputs.markers is not None:
        raise BodysenseError("--workers: --markers needs a single process; leave --workers out")
    devices, joints = named_of(inputs.device_names, inputs.vmc_in is not None or to.vmt, to.slimevr)
    if access.bridge and not sends:
        raise BodysenseError(
            "--bridge has nowhere to send to; give --vmc-out, --vrchat-out, --vrchat, --vmt, --solarxr or --robot"
        )
    origin = (*access.origin, ANY_ORIGIN) if access.bridge else access.origin
    file = wearer.person
    if file is not None and file == wearer.save_person and not file.exists():
        file = None  # created by the first calibration
    person = person_of(file, reading.height) or Person(height=reading.height)
    posture = "seated" if wearer.seated else "standing"
    return ServerSettings(
        access=access_of(access, origin),
        limits=Limits(sessions=load.sessions, recording=recording_limits(load)),
        allow_record=None if load.allow_record is None else writable_folder("--allow-record", load.allow_record),
        playable=playable_of(inputs.replay, inputs.device, reading, person, inputs.markers is not None),
        person=person,
        wearer=Settings(floor=reading.floor or 0.0, posture=posture, smoothing=wearer.smoothing),
        recentre=wearer.recentre,
        save_person=wearer.save_person,
        trackers={} if file is None else read_trackers(file),
        shared=shared_of(load),
        vmc_in=inputs.vmc_in,
        vmc_trackers=VmcTrackers(devices),
        camera=None if inputs.camera is None else CameraSettings(inputs.camera, inputs.landmarkers),
        markers_in=inputs.markers_in,
        markers=marker_server_of(inputs, reading),
        glove_set=glove_set_of(inputs.marker_set, inputs.markers_in is not None or inputs.markers is not None, person),
        receivers=(
            *(receiver_of("vmc", address, parts) for address in to.vmc_out),
            *(receiver_of("vrchat", address, parts) for address in to.vrchat_out),
        ),
        vmt=VmtSettings(to.vmt_host, port=to.vmt_port, first=to.vmt_first, hands=to.vmt_hands, devices=devices)
        if to.vmt
        else None,
        vrchat=VrchatSettings(to.vrchat_host, parts=parts) if to.vrchat else None,
        solarxr=SolarxrSettings(runtime_folder(os.environ), to.solarxr_port) if to.solarxr else None,
        robot=None if to.robot is None else RobotSettings(to.robot, to.robot_host, to.robot_port),
        slimevr=SlimevrSettings(to.slimevr_host, to.slimevr_port, joints) if to.slimevr else None,
    )


def recording_limits(load: LoadOptions) -> RecordingLimits:
    """Return the limits of recordings. Raises BodysenseError for a limit without a folder."""
    if load.allow_record is None and load.record_megabytes != LoadOptions.record_megabytes:
        raise BodysenseError("--record-megabytes is for recordings; give a folder for them with --allow-record")
    return RecordingLimits(folder_megabytes=load.record_megabytes)


def check_chosen(programs: ProgramOptions) -> None:
    """Raise BodysenseError for an option of a program that was not chosen."""
    for field in fields(ProgramOptions):
        name, _, rest = field.name.partition("_")
        needs = [f"--{name}"] + (["--vrchat-out"] if field.name == "vrchat_trackers" else [])
        if rest in ("", "out") or any(getattr(programs, need[2:].replace("-", "_")) for need in needs):
            continue
        if getattr(programs, field.name) != field.default:
            option = f"--{field.name.replace('_', '-')}"
            raise BodysenseError(f"{option}: for {' or '.join(needs)}; give that, too, or leave {option} out")


def named_of(table: Path | None, steamvr: bool, slimevr: bool) -> tuple[TrackedDevices, dict[str, str]]:
    """Return the points of devices, and the joints of SlimeVR's trackers, that a table names by serial.

    Raises BodysenseError, naming the option, for devices of an input that was not chosen.
    """
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
    try:
        return TrackedDevices(devices), joints
    except BodysenseError as error:
        raise BodysenseError(f"--device-names {table}: {error}") from None


def access_of(options: AccessOptions, origin: tuple[str, ...]) -> Access:
    """Return the rules of access. Raises BodysenseError, naming the options, for a wrong combination."""
    host, certificate, key, token = options.host, options.certificate, options.key, options.token
    if (certificate is None) != (key is None):
        raise BodysenseError("--certificate and --key: give both, a certificate and its own key")
    if token is not None and options.token_file is not None:
        raise BodysenseError("--token and --token-file: give one of them")
    if options.token_file is not None:
        token = secret_of("--token-file", options.token_file)
    if options.lan and is_loopback(host):
        address = lan_address()
        host = "0.0.0.0"
        if certificate is None:
            certificate, key = own_certificate(state_folder(), (address, "localhost", "127.0.0.1"))
    if certificate is not None and key is not None:
        check_pair(certificate, key)
    if token is None and (ANY_ORIGIN in origin or not is_loopback(host)):
        token = secrets.token_urlsafe(16)
    return Access(host, token, origin, certificate, key, options.trusted_proxy)


def shared_of(options: LoadOptions) -> str | None:
    """Return the address of the store of sessions, with its password. Raises BodysenseError for wrong options."""
    address, file = options.shared, options.shared_password_file
    if file is not None:
        if address is None:
            raise BodysenseError("--shared-password-file is for a store of sessions; give its address with --shared")
        scheme, _, rest = address.partition("://")
        if "@" in rest:
            raise BodysenseError("--shared has a password already; leave it or --shared-password-file out")
        address = f"{scheme}://:{quote(secret_of('--shared-password-file', file), safe='')}@{rest}"
    return None if address is None else check_store(address)


def secret_of(option: str, path: Path) -> str:
    """Return the secret in a file of one line. Raises BodysenseError, naming the option but not the secret."""
    try:
        secret = path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise BodysenseError(f"{option} {path}: cannot be read ({error}); give a text file of one line") from None
    if not secret or len(secret.split()) != 1:
        raise BodysenseError(f"{option} {path}: {len(secret.split())} words; give a text file with one secret")
    return secret


def address_of(access: Access, port: int, lan: bool) -> str:
    """Return the address of the page, token included."""
    host = lan_address() if lan and access.host == "0.0.0.0" else access.host
    bracketed = f"[{host}]" if ":" in host else host
    scheme = "http" if access.certificate is None else "https"
    return f"{scheme}://{bracketed}:{port}/" + (f"?token={access.token}" if access.token is not None else "")


def marker_server_of(inputs: InputOptions, reading: ReadingOptions) -> MarkerServer | None:
    """Return the server of markers. Raises BodysenseError, naming the options, for a wrong combination."""
    if inputs.markers is None:
        for option in ("names", "unlabelled", "record"):
            if getattr(inputs, option) is not None:
                raise BodysenseError(f"--{option}: for --markers; give the address of its server, or leave it out")
        return None
    if inputs.markers_in is not None:
        raise BodysenseError("--markers and --markers-in: give one of them, the person has one input of markers")
    protocol, host, port = parsed_address(inputs.markers)
    form = MarkerOptions(inputs.marker_set, inputs.names).form(replace(reading, height=None))
    sides: dict[str | None, tuple[Side, ...]] = {
        None: (),
        "both": ("left", "right"),
        "left": ("left",),
        "right": ("right",),
    }
    record = None if inputs.record is None else check_log(inputs.record)
    return MarkerServer(protocol, host, port, form, sides[inputs.unlabelled], record)


def glove_set_of(marker_set: str | None, has_gloves: bool, wearer: Person) -> GloveSet:
    """Return the marker set of the gloves. Raises BodysenseError if it needs calibrated hands that are missing."""
    if marker_set is None:
        return standard_set()
    if not has_gloves:
        raise BodysenseError(f"--marker-set {marker_set}: for gloves; give their input, --markers or --markers-in")
    glove_set = read_set(marker_set)
    known = [side for side, hand in wearer.hands.items() if hand.glove.markers == glove_set.names]
    if glove_set.names != standard_set().names and not known:
        raise BodysenseError(
            f"--marker-set {marker_set}: no hand is calibrated with it; do so first: bodysense track TAKE.c3d "
            f"--marker-set {marker_set} -o OUT.bvh --save-person ME.json, then serve --person ME.json"
        )
    return glove_set


def writable_folder(option: str, path: Path) -> Path:
    """Return a folder that can be written to. Raises BodysenseError, naming the option, for any other."""
    if not path.is_dir():
        raise BodysenseError(f"{option} {path}: no such folder; create it or choose another")
    try:
        with tempfile.TemporaryFile(dir=path):
            return path.resolve()
    except OSError as error:
        raise BodysenseError(f"{option} {path}: nothing can be written there ({error.strerror})") from None


def receiver_of(protocol: Literal["vmc", "vrchat"], address: str, parts: tuple[str, ...]) -> Receiver:
    """Return a receiver of poses at HOST:PORT; `parts`: parts of the body whose trackers are sent to VRChat."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise BodysenseError(f"--{protocol}-out {address}: give HOST:PORT, as 127.0.0.1:39539")
    return Receiver(protocol, host.strip("[]"), int(port), parts)


def playable_of(
    file: Path | None, device: str | None, reading: ReadingOptions, wearer: Person, has_markers: bool = False
) -> Playable | None:
    """Return a recording to replay, or a motion with the signal of a simulated device that tracks it.

    `has_markers`: the options of reading are those of a server of markers if there is no file.
    """
    if file is None:
        if device is not None:
            raise BodysenseError("--device is for a replayed motion; give it with --replay")
        if has_markers:
            return None
        if options := given_options(replace(reading, height=None, floor=None)):
            raise BodysenseError(f"{options} is for a replayed motion; give it with --replay")
        return None
    if not file.is_file():
        raise BodysenseError(f"--replay {file}: no such file")
    if is_recording(file):
        if device is not None:
            raise BodysenseError(f"--replay {file}: a recording; leave --device out")
        opened = open_source(file, reading)  # in metres and +Y up, by the options
        assert isinstance(opened, RecordingSource)
        recording = opened.recording
        is_known = recording.known and reading.height is None
        return Playable(recording.observation, Person(recording.skeleton) if is_known else wearer)
    if device is None:
        raise BodysenseError(
            f"--replay {file}: not a recording; for a motion, choose a device that tracks it: --device headset_camera "
            f"or another of {', '.join(DEVICES)}"
        )
    clip = load_clip(file, reading)
    return Playable(simulate(clip, device), Person(clip.pose.skeleton), clip.pose)
