"""Write the motion of the demonstration: a headset's wearer walks, turns, waves, sits and gestures.

Nothing in it was recorded. `scripts/performance/choreography.py` says what happens when; one optimisation finds the
smoothest motion of the default body that meets it. Run it with the packages of the tests (SciPy) installed::

    python scripts/make_performance.py [--output FILE.npz] [--iterations N]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from performance.choreography import FRAME_RATE
from performance.figure import machine
from performance.staging import perform

from bodysense.body.pose import Pose
from bodysense.geometry.rotation import quaternion_log, quaternion_multiply

OUTPUT = Path(__file__).parents[1] / "src" / "bodysense" / "demo" / "performance.npz"
Z_UP = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])  # +90° about X, the inverse of read_amass
ANGLE, LENGTH = 2.0**-12, 1e-4  # rad, m: resolution of the file


def amass_arrays(pose: Pose, frame_rate: float) -> dict[str, np.ndarray]:
    """Return a motion (T, …) of the default skeleton in the AMASS layout: SMPL-H's joints, world with Z up."""
    rotation = pose.rotation.copy()
    rotation[:, 0] = quaternion_multiply(Z_UP, rotation[:, 0])
    angles = quaternion_log(rotation).reshape(len(rotation), -1)
    x, y, z = pose.root_position.T
    trans = np.stack([x, -z, y], axis=-1)
    return {
        "poses": (np.round(angles / ANGLE) * ANGLE).astype(np.float32),
        "trans": (np.round(trans / LENGTH) * LENGTH).astype(np.float32),
        "mocap_framerate": np.array(frame_rate),
        "gender": np.array("neutral"),
        "betas": np.zeros(16, dtype=np.float32),
        "licence": np.array("Apache-2.0, as bodysense itself"),
        "source": np.array(
            "bodysense's own work: choreographed and optimised by scripts/make_performance.py, not recorded"
        ),
    }


def main() -> None:
    """Solve the choreography and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--output", type=Path, default=OUTPUT)
    parser.add_argument("--iterations", type=int, default=20)
    arguments = parser.parse_args()
    body = machine()
    motion = perform(body, arguments.iterations)
    np.savez_compressed(arguments.output, allow_pickle=False, **amass_arrays(body.pose(motion), FRAME_RATE))
    print(f"{arguments.output}: {len(motion)} frames")


if __name__ == "__main__":
    main()
