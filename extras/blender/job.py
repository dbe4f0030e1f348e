"""A job of bodysense on an armature, in small steps, so that the interface stays free.

Sample the armature's poses, run bodysense in a process, key its answer into a new action. Each step yields a line for
the status bar, and whether the job waits.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import bpy

from . import armature
from .bvh import read_rows, write_bvh
from .fault import Fault
from .process import environment, error_line, progress

Steps = Iterator[tuple[str, bool]]
_LONGEST = 65_536  # bytes of the last output, for the newest progress


def steps(
    scene: bpy.types.Scene,
    thing: bpy.types.Object,
    frames: tuple[int, int],
    holes: Mapping[str, set[int]],
    command: Callable[[str, str, Mapping[str, str]], list[str]],
    name: str,
) -> Steps:
    """Run a job.

    Args:
        scene: whose frames are sampled.
        thing: the armature.
        frames: the first and the last.
        holes: bone → frames that get keys.
        command: the command line from the take's path, the answer's, and bone → its name in BVH.
        name: of the new action.
    """
    first, last = frames
    bones = armature.tree(thing)
    joints, current, rows = armature.joints(bones), scene.frame_current, []
    try:
        for frame in range(first, last + 1):
            scene.frame_set(frame)
            rows.append(armature.row(bones))
            yield f"reading frame {frame} of {first}-{last}", False
    finally:
        scene.frame_set(current)
    names = {bone.name: joint.name for bone, joint in zip(bones, joints, strict=True)}
    with tempfile.TemporaryDirectory(prefix="bodysense-") as folder:
        take, out, printed = (Path(folder) / name for name in ("take.bvh", "out.bvh", "printed.txt"))
        take.write_text(write_bvh(joints, rows, scene.render.fps_base / scene.render.fps), encoding="utf-8")
        yield from _run(command(str(take), str(out), names), printed)
        answer = read_rows(out.read_text(encoding="utf-8"), joints)
    if len(answer) != len(rows):
        raise Fault(f"bodysense returned {len(answer)} frames of {len(rows)}")
    armature.copy_action(thing, name)
    for done in armature.keyed(thing, bones, answer, first, holes):
        yield f"keying bone {done} of {len(bones)}", False
    scene.frame_set(current)


def _run(command: list[str], printed: Path) -> Steps:
    """Run a command to its end; raise its one-line error."""
    with printed.open("wb") as out:
        try:
            process = subprocess.Popen(
                command, stdout=out, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, env=environment(os.environ)
            )
        except OSError as error:
            raise Fault(f"{command[0]}: cannot be started: {error.strerror}; see the add-on's preferences") from None
    try:
        while process.poll() is None:
            done = progress(printed.read_bytes()[-_LONGEST:].decode("utf-8", "replace"))
            yield ("bodysense starts" if done is None else f"bodysense: {done} %") + " (Esc cancels)", True
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
    if process.returncode:
        raise Fault(error_line(printed.read_text(encoding="utf-8", errors="replace"), process.returncode))
