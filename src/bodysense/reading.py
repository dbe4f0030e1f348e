"""Files as what they hold: `read` gives a motion or a recording, `write` writes either."""

from __future__ import annotations

from pathlib import Path

from bodysense.body.skeleton import default_skeleton
from bodysense.capture.markers import is_marker_file, read_markers, with_hands_of
from bodysense.capture.recording import Recording, is_recording, read_recording, write_recording
from bodysense.capture.video import is_video
from bodysense.data.clip import Clip
from bodysense.data.sources import Source, read_source
from bodysense.errors import BodysenseError
from bodysense.export.motion_files import ENDINGS, write_motion

RECORDING_ENDINGS = (".npz", ".jsonl")


def read(path: str | Path) -> Clip | Recording:
    """Read a motion (.bvh, AMASS .npz) as a Clip, a recording or gloves' markers (.csv, .c3d) as a Recording.

    A clip is in canonical form: metres, +Y up, the skeleton of 65 points. Raises BodysenseError, naming the file and
    the fix, for every other file.
    """
    path = Path(path)
    if is_video(str(path)):
        raise BodysenseError(f"{path}: a video is read while it is tracked; give it to track")
    if not path.is_file():
        raise BodysenseError(f"{path}: no such file")
    if is_marker_file(path):
        found = read_markers(path)
        return Recording(found.observation, with_hands_of(default_skeleton(), found.sizes), hands_shown=True)
    if is_recording(path):
        return read_recording(path)
    return read_source(Source(path, person="", split="test"))


def write(path: str | Path, content: Clip | Recording) -> None:
    """Write a clip (.bvh, .glb, .vrma) or a recording (.npz, .jsonl); the file appears whole or not at all.

    Raises BodysenseError where the ending is of another kind of file.
    """
    path = Path(path)
    if isinstance(content, Clip):
        write_motion(path, content)
    elif path.suffix.lower() in ENDINGS:
        raise BodysenseError(
            f"{path}: a recording is no motion; complete it first: track(recording).save({path.name!r}), "
            f"or give a name that ends in {' or '.join(RECORDING_ENDINGS)}"
        )
    else:
        write_recording(path, content)
