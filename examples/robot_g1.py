"""A Unitree G1 in MuJoCo follows a body that was completed from a headset and two controllers; writes g1.png.

Needs, besides bodysense, the solver mink and a model of the robot, which this wheel has:

    pip install mink daqp mujoco && pip install --no-deps holosoma-retargeting
    MUJOCO_GL=egl python examples/robot_g1.py
"""

# pyright: reportMissingImports=false

from importlib.util import find_spec
from pathlib import Path

import mink
import mujoco
import numpy as np
from PIL import Image

import bodysense as bs

# The robot's body for each of ours, and how much its place and its rotation count.
BODIES = {
    "pelvis": ("pelvis", 10.0, 5.0),
    "left_knee": ("left_knee_link", 5.0, 0.0),
    "right_knee": ("right_knee_link", 5.0, 0.0),
    "left_ankle": ("left_ankle_roll_link", 20.0, 2.0),
    "right_ankle": ("right_ankle_roll_link", 20.0, 2.0),
    "spine3": ("torso_link", 0.0, 3.0),
    "left_elbow": ("left_elbow_link", 3.0, 0.0),
    "right_elbow": ("right_elbow_link", 3.0, 0.0),
    "left_wrist": ("left_wrist_yaw_link", 5.0, 0.0),
    "right_wrist": ("right_wrist_yaw_link", 5.0, 0.0),
}
TURN = np.array([0.5, 0.5, 0.5, 0.5])  # world of the robot, +Z up and +X ahead ← ours; and back, of a joint's axes
LEG = 0.67  # m, from the robot's hip to its ankle: places are scaled by it

found = find_spec("holosoma_retargeting")
assert found is not None and found.submodule_search_locations
model = mujoco.MjModel.from_xml_path(str(Path(found.submodule_search_locations[0]) / "models/g1/g1_29dof.xml"))
robot = mink.Configuration(model)
tasks = {ours: mink.FrameTask(theirs, "body", *weights) for ours, (theirs, *weights) in BODIES.items()}
upright = mink.PostureTask(model, cost=0.5)  # weak, so that free joints rest
upright.set_target(robot.q)
motors = [model.joint(k).name for k in range(1, model.njnt)]
limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, dict.fromkeys(motors, np.array([6.0])))]  # rad/s

truth = bs.demo.packaged_performance()
seen = bs.simulate(truth, "three_point")  # a headset and two controllers
tracker = bs.Tracker(bs.Person(truth.pose.skeleton))
state, joints, pictures = tracker.start(), [], []
skeleton = truth.pose.skeleton
scale = LEG / -skeleton.rest_offset[[skeleton.index("left_knee"), skeleton.index("left_ankle")], 1].sum()
renderer = mujoco.Renderer(model, 480, 360)

for k in range(len(seen)):
    estimate, state = tracker.step(seen[k : k + 1], state)
    points, turns = bs.forward_kinematics(estimate.pose[0])
    for ours, task in tasks.items():
        index = skeleton.index(ours)
        place = mink.SE3.from_rotation_and_translation(
            mink.SO3(TURN) @ mink.SO3(turns[index]) @ mink.SO3(TURN).inverse(), scale * points[index][[2, 0, 1]]
        )
        task.set_target(place)
    for _ in range(30 if k == 0 else 1):
        velocity = mink.solve_ik(robot, [*tasks.values(), upright], 1 / 30, "daqp", damping=0.5, limits=limits)
        robot.integrate_inplace(velocity, 1 / 30)
    joints.append(robot.q[7:].copy())
    if k % (len(seen) // 6) == len(seen) // 12:
        camera = mujoco.MjvCamera()
        camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = robot.q[:3], 2.2, 150, -10
        renderer.update_scene(robot.data, camera)
        pictures.append(renderer.render())

speed = np.abs(np.diff(joints, axis=0)) * 30  # rad/s
print(f"{len(joints)} frames; 99 % of motors are slower than {np.quantile(speed, 0.99):.1f} rad/s, ", end="")
print(f"all than {speed.max():.1f}")
Image.fromarray(np.concatenate(pictures, axis=1)).save("g1.png")
print("wrote g1.png")
