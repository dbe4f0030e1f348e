"""Public motion data that the readers know, for `bodysense data sources`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Entry:
    """One collection."""

    name: str
    what: str
    format: str
    fingers: str
    licence: str
    where: str


CATALOGUE = (
    Entry(
        "AMASS",
        "45 h of optical capture, many sets",
        ".npz, SMPL-H or SMPL-X",
        "some",
        "research",
        "amass.is.tue.mpg.de",
    ),
    Entry(
        "CMU", "8 h, everyday to acrobatics (cgspeed BVH or in AMASS)", ".bvh, .npz", "no", "free", "mocap.cs.cmu.edu"
    ),
    Entry(
        "Rocketbox",
        "half an hour of avatar animation",
        ".bvh",
        "yes",
        "MIT",
        "github.com/microsoft/Microsoft-Rocketbox",
    ),
    Entry("UNOC", "3.7 h of social interaction", ".bvh", "yes", "see its page", "paper's page"),
    Entry(
        "Talking With Hands",
        "50 h of conversation",
        ".bvh",
        "yes",
        "CC BY-NC 4.0",
        "github.com/facebookresearch/TalkingWithHands32M",
    ),
    Entry(
        "LaFAN1",
        "4.6 h of game locomotion",
        ".bvh",
        "no",
        "CC BY-NC-ND 4.0",
        "github.com/ubisoft/ubisoft-laforge-animation-dataset",
    ),
    Entry("Mixamo", "animator's clips", ".bvh (exported)", "yes", "Adobe's terms", "mixamo.com"),
    Entry("100STYLE", "4 h of walking in styles (Xsens)", ".bvh", "no", "CC BY 4.0", "zenodo.org/records/8127870"),
)
