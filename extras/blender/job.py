"""A job of bodysense on an armature, in small steps, so that the interface stays free.

Sample the armature's poses, run bodysense in a process, key its answer into a new action. Each step yields a line for
the status bar, and whether the job waits.
"""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import bpy

from . import armature
from .bvh import read_rows, write_bvh
from .fault import Fault
from .process import command, environment, error_line, progress

Steps = Iterator[tuple[str, bool]]
_LONGEST = 65_536  # bytes of the last output, for the newest progress


def steps(
    scene: bpy.types.Scene,
    thing: bpy.types.Object,
    frames: tuple[int, int],
    holes: Mapping[str, set[int]],
    settings: Callable[[Mapping[str, str]], dict[str, Any]],
    name: str,
) -> Steps:
    """Run a job.

    Args:
        scene: whose frames are sampled.
        thing: the armature.
        frames: the first and the last.
        holes: bone → frames that get keys.
        settings: the arguments of `bodysense.track` from bone → its name in BVH.
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
        yield from _run(command(str(take), str(out)), json.dumps(settings(names)), printed)
        answer = read_rows(out.read_text(encoding="utf-8"), joints)
    if len(answer) != len(rows):
        raise Fault(f"bodysense returned {len(answer)} frames of {len(rows)}")
    armature.copy_action(thing, name)
    for done in armature.keyed(thing, bones, answer, first, holes):
        yield f"keying bone {done} of {len(bones)}", False
    scene.frame_set(current)


def _run(words: list[str], given: str, printed: Path) -> Steps:
    """Run a command to its end with `given` as its input; raise its one-line error."""
    read = printed.with_name("given.json")
    read.write_text(given, encoding="utf-8")
    with printed.open("wb") as out, read.open("rb") as given_file:
        try:
            process = subprocess.Popen(
                words, stdout=out, stderr=subprocess.STDOUT, stdin=given_file, env=environment(os.environ)
            )
        except OSError as error:
            raise Fault(f"{words[0]}: Blender's Python cannot be started: {error.strerror}") from None
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
