"""Half bodies: the arms or the legs that names give, in a tree whose other half is missing."""

from __future__ import annotations

from itertools import combinations

from bodysense.body.hands.hand import FINGERS
from bodysense.errors import BodysenseError
from bodysense.io.rigs.body import NO_BODY, Body, Limbs, body_of, named_body
from bodysense.io.rigs.figure import Tree
from bodysense.io.rigs.limbs import ALIKE, ROLES, Kind, Limb, longest_chain, named_limb, named_points
from bodysense.io.rigs.names import is_helper, words

_OF: dict[Kind, tuple[str, ...]] = {  # points of a limb
    "leg": ("hip", "knee", "ankle", "foot", "toe"),
    "arm": ("collar", "shoulder", "elbow", "wrist", *FINGERS),
}
_LIMB = 0.5  # of the limbs that names give: a longer pair of chains on the trunk is a pair of limbs
_SKIRT = 0.8  # of a leg with its foot: a shorter pair of chains at the hips may be a skirt


def find_body(tree: Tree) -> Body:
    """Return the body, or the half of one, that names give. Raises BodysenseError if they give none."""
    return named_body(tree) or _half(tree)


def _half(tree: Tree) -> Body:
    """Return the upper or lower half of a body. Raises BodysenseError if there are more limbs, or none."""
    points, count, joints = named_points(tree), len(tree.figure.points), len(tree.figure.joints)
    named: dict[Kind, Limb] = {kind: limb for kind in ROLES if (limb := named_limb(tree, points, kind))}
    kind: Kind = "arm" if "arm" in named else "leg"
    other: Kind = "leg" if kind == "arm" else "arm"
    if kind not in named or all(any(tree.means(k, role) for k in range(count)) for role in ROLES[other]):
        needed = [f"{side}_{role}" for role in (*ROLES["leg"], *ROLES["arm"]) for side in ("left", "right")]
        gone = [name for name in needed if name not in points]
        lacking = f", by name it has no {', '.join(gone)}" if 2 * len(gone) < len(needed) and gone else ""
        raise BodysenseError(NO_BODY + lacking)
    limb = named[kind]
    if more := _more_limbs(tree, limb):
        begin = " and ".join(repr(tree.name(point)) for point in more)
        raise BodysenseError(f"not a humanoid: {begin} begin limbs, besides its {kind}s, that are no {other}s by name")
    # The end of the trunk without limbs: the joint named so, or the farthest possible.
    trunk, part = (tree.figure.above(limb.hub), "pelvis") if kind == "arm" else (list(range(joints)), "spine")
    ends = [k for k in trunk if k not in limb.points and tree.means(k, part) and not is_helper(tree.name(k))]
    end = (ends or trunk[-1:])[0] if kind == "arm" else (ends or [limb.hub])[-1]
    stub = Limb(tree, end, ((end,), (end,)), ((end,) * 3, (end,) * 3), (limb.length / 2, limb.length / 2))
    body = body_of(Limbs(stub, limb) if kind == "arm" else Limbs(limb, stub), points, penalty=0.0)
    gone = [name for name in body.points if name.partition("_")[2].rstrip("123").removesuffix("_tip") in _OF[other]]
    return Body({name: point for name, point in body.points.items() if name not in gone}, 0.0)


def _more_limbs(tree: Tree, limb: Limb) -> tuple[int, int] | None:
    """Return the first points of a further pair of chains that is as long as limbs; at the hips a skirt may be longer.

    Hair on a head and helpers are no limbs.
    """
    skirt, least = _SKIRT * sum(tree.length[k] for k in limb.chains[0]), _LIMB * limb.length
    for hub in range(len(tree.figure.joints)):
        above = tree.figure.above(hub)
        if not limb.points.isdisjoint(above) or any("head" in words(tree.name(k)) for k in above[:-1]):
            continue
        long: list[tuple[int, float]] = []
        for point in tree.figure.children[hub]:
            chain = [point, *longest_chain(tree, point)]
            length = float(sum(tree.length[k] for k in chain))
            is_limb = len(chain) >= 3 and length > (skirt if hub == limb.hub else least)
            if is_limb and limb.points.isdisjoint(chain) and not is_helper(tree.name(point)):
                long.append((point, length))
        for (one, a), (two, b) in combinations(long, 2):
            if abs(a - b) <= ALIKE * max(a, b):
                return one, two
    return None
