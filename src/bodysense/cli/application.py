"""The tree of commands."""

from __future__ import annotations

from tyro.extras import SubcommandApp

from bodysense.cli import bench, conform, data, demo, evaluate, motion, samples, serve, study, train


def application() -> SubcommandApp:
    """All commands: `bodysense demo`, `bodysense data info` …"""
    root = SubcommandApp()
    for command in (demo.demo, motion.track, motion.simulate, conform.conform):
        root.command(command)
    root.command(samples.generate)
    root.command(serve.serve)
    root.command(data.commands(), name="data")
    root.command(train.commands(), name="train")
    root.command(evaluate.commands(), name="evaluate")
    root.command(bench.commands(), name="bench")
    root.command(study.commands(), name="study")
    return root
