"""UNOC on a recording: predictor, inverse kinematics, momentum-based smoothing (sections 3 and 4.2)."""

from __future__ import annotations

from bodysense.body.pose import Pose
from bodysense.io.clip import Clip
from bodysense.observing.observation import Observation
from bodysense.sources.open import Opened
from bodysense.sources.signals import signal_from
from bodysense_lab.data.tracked_clip import tracked_clip
from bodysense_lab.papers.paper_options import PaperOptions
from bodysense_lab.papers.unoc.ik_tracker import IkTracker, IkTrackerState
from bodysense_lab.papers.unoc.learned import Learned, load_model


def complete(opened: Opened, options: PaperOptions) -> Clip:
    """Return the wearer's motion. Bone lengths are an input of the paper: they are not inferred.

    A motion is watched by the headset's cameras unless `options.device` names another device.
    """
    options.choose_variant("unoc", ("paper",), "paper")
    device, model = options.choose_device(opened, "headset_camera"), load_model(options.networks)
    signal = signal_from(opened, device=device, height=options.height, noise=options.noise)
    tracker = IkTracker(Learned(model, signal.person.skeleton))

    def step(observation: Observation, state: IkTrackerState) -> tuple[Pose, IkTrackerState]:
        pose, _, state = tracker.step(observation, state)
        return pose, state

    return tracked_clip(signal, step, tracker.start())
