"""Layouts of published data sets: person, split and kind of each motion, from the names of files and folders.

    unoc     <participant>/merged bvh/*.bvh. The release of UNOC (Parger et al. 2021; 120 Hz, centimetres): a folder
             for each of its 13 participants. Other files of it (the hands alone, reference_skeleton.bvh) are left out.
    twh      mocap_data/<session>/<take>.zip. Talking With Hands 16.2M (Lee et al., ICCV 2019; 90 Hz, centimetres): two
             speakers a take, named in its members, take5_hasFingers_shallow26_scale_local.bvh. Unpacked, too.
    mixamo   BVH files whose root is called mixamorig:Hips, exported from Mixamo, in any folders.
    folder   Any other: the person is the first folder, or the beginning of the name. In a tree of AMASS,
             <set>/<subject>/*.npz, a person is both.

UNOC's wrists. The gloves measured the fingers relative to the hand, and the optical system the hand's orientation,
which is off by a constant turn for each participant, because of where the markers sat; the paper (section 3.1) found
that turn in a calibration take with markers on the fingertips and removed it. The files in 'merged bvh' have optical
hands with that turn removed and the gloves' fingers on them: `b_l_wrist` is the calibrated wrist of the body and of the
fingers alike. So nothing is applied here. The wrists of the release's separate hand files are the gloves' own, not
calibrated, on a body that stands still: those are not read as body motion.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Literal, get_args

from bodysense.errors import BodysenseError
from bodysense.files import natural_order
from bodysense.io.datasets.splits import Split, split_of

if TYPE_CHECKING:  # the command line imports this module, and starts sooner without what reads files
    from bodysense.io.formats.archive import MotionFile

Layout = Literal["unoc", "twh", "mixamo", "folder"]
LAYOUTS: tuple[Layout, ...] = get_args(Layout)
UNOC_PARTICIPANTS = 13

# As its archives are called, in the first release and after it.
# fmt: off
AMASS_SETS = frozenset((
    "ACCAD", "BMLhandball", "BMLmovi", "BMLrub", "BioMotionLab_NTroje", "CMU", "CNRS", "DFaust", "DFaust_67", "DanceDB",
    "EKUT", "EyesJapanDataset", "Eyes_Japan_Dataset", "GRAB", "HDM05", "HUMAN4D", "HumanEva", "KIT", "MOYO",
    "MPI_HDM05", "MPI_Limits", "MPI_mosh", "MoSh", "PosePrior", "SFU", "SOMA", "SSM", "SSM_synced", "TCDHands",
    "TCD_handMocap", "TotalCapture", "Transitions", "Transitions_mocap", "WEIZMANN",
))
# fmt: on
_MERGED = re.compile(r"merged[ _-]?bvh", re.IGNORECASE)
_SPEAKER = re.compile(r"(?:^|_)((?:deep|shallow)\d+)(?=[_.]|$)", re.IGNORECASE)
_SESSION = re.compile(r"session\d+", re.IGNORECASE)
_TAKE = re.compile(r"take\d+", re.IGNORECASE)
_MIXAMO_ROOT = re.compile(rb"ROOT\s+mixamorig", re.IGNORECASE)
_SUBJECT = re.compile(r"subject_?\d+", re.IGNORECASE)
_COPY = re.compile(r"\s*\(\d+\)$")  # of a file downloaded twice: 'Walking (1)'


@dataclass(frozen=True)
class Labelled:
    """A motion file and its labels from the folder."""

    file: MotionFile
    person: str
    split: Split
    category: str = ""
    rest: Literal["given", "found"] = "given"  # see `sources.Source`


def layout_of(directory: Path, files: Sequence[MotionFile]) -> Layout:
    """Return the layout of a folder, from the names in it and, for Mixamo, the first line of each file."""
    inside = [file.inside(directory) for file in files]
    if any(_is_merged(path) for path in inside):
        return "unoc"
    if any(_SPEAKER.search(path.name) and _TAKE.search(path.name) for path in inside):
        return "twh"
    bvh = [file for file in files if file.place.suffix.lower() == ".bvh"]
    return "mixamo" if bvh and all(_MIXAMO_ROOT.search(file.head()) for file in bvh) else "folder"


def labelled(layout: Layout, directory: Path, files: Sequence[MotionFile]) -> list[Labelled]:
    """Return the motion files of a folder that belong to its data set, with the labels of each.

    unoc: the person is the participant's folder. The paper tests on a fifth of the data, two unseen participants
    among them, and does not name them; its released code takes the last fifth in the order of the folders. Of a whole
    release (13 participants, in the order of their numbers or names) the last two are the test set here, the one
    before them validation; of another number, the name decides as elsewhere (`split_of`).
    twh: the person is the speaker, 'deep5' (several sessions) or 'shallow26' (one session); without
    one, the session. Takes that configs/conversations.json lists are 'conversation', others 'other'.
    mixamo: there are no persons, and one motion stands on several characters. What must not be in two splits is the
    motion, so the 'person' is its name: that of the file, without 'Character@' before it and ' (1)' behind it.
    folder: see `sources.list_sources`.
    Raises BodysenseError if the folder does not have the requested layout.
    """
    if layout == "unoc":
        return _unoc(directory, files)
    if layout == "twh":
        return _talking_with_hands(directory, files)
    if layout == "mixamo":
        people = [_COPY.sub("", file.place.stem.rpartition("@")[2]) for file in files]
    elif layout == "folder":
        people = [_person(file, directory) for file in files]
    else:
        raise BodysenseError(f"unknown layout {layout!r}; valid are {', '.join(LAYOUTS)}")
    return [Labelled(file, person, split_of(person)) for file, person in zip(files, people, strict=True)]


def _is_merged(path: PurePosixPath) -> bool:
    return _MERGED.fullmatch(path.parent.name) is not None


def _unoc(directory: Path, files: Sequence[MotionFile]) -> list[Labelled]:
    # A participant's own folder may be given, too: then 'merged bvh' has no folder above it but `directory`.
    people = {
        file: file.inside(directory).parent.parent.name or directory.resolve().name
        for file in files
        if _is_merged(file.inside(directory))
    }
    if not people:
        raise BodysenseError(
            f"{directory}: not laid out as UNOC's release: there is no folder 'merged bvh' in it; give the folder that "
            "holds the participants' folders"
        )
    order = sorted(set(people.values()), key=natural_order)
    split: dict[str, Split] = {person: split_of(person) for person in order}
    if len(order) == UNOC_PARTICIPANTS:  # the rule in `labelled`
        last: list[Split] = ["val", "test", "test"]
        split = {person: "train" for person in order[:-3]}
        split |= dict(zip(order[-3:], last, strict=True))
    return [Labelled(file, person, split[person], rest="found") for file, person in people.items()]


def _talking_with_hands(directory: Path, files: Sequence[MotionFile]) -> list[Labelled]:
    if not any(_SPEAKER.search(file.place.name) for file in files):
        raise BodysenseError(
            f"{directory}: not laid out as Talking With Hands: no file names a speaker, as "
            "take5_hasFingers_shallow26_scale_local.bvh does; give its folder mocap_data"
        )
    # A clone of the repository has zip files of sound, too.
    motion = [file for file in files if "mocap_data" in file.inside(directory).parts]
    conversations = _conversations(directory)
    found = []
    for file in motion or files:
        place = file.place.as_posix()
        session, take = (pattern.findall(place) for pattern in (_SESSION, _TAKE))
        speaker = _SPEAKER.search(file.place.name)
        person = speaker[1] if speaker else session[-1] if session else _person(file, directory)
        category = ""
        if conversations is not None:
            talks = bool(session and take) and (session[-1].lower(), take[-1].lower()) in conversations
            category = "conversation" if talks else "other"
        found.append(Labelled(file, person.lower(), split_of(person.lower()), category, rest="found"))
    return found


def _conversations(directory: Path) -> set[tuple[str, str]] | None:
    """Return (session, take) of the conversations that the release lists; None if the list is missing."""
    for folder in (directory, directory.resolve().parent):
        path = folder / "configs" / "conversations.json"
        if path.is_file():
            try:
                entries = json.loads(path.read_text(encoding="utf-8"))
                takes = {session: takes for session, takes in entries.items() if isinstance(takes, dict)}
            except (OSError, ValueError, AttributeError) as error:
                raise BodysenseError(f"{path}: cannot be read ({error}); download it again or remove it") from None
            return {(session.lower(), take.lower()) for session, names in takes.items() for take in names}
    return None


def _person(file: MotionFile, directory: Path) -> str:
    """Return the person: the first folder (a zip file only if nothing else names one), else the beginning of the name.

    Below the folder of a set of AMASS people have folders of their own.
    """
    above = PurePosixPath(file.path.relative_to(directory).as_posix()).parent.parts
    folders = (*above, *PurePosixPath(file.member).parent.parts)
    if not folders and file.member:
        folders = (file.path.stem,)
    if len(folders) > 1 and folders[0] in AMASS_SETS:
        return f"{folders[0]}_{folders[1]}"
    subject = _SUBJECT.search(file.place.stem)
    return folders[0] if folders else subject[0] if subject else file.place.stem.partition("_")[0]
