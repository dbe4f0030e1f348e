"""`bodysense evaluate`: tables of scores."""

from __future__ import annotations

from tyro.extras import SubcommandApp

from bodysense_lab.commands import arms, completion, gloves, hmd_vae, rendering, unoc


def commands() -> SubcommandApp:
    """Return the group's commands."""
    group = SubcommandApp()
    group.command(name="completion")(completion.completion_table)
    group.command(completion.kinds)
    group.command(completion.amass_p1)
    group.command(completion.scenes)
    group.command(name="fingers")(completion.untracked_fingers)
    group.command(completion.holes)
    group.command(name="repair")(completion.repair_table)
    group.command(unoc.finger_synthesis)
    group.command(name="hmd-vae")(hmd_vae.hmd_vae_figures)
    group.command(hmd_vae.hmd_vae_figure4)
    for command in (
        *(arms.pahmt_table1, rendering.video_rendered, unoc.unoc_table1, unoc.unoc_table2, unoc.unoc_table3),
        *(unoc.unoc_table4, unoc.unoc_table5, unoc.unoc_table6, unoc.unoc_smoothness, unoc.transitions),
        *(unoc.unoc_figure5, unoc.unoc_figure7, rendering.pahmt_figure3, rendering.pahmt_figure4),
        *(gloves.gloves_occlusion, gloves.gloves_limits, gloves.gloves_table3),
        *(gloves.gloves_table4, gloves.gloves_layouts, gloves.gloves_fusion, gloves.gloves_settings),
    ):
        group.command(command)
    return group
