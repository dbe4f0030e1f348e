"""`bodysense data info --occlusion`: what a headset's cameras would see of motion."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from bodysense.occlusion.headset_camera import HeadsetCamera

if TYPE_CHECKING:
    from rich.table import Table

    from bodysense.data.clip import Clip


def occlusion_table(clips: Iterable[Clip], camera: HeadsetCamera = HeadsetCamera()) -> tuple[Table, dict[str, float]]:
    """UNOC, Table 1: a column a category, then all, then the published ones; and the numbers of ours."""
    from rich.table import Table

    from bodysense.lab.unoc import occlusion_statistics as statistics
    from bodysense.lab.unoc.occlusion_table import columns_of, count_clips, numbers_of

    ours = columns_of(count_clips(clips, 1, lambda clip: None, camera)[0])
    header, rows = statistics.table([*ours, *statistics.PUBLISHED])
    shown = Table(title="Occlusion and contact (UNOC, Table 1; the last columns are published)")
    for name in header:
        shown.add_column(name, justify="left" if name == header[0] else "right")
    for row in rows:
        shown.add_row(*row)
    return shown, numbers_of(ours)
