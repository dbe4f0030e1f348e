"""`bodysense bench`: speed on this machine; one module for each benchmark."""

from __future__ import annotations

from tyro.extras import SubcommandApp


def commands() -> SubcommandApp:
    """Return the group's commands."""
    from bodysense_lab.commands.bench import (
        arms,
        bvh,
        gloves,
        ik,
        import_time,
        live,
        occlusion,
        step,
        take,
        training,
        video,
    )

    group = SubcommandApp()
    group.command(name="step")(step.bench_step)
    for command in (gloves.gloves, ik.ik, occlusion.occlusion, bvh.bvh, take.take):
        group.command(command)
    group.command(name="import")(import_time.import_time)
    group.command(training.training)
    for command in (arms.arms, video.video):
        group.command(command)
    group.command(name="live")(live.bench_live)
    return group
