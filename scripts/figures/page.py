"""Tables about the page, the server, the image and the packages, and measured sentences of docs/page.md."""

from __future__ import annotations

from .blocks import Block, Numbers, markdown


def requirements(page: Numbers, crowd: Numbers, few: Numbers, image: Numbers) -> str:
    """Return the measured figures of page, server and image next to their limits."""
    crowded = f"{crowd['answered_least']:.1%} to {crowd['answered_most']:.1%} answered"
    alone = f"{few['answered_least']:.0%} to {few['answered_most']:.0%} of {few['sessions']:.0f} wearers"
    rows = [
        [
            "first picture of a visit after at most 2 s",
            f"{page['moving_median_s']:.1f} s in the median, {page['moving_max_s']:.1f} s at most",
            "`python scripts/measure_page.py`",
        ],
        ["a visit of at most 5 MB", f"{page['visit_mb']:.1f} MB", "the same"],
        ["faults that axe-core finds, in light and dark: none", f"{page['axe_faults']:.0f}", "the same"],
        ["a webcam's ankles at most 5 cm from their height", f"{page['webcam_ankles_cm']:.1f} cm", "the same"],
        [
            "mean error at most 8 cm from the pelvis and 19 cm in the world",
            f"{page['webcam_error_cm']:.1f} cm and {page['webcam_world_cm']:.1f} cm",
            "the same",
        ],
        [
            f"{crowd['sessions']:.0f} wearers on a machine that bears {few['sessions']:.0f}: each at least 40 % "
            "answered, within 10 % of each other",
            f"{crowded}; {alone}",
            f"`bodysense bench live --sessions {crowd['sessions']:.0f} --share {crowd['share']:.1f}`",
        ],
        ["an image of at most 400 MB", f"{image['image_mb']:.0f} MB", "`python scripts/build_image.py`"],
    ]
    return markdown(["what, and the limit", "measured", "by"], rows)


def visit(page: Numbers) -> str:
    """Return the times of a first visit, its bytes, and the errors of a webcam's body."""
    seen = {
        name: f"{page[f'{name}_min_s']:.1f} to {page[f'{name}_max_s']:.1f} s (median {page[f'{name}_median_s']:.1f})"
        for name in ("words", "moving", "completed")
    }
    return (
        f"A first visit loads {page['visit_mb']:.1f} MB. Words stand after {seen['words']}, a figure moves after "
        f"{seen['moving']}, completed by the network after {seen['completed']}. Beside the poses of a film (22 joints, "
        f"a walk of two metres toward the camera) a webcam's body is off by {page['webcam_error_cm']:.1f} cm from the "
        f"pelvis with the heading aligned, and by {page['webcam_world_cm']:.1f} cm in the world, its ankles by "
        f"{page['webcam_ankles_cm']:.1f} cm from their height (`python scripts/measure_page.py`)."
    )


def headset(found: Numbers) -> str:
    """Return times and memory of a session in an emulated headset."""
    text = (
        f"{found['minutes']:.0f} minutes in an emulated headset at 72 Hz, without drawing "
        f"(`python scripts/measure_page.py`): {found['rate_hz']:.1f} steps a second; a step took "
        f"{found['step_p50_ms']:.1f} ms in the middle, {found['step_p99_ms']:.1f} ms in the slowest percent and "
        f"{found['step_worst_ms']:.0f} ms at most. "
    )
    if "thread_computed_ms" in found:
        text += (
            f"The worker's thread computed for {found['thread_computed_ms']:.2f} ms a step and waited "
            f"{found['thread_waited_ms']:.2f} ms for a processor. "
        )
    return text + (
        f"A frame of the page's own thread, which never waits for a step, took {found['frame_p50_ms']:.1f} ms in the "
        f"middle and {found['frame_p99_ms']:.1f} ms in the slowest percent. From when the timeline is full to the "
        f"end the page's heap went from {found['heap_early_mb']:.1f} to {found['heap_late_mb']:.1f} MB and its process "
        f"from {found['process_early_mb']:.0f} to {found['process_late_mb']:.0f} MB."
    )


def packages(found: Numbers) -> str:
    """Return the sizes of the packages of ecosystems."""
    rows = [
        ["Blender, for one system", f"{found['blender_mb']:.1f}"],
        ["Unity, for all systems", f"{found['unity_mb']:.1f}"],
        ["Godot, for all systems", f"{found['godot_mb']:.1f}"],
    ]
    return markdown(["package", "MB"], rows) + "\n\n`python scripts/build_packages.py`."


BLOCKS = (
    Block("docs/results.md", "requirements", requirements, ("page", "live-share-20", "live-share-10", "image")),
    Block("docs/page.md", "visit", visit, ("page",)),
    Block("docs/deploy.md", "packages", packages, ("packages",)),
    Block("docs/page.md", "headset", headset, ("page-endurance",)),
)
