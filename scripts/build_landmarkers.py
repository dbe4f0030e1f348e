"""Build MediaPipe's pose and hand landmarkers (.task files) from the wheel of mediapipe 0.10.21, the last with models.

Where Google's model files cannot be fetched, the package index still serves that wheel::

    python scripts/build_landmarkers.py [--wheel FILE.whl] [--out FOLDER]

Without --wheel the wheel is downloaded with pip and not installed. The files carry the names under which
`bodysense track VIDEO` looks for them, and by default they are put where it looks. The models are Google's,
Apache-2.0. Needs the extra `video`. Where npm is there, MediaPipe's WebAssembly is put beside them, for the webcam.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import flatbuffers
from mediapipe.tasks.metadata import metadata_schema_py_generated as metadata_schema  # pyright: ignore[reportMissingImports]
from mediapipe.tasks.metadata import schema_py_generated as model_schema  # pyright: ignore[reportMissingImports]

from bodysense.devices.video.landmarker_files import HAND_LANDMARKER, POSE_LANDMARKER, landmarker_folder
from bodysense.files import written_beside

WHEEL = "mediapipe==0.10.21"
RUNTIME = "@mediapipe/tasks-vision@1.1.0"  # of npm, as in web/package-lock.json
RUNTIME_FILES = ("vision_wasm_module_internal.js", "vision_wasm_module_internal.wasm")
# Contents of each .task file: name in it, model in the wheel, and (mean, standard deviation) of the pixels that a model
# without metadata was trained on.
BUNDLES = {
    POSE_LANDMARKER: (
        ("pose_detector.tflite", "pose_detection/pose_detection.tflite", (127.5, 127.5)),
        ("pose_landmarks_detector.tflite", "pose_landmark/pose_landmark_full.tflite", (0.0, 255.0)),
    ),
    HAND_LANDMARKER: (
        ("hand_detector.tflite", "palm_detection/palm_detection_full.tflite", None),
        ("hand_landmarks_detector.tflite", "hand_landmark/hand_landmark_full.tflite", None),
    ),
}


def main() -> None:
    """Write both .task files."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--wheel", type=Path, help=f"the wheel of {WHEEL}; downloaded with pip by default")
    parser.add_argument("--out", type=Path, default=landmarker_folder(), help="folder for the files")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        build(arguments.wheel or download(Path(folder)), arguments.out)
        names = [*BUNDLES, *fetch_runtime(Path(folder), arguments.out)]
    for name in names:
        print(f"wrote {arguments.out / name}")
    if len(names) == len(BUNDLES):
        print("no npm: the page's webcam stays closed")


def download(folder: Path) -> Path:
    """Download the wheel into a folder and return its path."""
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--retries", "1", "--no-deps"]
    subprocess.run([*command, "--dest", str(folder), WHEEL], check=True)
    return next(folder.glob("*.whl"))


def fetch_runtime(folder: Path, out: Path) -> tuple[str, ...]:
    """Write MediaPipe's WebAssembly, fetched with npm, into `out`; return the names of files (none without npm)."""
    npm = shutil.which("npm")
    if npm is None:
        return ()
    subprocess.run([npm, "pack", "--silent", "--pack-destination", str(folder), RUNTIME], check=True, cwd=folder)
    with tarfile.open(next(folder.glob("*.tgz"))) as package:
        for name in RUNTIME_FILES:
            member = package.extractfile(f"package/wasm/{name}")
            assert member is not None
            with written_beside(out / name) as beside:
                beside.write_bytes(member.read())
    return RUNTIME_FILES


def build(wheel: Path, out: Path) -> None:
    """Write the .task files: zip files that store their models without compression."""
    out.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(wheel) as source:
        for name, parts in BUNDLES.items():
            with written_beside(out / name) as beside, zipfile.ZipFile(beside, "w", zipfile.ZIP_STORED) as bundle:
                for part, path, pixels in parts:
                    model = source.read(f"mediapipe/modules/{path}")
                    # A fixed date, so that equal wheels give equal files.
                    bundle.writestr(zipfile.ZipInfo(part), model if pixels is None else with_metadata(model, *pixels))


def with_metadata(model: bytes, mean: float, deviation: float) -> bytes:
    """Return a TensorFlow Lite model with metadata: its input is an RGB image, (value − mean) / deviation."""
    tree: Any = model_schema.ModelT.InitFromPackedBuf(model, 0)
    graph = tree.subgraphs[0]
    image = metadata_schema.TensorMetadataT(name="image")
    image.content = metadata_schema.ContentT(
        contentPropertiesType=metadata_schema.ContentProperties.ImageProperties,
        contentProperties=metadata_schema.ImagePropertiesT(colorSpace=metadata_schema.ColorSpaceType.RGB),
    )
    image.processUnits = [
        metadata_schema.ProcessUnitT(
            optionsType=metadata_schema.ProcessUnitOptions.NormalizationOptions,
            options=metadata_schema.NormalizationOptionsT(mean=[mean], std=[deviation]),
        )
    ]
    outputs = [metadata_schema.TensorMetadataT(name=f"output{k}") for k in range(len(graph.outputs))]
    about = metadata_schema.ModelMetadataT(
        subgraphMetadata=[metadata_schema.SubGraphMetadataT(inputTensorMetadata=[image], outputTensorMetadata=outputs)]
    )
    tree.buffers.append(model_schema.BufferT(data=list(_packed(about, b"M001"))))
    entry = model_schema.MetadataT(name="TFLITE_METADATA", buffer=len(tree.buffers) - 1)
    tree.metadata = [*(tree.metadata or []), entry]
    return _packed(tree, b"TFL3")


def _packed(tree: Any, identifier: bytes) -> bytes:
    builder = flatbuffers.Builder(0)
    builder.Finish(tree.Pack(builder), file_identifier=identifier)
    return bytes(builder.Output())


if __name__ == "__main__":
    main()
