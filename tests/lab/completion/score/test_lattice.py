"""Random edges of the lattice of sensor sets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bodysense.body.person import Person
from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.observing.observation import Observation
from bodysense_lab.completion.data.points import INPUT_POINTS
from bodysense_lab.completion.kinds.lattice import random_edges, with_sensor
from bodysense_lab.completion.kinds.lattice_scores import choose_scenes, score_lattice
from bodysense_lab.completion.score.scenes import TrackedScene
from bodysense_lab.completion.score.tracking import TrackedMotion
from bodysense_lab.completion.training.options import TABLE_SETS

from ..conftest import Oracle


def test_the_tables_have_known_sensor_sets() -> None:
    assert set(TABLE_SETS) < set(SENSOR_SETS)


def test_an_edge_adds_one_sensor_to_any_kind_of_set() -> None:
    edges = random_edges(600, np.random.default_rng(1))
    assert len(edges) == 600
    for edge in edges:
        assert edge.more == with_sensor(edge.fewer, edge.sensor, edge.kind) and not edge.more.camera
        told, before = (len(one.position) + len(one.rotation) for one in (edge.more, edge.fewer))
        assert told - before == (2 if edge.kind == "position and rotation" else 1)
        for one in (edge.fewer, edge.more):
            assert len(set(one.position)) == len(one.position) and len(set(one.rotation)) == len(one.rotation)
            assert one.points and set(one.position) <= set(INPUT_POINTS) and set(one.rotation) <= set(BODY)
    assert {edge.sensor for edge in edges} == set(INPUT_POINTS)
    assert {edge.kind for edge in edges} == {"position and rotation", "position", "rotation"}
    heads = {("head" in edge.fewer.position, "head" in edge.fewer.rotation) for edge in edges}
    assert heads == {(True, True), (True, False), (False, True), (False, False)}
    of_head = {edge.kind for edge in edges if edge.sensor == "head"}
    assert of_head == {"position and rotation", "position", "rotation"}
    size = [len(edge.fewer.points) for edge in edges]
    assert min(size) == 1 and max(size) > 12


def test_the_same_edges_are_drawn_again() -> None:
    assert random_edges(20) == random_edges(20)
    assert random_edges(20) == random_edges(200)[:20]
    assert random_edges(20, np.random.default_rng(5)) != random_edges(20)


def test_edges_whose_sensor_harms_are_found(scenes: list[TrackedScene]) -> None:
    unseen = scenes[1::2]  # on unseen bodies; some sets have rotations alone, which are those of both bodies
    chosen = choose_scenes(unseen)

    def harmed(people: Sequence[Person], observations: Sequence[Observation]) -> list[TrackedMotion]:
        harm = 0.01 * (observations[0].has_position[0].sum() + observations[0].has_rotation[0].sum())
        return Oracle(unseen, lambda position, scene: position * [1, 1, 1 + harm])(people, observations)

    edges = random_edges(12)
    assert [score.violates for score in score_lattice(edges, chosen, harmed)] == [True] * 12
    unharmed = Oracle(unseen, lambda position, scene: position + np.array([0.0, 0.0, 0.05]))
    assert not any(score.violates for score in score_lattice(edges, chosen, unharmed))


def test_scenes_of_edges_are_of_the_main_categories(scenes: list[TrackedScene]) -> None:
    chosen = choose_scenes([*[scene for scene in scenes if scene.name.startswith("anna")], *scenes])
    assert chosen[0].name == "anna/anna-waves"
    assert {scene.group for scene in chosen} == {"main"}
