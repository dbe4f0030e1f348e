"""Settings of a server."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bodysense.body.hands.glove_set import GloveSet, standard_set
from bodysense.body.person import Person
from bodysense_live.protocols.camera_link import CameraSettings
from bodysense_live.protocols.datagrams import Receiver
from bodysense_live.protocols.markers.marker_link import MarkerServer
from bodysense_live.protocols.robots.robot_link import RobotSettings
from bodysense_live.protocols.slimevr_link import SlimevrSettings
from bodysense_live.protocols.solarxr.solarxr_link import SolarxrSettings
from bodysense_live.protocols.steamvr.vmt_link import VmtSettings
from bodysense_live.protocols.vmc import VmcTrackers
from bodysense_live.protocols.vrchat_link import VrchatSettings
from bodysense_live.security.safety import Access, Limits
from bodysense_live.server.messages import Settings
from bodysense_live.sessions.replay import Playable


@dataclass(frozen=True)
class ServerSettings:
    """Settings of a server."""

    access: Access = Access()
    limits: Limits = Limits()
    allow_record: Path | None = None  # a folder
    playable: Playable | None = None
    person: Person = Person()  # wearer of a session without a height
    wearer: Settings = Settings()  # for the server's own inputs
    recentre: bool = False  # the first position and heading is the origin
    shared: str | None = None  # address of a Valkey or Redis that shares sessions
    save_person: Path | None = None  # person's file, written after a calibration of the server's own input
    trackers: Mapping[str, str] = field(default_factory=dict)  # joints of unassigned trackers by serial
    vmc_in: int | None = None  # UDP port on the server's host
    vmc_trackers: VmcTrackers = VmcTrackers()
    markers_in: int | None = None  # UDP port on the server's host
    markers: MarkerServer | None = None  # a server of markers to connect to
    glove_set: GloveSet = field(default_factory=standard_set)  # marker set of the gloves at `markers_in`
    receivers: tuple[Receiver, ...] = ()
    vmt: VmtSettings | None = None
    vrchat: VrchatSettings | None = None
    slimevr: SlimevrSettings | None = None
    robot: RobotSettings | None = None
    solarxr: SolarxrSettings | None = None
    camera: CameraSettings | None = None
