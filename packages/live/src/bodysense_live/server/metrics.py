"""Counters of the server, for Prometheus."""

from __future__ import annotations

import os
from typing import Any

from bodysense.errors import missing_package

DROPS = ("late", "replaced", "slow client", "failed", "output", "malformed packet", "flood", "second sender")
_BUCKETS = (0.001, 0.002, 0.003, 0.005, 0.007, 0.009, 0.011, 0.015, 0.02, 0.03, 0.05, 0.1, 0.5)  # s


class Metrics:
    """Counters of one process, or of all that share a folder, named by `PROMETHEUS_MULTIPROC_DIR`."""

    def __init__(self) -> None:
        try:
            from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram
        except ImportError as error:
            raise missing_package(error) from None
        self._registry = registry = CollectorRegistry()
        self.sessions: Any = Gauge(
            "bodysense_sessions", "Sessions in memory", registry=registry, multiprocess_mode="livesum"
        )
        self.frames: Any = Counter("bodysense_frames", "Received signal frames", registry=registry)
        self.latency: Any = Histogram(
            "bodysense_frame_seconds", "From a signal frame to its pose", buckets=_BUCKETS, registry=registry
        )
        self.stepping: Any = Counter(
            "bodysense_step_seconds", "Processor time spent on completing bodies, s", registry=registry
        )
        self.store_failures: Any = Counter(
            "bodysense_unshared", "Times that storing sessions failed", registry=registry
        )
        drops = Counter("bodysense_drops", "Frames without an answer, by reason", ["reason"], registry=registry)
        self._drops = {reason: drops.labels(reason) for reason in DROPS}
        self._closed: Any = Counter("bodysense_closed", "Connections closed, by code", ["code"], registry=registry)

    def dropped(self, reason: str) -> None:
        """Count a frame without an answer."""
        self._drops[reason].inc()

    def closed(self, code: int) -> None:
        """Count a closed connection."""
        self._closed.labels(str(code)).inc()

    def text(self) -> tuple[bytes, str]:
        """Return the text that Prometheus reads, and its content type."""
        from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
        from prometheus_client.multiprocess import MultiProcessCollector

        registry = self._registry
        if "PROMETHEUS_MULTIPROC_DIR" in os.environ:
            registry = CollectorRegistry()
            MultiProcessCollector(registry)
        return generate_latest(registry), CONTENT_TYPE_LATEST
