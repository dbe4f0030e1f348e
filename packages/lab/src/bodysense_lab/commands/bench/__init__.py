"""`bodysense bench`: speed on this machine, and tests of the live server under load; one module for each benchmark."""

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
        live_fuzz,
        live_outputs,
        live_soak,
        occlusion,
        packet_decoders,
        packet_fuzz,
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
    for command in (live_outputs.live_outputs, live_fuzz.live_fuzz, packet_fuzz.packet_fuzz):
        group.command(command)
    group.command(packet_decoders.packet_decoders)
    group.command(live_soak.live_soak)
    return group
