"""Random training sequences: of recorded clips, of scripted scenes, and of hands."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from bodysense_lab.completion.data.corpus import Corpus
from bodysense_lab.completion.data.postures.postures import draw_kind
from bodysense_lab.completion.data.sensor_draws import FINGER_KINDS, draw_fingers, draw_sensors
from bodysense_lab.completion.data.sequences import (
    CAMERA,
    DrawSensors,
    Sequence,
    SequenceAugmentation,
    make_sequence,
    visible_points,
)
from bodysense_lab.completion.data.training_bodies import draw_body, with_other_hands
from bodysense_lab.synthesis import scenes

_LONGEST, _LONGEST_POSTURE = 15.0, 30.0  # s, longest sequence, and longest one in a posture
_STRAIGHTENED = 0.3  # share of sequences whose standing legs are straightened
_SCENE_SECONDS = (8.0, 15.0)  # s, from and to
_UPRIGHT = 0.3  # share of sequences whose stance is upright
_RATES, _ALL_RATES = (22.0, 60.0), (10.0, 144.0)  # Hz, of most and of some sequences
_FREE_WRISTS = 0.45  # share of sequences whose wrists turn freely


def draw_sequence(
    corpus: Corpus,
    clip: int,
    rng: np.random.Generator,
    change_posture: bool = False,
    backward: bool = False,
    stance_shift: float = 0.0,
    sensors: DrawSensors = draw_sensors,
) -> Sequence:
    """Draw an augmentation of a clip of the corpus, and make its sequence.

    With `change_posture`, a standing person takes a rare posture. `backward` reverses time. `stance_shift`, m, is that
    of an upright person (`upright.stance_shifts`). It is applied to some sequences, more or less. `sensors` draws the
    sensors.
    """
    posture = draw_kind(rng) if change_posture else None
    longest = _LONGEST if posture is None else _LONGEST_POSTURE
    seconds = float(corpus.length[clip] / corpus.rate[clip])
    drawn = SequenceAugmentation(
        body=draw_body(corpus.rest_offset[clip].astype(float), rng),
        sensors=sensors,
        rate=_draw_rate(rng),
        pace=float(np.exp(rng.uniform(-0.2, 0.2))) if rng.uniform() < 0.5 else 1.0,
        begin=max(0.0, float(rng.uniform(-longest / 2, seconds - longest / 2))),
        longest=longest,
        mirrored=bool(rng.uniform() < 0.5),
        free_wrists=bool(rng.uniform() < _FREE_WRISTS),
        posture=posture,
        straightening=float(rng.uniform(0.3, 1.0)) if rng.uniform() < _STRAIGHTENED else 0.0,
        stance_shift=stance_shift * float(rng.uniform(0.5, 1.1)) if rng.uniform() < _UPRIGHT else 0.0,
        noisy=bool(rng.uniform() < 0.6),
        backward=backward,
    )
    return make_sequence(corpus, clip, drawn, rng)


def draw_scene(rng: np.random.Generator, backward: bool = False, sensors: DrawSensors = draw_sensors) -> Sequence:
    """Draw a scripted scene of a person at home, and make its sequence. `backward` reverses time."""
    rate = _draw_rate(rng)
    scene = scenes.sequence(rng, round(rng.uniform(*_SCENE_SECONDS) * rate), rate)
    rotation, offset = scene.rotation, scene.rest_offset.astype(float)
    corpus = Corpus(
        rotation=rotation.astype(np.float32),
        root=scene.root.astype(np.float32),
        visible=visible_points(rotation, scene.root, offset),
        fingers=np.zeros((0, 30, 4), dtype=np.float32),
        rest_offset=offset[None].astype(np.float32),
        start=np.array([0]),
        length=np.array([len(rotation)]),
        rate=np.array([rate]),
        finger_start=np.array([-1]),
        name=np.array(["scene/" + "+".join(scene.kinds)]),
        category=np.array([""]),
    )
    drawn = SequenceAugmentation(
        body=draw_body(offset, rng),
        sensors=sensors,
        rate=rate,
        mirrored=bool(rng.uniform() < 0.5),
        free_wrists=bool(rng.uniform() < _FREE_WRISTS),
        noisy=bool(rng.uniform() < 0.6),
        backward=backward,
    )
    return make_sequence(corpus, 0, drawn, rng)


def _draw_rate(rng: np.random.Generator) -> float:
    """Draw a frame rate, Hz: mostly the usual one, at times any that devices have."""
    if rng.uniform() < 0.5:
        return 30.0
    rates = _RATES if rng.uniform() < 0.8 else _ALL_RATES
    return float(np.exp(rng.uniform(*np.log(rates))))


def draw_hands(corpus: Corpus, clip: int, rng: np.random.Generator) -> Sequence:
    """Draw an augmentation of a clip with fingers for their training, and make its sequence with hands.

    Clips are not mirrored: the network mirrors right hands, so a clip and its mirror image are equal to it.
    """
    seconds = float(corpus.length[clip] / corpus.rate[clip])
    drawn = SequenceAugmentation(
        body=with_other_hands(draw_body(corpus.rest_offset[clip].astype(float), rng), rng),
        sensors=CAMERA,
        rate=30.0 if rng.uniform() < 0.4 else float(np.exp(rng.uniform(np.log(22), np.log(60)))),
        begin=max(0.0, float(rng.uniform(-_LONGEST / 2, seconds - _LONGEST / 2))),
        longest=_LONGEST,
        free_wrists=bool(rng.uniform() < 0.35),
        noisy=bool(rng.uniform() < 0.6),
    )
    kind = str(rng.choice(list(FINGER_KINDS), p=list(FINGER_KINDS.values())))
    finger_noise = kind in ("tracked", "random") and bool(rng.uniform() < 0.5)
    drawn = replace(drawn, fingers=partial(draw_fingers, kind), finger_noise=finger_noise)
    return make_sequence(corpus, clip, drawn, rng)
