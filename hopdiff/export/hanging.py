"""Joints that do not hang where anatomy says: feet that are children of the root for the sake of inverse kinematics,
bones of a skin that were laid side by side, names that a leaf bone has, too."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import torch
from torch import Tensor

from hopdiff.export.anatomy import CHAINS, REQUIRED, SPINE
from hopdiff.export.skin import Skin
from hopdiff.geometry.body_parts import rest_positions, toe_of
from hopdiff.geometry.joint_names import SIDES, named
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.types import HopdiffError
from hopdiff.whole_body.skeleton import JOINTS

TRUNK = SPINE[1:4]  # between pelvis and neck
ENDS = (("knee", "ankle"), ("ankle", "toe"), ("elbow", "wrist"))  # a part, and what may hang elsewhere
AT = 0.02  # of the bone above a leaf up to which a joint is at its place
NEAR = 0.35  # of the bone above it that an end may be from where a leaf marks it


def loose_parts(skeleton: Skeleton, parts: Mapping[str, int], skin: Skin | None) -> dict[str, int]:
    """Parts with those that hang elsewhere: by name alone where legs were not found, and ends that hold the skin in
    place of leaves that hold nothing. skin: of the body, None if unknown."""
    found = dict(parts)
    if any(part not in found for part in REQUIRED):
        found = _by_name(skeleton, skin)
        if any(part not in found for part in REQUIRED):
            return dict(parts)
    places = rest_positions(skeleton)
    for side in SIDES:
        for upper, lower in ENDS:
            end = _end(skeleton, places, found, (side, upper, lower), skin)
            if end is None:
                continue
            found[f"{side}_{lower}"] = end
            toe = toe_of(skeleton, places, end) if lower == "ankle" else None
            if toe is not None and f"{side}_toe" not in found:
                found[f"{side}_toe"] = toe
    return found


def _by_name(skeleton: Skeleton, skin: Skin | None) -> dict[str, int]:
    """Parts by name alone, whatever hangs on what; of several those that hold most of the skin."""
    found: dict[str, int] = {}
    for part in JOINTS:
        side, _, name = part.rpartition("_")
        if part in TRUNK:
            continue
        of = named(skeleton.names, name or part, side if side in SIDES else None)
        free = [joint for joint in of if joint not in found.values()]
        if free:
            found[part] = max(free[:4], key=lambda joint: 0.0 if skin is None else skin.everything(joint))
    return found


def _end(
    skeleton: Skeleton, places: Tensor, found: Mapping[str, int], which: tuple[str, str, str], skin: Skin | None
) -> int | None:
    """The joint that a limb truly ends in, None where what was found is right, or nothing better is there. places:
    (J, 3) at rest. which: side, the part before, and that part."""
    side, upper, lower = which
    above, own = found.get(f"{side}_{upper}"), found.get(f"{side}_{lower}")
    if above is None:
        return None
    called, taken = named(skeleton.names, lower, side), set(found.values())
    if own is not None and own not in called and not _is_leaf(skeleton, own, skin):
        # A piece of the limb where the one that is called so hangs elsewhere, further along.
        far = [float((places[k] - places[above]).norm()) for k in (own, *called)]
        beyond = [k for k, way in zip(called, far[1:], strict=True) if way > far[0] and k not in taken]
        own = None if any(not _is_leaf(skeleton, k, skin) for k in beyond) else own
    if own is not None and not _is_leaf(skeleton, own, skin):
        return None
    # Where names do not tell, what hangs elsewhere lies at the leaf.
    others = called or _at(places, above, own)
    if lower == "toe":
        # Where the ankle is called so, the foot is what hangs on it.
        others += [k for k in named(skeleton.names, "ankle", side) if above in skeleton.above(k)]
    others = [k for k in others if k not in taken and k != own and not _is_leaf(skeleton, k, skin)]
    if own is not None:
        reach = NEAR * float((places[own] - places[above]).norm())
        near = [(float((places[k] - places[own]).norm()), k) for k in others]
        others = [k for distance, k in sorted(near) if distance < reach]
    return others[0] if others else None


def _at(places: Tensor, above: int, own: int | None) -> list[int]:
    """The joints at the place of one that hangs on another, nearest first."""
    if own is None:
        return []
    gaps = (places - places[own]).norm(dim=-1)
    reach = AT * float((places[own] - places[above]).norm())
    return [k for k in gaps.argsort().tolist() if float(gaps[k]) < reach]


def _is_leaf(skeleton: Skeleton, joint: int, skin: Skin | None) -> bool:
    """Whether a joint holds no skin, and nothing that hangs on it does."""
    below = skeleton.below(joint)
    return len(below) == 1 if skin is None else not any(skin.everything(k) > 0.0 for k in below)


def rehung(name: str, skeleton: Skeleton, parts: Mapping[str, int], skin: Skin | None) -> Skeleton:
    """The same joints at the same places, each part on the one that carries it, and what holds the skin on the body.

    Joints may be in another order. Frames are aligned with the axes. Raises HopdiffError, naming joints, for a part
    that carries the one it should hang on.
    """
    parents = list(skeleton.parents)

    def above(joint: int) -> list[int]:
        line = []
        while (joint := parents[joint]) >= 0:
            line.append(joint)
        return line

    for chain in CHAINS:
        for upper, lower in pairwise(part for part in chain if part in parts):
            one, other = parts[upper], parts[lower]
            if one in above(other):
                continue
            if other in above(one):
                ours, theirs = skeleton.names[other], skeleton.names[one]
                raise HopdiffError(f"{name}: {theirs!r} ({upper}) hangs on {ours!r} ({lower}), which it should carry.")
            parents[other] = one
    places = rest_positions(skeleton) + skeleton.offsets[0]
    if skin is not None and "pelvis" in parts:
        pelvis = parts["pelvis"]
        body = {k for k in range(len(parents)) if pelvis in (k, *above(k))}
        for joint in range(len(parents)):
            line = [joint, *above(joint)]
            top = next((k for k in line if parents[k] in above(pelvis)), None)
            if joint in body or joint in above(pelvis) or top is None or skin.everything(joint) == 0.0:
                continue
            shares = skin.shared(joint, len(parents))
            best = max(body, key=lambda k: (float(shares[k]), -float((places[k] - places[joint]).norm())))
            parents[top] = best
            body |= {k for k in range(len(parents)) if top in (k, *above(k))}
    if tuple(parents) == skeleton.parents:
        return skeleton
    order = sorted(range(len(parents)), key=lambda k: (len(above(k)), k))
    at = {old: new for new, old in enumerate(order)}
    held = [at[parents[old]] if parents[old] >= 0 else -1 for old in order]
    offsets = torch.stack([places[old] - (places[parents[old]] if parents[old] >= 0 else 0.0) for old in order])
    return Skeleton(tuple(skeleton.names[old] for old in order), tuple(held), offsets, skeleton.end_sites)
