"""One step of completion as one graph: points in the world in, a whole body out, the state in and out.

Change of frame, both networks, re-acquisition blending, forward kinematics, measured points, bent limbs, held feet and
the floor are inside, so that every runtime gives the same body. The order:

    rotations that measured points imply → frame under the head → network, asked twice (once in a mirror) → measured
    rotations in their place → fingers → directions between measured points → places → spine to a measured pelvis →
    collars, arms and legs to measured or predicted ends, feet held → places → local rotations
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.lab.completion.constraints import (
    BENT,
    CONTACT_BY_FOOT,
    JOINT_COUNT,
    LONGEST_REACH,
    MIDDLE_SIDE,
    ONE_SIDED,
    POINTS,
    STRAIGHT,
    FootState,
    applied,
    bent_limbs,
    frame_of,
    held_feet,
    indices,
    length,
    turned_onto,
    unit,
)
from bodysense.lab.completion.error_map import ErrorMap
from bodysense.lab.completion.fingers import HAND_JOINTS, HAND_POINTS, FingerNetwork, FingerSignal
from bodysense.lab.completion.network import (
    HEAD,
    HEAD_HEIGHT,
    JOINTS,
    SPIN_PLACES,
    Before,
    CompletionNetwork,
    Signal,
    body_places,
    orthonormal,
)

ADVANCE = 1 / 65  # s: the memory advances no sooner, so that faster devices are answered from the last one
NORMAL_BOUND = 1.567  # 90 % quantile of the length of normal errors in space, by their mean
# s: time constants in which what was shown gives way to what is predicted, after sensors came or went. How a hand is
# turned that is lost from sight nothing tells, and it mostly stays as it was.
BLEND, WRIST_BLEND = 0.06, 10.0
LONG_AGO = 1e3  # s
_SKELETON = default_skeleton()
_LEFT_RIGHT = [("left_hip", "right_hip"), ("left_shoulder", "right_shoulder"), ("left_ankle", "right_ankle")]


class Inputs(NamedTuple):
    """What a step reads, for B people. Values that are not tracked are finite."""

    position: Tensor  # (B, 65, 3) m, world
    rotation: Tensor  # (B, 52, 4) wxyz, world ← joint
    has_position: Tensor  # (B, 65) bool
    has_rotation: Tensor  # (B, 52) bool
    accuracy: Tensor  # (B, 65) m
    interval: Tensor  # (B,) s since the frame before
    rest_offset: Tensor  # (B, 65, 3) m
    certainty: Tensor  # (B, 65) m, standard deviation of each bone's length
    floor: Tensor  # (B,) m
    hold: Tensor  # (B,) 1: feet are held and kept above the floor; 0: not


class State(NamedTuple):
    """What a step remembers."""

    memory: Tensor  # (B, 2 · layers · hidden), of the body and of its mirror image
    fingers: Tensor  # (B, 2 · hidden) of both hands
    position: Tensor  # (B, 27, 3) m, of the frame in which the memory last advanced
    has_position: Tensor  # (B, 27)
    rotation: Tensor  # (B, 3, 3, 3) of head and wrists
    has_rotation: Tensor  # (B, 3)
    elapsed: Tensor  # (B,) s since that frame
    measured: Tensor  # (B, 117) masks of positions and rotations in the frame before
    shown: Tensor  # (B, 65, 3) m, in the frame before
    heading: Tensor  # (B, 2) cosine and sine, in the frame before
    axes: Tensor  # (B, 22, 3, 2) shown, in the frame under the head
    blend: Tensor  # (B, 22, 3, 2) what was shown when sensors last came or went, beside the prediction; of wrists alone
    age: Tensor  # (B, 22) s since then
    held: Tensor  # (B, 2)
    anchor: Tensor  # (B, 2, 2) m
    shift: Tensor  # (B, 2, 2) m
    begun: Tensor  # (B,) 0 before the first frame


class Outputs(NamedTuple):
    """What a step gives."""

    root_position: Tensor  # (B, 3) m
    local_rotation: Tensor  # (B, 52, 4) wxyz, parent ← joint; the root's is world ← root
    points: Tensor  # (B, 65, 3) m, world
    confidence: Tensor  # (B, 65) m, expected error
    bound: Tensor  # (B, 65) m, within which the error is in nine of ten cases
    contact: Tensor  # (B, 4) probability


class CompletionStep(nn.Module):
    """The whole step. `mean` and `bound` make the expected errors true (`uncertainty`)."""

    def __init__(self, body: CompletionNetwork, fingers: FingerNetwork, mean: ErrorMap, bound: ErrorMap) -> None:
        super().__init__()
        self.body, self.finger_network = body, fingers
        at, index = indices(), _SKELETON.index
        sides = ("left", "right")
        knuckles = [f"{side}_{finger}1" for side in sides for finger in ("index", "middle", "ring", "pinky")]
        spine = ("spine1", "spine2", "spine3")
        # Where each input point of the body's network is among the 65, the knuckles' mean being made of four.
        place_lists = {
            "triad_joint": at.triad[:, 0],
            "triad_ends": at.triad[:, 1:].T.ravel(),  # 4 · 4: all first ends, all second ends …
            "swung": at.swung,
            "child": at.child,
            "limb_start": at.limbs[0],
            "limb_middle": at.limbs[1],
            "limb_end": at.limbs[2],
            "bending": np.concatenate([at.limbs[0], at.limbs[1]]),
            "parents": at.parents,
            "joint_parents": [0, *(1 + at.joint_parents)],  # among [the world, joints]
            "feet": at.feet.ravel(),
            "hand_points": HAND_POINTS.ravel(),
            "hand_joints": HAND_JOINTS.ravel(),
            "contact_places": np.ravel(CONTACT_BY_FOOT),
            "body_points": body_places(),
            "knuckles": _SKELETON.indices(knuckles),
            "left_of": _SKELETON.indices([pair[0] for pair in _LEFT_RIGHT]),
            "right_of": _SKELETON.indices([pair[1] for pair in _LEFT_RIGHT]),
            "wrists": _SKELETON.indices([f"{side}_wrist" for side in sides]),
            "collars": _SKELETON.indices([f"{side}_collar" for side in sides]),
            "hips": _SKELETON.indices([f"{side}_hip" for side in sides]),
            "spine": _SKELETON.indices(spine),
            "spine_ends": [index("neck"), index("spine2"), index("spine1")],
            "spins": SPIN_PLACES,
            # Rotations of the joints after a part of them was turned: of [old ones, turned ones] which to take.
            "after_triad": _replacing(JOINT_COUNT, at.triad[:, 0]),
            "after_swing": _replacing(JOINT_COUNT, at.swung),
            "after_spine": _replacing(JOINT_COUNT, _SKELETON.indices(spine)),
            "after_limbs": _replacing(
                JOINT_COUNT,
                np.concatenate([_SKELETON.indices([f"{side}_collar" for side in sides]), at.limbs[0], at.limbs[1]]),
            ),
        }
        for name, places in place_lists.items():
            self.register_buffer(name, torch.tensor(np.asarray(places), dtype=torch.int64), persistent=False)
        # A joint of three is the origin of its own frame: its children's rest offsets count, its own does not.
        own = (at.triad[:, 1:] != at.triad[:, :1]).T.ravel()[:, None]
        for name, values in (
            ("triad_own", own),
            ("from_head_all", at.from_head),
            ("to_matrix", _QUATERNION_TO_MATRIX),
            ("to_heading", _MATRIX_TO_HEADING),
            ("heading_to_turn", _HEADING_TO_TURN),
            ("middle_side", MIDDLE_SIDE),
            ("one_sided", ONE_SIDED),
            ("bias", [[1e-3]]),
            ("is_wrist", [float(name.endswith("_wrist")) for name in BODY]),
            ("blend_time", [WRIST_BLEND if name.endswith("_wrist") else BLEND for name in BODY]),
            # Of log errors and masks: (25 + 47, 2 · 25), means then bounds.
            ("error_weight", np.block([[np.diag(mean.slope), np.diag(bound.slope)], [mean.weight, bound.weight]])),
            ("error_offset", np.concatenate([mean.offset, bound.offset])),
            ("error_places", _error_places()),
            ("axes_sign", [1.0, -1.0, -1.0, 1.0, -1.0, 1.0]),
            ("vector_sign", [-1.0, 1.0, 1.0]),
        ):
            kind = torch.int64 if name == "error_places" else torch.float32
            self.register_buffer(name, torch.tensor(np.asarray(values), dtype=kind), persistent=False)

    triad_joint: Tensor
    triad_ends: Tensor
    swung: Tensor
    child: Tensor
    limb_start: Tensor
    limb_middle: Tensor
    limb_end: Tensor
    bending: Tensor
    parents: Tensor
    joint_parents: Tensor
    feet: Tensor
    hand_points: Tensor
    hand_joints: Tensor
    contact_places: Tensor
    body_points: Tensor
    knuckles: Tensor
    left_of: Tensor
    right_of: Tensor
    wrists: Tensor
    collars: Tensor
    hips: Tensor
    spine: Tensor
    spine_ends: Tensor
    spins: Tensor
    after_triad: Tensor
    after_swing: Tensor
    after_spine: Tensor
    after_limbs: Tensor
    triad_own: Tensor
    from_head_all: Tensor
    to_matrix: Tensor
    to_heading: Tensor
    heading_to_turn: Tensor
    middle_side: Tensor
    one_sided: Tensor
    bias: Tensor
    is_wrist: Tensor
    blend_time: Tensor
    error_weight: Tensor
    error_offset: Tensor
    error_places: Tensor
    axes_sign: Tensor
    vector_sign: Tensor

    def start(self, batch: int) -> State:
        """The state before the first frame of `batch` people."""
        zeros = self.error_offset.new_zeros
        config = self.body.config
        return State(
            memory=zeros(batch, 2 * config.layers * config.hidden),
            fingers=zeros(batch, 2 * self.finger_network.config.hidden),
            position=zeros(batch, 27, 3),
            has_position=zeros(batch, 27),
            rotation=zeros(batch, 3, 3, 3),
            has_rotation=zeros(batch, 3),
            elapsed=zeros(batch),
            measured=zeros(batch, POINTS + JOINT_COUNT),
            shown=zeros(batch, POINTS, 3),
            heading=zeros(batch, 2) + zeros(2).new_tensor([1.0, 0.0]),
            axes=zeros(batch, JOINTS, 3, 2),
            blend=zeros(batch, JOINTS, 3, 2),
            age=zeros(batch, JOINTS) + LONG_AGO,
            held=zeros(batch, 2) - 1,
            anchor=zeros(batch, 2, 2),
            shift=zeros(batch, 2, 2),
            begun=zeros(batch),
        )

    def forward(self, inputs: Inputs, state: State) -> tuple[Outputs, State]:
        """Complete one frame of B people."""
        seen = inputs.has_position.unsqueeze(-1)
        quaternion = inputs.rotation
        given = ((quaternion.unsqueeze(-1) * quaternion.unsqueeze(-2)).flatten(-2) @ self.to_matrix).unflatten(
            -1, (3, 3)
        )
        inputs, given = self._with_branches(inputs, given)
        turned = inputs.has_rotation.unsqueeze(-1).unsqueeze(-1)
        heading, origin, turn = self._frame(inputs, given, state)
        signal = self._signal(inputs, given, heading, origin, turn, state)
        features = self.body.read(signal)
        (said_turned, said_judged), memory = self._ask_twice(features, state.memory)
        prediction = self.body.prediction(said_turned.squeeze(1), said_judged.squeeze(1))
        size = signal.size.unsqueeze(-1)

        axes = prediction.axes
        masks = torch.cat([inputs.has_position, inputs.has_rotation], dim=-1).to(axes)
        blend, age, kept = self._blended(axes, masks, inputs.interval, state)
        rotation = turn.unsqueeze(1) @ orthonormal(axes + blend)

        # What is measured is as it is measured.
        body = torch.where(turned[:, :JOINTS], given[:, :JOINTS], rotation)
        head_seen = inputs.has_position[:, HEAD : HEAD + 1]
        head = torch.where(head_seen, inputs.position[:, HEAD], origin + applied(turn, prediction.head) * size)
        world, finger_memory, finger_error = self._with_fingers(body, given, head, turn, inputs, state)
        world = self._along_measured(world, inputs)

        # Places in the world: the head is where it is measured; without it the pelvis, or what is seen, decides.
        points = self._placed(world, inputs.rest_offset, head)
        off = torch.where(seen, inputs.position - points, 0.0)
        count = seen.to(off).sum(dim=1).clamp(min=1.0)
        shift = torch.where(inputs.has_position[:, :1], off[:, 0], off.sum(dim=1) / count)
        shift = torch.where(head_seen, 0.0, shift)
        head, points, off = head + shift, points + shift.unsqueeze(1), off - shift.unsqueeze(1)
        world = self._spine_to_pelvis(world, points, off, inputs)
        points = self._placed(world, inputs.rest_offset, head)
        contact = torch.sigmoid(prediction.contact_logit)
        world, foot_state = self._limbs_to_ends(world, points, contact, inputs, state)
        points = self._placed(world, inputs.rest_offset, head)

        elapsed = state.elapsed + inputs.interval
        advance = ((elapsed >= ADVANCE) | (state.begun < 0.5)).unsqueeze(-1)
        wide = advance.unsqueeze(-1)
        after = State(
            memory=torch.where(advance, memory, state.memory),
            fingers=torch.where(advance, finger_memory, state.fingers),
            position=torch.where(wide, signal.position.squeeze(1), state.position),
            has_position=torch.where(advance, signal.has_position.squeeze(1).to(off), state.has_position),
            rotation=torch.where(wide.unsqueeze(-1), given.index_select(1, self.spins), state.rotation),
            has_rotation=torch.where(
                advance, inputs.has_rotation.index_select(1, self.spins).to(off), state.has_rotation
            ),
            elapsed=torch.where(advance.squeeze(-1), 0.0, elapsed),
            measured=masks,
            shown=points,
            heading=heading,
            axes=(turn.mT.unsqueeze(1) @ world[:, :JOINTS])[..., :2],
            blend=kept,
            age=age,
            held=foot_state.held,
            anchor=foot_state.anchor,
            shift=foot_state.shift,
            begun=torch.ones_like(state.begun),
        )
        above = torch.cat([torch.eye(3).to(world).expand(world.shape[0], 1, 3, 3), world], dim=1)
        local = above.index_select(1, self.joint_parents).mT @ world
        confidence, bound = self._expected(prediction.error * size, finger_error, inputs)
        return Outputs(points[:, 0], quaternion_of(local), points, confidence, bound, contact), after

    def _blended(self, axes: Tensor, masks: Tensor, interval: Tensor, state: State) -> tuple[Tensor, Tensor, Tensor]:
        """Re-acquisition blending: what is added to predicted axes, and the age and the blend that are kept.

        Where sensors came or went, what was shown gives way to what is predicted: its offset fades. A wrist keeps the
        direction itself, and gives it up slowly: nothing tells how a hand is turned that is lost from sight.
        """
        change = (masks - state.measured).abs()
        whole = change.amax(dim=-1, keepdim=True) * (1 - self.is_wrist)
        own = change[:, POINTS : POINTS + JOINTS] * self.is_wrist
        changed = ((whole + own) * state.begun.unsqueeze(-1)) > 0.5
        wrist = self.is_wrist[:, None, None]
        held = torch.where(changed[..., None, None], state.axes - (1 - wrist) * axes, state.blend)
        age = torch.where(changed, 0.0, state.age) + interval.unsqueeze(-1)
        along = age / self.blend_time
        fade = ((1 + along) * torch.exp(-along))[..., None, None]
        return fade * (held - wrist * axes), age, held

    def _expected(self, error: Tensor, finger_error: Tensor, inputs: Inputs) -> tuple[Tensor, Tensor]:
        """Expected errors and their bounds, (B, 65) m each; what is measured errs as its sensor does."""
        masks = torch.cat(
            [inputs.has_position.index_select(1, self.body_points), inputs.has_rotation[:, :JOINTS]], dim=1
        ).to(error)
        true = torch.exp(torch.cat([torch.log(error), masks], dim=1) @ self.error_weight + self.error_offset)
        parts = []
        for placed, spread in zip(true.chunk(2, dim=1), (1.0, NORMAL_BOUND), strict=True):
            # A finger is misplaced by its wrist's error as well.
            wrists = placed.index_select(1, self.wrists).unsqueeze(-1)
            fingers = (finger_error.unflatten(1, (2, -1)) * spread + wrists).flatten(1)
            whole = torch.cat([placed, fingers], dim=1).index_select(1, self.error_places)
            parts.append(torch.where(inputs.has_position, inputs.accuracy * spread, whole))
        return parts[0], parts[1]

    def _frame(self, inputs: Inputs, given: Tensor, state: State) -> tuple[Tensor, Tensor, Tensor]:
        """The frame under the head: heading (B, 2), origin (B, 3), turn (B, 3, 3)."""
        seen = inputs.has_position.unsqueeze(-1).to(inputs.position)
        # A head that is not tracked goes with the points that are.
        moved = ((inputs.position - state.shown) * seen).sum(dim=1) / seen.sum(dim=1).clamp(min=1.0)
        head = inputs.has_position[:, HEAD : HEAD + 1]
        place = torch.where(head, inputs.position[:, HEAD], state.shown[:, HEAD] + moved)
        # Its heading is its own, the pelvis's, that of the line from right to left, or what it was.
        left, right = self.left_of, self.right_of
        apart = inputs.position.index_select(1, left) - inputs.position.index_select(1, right)
        both = seen.index_select(1, left) * seen.index_select(1, right)
        across = (apart * both).sum(dim=1) @ self.heading_to_turn[:3, :2]
        twist = given.flatten(-2) @ self.to_heading
        known = length(across) > 0.1
        fallback = torch.where(known, across, state.heading)
        fallback = torch.where(inputs.has_rotation[:, :1], twist[:, 0], fallback)
        heading = unit(torch.where(inputs.has_rotation[:, HEAD : HEAD + 1], twist[:, HEAD], fallback))
        turn = (heading @ self.heading_to_turn[3:5] + self.heading_to_turn[5]).unflatten(-1, (3, 3))
        origin = torch.cat([place[:, :1], inputs.floor.unsqueeze(-1), place[:, 2:]], dim=-1)
        return heading, origin, turn

    def _signal(
        self, inputs: Inputs, given: Tensor, heading: Tensor, origin: Tensor, turn: Tensor, state: State
    ) -> Signal:
        """What the network reads, in one frame."""
        knuckles = self.knuckles
        seen = inputs.has_position.index_select(1, knuckles).unflatten(1, (2, 4)).all(dim=-1)
        middle = inputs.position.index_select(1, knuckles).unflatten(1, (2, 4)).mean(dim=2)
        rest = inputs.rest_offset.index_select(1, self.body_points)
        height = -(self.body.from_head @ rest[:, 1:])[..., 1].amin(dim=-1)
        return Signal(
            position=torch.cat([inputs.position.index_select(1, self.body_points), middle], dim=1).unsqueeze(1),
            rotation=given[:, :JOINTS].unsqueeze(1),
            has_position=torch.cat([inputs.has_position.index_select(1, self.body_points), seen], dim=1).unsqueeze(1),
            has_rotation=inputs.has_rotation[:, :JOINTS].unsqueeze(1),
            accuracy=inputs.accuracy.index_select(1, torch.cat([self.body_points, knuckles[::4]])).unsqueeze(1),
            interval=(state.elapsed + inputs.interval).unsqueeze(-1),
            turn=turn.unsqueeze(1),
            origin=origin.unsqueeze(1),
            before=Before(
                state.position.unsqueeze(1),
                state.has_position.unsqueeze(1) > 0.5,
                state.rotation.unsqueeze(1),
                state.has_rotation.unsqueeze(1) > 0.5,
            ),
            rest_offset=rest,
            certainty=inputs.certainty.index_select(1, self.body_points),
            size=height / HEAD_HEIGHT,
        )

    def _ask_twice(self, features: Tensor, memory: Tensor) -> tuple[tuple[Tensor, Tensor], Tensor]:
        """What the network says of features (B, 1, F), averaged with what it says in a mirror; the memory after."""
        layers, hidden = self.body.config.layers, self.body.config.hidden
        # The pair of a body and its mirror image stands side by side: 2 B rows.
        both = torch.stack([features, self.body.mirrored(features)], dim=1).flatten(0, 1)
        before = memory.unflatten(-1, (2, layers, hidden)).flatten(0, 1).transpose(0, 1)
        (turned, judged), after = self.body.predict(both, before)
        turned, judged = turned.unflatten(0, (-1, 2)), judged.unflatten(0, (-1, 2))
        joints = 6 * JOINTS
        turned, in_mirror = turned[:, 0], turned[:, 1]
        other = (
            in_mirror[..., :joints].unflatten(-1, (JOINTS, 6)).index_select(-2, self.body.mirror_joints)
            * self.axes_sign
        )
        in_mirror = torch.cat([other.flatten(-2), in_mirror[..., joints:] * self.vector_sign], dim=-1)
        judged = judged[:, 0] + judged[:, 1].index_select(-1, self.body.mirror_judged)
        return ((turned + in_mirror) / 2, judged / 2), after.transpose(0, 1).reshape(memory.shape)

    def _with_branches(self, inputs: Inputs, given: Tensor) -> tuple[Inputs, Tensor]:
        """Inputs in which joints that branch are turned as the points on them say, where these are seen.

        A hand whose wrist and knuckles are seen, or a pelvis with its hips and spine, has a rotation like any other.
        """
        ends, joint = self.triad_ends, self.triad_joint
        known = inputs.has_position.index_select(1, ends).unflatten(1, (4, 4)).all(dim=1)
        known = known & ~inputs.has_rotation.index_select(1, joint)
        rest = inputs.rest_offset.index_select(1, ends) * self.triad_own
        # Rest and present together: (2, B, 2 vectors, 2 ends, 4 joints, 3).
        both = torch.stack([rest, inputs.position.index_select(1, ends)]).unflatten(2, (2, 2, 4))
        apart = both[:, :, :, 1] - both[:, :, :, 0]
        rows = frame_of(apart[:, :, 0], apart[:, :, 1])
        turned = torch.where(known.unsqueeze(-1).unsqueeze(-1), rows[1].mT @ rows[0], given.index_select(1, joint))
        given = torch.cat([given, turned], dim=1).index_select(1, self.after_triad)
        has_rotation = torch.cat([inputs.has_rotation, known | inputs.has_rotation.index_select(1, joint)], dim=1)
        return inputs._replace(has_rotation=has_rotation.index_select(1, self.after_triad)), given

    def _with_fingers(
        self, body: Tensor, given: Tensor, head: Tensor, turn: Tensor, inputs: Inputs, state: State
    ) -> tuple[Tensor, Tensor, Tensor]:
        """World rotations (B, 52, 3, 3) with fingers; the memory after; expected errors (B, 40) of their points."""
        wrist = body.index_select(1, self.wrists)
        seen = inputs.has_position.index_select(1, self.wrists).unsqueeze(-1)
        # A wrist that is not seen is placed as predicted; fingers alone do not need it to a centimetre.
        rest = inputs.rest_offset.index_select(1, self.body_points)[:, 1:]
        bones = applied(body.index_select(1, self.body.bone_parents), rest)
        placed = (self.body.from_head.index_select(0, self.wrists) @ bones) + head.unsqueeze(1)
        place = torch.where(seen, inputs.position.index_select(1, self.wrists), placed)
        into = wrist.mT.unsqueeze(2)
        points = inputs.position.index_select(1, self.hand_points).unflatten(1, (2, -1))
        measured = given.index_select(1, self.hand_joints).unflatten(1, (2, -1))
        known = inputs.has_rotation.index_select(1, self.hand_joints).unflatten(1, (2, -1))
        moved = (place - state.shown.index_select(1, self.wrists)) * state.begun[:, None, None]
        signal = FingerSignal(
            position=((points - place.unsqueeze(2)) @ wrist).unsqueeze(1),
            has_position=(inputs.has_position.index_select(1, self.hand_points).unflatten(1, (2, -1)) & seen).unsqueeze(
                1
            ),
            rotation=(into @ measured).unsqueeze(1),
            has_rotation=known.unsqueeze(1),
            rest_offset=inputs.rest_offset.index_select(1, self.hand_points).unflatten(1, (2, -1)),
            wrist=((place - head.unsqueeze(1)) @ turn).unsqueeze(1),
            wrist_rotation=(turn.mT.unsqueeze(1) @ wrist).unsqueeze(1),
            wrist_velocity=((moved / inputs.interval[:, None, None]).clamp(-5, 5) @ turn).unsqueeze(1),
            interval=(state.elapsed + inputs.interval).unsqueeze(-1),
        )
        before = state.fingers.unflatten(-1, (2, -1)).flatten(0, 1).unsqueeze(0)
        fingers, error, after = self.finger_network(signal, before)
        fingers = torch.where(known.unsqueeze(-1).unsqueeze(-1), measured, wrist.unsqueeze(2) @ fingers.squeeze(1))
        world = torch.cat([body, fingers.flatten(1, 2)], dim=1)  # the 22 joints, the left hand's, the right hand's
        return world, after.reshape(state.fingers.shape), error.flatten(1)

    def _along_measured(self, world: Tensor, inputs: Inputs) -> Tensor:
        """Joints with one child, turned toward it where both are seen and the rotation is not measured."""
        joint, child = self.swung, self.child
        seen = inputs.has_position
        known = seen.index_select(1, joint) & seen.index_select(1, child) & ~inputs.has_rotation.index_select(1, joint)
        old = world.index_select(1, joint)
        bone = applied(old, inputs.rest_offset.index_select(1, child))
        apart = inputs.position.index_select(1, child) - inputs.position.index_select(1, joint)
        # Where points err as much as they are apart, their direction says little.
        doubt = (inputs.accuracy.index_select(1, joint) + inputs.accuracy.index_select(1, child)).unsqueeze(
            -1
        ) / length(bone)
        trust = known.unsqueeze(-1).to(bone) / (1 + 4 * doubt * doubt)
        turned = turned_onto(old, bone, bone + trust * (apart - bone))
        return torch.cat([world, turned], dim=1).index_select(1, self.after_swing)

    def _placed(self, world: Tensor, rest_offset: Tensor, head: Tensor) -> Tensor:
        """Places (B, 65, 3) m of all points."""
        bones = applied(world.index_select(1, self.parents), rest_offset[:, 1:])
        return self.from_head_all @ bones + head.unsqueeze(1)

    def _spine_to_pelvis(self, world: Tensor, points: Tensor, off: Tensor, inputs: Inputs) -> Tensor:
        """The spine bent so that the pelvis is where it, or a hip, is measured; the pelvis keeps its rotation."""
        hips = inputs.has_position.index_select(1, self.hips).unsqueeze(-1).to(off)
        from_hips = off.index_select(1, self.hips).sum(dim=1) / hips.sum(dim=1).clamp(min=1.0)
        move = torch.where(inputs.has_position[:, :1], off[:, 0], from_hips)
        start, middle, end = points.index_select(1, self.spine_ends).split(1, dim=1)
        back = -world.index_select(1, self.spine[1:2])[..., 2]
        new_middle, new_end = bent_limbs(start, middle, end, end + move.unsqueeze(1), middle, back, self.bias, None)
        known = (move * move).sum(dim=-1) > 1e-10
        before = torch.cat([middle - end, start - middle, start - middle], dim=1)
        after = torch.cat([new_middle - new_end, start - new_middle, start - new_middle], dim=1)
        old = world.index_select(1, self.spine)
        turned = torch.where(known[:, None, None, None], turned_onto(old, before, after), old)
        return torch.cat([world, turned], dim=1).index_select(1, self.after_spine)

    def _limbs_to_ends(
        self, world: Tensor, points: Tensor, contact: Tensor, inputs: Inputs, state: State
    ) -> tuple[Tensor, FootState]:
        """Arms and legs bent to measured wrists and ankles, or to those predicted, with feet that stand held."""
        start = points.index_select(1, self.limb_start)
        middle = points.index_select(1, self.limb_middle)
        end = points.index_select(1, self.limb_end)
        at, seen = inputs.position, inputs.has_position.unsqueeze(-1)
        at_middle, has_middle = at.index_select(1, self.limb_middle), seen.index_select(1, self.limb_middle)
        at_end, has_end = at.index_select(1, self.limb_end), seen.index_select(1, self.limb_end)
        shift, foot_state = held_feet(
            points.index_select(1, self.feet).unflatten(1, (2, 3)),
            contact.index_select(1, self.contact_places).unflatten(1, (2, 2)),
            inputs.interval,
            inputs.floor,
            inputs.hold,
            FootState(state.held, state.anchor, state.shift),
        )
        free = end + torch.cat([torch.zeros_like(shift), shift], dim=1)
        pole = torch.where(has_middle, at_middle, middle)
        target = torch.where(has_end, at_end, free + (pole - middle))
        # A collar gives an arm that is too short.
        upper, lower = length(middle - start), length(end - middle)
        arms = (target - start)[:, :2]
        lacking = (length(arms) - STRAIGHT * (upper + lower)[:, :2]).clamp(min=0.0, max=LONGEST_REACH)
        collar = points.index_select(1, self.collars)
        shoulder = start[:, :2] - collar
        reached = shoulder + unit(arms) * (lacking * has_end[:, :2].to(lacking))
        reached = unit(reached) * length(shoulder)
        given = torch.cat([reached - shoulder, torch.zeros_like(shoulder)], dim=1)
        # A limb whose upper bone is measured, by its rotation or by its ends, bends as that says.
        told = has_middle | inputs.has_rotation.index_select(1, self.limb_start).unsqueeze(-1)
        free_middle = 1 - told.to(given)
        begin = start + given
        bending = world.index_select(1, self.bending)
        new_middle, new_end = bent_limbs(
            begin,
            middle + given,
            end + given,
            target,
            pole,
            applied(bending[:, :4], self.middle_side),
            BENT * free_middle,
            self.one_sided * free_middle,
        )
        bones = torch.cat([shoulder, middle - start, end - middle], dim=1)
        now = torch.cat([reached, new_middle - begin, new_end - new_middle], dim=1)
        old = torch.cat([world.index_select(1, self.collars), bending], dim=1)
        turned = turned_onto(old, bones, now)
        return torch.cat([world, turned], dim=1).index_select(1, self.after_limbs), foot_state


def quaternion_of(matrix: Tensor) -> Tensor:
    """(..., 3, 3) → (..., 4) wxyz, w ≥ 0: of four forms the sum that no cancellation spoils."""
    parts = matrix.flatten(-2)
    forms = (parts @ parts.new_tensor(_MATRIX_TO_FORMS) + parts.new_tensor(_FORMS_CONSTANT)).unflatten(-1, (4, 4))
    # Row k is 4 q_k q; of q⊗q any weighted sum of rows that point alike is q: take the row of the largest q_k.
    largest = forms.diagonal(dim1=-2, dim2=-1).argmax(dim=-1, keepdim=True)
    q = unit(forms.gather(-2, largest.unsqueeze(-1).expand(*forms.shape[:-2], 1, 4)).squeeze(-2))
    return torch.where(q[..., :1] < 0, -q, q)


def _replacing(count: int, places: np.ndarray) -> np.ndarray:
    """(count,) indices into [all, some new ones] that take the new ones at `places`."""
    chosen = np.arange(count)
    chosen[places] = count + np.arange(len(places))
    return chosen


def _error_places() -> list[int]:
    """(65,) where the expected error of each point stands in [25 of the body, 20 of the left hand, 20 of the right]."""
    body = body_places()
    places = []
    for point in range(POINTS):
        if point in body:
            places.append(body.index(point))
        else:
            places.append(len(body) + HAND_POINTS.ravel().tolist().index(point))
    return places


def _quaternion_to_matrix() -> np.ndarray:
    """(16, 9): products of a quaternion's parts, ww, wx … → the entries of its matrix."""
    table = np.zeros((4, 4, 3, 3))
    for part, sign in ((0, (1, 1, 1)), (1, (1, -1, -1)), (2, (-1, 1, -1)), (3, (-1, -1, 1))):
        for axis in range(3):
            table[part, part, axis, axis] = sign[axis]
    for a, b in ((1, 2), (1, 3), (2, 3)):
        table[a, b, a - 1, b - 1] = table[a, b, b - 1, a - 1] = 2
    for part, (i, j) in ((3, (1, 0)), (2, (0, 2)), (1, (2, 1))):
        table[0, part, i, j], table[0, part, j, i] = 2, -2
    return table.reshape(16, 9)


def _matrix_to_forms() -> tuple[np.ndarray, np.ndarray]:
    """(9, 16) and (16,): a matrix's entries → 4 q⊗q, row by row."""
    table, constant = np.zeros((3, 3, 4, 4)), np.eye(4)
    for part, sign in ((0, (1, 1, 1)), (1, (1, -1, -1)), (2, (-1, 1, -1)), (3, (-1, -1, 1))):
        for axis in range(3):
            table[axis, axis, part, part] = sign[axis]
    for a, b in ((1, 2), (1, 3), (2, 3)):
        for i, j in ((a - 1, b - 1), (b - 1, a - 1)):
            table[i, j, a, b] = table[i, j, b, a] = 1
    for part, (i, j) in ((3, (1, 0)), (2, (0, 2)), (1, (2, 1))):
        for p, q in ((0, part), (part, 0)):
            table[i, j, p, q], table[j, i, p, q] = 1, -1
    return table.reshape(9, 16), constant.ravel()


def _matrix_to_heading() -> np.ndarray:
    """(9, 2): a matrix's entries → cosine and sine of its twist about +Y, both times the same."""
    table = np.zeros((3, 3, 2))
    table[0, 0, 0] = table[2, 2, 0] = 1
    table[0, 2, 1], table[2, 0, 1] = 1, -1
    return table.reshape(9, 2)


def _heading_to_turn() -> np.ndarray:
    """(6, 9): rows 0-2 take a vector from right to left to cosine and sine; 3-5 cosine, sine and 1 to a turn."""
    table = np.zeros((6, 3, 3))
    turn = table[3:]
    turn[0, 0, 0] = turn[0, 2, 2] = 1
    turn[1, 0, 2], turn[1, 2, 0] = 1, -1
    turn[2, 1, 1] = 1
    flat = table.reshape(6, 9)
    flat[0, 0], flat[2, 1] = 1, -1
    return flat


_QUATERNION_TO_MATRIX = _quaternion_to_matrix()
_MATRIX_TO_FORMS, _FORMS_CONSTANT = _matrix_to_forms()
_MATRIX_TO_HEADING, _HEADING_TO_TURN = _matrix_to_heading(), _heading_to_turn()
