"""Commands of the laboratory: train, evaluate, papers, bench, study, data prepare and data render."""

from __future__ import annotations

from tyro.extras import SubcommandApp


def add_commands(root: SubcommandApp, data: SubcommandApp) -> None:
    """Add the laboratory's commands to the tree and to its group `data`; `data info` then also reads stores."""
    from bodysense_lab.commands import bench, evaluate, info, papers, prepare, rendering, study, train

    data.command(info.info)
    data.command(prepare.prepare)
    data.command(rendering.render)
    root.command(train.commands(), name="train", help="Train a network.")
    root.command(evaluate.commands(), name="evaluate", help="Compute a table, next to the published figures.")
    root.command(papers.commands(), name="papers", help="Run the system of a paper on a recording.")
    root.command(bench.commands(), name="bench", help="Time a part, or test the live server under load.")
    root.command(study.commands(), name="study", help="Build, simulate and analyse a user study of motion.")
