"""The segments of the body, against the numbers of the character files."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from hopdiff.whole_body.kinematics import joint_places, segment_centres
from hopdiff.whole_body.layout import COUNT, JOINT_OF, PARENTS, SEGMENTS, Layout
from hopdiff.whole_body.skeleton import full_skeleton
from tests.builders import settings_of
from tests.whole_body.bodies import DTYPE, layout_of, plain_problem

BODIES = ("human", "child", "cartoon")
# De Leva (1996), table 4, male: shares of the mass, centres and radii of gyration (left, up, forward).
FOOT, SHANK = 0.0137, 0.0433
MIDDLE_TRUNK, ABOVE_WAIST = 0.1033, 0.3229  # upper and middle trunk above the waist
SIDES = ("left", "right")


def standing(layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """Joints and centres of mass (S, 3) of a body that stands straight, from the root."""
    frames = torch.eye(3, dtype=DTYPE).expand(1, COUNT, 3, 3).unsqueeze(-1)
    root = torch.zeros(1, 3, 1, dtype=DTYPE)
    joints = joint_places(layout, root, frames)
    return joints[0, :, :, 0].numpy(), segment_centres(layout, root, frames)[0, :, :, 0].numpy()


def whole(masses: np.ndarray, centres: np.ndarray, moments: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre (3,) and inertia tensor (3, 3) about it of segments with principal moments (S, 3)."""
    mass = float(masses.sum())
    centre = (masses[:, None] * centres).sum(0) / mass
    tensor = np.diag(moments.sum(0))
    for m, arm in zip(masses, centres - centre, strict=True):
        tensor = tensor + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return mass, centre, tensor


def part(layout: Layout, names: tuple[str, ...]) -> tuple[float, np.ndarray, np.ndarray]:
    rows = [SEGMENTS.index(name) for name in names]
    _, centres = standing(layout)
    return whole(layout.masses.numpy()[rows], centres[rows], layout.inertias.numpy()[rows])


def joints_of(name: str) -> dict[str, Any]:
    return settings_of("character", name)["joints"]


def place(joints: dict[str, Any], name: str) -> np.ndarray:
    """Of a joint of the file, from the pelvis [body heights]."""
    parent = joints[name].get("parent")
    return np.zeros(3) if parent is None else place(joints, parent) + np.array(joints[name]["offset"])


def from_file(name: str) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre and inertia of the standing body, worked out from the file alone."""
    joints, settings = joints_of(name), settings_of("character", name)
    masses, centres, moments = [], [], []
    for joint, entry in joints.items():
        segment, origin = entry["segment"], place(joints, joint)
        if not joint.endswith("knee"):
            masses.append(segment["mass"])
            centres.append(origin + np.array(segment["com"]))
            moments.append(segment["mass"] * np.array(segment["gyration"]) ** 2)
            continue
        # Shank and foot: the ankle is .039 of the body above the sole, where the shank with the foot is .285 of it.
        length = -entry["end"][1]
        height, back, tip = (length * x / 0.285 for x in (0.039, 0.04, 0.112))
        bone, size = length - height, back + tip
        for share, centre, radii in (
            (SHANK, np.array([0.0, -0.4459 * bone, 0.0]), np.array([0.255, 0.103, 0.249]) * bone),
            (
                FOOT,
                np.array([0.0, -bone - 0.5 * (height + settings["shoe"]), -back + 0.4415 * size]),
                np.array([0.257, 0.245, 0.124]) * size,
            ),
        ):
            m = segment["mass"] * share / (SHANK + FOOT)
            masses.append(m)
            centres.append(origin + centre)
            moments.append(m * radii**2)
    mass, centre, tensor = whole(np.array(masses), np.array(centres), np.array(moments))
    total, scale = settings["mass"], settings["height"]
    return total, centre * scale, tensor * total / mass * scale**2


@pytest.mark.parametrize("name", BODIES)
def test_the_standing_body_has_the_mass_centre_and_inertia_of_its_file(name: str) -> None:
    """Cutting the trunk in two changes none of them; cutting the shank gives the numbers of its two parts."""
    mass, centre, tensor = part(layout_of(name), SEGMENTS)
    wanted = from_file(name)
    assert mass == pytest.approx(wanted[0], rel=1e-9)
    np.testing.assert_allclose(centre, wanted[1], atol=1e-9)
    if name == "human":
        np.testing.assert_allclose(tensor, wanted[2], atol=1e-9)
    np.testing.assert_allclose(tensor, wanted[2], rtol=0.02, atol=1e-6)


@pytest.mark.parametrize("name", BODIES)
def test_cutting_the_trunk_leaves_it_as_it_was(name: str) -> None:
    layout, settings = layout_of(name), settings_of("character", name)
    segment = joints_of(name)["waist"]["segment"]
    mass, centre, tensor = part(layout, ("waist", "chest"))
    share = segment["mass"] / sum(entry["segment"]["mass"] for entry in joints_of(name).values())
    assert mass == pytest.approx(settings["mass"] * share, rel=1e-9)
    waist = place(joints_of(name), "waist")
    np.testing.assert_allclose(centre, (waist + np.array(segment["com"])) * settings["height"], atol=1e-12)
    moments = mass * (np.array(segment["gyration"]) * settings["height"]) ** 2
    # A made-up body may be too slender for an abdomen of people's: then a third of the moments stays in the chest.
    slack = 1e-9 if name == "human" else 0.6
    np.testing.assert_allclose(tensor, np.diag(moments), rtol=slack, atol=1e-9)


def test_the_abdomen_and_the_foot_have_the_shares_of_people() -> None:
    layout = layout_of()
    mass = dict(zip(SEGMENTS, layout.masses.tolist(), strict=True))
    assert mass["waist"] / (mass["waist"] + mass["chest"]) == pytest.approx(MIDDLE_TRUNK / ABOVE_WAIST)
    # Half-way up the abdomen, as far ahead as the centre of the whole trunk.
    trunk = np.array(joints_of("human")["waist"]["segment"]["com"]) * 1.75
    half = 0.5 * layout.offsets[SEGMENTS.index("chest")].numpy()
    np.testing.assert_allclose(
        layout.centres[SEGMENTS.index("waist")].numpy(), half + trunk * (1.0, 0.0, 1.0), atol=1e-9
    )
    for side in SIDES:
        both = mass[f"{side}_shank"] + mass[f"{side}_foot"]
        assert mass[f"{side}_foot"] / both == pytest.approx(FOOT / (FOOT + SHANK))
        assert both == pytest.approx(70.0 * 0.057 / sum(x["segment"]["mass"] for x in joints_of("human").values()))
        # The file gives both as one piece; de Leva's table gives its parts: they agree to two centimetres.
        _, centre, _ = part(layout, (f"{side}_shank", f"{side}_foot"))
        knee = place(joints_of("human"), f"{side}_knee")
        joined = (knee + np.array(joints_of("human")[f"{side}_knee"]["segment"]["com"])) * 1.75
        assert np.abs(centre - joined).max() < 0.02


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("changed", [{}, {"proportions__legs": 1.3, "proportions__arms": 0.8}, {"shoe": 0.03}])
def test_segments_hang_where_their_joints_are(name: str, changed: dict[str, float]) -> None:
    layout = layout_of(name, **changed)
    assert float(layout.masses.sum()) == pytest.approx(settings_of("character", name)["mass"], rel=1e-9)
    assert bool((layout.masses > 0).all())
    assert bool((layout.spread > 0).all())
    straight = torch.eye(3, dtype=DTYPE).expand(len(layout.skeleton.names), 3, 3)
    places, _ = layout.skeleton.forward(torch.zeros(3, dtype=DTYPE), straight)
    joints, _ = standing(layout)
    for k, segment in enumerate(SEGMENTS):
        wanted = places[layout.skeleton.index(JOINT_OF[segment])]
        np.testing.assert_allclose(joints[k], wanted.numpy(), atol=1e-12)
    # The body stands on its soles: hips are a leg, an ankle and a shoe above them.
    root = float(layout.skeleton.offsets[0, 1])
    assert root == pytest.approx(layout.leg - float(layout.heel[1]), rel=1e-9)
    assert float(layout.ball[1]) == float(layout.toe[1]) == pytest.approx(float(layout.heel[1]))
    assert float(layout.heel[2]) < 0.0 < float(layout.ball[2]) < float(layout.toe[2])


@pytest.mark.parametrize("name", BODIES)
def test_left_and_right_are_mirror_images(name: str) -> None:
    layout = layout_of(name)
    flip = torch.tensor([-1.0, 1.0, 1.0], dtype=DTYPE)
    for k, segment in enumerate(SEGMENTS):
        if segment.startswith("left"):
            twin = SEGMENTS.index(segment.replace("left", "right"))
            assert float(layout.masses[twin]) == float(layout.masses[k])
            assert torch.equal(layout.inertias[twin], layout.inertias[k])
            torch.testing.assert_close(layout.offsets[twin], layout.offsets[k] * flip, rtol=0.0, atol=1e-15)
            torch.testing.assert_close(layout.centres[twin], layout.centres[k] * flip, rtol=0.0, atol=1e-15)


def test_spread_is_the_other_way_to_tell_inertia() -> None:
    """Moments about an axis are the second moments along the two others."""
    layout = layout_of()
    x, y, z = layout.spread.unbind(-1)
    torch.testing.assert_close(torch.stack((y + z, x + z, x + y), dim=-1), layout.inertias, rtol=1e-12, atol=0.0)


def test_above_follows_the_parents() -> None:
    above = layout_of().above
    for k in range(COUNT):
        chain, joint = {k}, k
        while (joint := PARENTS[joint]) >= 0:
            chain.add(joint)
        assert set(above[k].nonzero().flatten().tolist()) == chain
    assert set(above.unique().tolist()) == {0.0, 1.0}


def test_a_shoe_lifts_the_body_and_leaves_the_leg_alone() -> None:
    bare, shod = layout_of(shoe=0.0), layout_of(shoe=0.02)
    thick = 0.02 * 1.75
    assert float(shod.skeleton.offsets[0, 1] - bare.skeleton.offsets[0, 1]) == pytest.approx(thick)
    assert shod.leg == bare.leg
    assert shod.character.leg_length == bare.character.leg_length
    for point in ("heel", "ball", "toe"):
        change = getattr(shod, point) - getattr(bare, point)
        torch.testing.assert_close(change, torch.tensor([0.0, -thick, 0.0], dtype=DTYPE), rtol=0.0, atol=1e-12)


def test_the_head_of_the_whole_body_ends_where_that_of_eleven_joints_does() -> None:
    own = plain_problem().character.skeleton
    whole = full_skeleton(own)
    chain = ("pelvis", "waist", "chest", "upper_chest", "neck", "head")
    top = sum((whole.offsets[whole.index(name)] for name in chain), whole.end_sites["head"])
    short = sum((own.offsets[own.index(name)] for name in ("pelvis", "waist", "neck")), own.end_sites["neck"])
    torch.testing.assert_close(top, short)


def test_longer_legs_make_longer_legs() -> None:
    plain, long = layout_of(), layout_of(proportions__legs=1.25)
    assert long.thigh == pytest.approx(1.25 * plain.thigh)
    assert long.shank == pytest.approx(1.25 * plain.shank)
    assert float(long.toe[2]) == pytest.approx(1.25 * float(plain.toe[2]))
    for part_of in ("upper_arm", "forearm", "head"):
        k = next(i for i, name in enumerate(SEGMENTS) if name.endswith(part_of))
        torch.testing.assert_close(long.centres[k], plain.centres[k])


def test_shoes_lift_the_body_and_leave_the_toes_at_the_ground() -> None:
    own = plain_problem().character.skeleton
    bare, shod = full_skeleton(own), full_skeleton(own, 0.03)
    torch.testing.assert_close(bare.offsets[bare.index("pelvis")], own.offsets[own.index("pelvis")])
    lifted = shod.offsets - bare.offsets
    assert float(lifted[shod.index("pelvis"), 1]) == pytest.approx(0.03)
    # The balls of the feet stay at the soles.
    moved = {name for name, row in zip(shod.names, lifted, strict=True) if float(row.abs().max()) > 1e-12}
    assert moved == {"pelvis", "left_toe", "right_toe"}
