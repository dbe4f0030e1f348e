"""Public motion data that the readers know, for `bodysense data sources` and for errors about missing sets."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bodysense.errors import BodysenseError


@dataclass(frozen=True)
class Entry:
    """One collection."""

    name: str
    what: str
    format: str
    fingers: str
    licence: str
    where: str
    tables: str = ""  # of the papers, that need it


CATALOGUE = (
    Entry(
        "UNOC",
        "3.7 h of social interaction, 13 people, 120 Hz",
        ".bvh",
        "yes",
        "MIT",
        "github.com/facebookresearch/UNOC",
        "UNOC 1-6",
    ),
    Entry(
        "TWH16.2M",
        "Talking With Hands: 20 h of conversation in pairs, 90 Hz",
        ".bvh in .zip",
        "yes",
        "CC BY-NC 4.0",
        "github.com/facebookresearch/TalkingWithHands32M",
        "UNOC 1, 5",
    ),
    Entry(
        "Mixamo",
        "animators' clips, 30 Hz; export them as BVH",
        ".bvh",
        "yes",
        "Adobe's terms, no redistribution",
        "mixamo.com",
        "UNOC 1, 5, 6",
    ),
    Entry(
        "AMASS",
        "45 h of optical capture, many sets",
        ".npz, SMPL-H or SMPL-X",
        "some",
        "research only",
        "amass.is.tue.mpg.de",
        "HMD-VAE",
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
    Entry(
        "LaFAN1",
        "4.6 h of game locomotion",
        ".bvh",
        "no",
        "CC BY-NC-ND 4.0",
        "github.com/ubisoft/ubisoft-laforge-animation-dataset",
    ),
    Entry("100STYLE", "4 h of walking in styles (Xsens)", ".bvh", "no", "CC BY 4.0", "zenodo.org/records/8127870"),
)


def entry(name: str) -> Entry:
    """Return the collection of that name. Raises BodysenseError with the valid names."""
    for one in CATALOGUE:
        if one.name.lower() == name.lower():
            return one
    raise BodysenseError(f"unknown data set {name!r}; valid are {', '.join(one.name for one in CATALOGUE)}")


def require(name: str, directory: str | Path | None) -> Path:
    """Return the folder or store of a data set that a table needs.

    Raises BodysenseError if no folder is given or it holds no motion. The message says which data set is missing,
    where to get it and under which licence.
    """
    data = entry(name)
    there = "no folder of it is given"
    if directory is not None:
        directory = Path(directory)
        if (directory / "zarr.json").is_file():
            return directory
        from bodysense.io.datasets.sources import list_sources

        try:
            list_sources(directory)
            return directory
        except BodysenseError as error:
            there = str(error).partition(";")[0]
    raise BodysenseError(
        f"the data set {data.name} is missing ({there}); get it at {data.where} (licence: {data.licence}) and give its "
        "folder, or a store made of it by `bodysense data prepare`"
    )
