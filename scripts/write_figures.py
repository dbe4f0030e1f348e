"""Write every table of measured figures in README, docs and model cards from the numbers that commands wrote.

    python scripts/write_figures.py FIGURES

FIGURES is a folder of what these commands wrote; each file names the processor. A table whose file is missing stays
unchanged. DATA is a folder of motion or a prepared store.

    python scripts/measure_figures.py FIGURES/marker-sets.json       (and marker-gaps, mounts, gloves-expected,
    gloves-steps)
    bodysense evaluate completion --data DATA --json FIGURES/completion.json
    … the same with --limit 36 --takes, into FIGURES/completion-takes.json
    … the same with --sets mocopi_six dip_six slimevr_five slimevr_six --no-mean-body, into FIGURES/suits.json
    … the same with --split val --bodies own --takes, into FIGURES/validation.json, for the cards of the networks
    bodysense evaluate kinds --data DATA --json FIGURES/kinds.json
    bodysense evaluate scenes --headset DATA/headset --json FIGURES/scenes.json
    bodysense evaluate holes --data DATA --clips 100 --json FIGURES/holes.json
    bodysense evaluate holes --data DATA --parts fingers --json FIGURES/holes-fingers.json
    bodysense evaluate fingers --data DATA --networks RUN/without_*.ckpt --json FIGURES/fingers.json
      (docs/completion.md trains these networks)
    bodysense bench step --json FIGURES/step.json
    bodysense bench ik --json FIGURES/ik.json
    bodysense bench take --json FIGURES/take.json
    python scripts/figures/first_body.py --json FIGURES/first-body.json
    bodysense bench training --json FIGURES/training.json
    python scripts/figures/measure_hours.py DATA FIGURES/hours.json
    bodysense data info DATA --occlusion --split test --json FIGURES/hidden.json
    … with --camera.solid-scale 0.8, FIGURES/hidden_thin.json, and with 0.7, FIGURES/hidden_thinner.json
    … with --camera.nose-distance 0, FIGURES/hidden_back.json
    … with --camera.nose-distance 0 --camera.solid-scale 0.7, FIGURES/hidden_both.json
    … with --camera.tilt 30, FIGURES/hidden_tilted.json
    bodysense demo --out FIGURES/demo

UNOC. NETWORKS comes from `bodysense train unoc-tables --window-stride 24 --batch-scale 0.25`, EACH is a folder of
networks for each set.

    bodysense evaluate unoc-table2 --data DATA --json FIGURES/headset.json
    bodysense evaluate unoc-table2 --data DATA --networks NETWORKS --stride 8 --json FIGURES/unoc-table2.json
    … unoc-table3 and unoc-table4 likewise, into FIGURES/unoc-table3.json and FIGURES/unoc-table4.json
    … unoc-smoothness likewise, into FIGURES/unoc-smoothness.json
    python scripts/measure_figures.py FIGURES/unoc-loss-sums.json DATA
    python scripts/measure_figures.py FIGURES/unoc-avatars.json DATA
    bodysense evaluate unoc-table5 --networks EACH --json FIGURES/unoc-table5.json
    bodysense evaluate unoc-table6 --data DATA --json FIGURES/unoc-table6.json
    bodysense train upper-body --data DATA/TRAIN --limit 60 --steps 150 -o UPPER.onnx
    bodysense evaluate unoc-table6 --quick --data DATA/TEST --model UPPER.onnx \
        --json FIGURES/unoc-table6-TRAIN-TEST.json      (TRAIN and TEST: cmu and rocketbox, all four)
    bodysense evaluate finger-synthesis --data DATA --json FIGURES/finger-synthesis.json
    bodysense evaluate transitions --data DATA --json FIGURES/transitions.json
    bodysense evaluate unoc-figure5 FIGURES/demo/truth.bvh -o docs/figures/unoc-figure5.webp
    bodysense evaluate unoc-figure7 FIGURES/demo/truth.bvh -o docs/figures/unoc-figure7.webp
    bodysense study build STUDY --scenes 6
    bodysense study simulate STUDY/key.json -o ANSWERS --preference truth=0.76,ours=0.3
    bodysense study analyze STUDY/key.json ANSWERS/*.json --json FIGURES/study.json

HMD-VAE. VAES comes from `bodysense train hmd-vae --sweep --grid one`.

    bodysense evaluate hmd-vae --data DATA --networks VAES --json FIGURES/hmd-vae.json
    bodysense train hmd-vae --data DATA -o FOLDER --sweep --grid all --limit 20 --steps 20 --batch 64
    python scripts/measure_figures.py FIGURES/hmd-vae-sweep.json FOLDER
    bodysense evaluate hmd-vae-figure4 FIGURES/demo/truth.bvh --networks MODEL1 … MODEL4 \
        -o docs/figures/hmd-vae-figure4.webp
    … without --networks, with --span 1.5 4.5, into docs/figures/hmd-vae-walk.webp
    bodysense evaluate hmd-vae --data DATA --networks body_vae.onnx --json body-vae.json   (then `bodysense train card
    body_vae.onnx --figures body-vae.json`)

PAHMT. ARMS comes from `bodysense train arms-table`.

    python scripts/measure_figures.py FIGURES/arm-windows.json DATA
    bodysense data render DATA -o RENDERED --videos 24 --seconds 6
    bodysense evaluate video-rendered RENDERED --json FIGURES/video-rendered.json
    bodysense data render -o GESTURES
    bodysense evaluate video-rendered GESTURES --json FIGURES/gestures.json
    bodysense bench video GESTURES/waves_0_woman.mp4 --json FIGURES/video-speed.json
    bodysense evaluate pahmt-table1 --data DATA --networks ARMS --out FIGURES --json FIGURES/pahmt-table1.json
    … train and evaluate with --keypoints perfect, into FIGURES/pahmt-table1-perfect.json
    bodysense bench arms --json FIGURES/arms-speed.json

Two hands. LEFT_OUT comes from `bodysense train gloves --leave-one-out`; PAPER is the folder of the paper's networks,
`packages/lab/src/bodysense_lab/weights`.

    bodysense evaluate gloves-table3 --data DATA --left-out LEFT_OUT --json FIGURES/gloves-table3.json
    bodysense evaluate gloves-table4 --data DATA --left-out LEFT_OUT --json FIGURES/gloves-table4.json
    bodysense evaluate gloves-table3 --data DATA --model PAPER/glove_markers_paper.onnx --json FIGURES/gloves-paper.json
    bodysense evaluate gloves-table4 --data DATA --markers PAPER/glove_markers_paper.onnx \
        --joints PAPER/glove_joints_paper.onnx --json FIGURES/gloves-paper-joints.json
    bodysense evaluate gloves-fusion --data DATA --json FIGURES/gloves-fusion.json
    bodysense evaluate gloves-settings --data DATA --json FIGURES/gloves-settings.json
    bodysense evaluate gloves-layouts --hands 3 --json FIGURES/gloves-layouts.json
    bodysense evaluate gloves-occlusion --data DATA --json FIGURES/gloves-occlusion.json
    bodysense evaluate gloves-limits --data DATA --json FIGURES/gloves-limits.json
    bodysense bench gloves --json FIGURES/gloves-speed.json

Live, with P processes and N sessions: 1 and 8; 2 and 8, 16, 24, 40.

    bodysense bench live --workers P --sessions N --json FIGURES/live-PxN.json
    bodysense bench live --sessions 20 --share 0.4 --json FIGURES/live-share-20.json
    … the same with 10 sessions, into FIGURES/live-share-10.json
    python scripts/figures/measure_page.py FIGURES/page.json
    python scripts/figures/measure_page.py FIGURES/page-endurance.json
    python scripts/build_image.py --json FIGURES/image.json
    python scripts/build_packages.py --json FIGURES/packages.json
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from figures.described import write_descriptions
from figures.rows import write_rows
from figures.tables import ROOT, read_measured, read_templates, write_blocks
from PIL import Image


def main(folder: Path) -> None:
    """Replace the text of every block and the pictures whose figures are in `folder`, then the rows of the papers."""
    blocks, rows = read_templates()
    measured = read_measured(folder)
    write_blocks(blocks, measured)
    write_descriptions(measured)
    write_rows(rows)
    if (drawn := folder / "demo" / "demo.webp").is_file():
        shutil.copyfile(drawn, ROOT / "docs" / "figures" / "demo.webp")
    if (drawn := folder / "pahmt-table1.png").is_file():
        Image.open(drawn).convert("RGB").quantize(64).save(ROOT / "docs" / "figures" / "arms.png", optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
