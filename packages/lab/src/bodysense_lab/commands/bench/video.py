"""`bodysense bench video`: detection of landmarks in a video, and completion of its person."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import tyro

from bodysense_lab.commands.bench.timing import report, resident_memory
from bodysense_lab.core.options import Json


def video(file: Annotated[Path, tyro.conf.Positional], json: Json = None) -> None:
    """Measure the processor time of each picture: reading it and detecting landmarks, and completing a body.

    Args:
        file: video or folder of pictures.
    """
    import bodysense as bs
    from bodysense.devices.video.landmarker_files import find_landmarkers
    from bodysense.devices.video.landmarks import Landmarker, LandmarkerSettings
    from bodysense.devices.video.pictures import open_video

    bs.track(str(file))  # fills the caches, and refuses other files
    begun = time.process_time()
    bs.track(str(file))
    whole = time.process_time() - begun
    models, numbers = find_landmarkers(), dict[str, float]()
    for people in (1, 2):
        with open_video(str(file)) as source, Landmarker(models, LandmarkerSettings(people)) as landmarker:
            begun, count, width, height = time.process_time(), 0, 0, 0
            for picture in source.pictures:
                landmarker.find(picture)
                count, (height, width) = count + 1, picture.pixels.shape[:2]
            numbers[f"people_{people}_landmarks_ms"] = 1000 * (time.process_time() - begun) / count
    numbers["whole_ms"] = 1000 * whole / count
    numbers["body_ms"] = numbers["whole_ms"] - numbers["people_1_landmarks_ms"]
    numbers["memory_mb"] = resident_memory()
    report("video", numbers | {"pictures": count, "width": width, "height": height}, json)
