"""The two-hands system on a take of gloves: only the paper's steps (section 3.2), and its flat-hand calibration.

Rejection of wrong markers, contact of hands, fading of offsets and restraint of large turns are left out. Markers that
are found again approach their measured places one by one (`continuity`). The tracker completes the body around the
hands.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from bodysense.arrays import read_arrays
from bodysense.body.hands.glove import default_glove
from bodysense.body.hands.hand import glove_hands
from bodysense.devices.gloves.device import GloveDevice, glove_device, gloved_sides, has_standard_gloves
from bodysense.devices.gloves.gap_fillers import GapFillerStack, NetworkGapFiller, RigidGapFiller
from bodysense.devices.gloves.hands import GloveModels, HandsSettings, load_glove_models, natural_markers
from bodysense.devices.gloves.networks import GloveNetwork, load_joint_network, load_marker_network
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.io.clip import Clip
from bodysense.io.formats.recording import Recording
from bodysense.sources.open import MotionSource, Opened
from bodysense.sources.signals import Signal, signal_from
from bodysense.takes.track import track
from bodysense_lab.papers.paper_options import PaperOptions, Variant
from bodysense_lab.papers.two_hands.continuity import Continuity
from bodysense_lab.weights import packaged

FORMS: tuple[Variant, ...] = ("paper", "shipped")
SETTINGS = HandsSettings(rejection=None, speed=0.25, unseen_speed=0.25, fading=None, restraint=0.0)
FILES = ("glove_markers.onnx", "glove_joints.onnx")
PAPER_FILES = ("glove_markers_paper.onnx", "glove_joints_paper.onnx")  # packaged


def complete(opened: Opened, options: PaperOptions) -> Clip:
    """Return the motion of hands from nine markers each, with the form of networks that `options.variant` names.

    A motion wears gloves in a simulated ring of cameras. Raises BodysenseError for a source without gloves.
    """
    models = networks_of(options)
    signal = _gloved(opened, options)
    device = _device(signal, models)
    if options.calibration is not None:
        kept = read_calibration(options.calibration, tuple(device.hands.hands))
        device = replace(device, hands=replace(device.hands, calibration=kept))
    joints, _ = device.step(signal.observation, device.start())
    return track(Recording(joints, signal.person.skeleton)).clip


def calibrate(opened: Opened, out: Path, options: PaperOptions) -> tuple[str, ...]:
    """Write the flat-hand calibration of a take to an .npz file; returns the hands in it."""
    if isinstance(opened, MotionSource) and not opened.clip.has_fingers:
        raise BodysenseError(
            f"{opened.name}: its fingers are not recorded, so that its hands are relaxed; give a take of flat hands"
        )
    device = _device(signal := _gloved(opened, options), networks_of(options))
    hands = device.hands.calibrated(signal.observation)
    assert hands.calibration is not None
    with written_beside(out) as beside, beside.open("wb") as file:
        np.savez(file, **dict(zip(hands.hands, hands.calibration, strict=True)))
    return tuple(hands.hands)


def read_calibration(path: Path, sides: tuple[str, ...]) -> np.ndarray:
    """Return rotations (H, 15, 4) of the named hands. Raises BodysenseError for a file that lacks one."""
    arrays = read_arrays(path)
    for side in sides:
        if side not in arrays or arrays[side].shape != (15, 4):
            raise BodysenseError(
                f"{path}: no flat-hand calibration of the {side} hand; write one: bodysense papers calibrate-hands"
            )
    return np.stack([arrays[side] for side in sides])


def _gloved(opened: Opened, options: PaperOptions) -> Signal:
    device = options.choose_device(opened, "gloves")
    signal = signal_from(opened, device=device, height=options.height, noise=options.noise)
    if not (glove_hands(signal.observation.points) and has_standard_gloves(signal.observation)):
        raise BodysenseError(
            f"{opened.name}: --method two_hands reads gloves of nine markers; give a take of them, or a motion with "
            "--device gloves"
        )
    return signal


def _device(signal: Signal, models: GloveModels) -> GloveDevice:
    sides = gloved_sides(signal.observation.points)
    device = glove_device(signal.person.skeleton, sides, models, SETTINGS)
    hands = tuple(device.hands.hands.values())
    network = Continuity(NetworkGapFiller(models.markers, hands, fading=None))
    last = RigidGapFiller(np.stack([natural_markers(default_glove(), hand) for hand in hands]))
    return replace(device, hands=replace(device.hands, gap_filler=GapFillerStack((network, last))))


def networks_of(options: PaperOptions) -> GloveModels:
    """Return the networks that options name. Raises BodysenseError for files that are not of the form."""
    form = options.choose_variant("two_hands", FORMS, "paper")
    if options.networks is None and form == "shipped":
        return load_glove_models()
    if options.networks is None:
        return GloveModels(*_open(*(packaged(name) for name in PAPER_FILES)))
    if not options.networks.is_dir():
        raise BodysenseError(
            f"{options.networks}: no such folder; give the one that `bodysense train gloves --form {form} -o` wrote"
        )
    networks = _open(*(options.networks / name for name in FILES))
    for one in networks:
        if options.variant is not None and one.network.card["form"] != form:
            raise BodysenseError(f"--variant {form}: {one.network.name} has the form {one.network.card['form']!r}")
    return GloveModels(*networks)


def _open(markers: Path, joints: Path) -> tuple[GloveNetwork, GloveNetwork]:
    return load_marker_network(markers), load_joint_network(joints)
