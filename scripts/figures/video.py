"""Tables of docs/rendered.md and docs/papers/pahmt.md."""

from __future__ import annotations

from bodysense_lab.papers.pahmt.options import TABLE_1
from bodysense_lab.rendering.tables import PUBLISHED as PAPER

from .blocks import ROOT, Block, Numbers, figure, markdown

WEIGHTS = ROOT / "src" / "bodysense" / "weights" / "arms.onnx"
METHODS = {
    "network": "bodysense, from the video",
    "landmarks_ik": "MediaPipe's landmarks, inverse kinematics",
    "network_true": "bodysense, from perfect key-points",
    "positions_ik": "inverse kinematics on true positions",
}
GESTURES = {
    "t_pose": "T-pose",
    "arms_up": "arms up",
    "arms_ahead": "arms ahead",
    "punches": "punches",
    "waves": "waves beside the face",
    "waves_at_desk": "waves before the face, webcam",
    "moving_camera": "moving camera",
    "moving_camera_first": "its first second",
}
BONES = {
    "upper_arm_picture_deg": "upper arm, picture °",
    "forearm_picture_deg": "forearm °",
    "upper_arm_space_deg": "upper arm, space °",
    "forearm_space_deg": "forearm °",
    "wrist_acceleration": "wrists m/s²",
}
MEASURES = {
    "arms_deg": "arms °",
    "upper_arm_twist_deg": "twist of upper arms °",
    "forearm_twist_deg": "of forearms °",
    "overall_cm": "arms and hands cm",
    "hands_cm": "fingers cm",
}


def rendered(numbers: Numbers) -> str:
    """Return rows of methods on rendered videos."""
    rows = [[title, *(_one(numbers, f"{name}_{key}") for key in MEASURES)] for name, title in METHODS.items()]
    less = 1 - numbers["network_arms_deg"] / numbers["landmarks_ik_arms_deg"]
    sentence = (
        f"`bodysense evaluate video-rendered`: {numbers['videos']:.0f} videos, {60 * numbers['minutes']:.0f} s; arms' "
        f"rotations are {less:.0%} nearer than those of the landmarks. A person was found in "
        f"{numbers['detection_rate']:.0%} of the pictures, {numbers['hand_detection_rate']:.0%} of the hands."
    )
    return "\n\n".join((markdown(["", *MEASURES.values()], rows), sentence, published()))


def published() -> str:
    """Return the figures of the paper's Table 3."""
    one = (
        f"{name.partition(',')[0]} {row['overall_cm']:.2f} cm and {row['arms_rad']:.4f} rad"
        for name, row in PAPER.items()
    )
    return (
        "Published (PAHMT, Table 3, on its own characters): arms and hands, and axis-angle components of arms: "
        f"{'; '.join(one)}."
    )


def gestures(numbers: Numbers) -> str:
    """Return rows of gestures: bones of arms, in brackets those of the landmarks, and true accelerations of wrists."""
    rows = [
        [
            title,
            *(
                f"{_one(numbers, f'network_{bone}_{key}')} ({_one(numbers, f'landmarks_ik_{bone}_{key}')})"
                for bone in BONES
            ),
            _one(numbers, f"positions_ik_wrist_acceleration_{key}"),
        ]
        for key, title in GESTURES.items()
    ]
    return markdown(["", *BONES.values(), "true"], rows)


def table(numbers: Numbers, perfect: Numbers | None) -> str:
    """Return PAHMT's Table 1, ours and the paper's, and networks trained and tested on exact key-points."""
    measures = {"hands_m": "hands m", "overall_m": "overall m", "arms": "arms rad", "arms_deg": "arms °"}

    def ours(name: str) -> list[str]:
        key = name.replace("-", "_")
        measured = [(numbers, measure) for measure in measures] + [
            (perfect or {}, "overall_m"),
            (perfect or {}, "arms_deg"),
        ]
        return [_one(of, f"{key}_{measure}", 1 if measure == "arms_deg" else 4) for of, measure in measured]

    rows = []
    for name, row in TABLE_1.items():
        if f"{name.replace('-', '_')}_hands_m" in numbers:
            losses = ("yes" if loss in row.losses else "" for loss in ("smooth", "fk"))
            published = [f"{value:.4f}" for value in row.published] + ["–"] * (3 - len(row.published))
            rows.append([row.title, *losses, *ours(name), *published])
    for name, title in (("shipped", "of --model"), ("ik", "inverse kinematics, true positions")):
        if f"{name}_hands_m" in numbers:
            rows.append([title, "", "", *ours(name), "–", "–", "–"])
    head = ["network", "smooth", "fk", *measures.values(), "without errors: overall m", "arms °"]
    sentence = (
        "`bodysense evaluate pahmt-table1`; *without errors*: trained and asked with `--keypoints perfect`. The "
        "paper's figures are of its own motion."
    )
    return markdown([*head, "paper: hands", "overall", "arms"], rows) + "\n\n" + sentence


def speed(numbers: Numbers) -> str:
    """Return the time of a window."""
    return (
        f"A window of 32 frames takes {numbers['p50_ms']:.1f} ms (p50; p99 {numbers['p99_ms']:.1f} ms) on one core; "
        f"the file is {WEIGHTS.stat().st_size / 1e6:.1f} MB (`bodysense bench arms`)."
    )


def _one(numbers: Numbers, key: str, digits: int = 1) -> str:
    return figure(numbers, key, digits)


def video_speed(numbers: Numbers) -> str:
    """Return the processor time of a picture of a video."""
    one, two = (numbers[f"people_{people}_landmarks_ms"] for people in (1, 2))
    return (
        f"Processor time of a picture of {numbers['width']:.0f} × {numbers['height']:.0f} pixels, "
        f"`bodysense bench video`: reading it and finding landmarks {one:.0f} ms with `--people 1` and {two:.0f} ms "
        f"with 2; choosing the person and completing the body with past and future {numbers['body_ms']:.0f} ms. Peak "
        f"memory {numbers['memory_mb']:.0f} MB; it does not grow with the number of pictures."
    )


BLOCKS = (
    Block("docs/rendered.md", "video", rendered, ("video-rendered",)),
    Block("docs/rendered.md", "gestures", gestures, ("gestures",)),
    Block("docs/video.md", "video-speed", video_speed, ("video-speed",)),
    Block("docs/papers/pahmt.md", "table1", table, ("pahmt-table1",), ("pahmt-table1-perfect",)),
    Block("docs/papers/pahmt.md", "arms-speed", speed, ("arms-speed",)),
)
