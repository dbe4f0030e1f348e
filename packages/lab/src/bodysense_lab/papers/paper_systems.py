"""Systems of the papers and the tracker, by name. Each completes an opened source to a clip."""

from __future__ import annotations

from collections.abc import Callable

from bodysense.io.clip import Clip
from bodysense.sources.open import Opened
from bodysense.takes.track import track
from bodysense.tracking.model import load_completion
from bodysense_lab.papers.hmd_vae import system as hmd_vae
from bodysense_lab.papers.pahmt import system as pahmt
from bodysense_lab.papers.paper_options import Method, PaperOptions
from bodysense_lab.papers.two_hands import system as two_hands
from bodysense_lab.papers.unoc import system as unoc


def complete_by_tracker(opened: Opened, options: PaperOptions) -> Clip:
    """Complete a source by the tracker of `bodysense track`; a motion is tracked by simulated cameras of a headset."""
    options.choose_variant("completion", (), "shipped")
    device = options.choose_device(opened, "headset_camera")
    network = None if options.networks is None else load_completion(options.networks)
    return track(opened, device=device, height=options.height, noise=options.noise, network=network).clip


SYSTEMS: dict[Method, Callable[[Opened, PaperOptions], Clip]] = {
    "unoc": unoc.complete,
    "hmd_vae": hmd_vae.complete,
    "pahmt": pahmt.complete,
    "two_hands": two_hands.complete,
    "completion": complete_by_tracker,
}
