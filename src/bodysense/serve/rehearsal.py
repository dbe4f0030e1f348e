"""Everything that a first wearer would wait for, done once before anybody comes."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from bodysense.body.person import Person
from bodysense.serve.estimation import load
from bodysense.serve.messages import Resume, Settings
from bodysense.serve.protocol import SignalFrame, write_pose
from bodysense.serve.seat import Seat
from bodysense.serve.session import Session
from bodysense.serve.session_store import Kept, SessionStore
from bodysense.serve.webxr import Placement

_POINTS = ("headset", "left_controller", "right_controller")


def rehearse() -> None:
    """Load the network, complete a few frames of somebody, and let another process's session be resumed."""
    load()
    session = Session(_POINTS, Person())
    places = np.array([[0, 1.6, 0], [-0.3, 1.0, -0.3], [0.3, 1.0, -0.3]], dtype=np.float32)
    upright = np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (3, 1))
    for k in range(3):
        session.receive(SignalFrame(k, k / 72, np.arange(3), np.full(3, 3), places, upright), 0.0)
        answer = session.step()
        if answer is not None:
            write_pose(answer.frame, 0)
    Seat(16 * "0", "", "", "", session).welcome((), recording=False)
    with tempfile.TemporaryDirectory(prefix="bodysense-") as folder:
        store = SessionStore(Path(folder), 10.0)
        store.put(16 * "0", Kept("rehearsal", "", "", Settings(), Person(), Placement(), {}))
        store.take(Resume(16 * "0", "rehearsal"))
