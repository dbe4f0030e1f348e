"""Reading and writing of motions and recordings: `read` and `write`."""

from __future__ import annotations

from pathlib import Path

from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError, expect
from bodysense.io.clip import Clip
from bodysense.io.formats.recording import Recording, write_recording
from bodysense.io.motion_files import ENDINGS, write_motion
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.observing.observation import Observation
from bodysense.sources.open import MotionSource, VideoSource, open_source

RECORDING_ENDINGS = (".npz", ".jsonl")


def read(path: str | Path, options: ReadingOptions = AS_FOUND) -> Clip | Recording:
    """Read a motion (.bvh, .fbx, AMASS or SMPL .npz, .npy, .glb …) as a Clip, anything else as a Recording.

    Recordings (.npz, .jsonl) and markers (.c3d, .csv, .trc, .tsv) become a Recording. A clip is in canonical form:
    metres, +Y up, the skeleton of 65 points. `options` are facts that a motion file omits or has wrong: unit, upward
    axis, floor, height, joints, which body.

    Raises BodysenseError, naming the file and the fix, for every other file.
    """
    opened = open_source(path, options)
    if isinstance(opened, VideoSource):
        raise BodysenseError(f"{path}: a video is read while it is tracked; give it to track")
    return opened.clip if isinstance(opened, MotionSource) else opened.recording


def write(path: str | Path, content: Clip | Recording | Observation) -> None:
    """Write a clip (.bvh, .fbx, .glb, .vrma, .mcap) or a recording (.npz, .jsonl); it appears whole or not at all.

    An observation is written as a recording of an unknown body. Raises BodysenseError if the ending is of another kind
    of file.
    """
    expect(path, (str, Path), "write", "the path first: write(path, content)")
    expect(content, (Clip, Recording, Observation), "write", "a Clip, a Recording or an Observation")
    path = Path(path)
    if isinstance(content, Observation):
        content = Recording(content, default_skeleton(), known=False)
    if isinstance(content, Clip):
        write_motion(path, content)
    elif path.suffix.lower() in ENDINGS:
        raise BodysenseError(
            f"{path}: a recording is no motion; complete it first: track(recording).save({path.name!r}), "
            f"or give a name that ends in {' or '.join(RECORDING_ENDINGS)}"
        )
    else:
        write_recording(path, content)
