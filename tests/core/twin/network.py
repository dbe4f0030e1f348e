"""The body's network, evaluated on the tracked points and on their mirror image; the outputs are averaged."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from .features import HEAD_HEIGHT, MIRROR, Before, Head, Reading, features, find_head, mirrored, read, remember, stature
from .layers import FEATURE, STATE, Update, branch_of, logistic, recurrent_of, rounded, softplus, updates_of
from .points import BODY, BODY_PARTNER, HEAD, PARTNER
from .tracked import Tracked
from .vectors import frame_of

LEAST_UNLIKE = 0.003  # two answers differ by no less
ADVANCE = 1 / 65  # s: memories advance no sooner
SMALLEST_ERROR, ERROR_BIAS = 0.002, -3.0  # m at the reference stature; of the error before it is made positive
LAYERS = 2


@dataclass
class Memory:
    """The memory of the networks for one person."""

    turn: np.ndarray  # (3, 3) world ← frame under the head, in the frame before
    hidden: list[np.ndarray]  # of each layer (H, 2): of the body, of its mirror image
    hands: np.ndarray  # (H, 2) of both hands
    before: Before | None = None  # when memories last advanced
    wrists: np.ndarray | None = None  # (2, 3) m, from base: of the body of the frame before
    elapsed: float = 0.0  # s since memories last advanced
    advances: bool = False  # in this frame
    # States of the core after this frame, if it advances. Products of the layers above read these, because a state
    # whose last bit differs may be rounded to another of 127 steps.
    core: tuple[list[np.ndarray], np.ndarray] | None = None


@dataclass(frozen=True)
class Prediction:
    """A body as the network predicts it, in the world."""

    rotation: np.ndarray  # (22, 3, 3) world ← joint
    head: np.ndarray  # (3,) m, from base: where the head is if it is not tracked
    contact: np.ndarray  # (4,) probability
    error: np.ndarray  # (25,) m, expected
    unlike: np.ndarray  # (22,) how much the axes predicted for a body and for its mirror image differ


def first_memory(of: Mapping[str, np.ndarray]) -> Memory:
    """The memory before the first frame."""
    sizes = [of[f"body.recurrent.weight_hh_l{k}"].shape[1] for k in range(LAYERS)]
    hands = of["fingers.recurrent.weight_hh_l0"].shape[1]
    return Memory(np.eye(3, dtype=np.float32), [np.zeros((size, 2)) for size in sizes], np.zeros((hands, 2)))


def predict(of: Mapping[str, np.ndarray], seen: Tracked, memory: Memory) -> tuple[Prediction, Head]:
    """Predict a body and find the frame under its head. The memory advances at most 65 times a second."""
    head = find_head(seen, memory.turn)
    interval = np.float32(memory.elapsed) + np.float32(seen.interval)
    reading = read(seen, head, memory.before, interval, of["body.usual_bones"])
    x = rounded(np.stack([features(reading), features(mirrored(reading))], axis=1), FEATURE)
    memory.advances = memory.before is None or bool(interval >= ADVANCE)
    known = memory.core[0] if memory.core and memory.advances else None
    after, turned, judged = outputs_of(of, reading, x, memory.hidden, known=known)
    memory.turn, memory.elapsed = head.turn, float(interval)
    if memory.advances:
        memory.hidden, memory.before = after, remember(seen)
    return _meaning(of, turned, judged, head, float(stature(seen.rest_offset))), head


def outputs_of(
    of: Mapping[str, np.ndarray],
    reading: Reading,
    x: np.ndarray,
    hidden: Sequence[np.ndarray],
    steps: int = STATE,
    known: Sequence[np.ndarray] | None = None,
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Return the states of all layers after rounded features (F, C), and the outputs of both branches.

    States are rounded to `steps` before they are read. `known` states are read instead of own ones if they are given.
    """
    has_pose = reading.has_place[HEAD] and reading.has_axes[HEAD]

    def updates(*products: str) -> list[Update]:
        """Updates of products, which act while the head's pose is not tracked."""
        return [] if has_pose else [update for product in products for update in updates_of(of, product)]

    above, after = x, list[np.ndarray]()
    for layer, before in enumerate(hidden):
        added = updates(f"input_l{layer}", f"state_l{layer}")
        after.append(recurrent_of(of, "body", layer).step(above, before, steps, added))
        above = rounded(known[layer] if known else after[-1], steps)
    split = len(above)
    parts = [part for one in updates("turn_branch") for part in one.columns(slice(split), slice(split, None))]
    turned = branch_of(of, "body.turn_branch").outputs(above, x, parts)
    return after, turned, branch_of(of, "body.judge_branch").outputs(above, x)


def _meaning(
    of: Mapping[str, np.ndarray], turned: np.ndarray, judged: np.ndarray, head: Head, size: float
) -> Prediction:
    """Return the prediction of outputs (O, 2) for a body and for its mirror image."""
    axes = turned[: 6 * BODY].T.reshape(2, BODY, 3, 2)
    image = axes[1][PARTNER[:BODY]] * MIRROR[:, None] * MIRROR[:2]
    mean = (axes[0] + image) / 2 + of["body.standing"].reshape(BODY, 3, 2)
    half = ((axes[0] - image) / 2).reshape(BODY, 6)
    raised = (turned[6 * BODY :, 0] + MIRROR * turned[6 * BODY :, 1]) / 2 + [0, HEAD_HEIGHT, 0]
    contact, error = judged[:4], judged[4:]
    error = (error[:, 0] + error[BODY_PARTNER, 1]) / 2
    return Prediction(
        rotation=np.array([head.turn @ frame_of(joint[:, 0], joint[:, 1]) for joint in mean]),
        head=head.origin + head.turn @ raised * size,
        contact=logistic((contact[:, 0] + contact[[1, 0, 3, 2], 1]) / 2),
        error=(softplus(error + ERROR_BIAS) + SMALLEST_ERROR) * size,
        unlike=np.array([sqrt(row @ row + LEAST_UNLIKE**2) for row in half]),
    )
