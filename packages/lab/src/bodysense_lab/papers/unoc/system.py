"""UNOC on a recording: predictor, inverse kinematics, momentum-based smoothing (sections 3 and 4.2)."""

from __future__ import annotations

from bodysense.body.pose import Pose
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.observing.observation import Observation
from bodysense.sources.open import Opened
from bodysense.sources.signals import signal_from
from bodysense_lab.data.tracked_clip import tracked_clip
from bodysense_lab.papers.paper_options import PaperOptions, missing_weights_error
from bodysense_lab.papers.unoc.ik_tracker import IkTracker, IkTrackerState
from bodysense_lab.papers.unoc.learned import Learned, load_model


def complete(opened: Opened, options: PaperOptions) -> Clip:
    """Return the wearer's motion. Bone lengths are an input of the paper: they are not inferred.

    A motion is watched by the headset's cameras unless `options.device` names another device.
    """
    variant = options.choose_variant("unoc", ("paper", "shipped"), "shipped")
    device, model = options.choose_device(opened, "headset_camera"), load_model(options.networks)
    form = "paper" if str(model.card.get("form", "shipped")).startswith("paper") else "shipped"
    if options.variant is not None and variant != form:
        if options.networks is not None:
            raise BodysenseError(f"{options.networks}: not of the {variant} form; leave --variant out")
        command = "bodysense train body-gru --data DIR --form paper -o body.onnx"
        raise missing_weights_error("--method unoc --variant paper", command, "--networks body.onnx")
    signal = signal_from(opened, device=device, height=options.height, noise=options.noise)
    tracker = IkTracker(Learned(model, signal.person.skeleton))

    def step(observation: Observation, state: IkTrackerState) -> tuple[Pose, IkTrackerState]:
        pose, _, state = tracker.step(observation, state)
        return pose, state

    return tracked_clip(signal, step, tracker.start())
