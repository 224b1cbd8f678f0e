from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hopdiff.export.body.loft import Surface
from hopdiff.export.body_mesh import body_mesh
from hopdiff.export.pose import root_height, with_rest_pose
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.whole_body.skeleton import full_skeleton
from tests.builders import make_character
from tests.export.rigs import skeleton as rig
from tests.export.takes import WALKS, own, walked

Floats = NDArray[np.float64]
MOST_TRIANGLES = 6000
# How far runners bend, in degrees about the left axis of a body that faces +z: heel up, knee up, elbow bent.
BENT = {
    "swing": {"left_hip": -100.0, "left_knee": 120.0, "left_ankle": 30.0, "right_hip": 30.0, "right_toe": -45.0},
    "arms": {"left_elbow": -110.0, "right_elbow": -60.0, "left_shoulder": 70.0, "right_shoulder": -60.0},
    "recovery": {"left_hip": -20.0, "left_knee": 120.0, "left_toe": -30.0, "right_ankle": -25.0, "neck": 20.0},
    "lean": {"waist": 25.0, "chest": 10.0, "left_hip": -60.0, "right_hip": 20.0, "right_wrist": 30.0},
}


def volume(surface: Surface) -> float:
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


def closed(surface: Surface) -> bool:
    """Whether every edge has a neighbour that runs the other way."""
    edges = np.concatenate([surface.faces[:, [k, (k + 1) % 3]] for k in range(3)])
    there = {tuple(edge) for edge in edges.tolist()}
    return all((b, a) in there for a, b in there) and len(there) == len(edges)


def places_of(skeleton: Skeleton, rotations: Floats | None = None) -> tuple[Floats, Floats]:
    """(J, 3) joints and (J, 3, 3) frames of a pose, the root at the origin."""
    turns = np.tile(np.eye(3), (len(skeleton.names), 1, 1)) if rotations is None else rotations
    places, frames = skeleton.forward(torch.zeros(1, 3).double(), torch.from_numpy(turns)[None])
    return places[0].numpy(), frames[0].numpy()


def skinned(skeleton: Skeleton, surface: Surface, degrees: dict[str, float]) -> Floats:
    """(V, 3) vertices in a pose, as every program moves them."""
    rotations = np.tile(np.eye(3), (len(skeleton.names), 1, 1))
    for name, angle in degrees.items():
        rotations[skeleton.index(name)] = Rotation.from_euler("x", angle, degrees=True).as_matrix()
    rest, _ = places_of(skeleton)
    places, frames = places_of(skeleton, rotations)
    found = np.zeros_like(surface.vertices)
    for k in range(4):
        joint = surface.joints[:, k]
        turned = np.einsum("vij,vj->vi", frames[joint], surface.vertices - rest[joint]) + places[joint]
        found += surface.weights[:, k : k + 1] * turned
    return found


def inside(points: Floats, vertices: Floats, faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether points are inside any of some closed surfaces: by the angle under which these are seen (van Oosterom and
    Strackee, 1983)."""
    angle = np.zeros(len(points))
    for face in vertices[faces]:
        a, b, c = (corner - points for corner in face)
        la, lb, lc = (np.linalg.norm(one, axis=-1) for one in (a, b, c))
        under = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
        angle += 2.0 * np.arctan2((a * np.cross(b, c)).sum(-1), under)
    return angle > 2.0 * np.pi


def character_of(name: str) -> tuple[Skeleton, dict[str, float]]:
    body = make_character(name)
    masses = dict(zip(body.skeleton.names, body.masses.tolist(), strict=True))
    return full_skeleton(body.skeleton, body.shoe), masses


def whole(surfaces: dict[str, Surface]) -> Surface:
    starts = np.cumsum([0, *(len(one.vertices) for one in surfaces.values())])
    parts = surfaces.values()
    return Surface(
        np.concatenate([one.vertices for one in parts]),
        np.concatenate([one.normals for one in parts]),
        np.concatenate([one.faces + start for one, start in zip(parts, starts, strict=False)]),
        np.concatenate([one.joints for one in parts]),
        np.concatenate([one.weights for one in parts]),
    )


def followers(skeleton: Skeleton, surface: Surface, name: str, least: float = 0.9) -> Floats:
    """(N, 3) vertices that follow a joint."""
    share = np.where(surface.joints == skeleton.index(name), surface.weights, 0.0).sum(axis=-1)
    found: Floats = surface.vertices[share > least]
    return found


SKELETONS = [f"own {pose}" for pose in ("straight", "a", "t")] + ["eleven", "mixamo", *WALKS]


def skeleton_of(name: str) -> Skeleton:
    if name in WALKS:
        return walked(name).clip.skeleton
    if name == "eleven":
        return own().clip.skeleton
    return rig(name) if name == "mixamo" else rig("hopdiff", name.split()[1])


@pytest.mark.parametrize("name", SKELETONS)
def test_bodies_are_closed_small_and_bound_to_near_joints(name: str) -> None:
    skeleton = skeleton_of(name)
    surfaces = body_mesh(skeleton)
    assert set(surfaces) == {"left", "right", "middle"}
    assert all(closed(one) for one in surfaces.values())
    one = whole(surfaces)
    assert len(one.faces) < MOST_TRIANGLES
    assert one.weights.shape[1] == one.joints.shape[1] == 4
    assert bool((one.weights >= 0.0).all())
    np.testing.assert_allclose(one.weights.sum(axis=-1), 1.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(one.normals, axis=-1), 1.0, atol=1e-6)
    # Every vertex is near the bones of the joints that it follows.
    rest, _ = places_of(skeleton)
    size = float(np.ptp(rest[:, 1]))
    for k in range(4):
        for joint in np.unique(one.joints[one.weights[:, k] > 0.0, k]):
            ends = [rest[child] for child in skeleton.children(joint)]
            if (site := skeleton.end_sites.get(skeleton.names[joint])) is not None:
                ends.append(rest[joint] + site.double().numpy())
            points = one.vertices[(one.joints[:, k] == joint) & (one.weights[:, k] > 0.0)]
            away = np.linalg.norm(points - rest[joint], axis=-1)
            for end in ends:
                way = end - rest[joint]
                share = ((points - rest[joint]) @ way / max(float(way @ way), 1e-9)).clip(0.0, 1.0)
                away = np.minimum(away, np.linalg.norm(points - rest[joint] - share[:, None] * way, axis=-1))
            assert away.max() < 0.2 * size, skeleton.names[joint]


@pytest.mark.parametrize("name", ["human", "child", "cartoon"])
def test_bodies_weigh_what_they_should_and_mirror_themselves(name: str) -> None:
    skeleton, masses = character_of(name)
    surfaces = body_mesh(skeleton, masses)
    # Parts reach into each other, so that together they hold a little more than the body. The cartoon's head is hollow,
    # and its feet are large.
    limbs = sum(mass for part, mass in masses.items() if part.startswith(("left", "right")))
    assert 1000.0 * (volume(surfaces["left"]) + volume(surfaces["right"])) == pytest.approx(limbs, rel=0.25)
    if name != "cartoon":
        assert 1000.0 * sum(volume(one) for one in surfaces.values()) == pytest.approx(sum(masses.values()), rel=0.2)
    left, right = surfaces["left"], surfaces["right"]
    flip = np.array([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(left.vertices, right.vertices * flip, atol=1e-9)
    np.testing.assert_allclose(left.normals, right.normals * flip, atol=1e-6)
    np.testing.assert_allclose(left.weights, right.weights, atol=1e-9)
    assert bool((left.vertices[:, 0] > 0.0).all())
    middle = surfaces["middle"].vertices
    for points in (middle, middle * flip):
        np.testing.assert_allclose(points.max(axis=0), middle.max(axis=0), atol=1e-9)


def test_heavier_bodies_are_thicker() -> None:
    skeleton, _ = character_of("human")
    names = make_character().skeleton.names
    thin, thick = (body_mesh(skeleton, dict.fromkeys(names, mass)) for mass in (3.0, 6.0))
    for side in ("left", "middle"):
        assert abs(volume(thick[side])) > 1.2 * abs(volume(thin[side]))


@pytest.mark.parametrize("pose", BENT)
@pytest.mark.parametrize("name", ["human", "child", "cartoon"])
def test_skin_does_not_tear_where_runners_bend(name: str, pose: str) -> None:
    skeleton, masses = character_of(name)
    for side, surface in body_mesh(skeleton, masses).items():
        posed = skinned(skeleton, surface, BENT[pose])
        edges = np.unique(
            np.sort(np.concatenate([surface.faces[:, [k, (k + 1) % 3]] for k in range(3)]), axis=-1), axis=0
        )
        was, now = (
            np.linalg.norm(np.diff(points[edges], axis=1)[:, 0], axis=-1) for points in (surface.vertices, posed)
        )
        assert (now / was).max() < 2.0, side


@pytest.mark.parametrize(("joint", "degrees"), [("left_knee", 120.0), ("left_elbow", -110.0), ("left_hip", -100.0)])
def test_bent_joints_keep_their_volume(joint: str, degrees: float) -> None:
    skeleton, masses = character_of("human")
    surface = whole(body_mesh(skeleton, masses))
    rest, _ = places_of(skeleton)
    centre = rest[skeleton.index(joint)]
    thick = {"left_knee": 0.055, "left_elbow": 0.036, "left_hip": 0.09}[joint]
    grid = np.linspace(-thick, thick, 11)
    points = np.stack(np.meshgrid(grid, grid, grid), axis=-1).reshape(-1, 3)
    points = points[np.linalg.norm(points, axis=-1) < thick] + centre
    before = inside(points, surface.vertices, surface.faces).sum()
    # Joints above it are straight, so that its place stays.
    bent = skinned(skeleton, surface, {joint: degrees})
    assert before > 0.8 * len(points)
    assert inside(points, bent, surface.faces).sum() > 0.7 * before
    # And in the half that looks away from what it folds, where skin would sink in.
    fold = np.array([0.0, 1.0, 0.0]) + Rotation.from_euler("x", degrees, degrees=True).apply([0.0, -1.0, 0.0])
    outer = points[(points - centre) @ fold < -0.35 * thick * np.linalg.norm(fold)]
    assert inside(outer, bent, surface.faces).sum() > 0.7 * inside(outer, surface.vertices, surface.faces).sum()


@pytest.mark.parametrize("name", ["human", "child", "cartoon"])
def test_bodies_face_ahead_and_stand_on_their_soles(name: str) -> None:
    skeleton, masses = character_of(name)
    surfaces = body_mesh(skeleton, masses)
    rest, _ = places_of(skeleton)
    # The nose is what stands out most of the face, in the middle, below the brow and above the mouth.
    face = followers(skeleton, surfaces["middle"], "head")
    nose = face[face[:, 2].argmax()]
    chin, crown = face[:, 1].min(), face[:, 1].max()
    assert nose[2] > rest[skeleton.index("head"), 2] + 0.4 * (crown - chin)
    assert abs(nose[0]) < 0.01
    assert 0.2 < (nose[1] - chin) / (crown - chin) < 0.45
    # Ears stand out on both sides.
    assert np.abs(face[np.abs(face[:, 1] - nose[1]) < 0.1 * (crown - chin), 0]).max() > 0.3 * (crown - chin)
    for side in ("left", "right"):
        ankle, toe = (rest[skeleton.index(f"{side}_{part}")] for part in ("ankle", "toe"))
        toes = followers(skeleton, surfaces[side], f"{side}_toe")
        heel = followers(skeleton, surfaces[side], f"{side}_ankle")
        assert toes[:, 2].min() > ankle[2]
        assert toes[:, 2].max() > toe[2] + 0.02
        assert heel[:, 2].min() < ankle[2] - 0.02
        # Heel and ball on the ground, the arch above it.
        ground = -root_height(skeleton)
        for points in (toes, heel):
            assert points[:, 1].min() == pytest.approx(ground, abs=1e-4)
        low = surfaces[side].vertices[np.abs(surfaces[side].vertices[:, 2] - 0.5 * (ankle[2] + toe[2])) < 0.02]
        assert low[:, 1].min() > ground + 1e-3


def test_children_and_cartoons_look_like_some() -> None:
    sizes = {}
    for name in ("human", "child", "cartoon"):
        skeleton, masses = character_of(name)
        surfaces = body_mesh(skeleton, masses)
        rest, _ = places_of(skeleton)
        head = followers(skeleton, surfaces["middle"], "head")
        height = head[:, 1].max() + root_height(skeleton)
        leg = rest[skeleton.index("left_hip"), 1] + root_height(skeleton)
        foot = np.ptp(
            np.concatenate([followers(skeleton, surfaces["left"], f"left_{k}")[:, 2] for k in ("ankle", "toe")])
        )
        hand = np.ptp(followers(skeleton, surfaces["left"], "left_wrist")[:, 1])
        sizes[name] = np.ptp(head[:, 1]) / height, np.ptp(head[:, 0]) / height, foot / leg, hand / height
    human, child, cartoon = (np.array(sizes[name]) for name in ("human", "child", "cartoon"))
    assert human[0] == pytest.approx(0.13, abs=0.01)  # Drillis and Contini (1966): chin to crown, in body heights
    assert 1.2 < child[0] / human[0] < 1.6
    assert cartoon[0] > 2.0 * human[0]
    assert cartoon[1] > 2.0 * human[1]
    assert cartoon[2] > 1.1 * human[2]
    assert cartoon[3] > 1.2 * human[3]


def test_arms_in_any_rest_pose_have_the_same_shape() -> None:
    """Palms look down and thumbs ahead where arms are raised; where they hang palms look at the thighs."""
    hanging = with_rest_pose(own(), "straight").clip.skeleton
    raised = with_rest_pose(own(), "t").clip.skeleton
    down, up = (body_mesh(skeleton, own().masses)["left"] for skeleton in (hanging, raised))
    elbow = hanging.index("left_elbow")
    quarter = Rotation.from_euler("z", 90.0, degrees=True)
    for skeleton, surface, turned in ((hanging, down, quarter), (raised, up, Rotation.identity())):
        rest, _ = places_of(skeleton)
        arm = surface.vertices[(surface.joints[:, 0] == elbow) & (surface.weights[:, 0] > 0.99)]
        found = turned.apply(arm - rest[elbow])
        if skeleton is hanging:
            first = found
    np.testing.assert_allclose(first, found, atol=1e-6)


@pytest.mark.parametrize("name", WALKS)
def test_people_have_one_around_their_bones(name: str) -> None:
    skeleton = walked(name).clip.skeleton
    surfaces = body_mesh(skeleton)
    places, _ = places_of(skeleton)
    points = np.concatenate([one.vertices for one in surfaces.values()])
    for axis in range(3):
        assert points[:, axis].min() < places[:, axis].min() + 0.03
        assert points[:, axis].max() > places[:, axis].max() - 0.03
    height = np.ptp(points[:, 1])
    assert 1.3 < height < 2.1
    # A body, not a balloon.
    assert 25.0 < 1000.0 * sum(volume(one) for one in surfaces.values()) < 130.0


def test_skeletons_that_are_no_body_get_plain_bones() -> None:
    chain = Skeleton(
        ("a", "b", "c"),
        (-1, 0, 1),
        torch.tensor([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.5]]).double(),
        {"c": torch.tensor([0.0, 0.5, 0.0]).double()},
    )
    surfaces = body_mesh(chain)
    assert list(surfaces) == ["middle"]
    assert set(surfaces["middle"].joints[:, 0].tolist()) == {0, 1, 2}


def folded(skeleton: Skeleton, kind: str) -> Skeleton:
    """A skeleton whose bones lie so that some direction or length of its body is not there."""
    offsets, names = skeleton.offsets.clone().double(), skeleton.names
    match kind:
        case "ankle at the knee":
            for side in ("left", "right"):
                offsets[names.index(f"{side}_ankle")] = 0.0
        case "ankle nearly at the knee":
            for side in ("left", "right"):
                offsets[names.index(f"{side}_ankle")] *= 1e-5
        case "forearm back":
            for side in ("left", "right"):
                offsets[names.index(f"{side}_wrist")] = -0.7 * offsets[names.index(f"{side}_elbow")]
        case "shank back":
            for side in ("left", "right"):
                offsets[names.index(f"{side}_ankle")] = -0.9 * offsets[names.index(f"{side}_knee")]
        case "along x" | "along y" | "along z":
            axis = "xyz".index(kind[-1])
            length = offsets.norm(dim=-1)
            offsets = torch.zeros_like(offsets)
            offsets[:, axis] = length
        case "in one point":
            offsets = torch.zeros_like(offsets)
        case "hips together":
            for side in ("left", "right"):
                offsets[names.index(f"{side}_hip")] = 0.0
        case "shoulders together":
            for side in ("left", "right"):
                for part in ("collar", "shoulder"):
                    if f"{side}_{part}" in names:
                        offsets[names.index(f"{side}_{part}")] = 0.0
        case "flat":
            offsets[:, 1] = 0.0
        case "thin":
            offsets[:, 0] = 0.0
    return Skeleton(names, skeleton.parents, offsets, skeleton.end_sites if kind != "in one point" else {})


HEAPS = ["ankle at the knee", "ankle nearly at the knee", "forearm back", "shank back", "along x", "along y", "along z"]
HEAPS += ["in one point", "hips together", "shoulders together", "flat", "thin"]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", HEAPS)
@pytest.mark.parametrize("ends", [True, False])
def test_heaps_of_bones_get_finite_bodies_or_none(kind: str, ends: bool) -> None:
    human, masses = character_of("human")
    for known in (masses, None):
        skeleton = folded(human, kind)
        if not ends:
            skeleton = Skeleton(skeleton.names, skeleton.parents, skeleton.offsets, {})
        for side, surface in body_mesh(skeleton, known).items():
            assert bool(np.isfinite(surface.vertices).all()), side
            assert bool(np.isfinite(surface.normals).all()), side
            assert bool((surface.weights >= 0.0).all()), side
            np.testing.assert_allclose(surface.weights.sum(axis=-1), 1.0, atol=1e-9, err_msg=side)
            assert float(np.abs(surface.vertices).max()) < 100.0, side
