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
    person: Person = Person()  # what is known of wearers who do not tell their height
    wearer: Settings = Settings()  # of the server's own inputs
    recentre: bool = False  # where they first stand is the middle
    shared: str | None = None  # address of the Valkey or Redis by which servers and workers resume sessions
    save_person: Path | None = None  # file for the wearer of the server's own input, written after a calibration
    trackers: Mapping[str, str] = field(default_factory=dict)  # joints of nameless trackers by serial
    vmc_in: int | None = None  # ports, on the server's host
    vmc_trackers: VmcTrackers = VmcTrackers()
    markers_in: int | None = None
    glove_set: GloveSet = field(default_factory=standard_set)  # the marker set of gloves that come in there
    receivers: tuple[Receiver, ...] = ()
    vmt: VmtSettings | None = None
    vrchat: VrchatSettings | None = None
    slimevr: SlimevrSettings | None = None
    solarxr: SolarxrSettings | None = None
