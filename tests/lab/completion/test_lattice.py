"""Random edges of the lattice of sensor sets."""

from __future__ import annotations

import numpy as np

from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense_lab.completion.kinds.lattice import LATTICE_PARTS, random_edges, with_sensor
from bodysense_lab.completion.training.options import TABLE_SETS


def test_the_tables_have_known_sensor_sets() -> None:
    assert set(TABLE_SETS) < set(SENSOR_SETS)


def test_an_edge_adds_one_sensor() -> None:
    edges = random_edges(300, np.random.default_rng(1))
    assert len(edges) == 300
    for edge in edges:
        assert edge.sensor not in edge.fewer.points and set(edge.more.points) - set(edge.fewer.points) == {edge.sensor}
        assert edge.more == with_sensor(edge.fewer, edge.sensor, edge.kind)
        assert "head" in edge.fewer.position and "head" in edge.fewer.rotation and not edge.more.camera
    names = {edge.sensor.removeprefix("left_").removeprefix("right_") for edge in edges}
    assert names == {*LATTICE_PARTS, "wrist"}
    assert {edge.kind for edge in edges} == {"position and rotation", "position", "rotation"}
    size = [len(edge.fewer.points) for edge in edges]
    assert min(size) == 1 and max(size) > 8


def test_the_same_edges_are_drawn_again() -> None:
    assert random_edges(20) == random_edges(20)
    assert random_edges(20) == random_edges(200)[:20]
    assert random_edges(20, np.random.default_rng(5)) != random_edges(20)
