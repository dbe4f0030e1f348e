"""The links of a server, from its settings."""

from __future__ import annotations

from functools import partial

from bodysense.serve.datagrams import InputLink, MarkerInput, PoseSender, marker_points
from bodysense.serve.links import DeviceInput, Link, Reader
from bodysense.serve.metrics import Metrics
from bodysense.serve.settings import ServerSettings
from bodysense.serve.slimevr_link import SENSORS, SlimevrLink
from bodysense.serve.sockets import listen_udp
from bodysense.serve.solarxr_input import InputReader
from bodysense.serve.solarxr_link import SolarxrLink
from bodysense.serve.tracked_devices import SIGNALS
from bodysense.serve.vmt import VmtReader
from bodysense.serve.vmt_link import VmtLink
from bodysense.serve.vrchat_devices import VRCHAT_POINTS, VrchatReader
from bodysense.serve.vrchat_link import VrchatLink


def links_of(settings: ServerSettings, metrics: Metrics) -> list[Link]:
    """All other programs that a server talks with. Raises BodysenseError for ports and hosts that cannot be had.

    Inertial trackers join every input that tracks a wearer's head, and stand alone where there is none.
    """
    host, links = settings.access.host, list[Link]()
    sensors: SlimevrLink | None = None

    def also(reader: Reader, points: tuple[str, ...]) -> tuple[Reader, tuple[str, ...]]:
        return (reader, points) if sensors is None else (sensors.joined(reader), (*points, *SENSORS))

    try:
        if settings.slimevr is not None:
            headsets = settings.vmc_in, settings.vmt, settings.vrchat, settings.solarxr
            sensors = SlimevrLink(settings.slimevr, metrics, alone=all(one is None for one in headsets))
            links.append(sensors)
        if settings.vmc_in is not None:
            reader, points = also(settings.vmc_trackers, SIGNALS)
            protocol = partial(DeviceInput, metrics=metrics, reader=reader, points=points)
            links.append(InputLink("vmc", listen_udp("--vmc-in", host, settings.vmc_in), points, protocol))
        if settings.markers_in is not None:
            bound = listen_udp("--markers-in", host, settings.markers_in)
            protocol = partial(MarkerInput, metrics=metrics, worn=settings.worn)
            links.append(InputLink("markers", bound, marker_points(settings.worn), protocol))
        if settings.receivers:
            links.append(PoseSender(settings.receivers, metrics))
        if settings.vmt is not None:
            links.append(VmtLink(settings.vmt, metrics, *also(VmtReader(settings.vmt.devices), SIGNALS)))
        if settings.vrchat is not None:
            links.append(VrchatLink(settings.vrchat, metrics, *also(VrchatReader(), VRCHAT_POINTS)))
        if settings.solarxr is not None:
            links.append(SolarxrLink(settings.solarxr, metrics, *also(InputReader(), SIGNALS)))
    except BaseException:
        for link in links:
            link.close()
        raise
    return links
