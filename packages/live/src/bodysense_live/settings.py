"""Settings of a server."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bodysense.body.glove_set import GloveSet, standard_set
from bodysense.body.person import Person
from bodysense_live.datagrams import Receiver
from bodysense_live.messages import Settings
from bodysense_live.replay import Playable
from bodysense_live.safety import Access, Limits
from bodysense_live.slimevr_link import SlimevrSettings
from bodysense_live.solarxr_link import SolarxrSettings
from bodysense_live.vmc import VmcTrackers
from bodysense_live.vmt_link import VmtSettings
from bodysense_live.vrchat_link import VrchatSettings


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
    glove_set: GloveSet = field(default_factory=standard_set)  # marker set of the gloves at `markers_in`
    receivers: tuple[Receiver, ...] = ()
    vmt: VmtSettings | None = None
    vrchat: VrchatSettings | None = None
    slimevr: SlimevrSettings | None = None
    solarxr: SolarxrSettings | None = None
