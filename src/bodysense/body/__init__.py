"""The human body: rotations, skeleton, pose, capsules, inverse kinematics."""
