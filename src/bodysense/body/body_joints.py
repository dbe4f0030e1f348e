"""The 22 joints of `BODY` alone: conversion to a skeleton without hands, and back."""

from __future__ import annotations

import numpy as np

from bodysense.body.pose import Pose, standing_pose
from bodysense.body.skeleton import BODY, Skeleton


def body_skeleton(skeleton: Skeleton) -> Skeleton:
    """Return the skeleton of the 22 joints of `BODY`; each hangs on its nearest ancestor among them."""
    places = skeleton.indices(BODY)
    order = {place: k for k, place in enumerate(places.tolist())}
    parents = tuple(order.get(skeleton.parents[place], -1) for place in places.tolist())
    return Skeleton(BODY, (), parents, skeleton.rest_offset[places])


def body_pose(pose: Pose) -> Pose:
    """Return the 22 joints of a pose (NumPy); world positions and rotations are unchanged."""
    places = pose.skeleton.indices(BODY)
    return Pose(body_skeleton(pose.skeleton), pose.root_position, pose.rotation[..., places, :])


def whole_pose(skeleton: Skeleton, root_position: np.ndarray, rotation: np.ndarray) -> Pose:
    """Return the pose of a whole skeleton from local rotations (..., 22, 4) of `BODY`, with relaxed fingers."""
    whole = np.broadcast_to(standing_pose(skeleton).rotation, (*rotation.shape[:-2], len(skeleton.joints), 4)).copy()
    whole[..., skeleton.indices(BODY), :] = rotation
    return Pose(skeleton, root_position, whole)
