"""`bodysense bench`: speed on this machine; one module for each benchmark."""

from __future__ import annotations

from tyro.extras import SubcommandApp


def commands() -> SubcommandApp:
    """Return the group's commands."""
    from bodysense_lab.commands.bench import arms, gloves, ik, live, step, take, training, video

    group = SubcommandApp()
    group.command(name="step")(step.bench_step)
    for command in (gloves.gloves, ik.ik, take.take, training.training, arms.arms, video.video):
        group.command(command)
    group.command(name="live")(live.bench_live)
    return group
