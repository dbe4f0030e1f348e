"""Tables of speed in docs/evaluation.md, and of the time from a clone to a moving body in docs/results.md."""

from __future__ import annotations

from .blocks import Block, Numbers, markdown


def speed(step: Numbers, ik: Numbers, occlusion: Numbers, bvh: Numbers, imported: Numbers) -> str:
    """Return the figures of the bench commands."""
    rows = [
        ["`bench step`", "a frame at 72 Hz, caches cold", f"p50 {step['paced_ms']:.2f} ms"],
        ["", "frames without a pause", f"p50 {step['hot_ms']:.2f} ms, p99 {step['p99_ms']:.2f} ms"],
        ["", "`observe` of head and wrists", f"p50 {step['observe_ms']:.3f} ms"],
        ["", "a frame of each of 16 wearers in a batch", f"{step['batch16_ms']:.2f} ms each"],
        ["", "peak resident memory; the network's file", f"{step['rss_mb']:.0f} MB; {step['file_mb']:.1f} MB"],
        ["`bench ik`", "whole body and hands, warm start", f"p50 {ik['p50_ms']:.2f} ms, p99 {ik['p99_ms']:.2f} ms"],
        ["`bench occlusion`", "frames seen by the headset", f"{occlusion['frames_per_second']:,.0f} /s"],
        [
            "`bench import`",
            "`import bodysense`; with the tracker",
            f"{1000 * imported['package_seconds']:.0f} ms; {imported['seconds']:.2f} s",
        ],
        [
            "`bench bvh`",
            "reading, beside parsing the floats alone",
            f"{bvh['mb_per_second']:.0f} of {bvh['bare_parse_mb_per_second']:.0f} MB/s",
        ],
    ]
    return markdown(["command", "what", "figure"], rows)


def training(found: Numbers) -> str:
    """Return the speed of training the completion network: drawing sequences, and steps."""
    rows = [
        ["drawing sequences for `train completion`", f"{found['draw_frames_per_second']:,.0f} frames/s"],
        ["its steps", f"{found['step_frames_per_second']:,.0f} frames/s"],
    ]
    return markdown(["training", "speed"], rows)


def first_body(found: Numbers) -> str:
    """Return the seconds from a clone to a moving body."""
    rows = [
        [name, *(f"{found[f'{kind}_{key}']:.0f}" for kind in ("cold", "offline"))]
        for name, key in (
            ("clone", "clone_s"),
            ("install", "install_s"),
            ("demo", "demo_s"),
            ("in all", "s"),
            ("time of a processor", "processor_s"),
        )
    ]
    table = markdown(["step, s", "empty cache", "no network"], rows)
    compiler = "the wheel `ziglang` as compiler" if found["without_compiler"] else "the system's compiler"
    by_uvx = f" With `uvx` and an empty cache: {found['uvx_s']:.0f} s." if "uvx_s" in found else ""
    return (
        f"{table}\n\nWith {compiler}. Packages have {found['packages_mb']:.0f} MB, "
        f"which took {found['network_s']:.0f} s; the clone has {found['clone_mb']:.0f} MB.{by_uvx}"
    )


def take(found: Numbers) -> str:
    """Return the speed of completing takes."""
    return (
        f"Recordings of head and hands: {found['frames_per_second']:,.0f} frames a second, and "
        f"{found['causal_frames_per_second']:,.0f} with `--causal` (`bodysense bench take`: 10 minutes at 30 Hz, one "
        "thread)."
    )


BLOCKS = (
    Block("docs/completion.md", "take-speed", take, ("take",)),
    Block("docs/evaluation.md", "speed", speed, ("step", "ik", "occlusion", "bvh", "import")),
    Block("docs/evaluation.md", "training", training, ("training",)),
    Block("docs/results.md", "first-body", first_body, ("first-body",)),
)
