"""The bridge: pages of any origin send whole bodies, which are forwarded to avatar programs."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import SignalFrame
from bodysense_live.security.safety import ANY_ORIGIN, Access, refusal_reason
from bodysense_live.server.messages import Settings
from bodysense_live.sessions.session import Session


def test_a_bridge_forwards_a_whole_body() -> None:
    pose = packaged_performance().pose[0:120:2]
    skeleton = pose.skeleton
    position, rotation = map(np.asarray, forward_kinematics(pose))
    count = len(skeleton.joints)
    session = Session(skeleton.joints, settings=Settings(hold_feet=False))
    apart = []
    for k in range(len(pose.root_position)):
        rows = np.arange(count, dtype=np.uint8)
        places, turns = position[k, :count].astype(np.float32), rotation[k, :count].astype(np.float32)
        frame = SignalFrame(k, k / 30, rows, np.full(count, 3, np.uint8), places, turns)
        session.receive(frame, k / 30)
        answer = session.step()
        assert answer is not None
        apart.append(np.linalg.norm(answer.points[:count] - places, axis=-1))
    assert np.mean(apart[30:]) < 0.01 and np.max(apart[30:]) < 0.04  # m


def test_a_page_of_any_origin_needs_the_bridge_token() -> None:
    with pytest.raises(BodysenseError, match="needs a token"):
        Access(origins=(ANY_ORIGIN,))
    access = Access(token="12345678", origins=(ANY_ORIGIN,))
    for origin in ("https://example.org", "null", None):
        assert refusal_reason(access, "localhost:8765", origin, ["12345678"]) is None
        assert refusal_reason(access, "localhost:8765", origin, ["87654321"]) is not None
