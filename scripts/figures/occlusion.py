"""Tables of docs/occlusion.md."""

from __future__ import annotations

from bodysense_lab.papers.unoc.score.occlusion import PUBLISHED

from .blocks import Block, Numbers, markdown

CATEGORIES = ("talk_gesture", "sit", "everyday", "locomotion", "all")


CAMERAS = {
    "hidden": "as it ships",
    "hidden_thin": "solids of 0.8",
    "hidden_thinner": "solids of 0.7",
    "hidden_back": "camera at the nose",
    "hidden_both": "solids of 0.7, camera at the nose",
    "hidden_tilted": "tilted down by 30°",
}


GROUPS_HIDDEN = ("shoulder", "elbow", "hand", "hip", "knee", "foot", "body", "all")


def hidden(numbers: Numbers) -> str:
    """Return shares of hidden time: ours by category, and published ones."""
    categories = [name for name in CATEGORIES if f"{name}_shoulder_hidden" in numbers]
    rows = []
    for group in GROUPS_HIDDEN:
        ours = [f"{100 * numbers[f'{category}_{group}_hidden']:.0f} %" for category in categories]
        published = [column.figures.get(f"{group}_hidden") for column in PUBLISHED]
        rows.append([group, *ours, *("–" if ratio is None else f"{100 * ratio:.0f} %" for ratio in published)])
    for name, label in (("self_contact", "self-contact"), ("hand_contact", "hand-body contact")):
        ours = [f"{100 * numbers[f'{category}_{name}']:.0f} %" for category in categories]
        published = [column.figures.get(name) for column in PUBLISHED]
        rows.append([label, *ours, *("–" if ratio is None else f"{100 * ratio:.0f} %" for ratio in published)])
    heads = [*categories, *(f"{column.name}, published" for column in PUBLISHED)]
    spans = []
    for group in GROUPS_HIDDEN:
        ours = [f"{numbers[f'{category}_{group}_seconds']:.2f}" for category in categories]
        published = [column.figures.get(f"{group}_seconds") for column in PUBLISHED]
        spans.append([group, *ours, *("–" if span is None else f"{span:.2f}" for span in published)])
    amount = "; ".join(
        f"{column.name} {column.frames:,} frames at {column.frame_rates[0]:g} Hz" for column in PUBLISHED
    )
    return f"{markdown(['', *heads], rows)}\n\n{markdown(['mean span, s', *heads], spans)}\n\nPublished: {amount}."


def cameras(*shares: Numbers) -> str:
    """Return shares of hidden time while people talk and sit, for settings that the paper does not specify."""
    rows = [
        [
            label,
            *(
                " / ".join(f"{100 * numbers[f'{kind}_{group}_hidden']:.0f}" for kind in ("talk_gesture", "sit"))
                for group in GROUPS_HIDDEN[:6]
            ),
        ]
        for numbers, label in zip(shares, CAMERAS.values(), strict=True)
    ]
    ratios = [[column.figures.get(f"{group}_hidden") for column in PUBLISHED] for group in GROUPS_HIDDEN[:6]]
    found = [[ratio for ratio in row if ratio is not None] for row in ratios]
    rows.append(["published, by data set", *(f"{100 * min(row):.0f}-{100 * max(row):.0f}" for row in found)])
    return markdown(["%, talk_gesture / sit", *GROUPS_HIDDEN[:6]], rows)


BLOCKS = (
    Block("docs/occlusion.md", "occlusion", hidden, ("hidden",)),
    Block("docs/occlusion.md", "cameras", cameras, tuple(CAMERAS)),
)
