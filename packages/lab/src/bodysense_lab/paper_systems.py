"""Systems of the papers by name, and the tracker next to them: each completes an opened source into a clip."""

from __future__ import annotations

from collections.abc import Callable

from bodysense.completion.model import load_completion
from bodysense.io.clip import Clip
from bodysense.open import Opened
from bodysense.take import track
from bodysense_lab.hmd_vae import system as hmd_vae
from bodysense_lab.pahmt import system as pahmt
from bodysense_lab.paper_options import Method, PaperOptions
from bodysense_lab.two_hands import system as two_hands
from bodysense_lab.unoc import system as unoc


def completed(opened: Opened, options: PaperOptions) -> Clip:
    """Complete a source by the tracker of `bodysense track`; a motion is watched by the headset's cameras."""
    options.chosen("completion", (), "shipped")
    device = options.watched_by(opened, "headset_camera")
    network = None if options.networks is None else load_completion(options.networks)
    return track(opened, device=device, height=options.height, noise=options.noise, network=network).clip


SYSTEMS: dict[Method, Callable[[Opened, PaperOptions], Clip]] = {
    "unoc": unoc.complete,
    "hmd_vae": hmd_vae.complete,
    "pahmt": pahmt.complete,
    "two_hands": two_hands.complete,
    "completion": completed,
}
