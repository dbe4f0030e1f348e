"""The whole step: exact where measured, rigid, symmetric, steady where sensors come and go, the same as a file."""

import math
from functools import lru_cache

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.demo import packaged_performance
from bodysense_lab.completion.error_map import unchanged_errors
from bodysense_lab.completion.fingers import FingerConfig, FingerNetwork
from bodysense_lab.completion.graph import CompletionStep
from bodysense_lab.completion.network import CompletionConfig, CompletionNetwork
from bodysense_lab.completion.state import Inputs, Outputs, untracked

FRAMES = 40
SKELETON = default_skeleton()
AT = SKELETON.index
HEAD, WRISTS, ANKLES, KNEES = AT("head"), [20, 21], [7, 8], [4, 5]
FEET = [7, 8, 10, 11, 53, 54]  # ankles, balls and toe tips
PARENTS = list(SKELETON.parents[1:])
UPRIGHT = torch.tensor([1.0, 0, 0, 0])


Motion = tuple[torch.Tensor, torch.Tensor, torch.Tensor]


@lru_cache
def small_step() -> CompletionStep:
    """A step of networks that were never trained."""
    torch.manual_seed(5)
    body = CompletionNetwork(CompletionConfig(hidden=16, branch=16, judge_branch=8))
    fingers = FingerNetwork(FingerConfig(hidden=8, branch=8))
    return CompletionStep(body, fingers, unchanged_errors(), unchanged_errors()).eval()


@pytest.fixture(scope="module")
def step() -> CompletionStep:
    return small_step()


@lru_cache
def performance() -> Motion:
    """Positions (T, 65, 3), rotations (T, 52, 4) and rest offsets (65, 3) of the packaged performance."""
    clip = packaged_performance()
    placed = forward_kinematics(clip.pose[:FRAMES])
    position, rotation = (torch.tensor(np.asarray(part), dtype=torch.float32) for part in placed)
    return position, rotation, torch.tensor(clip.pose.skeleton.rest_offset.copy(), dtype=torch.float32)


@pytest.fixture(scope="module")
def motion() -> Motion:
    return performance()


def seen_as(
    motion: Motion,
    has_position: torch.Tensor,
    has_rotation: torch.Tensor,
    frames: list[int] | None = None,
    **other: torch.Tensor,
) -> list[Inputs]:
    """A motion as sensors see it: masks (T, B, 65) and (T, B, 52)."""
    position, rotation, offset = motion
    people = has_position.shape[1]
    made = []
    for t, (has, turned) in enumerate(zip(has_position, has_rotation, strict=True)):
        frame = t if frames is None else frames[t]
        made.append(
            untracked(people)._replace(
                position=position[frame] * has[..., None],
                rotation=torch.where(turned[..., None], rotation[frame], UPRIGHT),
                has_position=has,
                has_rotation=turned,
                rest_offset=offset.expand(people, -1, -1),
                **other,
            )
        )
    return made


def changing_masks(people: int, frames: int = FRAMES, seed: int = 5) -> tuple[torch.Tensor, torch.Tensor]:
    """Sensors that come and go every ten frames, differently of each person; the head's stay."""
    rng = np.random.default_rng(seed)
    spans = -(-frames // 10)
    seen = np.repeat(rng.uniform(size=(spans, people, 65)) < 0.4, 10, axis=0)[:frames]
    turned = np.repeat(rng.uniform(size=(spans, people, 52)) < 0.3, 10, axis=0)[:frames]
    seen[:, :, HEAD] = turned[:, :, HEAD] = True
    return torch.tensor(seen), torch.tensor(turned)


def masks_of(names: list[str], frames: int = FRAMES, turned: bool = True) -> tuple[torch.Tensor, torch.Tensor]:
    places = [AT(name) for name in names]
    seen, has = torch.zeros(frames, 1, 65, dtype=torch.bool), torch.zeros(frames, 1, 52, dtype=torch.bool)
    seen[:, :, places] = True
    has[:, :, [place for place in places if place < 52]] = turned
    return seen, has


@torch.no_grad()
def run(step: CompletionStep, of: list[Inputs]) -> list[Outputs]:
    state, made = step.start(len(of[0].interval)), []
    for inputs in of:
        outputs, state = step(inputs, state)
        made.append(outputs)
    return made


def points_of(outputs: list[Outputs]) -> torch.Tensor:
    return torch.stack([each.points for each in outputs])


def world_rotations(outputs: Outputs, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forward kinematics of what a step gives, in double precision."""
    pose = Pose(SKELETON, outputs.root_position.double().numpy(), outputs.local_rotation.double().numpy())
    position, rotation = forward_kinematics(pose, offset)
    return np.asarray(position), np.asarray(rotation)


def test_a_batch_is_each_alone(step: CompletionStep, motion: Motion) -> None:
    whole = seen_as(motion, *changing_masks(3))
    together = run(step, whole)
    for k in range(3):
        alone = run(step, [Inputs(*(values[k : k + 1] for values in inputs)) for inputs in whole])
        for a, b in zip(together, alone, strict=True):
            assert torch.allclose(a.points[k], b.points[0], atol=2e-5)


def test_a_mirror_image_moves_as_one(step: CompletionStep, motion: Motion) -> None:
    swap = torch.tensor(SKELETON.mirror.copy())
    position, rotation, offset = motion
    flip, turn = torch.tensor([-1.0, 1, 1]), torch.tensor([1.0, 1, -1, -1])
    mirrored = (position[:, swap] * flip, rotation[:, swap[:52]] * turn, offset[swap] * flip)
    seen, turned = changing_masks(2)
    of_image = run(step, seen_as(mirrored, seen[..., swap], turned[..., swap[:52]]))
    for a, b in zip(run(step, seen_as(motion, seen, turned)), of_image, strict=True):
        assert torch.allclose(a.points[:, swap] * flip, b.points, atol=1e-3)
        assert torch.allclose(a.confidence[:, swap], b.confidence, atol=1e-3)


@pytest.mark.parametrize("headless", [False, True])
def test_a_body_elsewhere_and_turned_is_the_same(step: CompletionStep, motion: Motion, headless: bool) -> None:
    position, rotation, offset = motion
    yaw = Rotation.from_euler("Y", 2.1)
    moved = torch.tensor([3.0, 0.7, -5.0])
    turned = yaw * Rotation.from_quat(rotation.reshape(-1, 4).numpy(), scalar_first=True)
    elsewhere = (
        position @ torch.tensor(yaw.as_matrix().T, dtype=torch.float32) + moved,
        torch.tensor(turned.as_quat(scalar_first=True), dtype=torch.float32).reshape(rotation.shape),
        offset,
    )
    masks = changing_masks(2)
    if headless:  # the pelvis says the heading
        for mask in masks:
            mask[:, :, HEAD] = False
            mask[:, :, 0] = True
    here = points_of(run(step, seen_as(motion, *masks)))
    floor = torch.full((2,), 0.7)
    there = points_of(run(step, seen_as(elsewhere, *masks, floor=floor)))
    wanted = here @ torch.tensor(yaw.as_matrix().T, dtype=torch.float32) + moved
    assert torch.allclose(there, wanted, atol=2e-3)


def test_a_larger_body_is_the_same_at_its_size(step: CompletionStep, motion: Motion) -> None:
    position, rotation, offset = motion
    masks, free = changing_masks(2), torch.zeros(2)
    small = points_of(run(step, seen_as(motion, *masks, hold=free)))
    large = points_of(run(step, seen_as((position * 1.2, rotation, offset * 1.2), *masks, hold=free)))
    assert torch.allclose(large, small * 1.2, atol=3e-3)


def test_far_away_is_as_exact(step: CompletionStep, motion: Motion) -> None:
    position, rotation, offset = motion
    masks = changing_masks(2)
    here = points_of(run(step, seen_as(motion, *masks)))
    away = torch.tensor([700.0, 0.0, -450.0])
    there = points_of(run(step, seen_as((position + away, rotation, offset), *masks)))
    assert torch.allclose(there - away, here, atol=5e-3)
    assert (there - away - here).norm(dim=-1).mean() < 3e-4


def test_bones_are_rigid_and_points_are_those_of_the_rotations(step: CompletionStep, motion: Motion) -> None:
    of = seen_as(motion, *changing_masks(2))
    for inputs, outputs in zip(of, run(step, of), strict=True):
        bones = (outputs.points[:, 1:] - outputs.points[:, PARENTS]).norm(dim=-1)
        assert torch.allclose(bones, inputs.rest_offset[:, 1:].norm(dim=-1), atol=1e-4)
        position, _ = world_rotations(outputs, inputs.rest_offset.double().numpy())
        assert np.abs(position - outputs.points.numpy()).max() < 1e-4


@given(st.lists(st.integers(0, 64), max_size=20), st.lists(st.integers(0, 51), max_size=12), st.integers(0, FRAMES - 4))
@settings(max_examples=60)
def test_what_is_measured_is_kept(points: list[int], turns: list[int], first: int) -> None:
    step, motion = small_step(), performance()
    seen, turned = torch.zeros(3, 1, 65, dtype=torch.bool), torch.zeros(3, 1, 52, dtype=torch.bool)
    seen[:, :, points] = True
    turned[:, :, turns] = True
    of = seen_as(motion, seen, turned, frames=[first, first + 1, first + 2])
    outputs, true = run(step, of)[-1], motion[0][first + 2]
    placed = outputs.points[0]
    assert torch.isfinite(placed).all()
    assert torch.isfinite(outputs.confidence).all()
    off = (placed - true).norm(dim=-1)
    _, rotation = world_rotations(outputs, of[0].rest_offset.double().numpy())
    if HEAD in points:
        assert off[HEAD] < 1e-3
    if HEAD in turns:
        assert 2 * np.arccos(min(1.0, abs(rotation[0, HEAD] @ motion[1][first + 2, HEAD].double().numpy()))) < 2e-3
    for start, end in ((16, 20), (17, 21), (1, 7), (2, 8)):
        middle = SKELETON.parents[end]
        upper, lower = (float(motion[2][k].norm()) for k in (middle, end))
        far = float((true[end] - placed[start]).norm())
        if end in points and abs(upper - lower) + 0.01 < far < 0.999 * (upper + lower):
            assert off[end] < 5e-3


def test_the_pelvis_is_kept_where_the_spine_reaches_it(step: CompletionStep, motion: Motion) -> None:
    for outputs, true in zip(run(step, seen_as(motion, *masks_of(["head", "pelvis"]))), motion[0], strict=True):
        placed = outputs.points[0]
        neck, lowest = placed[AT("neck")], placed[AT("spine1")] + true[0] - placed[0]
        if (neck - lowest).norm() < 0.95 * sum(motion[2][AT(name)].norm() for name in ("spine2", "spine3", "neck")):
            assert (placed[0] - true[0]).norm() < 1e-3


@pytest.mark.parametrize("degrees", [0, 40, 80])
def test_a_raised_knee_bends_forward_between_pelvis_and_ankle(step: CompletionStep, degrees: float) -> None:
    raised = np.zeros((1, 52, 4))
    raised[..., 0] = 1
    for joint, by in ((1, -degrees), (4, 1.2 * degrees), (2, -degrees / 2), (5, degrees)):
        raised[0, joint] = Rotation.from_euler("X", by, degrees=True).as_quat(scalar_first=True)
    offset = torch.tensor(SKELETON.rest_offset.copy(), dtype=torch.float32)
    position, rotation = forward_kinematics(Pose(SKELETON, SKELETON.rest_offset[None, 0], raised))
    motion = (
        torch.tensor(position).float().expand(20, -1, -1),
        torch.tensor(rotation).float().expand(20, -1, -1),
        offset,
    )
    masks = masks_of(["head", "pelvis", "left_ankle", "right_ankle"], 20)
    for outputs in run(step, seen_as(motion, *masks)):
        bent = Rotation.from_quat(outputs.local_rotation[0, KNEES].numpy(), scalar_first=True)
        shank = bent.apply(offset[ANKLES].numpy())  # in the frame of the thigh, which points along -Y
        assert (shank[:, 2] < 0.02).all()


def test_no_free_foot_is_under_the_floor(step: CompletionStep, motion: Motion) -> None:
    for floor in (0.0, 0.2):
        of = seen_as(motion, *masks_of(["head", "left_wrist"]), floor=torch.tensor([floor]))
        assert points_of(run(step, of))[:, 0, FEET, 1].min() > floor - 2e-3
    low = run(step, seen_as(motion, *masks_of(["head", "left_wrist"]), floor=torch.tensor([0.4]), hold=torch.zeros(1)))
    assert points_of(low)[:, 0, FEET, 1].min() < 0.3


def test_nothing_tracked_leaves_the_body_where_it_was(step: CompletionStep, motion: Motion) -> None:
    seen, turned = masks_of(["head", "left_wrist", "right_wrist", "pelvis"])
    seen[20:] = turned[20:] = False
    placed = points_of(run(step, seen_as(motion, seen, turned)))[:, 0]
    assert torch.isfinite(placed).all()
    assert (placed[20:, HEAD] - placed[19, HEAD])[:, [0, 2]].abs().max() < 1e-3
    assert (placed[1:] - placed[:-1])[20:].norm(dim=-1).max() < 0.06
    assert (placed[-1] - placed[-2]).norm(dim=-1).max() < 1e-3
    nothing = torch.zeros_like(seen)
    first = run(step, seen_as(motion, nothing, torch.zeros_like(turned)))
    assert torch.isfinite(points_of(first)).all()
    assert points_of(first)[-1, 0, HEAD, 1] > 0.5


def test_a_head_whose_rotation_alone_is_known(step: CompletionStep, motion: Motion) -> None:
    seen, turned = masks_of(["head"])
    outputs = run(step, seen_as(motion, torch.zeros_like(seen), turned))
    for each, true in zip(outputs, motion[1], strict=True):
        _, rotation = world_rotations(each, motion[2][None].double().numpy())
        assert abs(rotation[0, HEAD] @ true[HEAD].double().numpy()) > 1 - 1e-6


@pytest.mark.parametrize("none", [[3, 6], [13, 14], [4, 7], [22, 25, 28], list(range(65))])
def test_bones_without_length(step: CompletionStep, motion: Motion, none: list[int]) -> None:
    position, rotation, offset = motion
    offset = offset.clone()
    offset[none] = 0
    for outputs in run(step, seen_as((position, rotation, offset), *changing_masks(2))):
        for part in outputs:
            assert torch.isfinite(part).all()
        assert torch.allclose(outputs.local_rotation.norm(dim=-1), torch.ones(2, 52), atol=1e-4)


@pytest.mark.parametrize("untracked", [0.0, 1e4, -3.0])
def test_what_is_not_tracked_does_not_count(step: CompletionStep, motion: Motion, untracked: float) -> None:
    of = seen_as(motion, *changing_masks(2))
    other = [
        inputs._replace(
            position=torch.where(inputs.has_position[..., None], inputs.position, untracked),
            accuracy=torch.where(inputs.has_position, inputs.accuracy, 0.1 + abs(untracked)),
        )
        for inputs in of
    ]
    assert torch.allclose(points_of(run(step, of)), points_of(run(step, other)), atol=1e-4)


def standing_still(step: CompletionStep, motion: Motion, names: list[str], found: bool) -> torch.Tensor:
    """Points (80, 65, 3) of a wearer who stands still while some sensors are lost, or found, at frame 40."""
    position, rotation, offset = motion
    still = (position[:1].expand(80, -1, -1), rotation[:1].expand(80, -1, -1), offset)
    every = ["head", "pelvis", "left_wrist", "right_wrist", "left_ankle", "right_ankle", "left_elbow"]
    seen, turned = masks_of([*every, *(name for name in names if name not in every)], 80)
    places = [AT(name) for name in names]
    change = slice(0, 40) if found else slice(40, 80)
    seen[change, :, places] = turned[change, :, places] = False
    outputs = run(step, seen_as(still, seen, turned, interval=torch.full((1,), 1 / 72)))
    return points_of(outputs)[:, 0]


@pytest.mark.parametrize(
    ("found", "apart"),
    [
        (["left_wrist", "right_wrist"], ["left_knee", "right_ankle", "spine2"]),
        (["left_ankle"], ["right_knee", "right_ankle", "left_elbow", "right_elbow", "spine2"]),
        (["left_elbow"], ["right_elbow", "left_knee", "right_knee", "spine2"]),
        (["left_shoulder"], ["right_elbow", "left_knee", "right_knee", "spine2"]),
    ],
)
def test_what_is_found_moves_its_limb_alone(
    step: CompletionStep, motion: Motion, found: list[str], apart: list[str]
) -> None:
    placed = standing_still(step, motion, found, found=True)
    moved = (placed[40] - placed[39]).norm(dim=-1)
    assert moved[[AT(name) for name in apart]].max() < 3e-3
    others = [AT(name) for name in ("left_ankle", "right_ankle", "left_wrist", "right_wrist") if name not in found]
    assert moved[others].max() < 2e-3


def test_a_measured_shoulder_and_a_measured_forearm_are_followed(step: CompletionStep, motion: Motion) -> None:
    """A shoulder goes to where it is, as far as its collar reaches; a forearm's rotation says where the elbow is."""
    position = motion[0]
    names = ["head", "pelvis", "left_wrist", "right_wrist", "left_collar", "left_shoulder", "spine3"]
    seen, turned = masks_of(names, len(position))
    turned[:, :, AT("left_elbow")] = True
    outputs = run(step, seen_as(motion, seen, turned))
    placed = points_of(outputs)[:, 0]
    lower = placed[:, AT("left_wrist")] - placed[:, AT("left_elbow")]
    true = position[:, AT("left_wrist")] - position[:, AT("left_elbow")]
    cosine = (lower * true).sum(-1) / lower.norm(dim=-1) / true.norm(dim=-1)
    assert cosine.min() > math.cos(math.radians(10))
    assert (placed - position)[:, AT("left_shoulder")].norm(dim=-1).max() < 0.02


def test_a_doubtful_shoulder_is_followed_less(step: CompletionStep, motion: Motion) -> None:
    position = motion[0]
    seen, turned = masks_of(["head", "pelvis", "left_collar", "spine3"], len(position))
    turned[:, :, AT("left_collar")] = False
    seen[:, :, AT("left_shoulder")] = True
    off = []
    for accuracy in (0.001, 0.05, 1.0):
        told = [
            inputs._replace(
                accuracy=torch.full((1, 65), 0.001).index_fill(1, torch.tensor(AT("left_shoulder")), accuracy)
            )
            for inputs in seen_as(motion, seen, turned)
        ]
        off.append(float((points_of(run(step, told))[:, 0] - position)[:, AT("left_shoulder")].norm(dim=-1).mean()))
    assert off[0] < off[1] < off[2]
