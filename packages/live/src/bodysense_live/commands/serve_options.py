"""Options of `bodysense serve`, in the groups of its help."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from bodysense.devices.simulated.device import DeviceName
from bodysense.ranges import Megabytes, Port, Processes, Sessions
from bodysense_live.protocols.robots.messages import RobotFormat
from bodysense_live.security.safety import RecordingLimits

Addresses = Annotated[tuple[str, ...], tyro.conf.UseAppendAction]


@dataclass(frozen=True)
class AccessOptions:
    """Addresses that the server listens on, and clients that may connect."""

    host: str = "127.0.0.1"
    """address to listen on; other than loopback addresses need a token, which is created if omitted"""
    port: Port = 8765
    """TCP port; 0 for any free port"""
    token: str | None = None
    """secret that clients must present, at least 8 characters: letters, digits and -._~"""
    token_file: Path | None = None
    """file with the token, which other users of the machine cannot see in the list of processes"""
    trusted_proxy: Addresses = ()
    """address or network of a proxy, such as 10.0.0.0/8, whose X-Forwarded-For names the client. Repeatable"""
    origin: Addresses = ()
    """origin of a page on another server that may connect, such as http://localhost:5173. Repeatable"""
    lan: bool = False
    """admit headsets and phones of this network, encrypted, at a printed address with a QR code"""
    certificate: Path | None = None
    """PEM file of a certificate, in place of the one made for --lan"""
    key: Path | None = None
    """PEM file of its key"""
    bridge: bool = False
    """let pages of any origin send their bodies to avatar programs, with the token of the printed address"""


@dataclass(frozen=True)
class WearerOptions:
    """The wearer of the server's own inputs."""

    person: Path | None = None
    """person's file (.json) with the wearers' proportions and tracker mounts"""
    save_person: Path | None = None
    """person's file (.json), written after each calibration; may equal --person, even if it does not exist yet"""
    seated: bool = False
    """display the seated wearer as standing"""
    recentre: bool = False
    """use the wearer's first position and heading as the origin, facing +Z"""
    smoothing: float = 0.0
    """half-life in seconds, 0 to 0.5, of the smoothing of the wearer's body; it delays the body by as much"""


@dataclass(frozen=True)
class InputOptions:
    """Inputs of the server itself: recordings that it plays, signals by UDP, and servers of markers."""

    replay: Path | None = None
    """recording (.npz, .jsonl), or with --device a motion (.bvh, AMASS .npz), played in real time"""
    device: DeviceName | None = None
    """simulated device that tracks the body if the replay is a motion; the page then shows the true motion, too"""
    vmc_in: Port | None = None
    """UDP port for headset, controllers and trackers by VMC (usually 39539)"""
    markers_in: Port | None = None
    """UDP port for markers of gloves by OSC (usually 9123)"""
    camera: int | None = None
    """index of a webcam of this machine, 0 for the first: body, hands and fingers (docs/video.md)"""
    landmarkers: Path | None = None
    """folder with MediaPipe's models for --camera, in place of the cache"""
    markers: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """server of markers: natnet://HOST (OptiTrack), qtm://HOST (Qualisys) or vicon://HOST (docs/serve.md)"""
    names: Path | None = None
    """table of --markers' names and ours, .json or .csv (docs/markers.md)"""
    unlabelled: Literal["left", "right", "both"] | None = None
    """gloves to find among the points of --markers that have no name"""
    record: Path | None = None
    """file (.csv) for all frames of --markers, which `bodysense track` reads"""
    marker_set: str | None = None
    """marker set of the gloves, a file or a packaged name (docs/gloves.md); --person has hands calibrated with it"""
    device_names: Path | None = None
    """JSON table of devices of VMC, SteamVR or SlimeVR: serial to point (docs/avatars.md)"""


@dataclass(frozen=True)
class ProgramOptions:
    """Programs that send trackers, or receive bodies (docs/runtimes.md)."""

    vmc_out: Addresses = ()
    """HOST:PORT of an avatar program that receives bones by VMC (usually port 39539). Repeatable"""
    vrchat_out: Addresses = ()
    """HOST:PORT of a VRChat that receives trackers by OSC (usually port 9000). Repeatable"""
    vrchat: bool = False
    """find VRChat by OSCQuery, receive head and wrists from it and send it trackers"""
    vrchat_host: str = "127.0.0.1"
    """machine on which VRChat runs"""
    vrchat_trackers: Annotated[str, tyro.conf.arg(metavar="PART,PART")] = "hip,feet"
    """trackers that are sent to VRChat: a list of hip, feet, knees, chest, elbows"""
    vmt: bool = False
    """receive headset and controllers from SteamVR and send it trackers, by its driver VMT"""
    vmt_host: str = "127.0.0.1"
    """machine on which SteamVR runs"""
    vmt_port: Port = 39575
    """UDP port for answers of VMT's driver"""
    vmt_first: int = 0
    """index of the first virtual device; other programs may use lower ones"""
    vmt_hands: bool = False
    """send SteamVR skeletal hands, too, as two virtual controllers"""
    solarxr: bool = False
    """receive the headset of Monado or WiVRn, on Linux, and send them trackers and a body"""
    solarxr_port: Port = 21110
    """TCP port of this machine for SlimeVR's own programs; 0 for any free port"""
    robot: RobotFormat | None = None
    """publish the body for a humanoid robot: dictionaries for GMR, or SONIC's messages (docs/robots.md)"""
    robot_host: str = "127.0.0.1"
    """address of this machine to publish at; 0.0.0.0 for robots on the network"""
    robot_port: Port = 5556
    """TCP port to publish at"""
    slimevr: bool = False
    """receive SlimeVR's trackers, which find this machine in the network"""
    slimevr_host: str = "0.0.0.0"
    """address of this machine for SlimeVR's trackers; all addresses, if omitted"""
    slimevr_port: Port = 6969
    """UDP port for SlimeVR's trackers"""


@dataclass(frozen=True)
class LoadOptions:
    """Sessions, processes and recordings."""

    sessions: Sessions = 64
    """maximum number of sessions in each process"""
    workers: Processes = 1
    """number of processes that share the port; one that ends is replaced"""
    shared: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """address of a Valkey or Redis, such as redis://10.0.0.2:6379, by which workers and servers resume sessions"""
    shared_password_file: Path | None = None
    """file with the password of --shared, which other users cannot see in the list of processes"""
    allow_record: Path | None = None
    """folder for recordings that clients request; recording is off if omitted"""
    record_megabytes: Megabytes = RecordingLimits.folder_megabytes
    """maximum size of the folder for recordings in MB; a recording ends when it is reached"""
