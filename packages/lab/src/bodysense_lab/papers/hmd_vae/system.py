"""HMD-VAE on a recording: the decoder's body at the posterior's mean, without inverse kinematics or smoothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bodysense.body.body_joints import body_skeleton, whole_pose
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.observing.observation import Observation
from bodysense.sources.open import MotionSource, Opened
from bodysense.sources.signals import signal_from
from bodysense_lab.data.tracked_clip import tracked_clip
from bodysense_lab.papers.hmd_vae.body_vae import BodyVaeEstimator, BodyVaeModel, BodyVaeState, load_body_vae
from bodysense_lab.papers.paper_options import PaperOptions, Variant, missing_weights_error

MODELS: tuple[Variant, ...] = ("0", "1", "2", "3", "4")
PACKAGED: Variant = "4"


def complete(opened: Opened, options: PaperOptions) -> Clip:
    """Return the wearer's motion by the model 0 to 4 that `options.variant` names, if omitted by the file's.

    Models 1 to 4 read head and wrists: a motion is watched by a three-point device unless another is named. Model 0
    encodes and decodes whole bodies: it takes a motion. Raises BodysenseError for a file of another model.
    """
    model = _model(options)
    if model.card["network"]["model"] == 0:
        return _encoded(opened, options, model)
    device = options.choose_device(opened, "three_point")
    signal = signal_from(opened, device=device, height=options.height, noise=options.noise)
    estimator = BodyVaeEstimator(signal.person.skeleton, model)

    def step(observation: Observation, state: BodyVaeState) -> tuple[Pose, BodyVaeState]:
        estimate, state = estimator.step(observation, state)
        assert estimate.pose is not None
        return estimate.pose, state

    return tracked_clip(signal, step, estimator.start())


def _model(options: PaperOptions) -> BodyVaeModel:
    wanted = options.choose_variant("hmd_vae", MODELS, PACKAGED) if options.networks is None else options.variant
    if options.networks is None and wanted != PACKAGED:
        train = "bodysense train hmd-vae --data DIR --model"
        before, decoder = (f"{train} 0 -o zero.pt, then ", " --decoder zero.pt") if wanted == "3" else ("", "")
        raise missing_weights_error(
            f"--variant {wanted}",
            f"{before}{train} {wanted}{decoder} -o model{wanted}.onnx",
            f"--networks model{wanted}.onnx",
        )
    model = load_body_vae(options.networks)
    found = str(model.card["network"]["model"])
    if wanted is not None and options.choose_variant("hmd_vae", MODELS, PACKAGED) != found:
        raise BodysenseError(f"--variant {wanted}: {model.name} is a model {found}; leave --variant out")
    return model


def _encoded(opened: Opened, options: PaperOptions, model: BodyVaeModel) -> Clip:
    """Encode and decode every frame of a motion on its own."""
    if not isinstance(opened, MotionSource):
        raise BodysenseError(f"{opened.name}: model 0 reads whole bodies; give a motion, or --variant 1 to 4")
    given = {"--device": options.device, "--height": options.height, "--noise": options.noise}
    for option, value in given.items():
        if value is not None:
            raise BodysenseError(f"{opened.name}: model 0 reads the motion itself; leave {option} out")
    clip = opened.clip
    skeleton = clip.pose.skeleton
    position, rotation = (np.asarray(values) for values in forward_kinematics(clip.pose))
    body, rest = skeleton.indices(BODY), body_skeleton(skeleton).rest_offset
    mean = np.zeros(model.latent)
    frames = [
        model.body(position[t : t + 1, body], rotation[t : t + 1, body], 1.0, mean, rest) for t in range(len(clip))
    ]
    pose = whole_pose(skeleton, *(np.stack(parts) for parts in zip(*frames, strict=True)))
    return replace(clip, pose=pose, has_fingers=False)
