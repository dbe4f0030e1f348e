"""The links of a server, from its settings."""

from __future__ import annotations

from functools import partial

from bodysense.serve.datagrams import InputLink, MarkerInput, PoseSender, marker_points
from bodysense.serve.links import DeviceInput, Link, listened
from bodysense.serve.metrics import Metrics
from bodysense.serve.settings import ServerSettings
from bodysense.serve.tracked_devices import SIGNALS
from bodysense.serve.vmt_link import VmtLink


def links_of(settings: ServerSettings, metrics: Metrics) -> list[Link]:
    """All other programs that a server talks with. Raises BodysenseError for ports and hosts that cannot be had."""
    host, links = settings.access.host, list[Link]()
    try:
        if settings.vmc_in is not None:
            protocol = partial(DeviceInput, metrics=metrics, reader=settings.vmc_trackers, points=SIGNALS)
            links.append(InputLink("vmc", listened("--vmc-in", host, settings.vmc_in), SIGNALS, protocol))
        if settings.markers_in is not None:
            bound = listened("--markers-in", host, settings.markers_in)
            protocol = partial(MarkerInput, metrics=metrics, worn=settings.worn)
            links.append(InputLink("markers", bound, marker_points(settings.worn), protocol))
        if settings.receivers:
            links.append(PoseSender(settings.receivers, metrics))
        if settings.vmt is not None:
            links.append(VmtLink(settings.vmt, metrics))
    except BaseException:
        for link in links:
            link.close()
        raise
    return links
