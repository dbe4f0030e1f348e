"""One step of completion as one graph: points in the world in, a whole body out, the state in and out.

Change of frame, both networks, re-acquisition blending, forward kinematics, measured points, bent limbs, held feet and
the floor are inside, so that every runtime gives the same body. The order:

    rotations that measured points imply → frame under the head → network, asked twice (once in a mirror) → measured
    rotations in their place → directions between measured points → places → spine to a measured pelvis → arms and legs
    to measured or predicted ends, feet held → fingers → places → local rotations

A graph of few operations is what makes a step quick; see `vectors` for how its numbers are laid out.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from bodysense_lab.completion.blending import Blend, Blending
from bodysense_lab.completion.constraints import ARMS, LIMBS, FootState, Limbs, Spine, held_feet
from bodysense_lab.completion.error_map import ErrorMap
from bodysense_lab.completion.expected_errors import ExpectedErrors
from bodysense_lab.completion.features import MOVING, Reading
from bodysense_lab.completion.fingers import FingerNetwork
from bodysense_lab.completion.frame import Frame, FrameFinder
from bodysense_lab.completion.hands import HandStep
from bodysense_lab.completion.masks import Conditions, Means
from bodysense_lab.completion.measured import UNTRACKED, Branches, MeasuredDirections
from bodysense_lab.completion.mirrored import MirroredNetwork
from bodysense_lab.completion.network import CompletionNetwork
from bodysense_lab.completion.places import conditions, means, reading_tables, skeleton_tables
from bodysense_lab.completion.points import HEAD, JOINTS
from bodysense_lab.completion.state import (
    JOINT_COUNT,
    POINT_COUNT,
    Inputs,
    Memory,
    Numbers,
    Outputs,
    Rows,
    State,
    first_state,
    unpacked,
)
from bodysense_lab.completion.vectors import (
    axes_of,
    carried,
    frames,
    quaternion_between,
    replaced,
    spread,
    thrice,
    turned_onto,
)

ADVANCE = 1 / 65  # s: the memory advances no sooner, so that faster devices are answered from the last one
_FINEST = 1e-4  # m: no point is more accurate
_PARTS = [JOINTS, JOINT_COUNT - JOINTS]  # joints of the body and of both hands


class Tracked(NamedTuple):
    """What is tracked, rotations that points imply among it; what is not has a value that does no harm."""

    told: Tensor  # (B, 117) 1 or 0 of positions and rotations that are tracked
    masks: Tensor  # (B, 117) the same, with rotations that points imply
    turned: Tensor  # (B, 1, 52, 3) the latter, thrice
    holds: dict[str, Tensor]  # (B, n) `conditions`
    means: dict[str, Tensor]  # (B, 1, n, 65) `means`
    base: Tensor  # (B, 1, 1, 3) m, world: at the head; places count from there, so that they are as exact far away
    near: Tensor  # (B, 1, 65, 3) m, from the base; where they were shown where they are not tracked
    before: Tensor  # (B, 1, 65, 3) m, from the base: points as shown in the frame before
    axes: Tensor  # (B, 3, 52, 3) world
    rows: Tensor  # (B, 1, 156, 3) the same
    accuracy: Tensor  # (B, 65) m


class Body(NamedTuple):
    """A body with flat hands, placed from the base."""

    bones: Tensor  # (B, 1, 65, 3) m
    points: Tensor  # (B, 1, 65, 3) m


class CompletionStep(nn.Module):
    """The whole step. `mean` and `bound` make the expected errors true (`uncertainty`)."""

    def __init__(self, body: CompletionNetwork, fingers: FingerNetwork, mean: ErrorMap, bound: ErrorMap) -> None:
        super().__init__()
        self.body, self.finger_network = body, fingers
        self.conditions, self.means = Conditions(conditions()), Means(means(), {"body": HEAD})
        self.branches, self.directions = Branches(), MeasuredDirections()
        self.frame_finder, self.mirrored, self.blending = FrameFinder(), MirroredNetwork(body), Blending()
        self.spine, self.limbs, self.hands = Spine(), Limbs(), HandStep(fingers)
        self.expected_errors = ExpectedErrors(mean, bound)
        for name, values in {**reading_tables(), **skeleton_tables()}.items():
            self.register_buffer(name, values, persistent=False)

    input_points: Tensor
    spin_rows: Tensor
    axis_rows: Tensor
    accuracy_places: Tensor
    body_places: Tensor
    heights: Tensor
    flattest: Tensor
    from_head: Tensor
    parents: Tensor
    flat_parents: Tensor
    joint_parents: Tensor
    hanging: Tensor
    standing: Tensor
    starts: Tensor
    start_doubt: Tensor
    middles: Tensor
    ends: Tensor
    hinges: Tensor
    feet: Tensor
    legs: Tensor
    turned: Tensor
    with_turned: Tensor

    def start(self, batch: int) -> State:
        """The state before the first frame of `batch` people."""
        return first_state(self.body.config, self.finger_network.config, batch)

    def forward(self, inputs: Inputs, state: State) -> tuple[Outputs, State]:
        """Complete one frame of B people."""
        memory, shown, numbers = unpacked(state, self.body.config, self.finger_network.config)
        interval, offset = inputs.interval.unsqueeze(-1), inputs.rest_offset.unsqueeze(1)
        rest = spread(offset)
        tracked = self._tracked(inputs, offset, shown, numbers.begun)
        holds = tracked.holds
        frame = self.frame_finder(
            tracked.near, tracked.axes, tracked.masks, holds["lines"], tracked.base, inputs.floor, numbers.heading
        )
        reading, moving = self._reading(inputs, tracked, frame, memory, numbers, interval)
        size = reading.size.reshape(-1, 1, 1, 1)
        answer = self.mirrored(reading, memory.body)
        head = tracked.before[:, :, HEAD : HEAD + 1]
        rows = torch.cat([shown.axes, (head - frame.floor) / size], dim=2) @ frame.into
        blend = self.blending(answer.rows, rows, tracked.masks, interval, shown, numbers)

        # What is measured is as it is measured.
        axes, head = (blend.rows @ frame.back).split([2 * JOINTS, 1], dim=2)
        told = self.directions(tracked.near, rest, tracked.accuracy)
        axes = told.body.turned(frames(*axes.reshape(-1, 2, JOINTS, 3).split(1, dim=1)))
        measured = zip(tracked.axes.split(_PARTS, dim=2), tracked.turned.split(_PARTS, dim=2), strict=True)
        (of_body, body_turned), (of_fingers, fingers_turned) = measured
        axes = replaced(axes, of_body, body_turned)

        axes, head, body = self._hung(axes, head * size + frame.floor, rest, tracked)
        contact = torch.sigmoid(answer.contact_logit)
        start = body.points.index_select(2, self.starts)
        limbs = holds["limbs"].reshape(-1, 1, 5 * len(LIMBS), 1)
        free_end, free, led, hung, goes = limbs.split(len(LIMBS), dim=2)
        shifted, target, pole, ends, feet = self._targets(
            inputs, body, start, free_end, led, hung, goes, contact, tracked, frame, blend, shown, numbers
        )
        # A knee between a tracked hip and foot bends about what their rotations have to the left.
        hinge = self.hinges @ (tracked.axes[:, :1] * tracked.turned)
        hinge = hinge * tracked.turned.index_select(2, self.ends) * (1 - free_end)
        # What was shown was drawn to natural sides already.
        limbs = self.limbs(axes, body.bones, start, shifted, target, pole, hinge, free, 1 - blend.fade)
        fingers = self.hands(
            axes,
            target[:, :, :ARMS],
            head,
            offset,
            tracked.rows,
            told.from_wrists,
            holds["hands"],
            tracked.before,
            interval,
            frame,
            memory,
            numbers,
        )
        before, after = told.fingers.bones(fingers.axes)
        old = torch.cat([axes.index_select(2, self.turned), fingers.axes], dim=2)
        turned = turned_onto(old, torch.cat([limbs.before, before], dim=2), torch.cat([limbs.after, after], dim=2))
        limb_axes, finger_axes = turned.split([self.turned.shape[0], _PARTS[1]], dim=2)
        finger_axes = replaced(finger_axes, of_fingers, fingers_turned)
        world = torch.cat([axes, limb_axes, finger_axes], dim=2).index_select(2, self.with_turned)
        points = self.from_head @ carried(world.index_select(2, self.parents), rest) + (head + tracked.base)

        above = world.index_select(2, self.joint_parents) * self.hanging + self.standing
        confidence, bound = self.expected_errors(
            answer.error,
            fingers.error,
            reading.size,
            tracked.told,
            inputs.certainty,
            inputs.has_position,
            inputs.accuracy,
            answer.apart,
        )
        places = points.squeeze(1)
        outputs = Outputs(places[:, 0], quaternion_between(above, world), places, confidence, bound, contact)

        elapsed = numbers.elapsed + interval
        advances = elapsed - numbers.begun >= ADVANCE - 1  # and at first
        now = Memory(answer.memory, fingers.memory, moving, holds["moving"])
        axes = world.reshape(-1, 1, 3 * JOINT_COUNT, 3).index_select(2, self.axis_rows)
        elapsed = torch.where(advances, 0.0, elapsed)
        begun = numbers.begun.clamp(min=1.0)
        rows = Rows(points, axes, blend.kept, ends, feet.anchor, feet.shift)
        left = Numbers(tracked.masks, feet.held.reshape(-1, 4), frame.heading, blend.age, elapsed, begun)
        return outputs, State(
            memory=torch.where(advances, torch.cat(now, dim=1), state.memory),
            rows=torch.cat(rows, dim=2),
            numbers=torch.cat(left, dim=1),
        )

    def _tracked(self, inputs: Inputs, offset: Tensor, shown: Rows, begun: Tensor) -> Tracked:
        """What is tracked, with rotations that points imply. A point that is not stays where it was shown."""
        told = torch.cat([inputs.has_position, inputs.has_rotation], dim=1).to(offset)
        seen, measured = told.split([POINT_COUNT, JOINT_COUNT], dim=1)
        masks = torch.cat([seen, torch.maximum(measured, self.branches.implied(told))], dim=1)
        both = torch.cat([masks, measured], dim=1).reshape(-1, 1, POINT_COUNT + 2 * JOINT_COUNT, 1)
        seen_thrice, turned, measured = thrice(both).split([POINT_COUNT, JOINT_COUNT, JOINT_COUNT], dim=2)
        means = self.means(seen.reshape(-1, 1, 1, POINT_COUNT), begun.reshape(-1, 1, 1, 1))
        # A head that is not tracked goes with the points that are.
        moved = seen_thrice * (inputs.position.unsqueeze(1) - shown.points)
        base = shown.points[:, :, HEAD : HEAD + 1] + means["frame"] @ moved
        before = shown.points - base
        near = before + moved
        axes = self.branches(axes_of(inputs.rotation), measured, offset, near)
        accuracy = torch.where(inputs.has_position, inputs.accuracy, UNTRACKED).clamp(min=_FINEST)
        rows = axes.reshape(-1, 1, 3 * JOINT_COUNT, 3)
        return Tracked(told, masks, turned, self.conditions(masks), means, base, near, before, axes, rows, accuracy)

    def _reading(
        self, inputs: Inputs, tracked: Tracked, frame: Frame, memory: Memory, numbers: Numbers, interval: Tensor
    ) -> tuple[Reading, Tensor]:
        """What the body's network reads, and what to compare with at the next frame (B, 99)."""
        places = self.input_points @ tracked.near
        axes = tracked.rows.index_select(2, self.spin_rows)
        moving = torch.cat([places + tracked.base, axes], dim=2).reshape(-1, 3 * MOVING)
        moved = (moving - memory.rows).reshape(-1, 1, MOVING, 3)
        holds = tracked.holds
        heights = nn.functional.linear(inputs.rest_offset[..., 1], self.heights, self.flattest)
        reading = Reading(
            rows=torch.cat([places - frame.floor, moved, tracked.rows.index_select(2, self.axis_rows)], dim=2),
            seen=torch.cat([holds["points"], holds["moving"] * memory.seen, holds["axes"]], dim=1),
            into=frame.into,
            size=heights.amax(dim=1, keepdim=True),
            interval=numbers.elapsed + interval,
            accuracy=tracked.accuracy.index_select(1, self.accuracy_places),
            rest_offset=inputs.rest_offset.index_select(1, self.body_places).reshape(-1, 3 * self.body_places.shape[0]),
            certainty=inputs.certainty.index_select(1, self.body_places),
            acceleration=inputs.acceleration.unsqueeze(1),
            accelerated=inputs.has_acceleration.to(interval),
        )
        return reading, moving

    def _hung(self, axes: Tensor, head: Tensor, rest: Tensor, tracked: Tracked) -> tuple[Tensor, Tensor, Body]:
        """Axes, head and body, placed by its measured head or else by its pelvis or what is seen; the spine bent."""
        body = self._placed(axes, rest, head)
        off = tracked.near - body.points
        shift = tracked.means["body"] @ off
        axes = self.spine(axes, body.bones, tracked.means["pelvis"] @ (off - shift))
        return axes, head + shift, self._placed(axes, rest, head + shift)

    def _placed(self, axes: Tensor, rest: Tensor, head: Tensor) -> Body:
        """The points of a body with flat hands, for rest offsets (B, 3, 65, 3) as `spread` and a head (B, 1, 1, 3)."""
        bones = carried(axes.index_select(2, self.flat_parents), rest)
        return Body(bones, self.from_head @ bones + head)

    def _targets(
        self,
        inputs: Inputs,
        body: Body,
        start: Tensor,
        free: Tensor,
        led: Tensor,
        hung: Tensor,
        goes: Tensor,
        contact: Tensor,
        tracked: Tracked,
        frame: Frame,
        blend: Blend,
        shown: Rows,
        numbers: Numbers,
    ) -> tuple[Tensor, Tensor, Tensor, Tensor, FootState]:
        """Where limbs go: how far off shoulders are, ends, measured or predicted with feet held, middles from starts.

        Returns those (B, 1, 4, 3) m each, what is left of where ends were shown when sensors changed, and the feet.
        """
        count = len(LIMBS)
        to_end, to_middle, to_start = (tracked.means["limbs"] @ (tracked.near - body.points)).split(count, dim=2)
        doubt = nn.functional.linear(tracked.accuracy, self.start_doubt).reshape(-1, 1, count, 1)
        to_start = to_start / (1 + doubt * doubt)
        to_middle = to_middle + goes * to_start
        end = body.points.index_select(2, self.ends)
        left = tracked.before.index_select(2, self.ends) - end - to_middle - self.legs @ shown.shift
        ends = torch.where(blend.changed, left, shown.ends)
        move = to_end + free * (to_middle + blend.fade * ends)
        step, feet = held_feet(
            body.points.index_select(2, self.feet).reshape(-1, 3, 2, 3) + move[:, :, ARMS:],
            contact.reshape(-1, 2, 2, 1),
            inputs.interval.reshape(-1, 1, 1, 1),
            frame.floor,
            inputs.hold.reshape(-1, 1, 1, 1),
            FootState(numbers.held.reshape(-1, 2, 2, 1), shown.anchor - tracked.base, shown.shift),
        )
        target = end + move + free * (self.legs @ step)
        pole = to_middle + body.bones.index_select(2, self.middles)
        # Between a measured end and the start, a lower bone of measured rotation tells where the middle joint is.
        pole = pole + led * (target - start - body.bones.index_select(2, self.ends) - pole)
        return hung * to_start, target, pole, ends, feet._replace(anchor=feet.anchor + tracked.base)
