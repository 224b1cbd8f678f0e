"""One walk as many programs, and people, write it down."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.io.bvh_files import simple_positions
from tests.people import clip_of

Floats = NDArray[np.float64]
FRAMES, STEP = 36, 4  # of the walk, every so many of its frames
ARMS = [f"{side}{part}" for side in ("Left", "Right") for part in ("Arm", "ForeArm", "Hand")]
TOES = ("LeftToeBase", "RightToeBase")
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # x, y, z as they are to x, y, z with z up
OURS = ("Hips", "Spine", "Spine1", "Neck", "Head", "UpLeg", "Leg", "Foot", "ToeBase", "Arm", "ForeArm", "Hand")


def words(text: str) -> dict[str, str]:
    """What others call our joints."""
    return dict(zip(OURS, text.split(", "), strict=True))


MAX = words(
    "Bip01, Bip01 Spine, Bip01 Spine1, Bip01 Neck, Bip01 Head, Thigh, Calf, Foot, Toe0, UpperArm, Forearm, Hand"
)
POSER = words("hip, abdomen, chest, neck, head, Thigh, Shin, Foot, Toe, Shldr, ForeArm, Hand")
ENGINE = words("pelvis, spine_01, spine_02, neck_01, head, thigh, calf, foot, ball, upperarm, lowerarm, hand")


@dataclass(frozen=True)
class Written:
    """data: the file. plain: text with the same columns of numbers that a simple reader takes. unit: metres in one of
    it. up: its axis. hips: number of the joint that is the hips. frames: how many. notes: whether there are any."""

    data: bytes
    plain: str
    unit: float = 0.01
    up: str = "y"
    hips: int = 0
    frames: int = FRAMES
    notes: bool = False

    def positions(self, rows: Sequence[str] | None = None) -> Floats:
        """(T, J, 3) of all joints from the hips on [m], y up. rows: in place of the file's own."""
        text = self.plain
        if rows is not None:
            text = "\n".join([text[: text.index("Frames:")].rstrip(), f"Frames: {len(rows)}", "Frame Time: 1", *rows])
        found = self.unit * simple_positions(text)[1][:, self.hips :]
        return found @ Z_UP if self.up == "z" else found


def told(names: dict[str, str], put: Callable[[str, str], str]) -> Callable[[str], str]:
    """Names by those of ours. put: side as l or r and the word, together."""

    def name(own: str) -> str:
        for side in ("Left", "Right"):
            if own.startswith(side):
                return put(side[0].lower(), names[own.removeprefix(side)])
        return names[own]

    return name


def written(
    order: str = "ZYX",
    unit: float = 0.01,
    up: str = "y",
    six: bool = False,
    call: Callable[[str], str] = lambda own: own,
    without: Sequence[str] = (),
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rest_first: bool = False,
    ends: int = 1,
    frame_time: str = "0.0333333",
    grown: float = 1.0,
) -> str:
    """The walk as text. six: position channels on every joint. offset: of the root. rest_first: a frame 0 in T pose.
    ends: end sites of each last joint. grown: size of the body."""
    clip = clip_of("walk")
    skeleton = clip.skeleton
    axes = Z_UP.T if up == "z" else np.eye(3)
    rotations = axes.T @ clip.rotations[::STEP][:FRAMES].numpy() @ axes
    root = grown * clip.root_position[::STEP][:FRAMES].numpy() @ axes / unit
    offsets = grown * skeleton.offsets.numpy() @ axes / unit
    if rest_first:
        rotations, root = rotations.copy(), root.copy()
        rotations[0] = np.eye(3)
    kept = [joint for joint, name in enumerate(skeleton.names) if name not in without]
    lines, columns = ["HIERARCHY"], []

    def block(joint: int, depth: int) -> None:
        pad, name = "  " * depth, skeleton.names[joint]
        place = offset if joint == 0 else offsets[joint]
        places = "Xposition Yposition Zposition "
        own = places if joint == 0 or six else ""
        turns = " ".join(f"{axis}rotation" for axis in order)
        lines.append(f"{pad}{'JOINT' if joint else 'ROOT'} {call(name)}")
        lines.append(pad + "{")
        lines.append(f"{pad}  OFFSET {' '.join(f'{value:.6f}' for value in place)}")
        lines.append(f"{pad}  CHANNELS {len((own + turns).split())} {own}{turns}")
        if own:
            columns.append(root if joint == 0 else np.tile(offsets[joint], (FRAMES, 1)))
        columns.append(Rotation.from_matrix(rotations[:, joint]).as_euler(order, degrees=True))
        children = [child for child in skeleton.children(joint) if child in kept]
        for child in children:
            block(child, depth + 1)
        for k in range(0 if children else ends):
            end = (skeleton.end_sites[name].numpy() if name in skeleton.end_sites else np.zeros(3)) @ axes
            place = (1.0 + k) * grown * end / unit
            lines.extend([f"{pad}  End Site", pad + "  {"])
            lines.extend([f"{pad}    OFFSET {' '.join(f'{value:.6f}' for value in place)}", pad + "  }"])
        lines.append(pad + "}")

    block(0, 0)
    table = [" ".join(f"{value:.6f}" for value in row) for row in np.concatenate(columns, axis=1)]
    return "\n".join([*lines, "MOTION", f"Frames: {FRAMES}", f"Frame Time: {frame_time}", *table, ""])


def below(text: str, *above: tuple[str, str, str]) -> str:
    """The walk below more joints: of each name, channels, and its numbers in every frame."""
    lines = text.splitlines()
    start = lines.index("MOTION")
    head = ["HIERARCHY"]
    for k, (name, channels, _) in enumerate(above):
        count = len(channels.split())
        head += [f"{'JOINT' if k else 'ROOT'} {name}", "{", "OFFSET 0 0 0", f"CHANNELS {count} {channels}".rstrip()]
    body = [lines[1].replace("ROOT", "JOINT"), *lines[2:start], *["}"] * len(above)]
    numbers = " ".join(values for *_, values in above)
    return "\n".join([*head, *body, *lines[start : start + 3], *(f"{numbers} {row}" for row in lines[start + 3 :]), ""])


def way_apart(text: str) -> str:
    """The walk with its way on a root and its turn on the hips below."""
    lines = text.splitlines()
    start = lines.index("MOTION")
    head = ["HIERARCHY", "ROOT Trajectory", "{", "OFFSET 0 0 0", "CHANNELS 3 Xposition Yposition Zposition"]
    hips = ["JOINT Hips", "{", "OFFSET 0 0 0", "CHANNELS 3 Zrotation Yrotation Xrotation"]
    return "\n".join([*head, *hips, *lines[5:start], "}", *lines[start:], ""])


PLACES, TURNS = "Xposition Yposition Zposition", "Zrotation Xrotation Yrotation"
PLAIN = written()
HEAD, _, TABLE = PLAIN.partition("Frame Time: 0.0333333\n")
ROWS = TABLE.splitlines()


def other(change: Callable[[str], str | bytes], **more: object) -> Written:
    """The plain file, changed, that says the same."""
    data = change(PLAIN)
    return Written(data if isinstance(data, bytes) else data.encode(), PLAIN, **more)  # type: ignore[arg-type]


def same(text: str, **more: object) -> Written:
    """A file that a simple reader takes as it is."""
    return Written(text.encode(), text, **more)  # type: ignore[arg-type]


def channels(change: Callable[[str], str]) -> Callable[[str], str]:
    return lambda text: re.sub(r"[XYZ](?:position|rotation)", lambda found: change(found.group()), text)


def glued(text: str) -> str:
    """Blanks before some negative numbers lost, as by fields of a fixed width."""
    head, _, table = text.partition("Frame Time: 0.0333333\n")
    rows = table.splitlines()
    rows[3] = re.sub(r" (-\d)", r"\1", rows[3], count=2)
    return head + "Frame Time: 0.0333333\n" + "\n".join(rows) + "\n"


def commented(text: str) -> str:
    return "# somebody's walk\n" + text.replace("MOTION\n", "// from here on numbers\nMOTION\n")


WRITINGS: dict[str, Written] = {
    "plain": same(PLAIN),
    "capital channels": other(channels(str.upper)),
    "small channels": other(channels(str.lower)),
    "short channels": other(lambda text: text.replace("position", "pos").replace("rotation", "rot")),
    "small keywords": other(lambda t: re.sub(r"\b(HIERARCHY|ROOT|JOINT|OFFSET|CHANNELS)\b", lambda m: m[0].lower(), t)),
    "CRLF": other(lambda text: text.replace("\n", "\r\n")),
    "CR": other(lambda text: text.replace("\n", "\r")),
    "tabs": other(lambda text: text.replace("  ", "\t")),
    "trailing blanks": other(lambda text: text.replace("\n", " \n")),
    "blank lines": other(lambda text: text.replace("}\n", "}\n\n")),
    "no line end": other(lambda text: text.rstrip("\n")),
    "byte order mark": other(lambda text: b"\xef\xbb\xbf" + text.encode()),
    "UTF-16": other(lambda text: text.encode("utf-16")),
    "old code page": other(lambda text: text.replace("Spine1", "R\u00fccken").encode("latin-1")),
    "comments": other(commented),
    "named end sites": other(lambda text: text.replace("End Site", "End Site Tip")),
    "end sites in a word": other(lambda text: text.replace("End Site", "EndSite")),
    "braces on the line": other(lambda text: re.sub(r"\n *\{", " {", text)),
    "odd frame lines": other(
        lambda t: t.replace("Frames: ", "Frames:\t").replace("Time: 0.0333333", "Time:   .0333333")
    ),
    "powers of ten": other(lambda t: re.sub(r"OFFSET ([-\d.]+)", lambda m: f"OFFSET {float(m[1]):.8e}", t)),
    "numbers over lines": other(lambda text: HEAD + "Frame Time: 0.0333333\n" + TABLE.replace(" ", "\n")),
    "a blank lacks": other(glued, notes=True),
    "one frame more": other(lambda text: text.replace(f"Frames: {FRAMES}", f"Frames: {FRAMES - 1}"), notes=True),
    "one frame fewer": other(lambda text: text.replace(f"Frames: {FRAMES}", f"Frames: {FRAMES + 1}"), notes=True),
    **{f"order {order}": same(written(order)) for order in ("XYZ", "XZY", "YXZ", "YZX", "ZXY")},
    "six channels everywhere": same(written(six=True)),
    "a root with an offset": same(written(offset=(3.0, 90.0, -4.0))),
    "several end sites": same(written(ends=3)),
    "no toes": same(written(without=TOES)),
    "no head": same(written(without=("Neck", "Head"))),
    "no arms": same(written(without=ARMS)),
    "a first frame in T pose": same(written(rest_first=True)),
    "24 frames a second": same(written(frame_time="0.0416667")),
    "120 frames a second": same(written(frame_time="0.008333")),
    "metres": same(written(unit=1.0), unit=1.0),
    "millimetres": same(written(unit=0.001), unit=0.001),
    "inches": same(written(unit=0.0254), unit=0.0254),
    "units of Carnegie Mellon": same(written(unit=0.0254 / 0.45), unit=0.0254 / 0.45),
    "z up": same(written(up="z"), up="z"),
    "z up in metres": same(written(up="z", unit=1.0), up="z", unit=1.0),
    "a child with z up": same(written(up="z", grown=0.66), up="z"),
    "a root that stands still": same(below(PLAIN, ("Root", f"{PLACES} {TURNS}", "0 0 0 0 0 0")), hips=1, notes=True),
    "a root without channels": same(below(PLAIN, ("Armature", "", "")), hips=1, notes=True),
    "three joints above": same(
        below(PLAIN, ("World", "", ""), ("Reference", f"{PLACES} {TURNS}", "0 0 0 0 0 0"), ("Offset", TURNS, "0 0 0")),
        hips=3,
        notes=True,
    ),
    "way and turn apart": same(way_apart(PLAIN), hips=1, notes=True),
    "names of Mixamo": other(lambda text: re.sub(r"(ROOT|JOINT) ", r"\1 mixamorig:", text)),
    "names of 3ds Max": same(written(call=told(MAX, lambda side, word: f"Bip01 {side.upper()} {word}"))),
    "names of Poser": same(written(call=told(POSER, lambda side, word: side + word))),
    "names of game engines": same(written(call=told(ENGINE, lambda side, word: f"{word}_{side}"))),
    "names that say nothing": same(
        written(call=lambda own: f"J{sum(ord(letter) * (k + 1) for k, letter in enumerate(own))}")
    ),
    "joints called End": same(written(call=lambda own: {"Head": "End", "LeftHand": "EndSite1"}.get(own, own))),
    "one name for many": same(written(call=lambda own: "Twist" if own in ("Spine", "Neck", "Head") else own)),
}

REFUSED: dict[str, tuple[str | bytes, str]] = {
    "two frames more": (PLAIN.replace(f"Frames: {FRAMES}", f"Frames: {FRAMES - 2}"), "says that it has 34 frames, but"),
    "cut off": (PLAIN[:-60], "numbers stand here, but a frame has"),
    "cut off in its head": (PLAIN[:900], "the file ends"),
    "no numbers": (HEAD + "Frame Time: 0.0333333\n", "says that it has 36 frames, but holds 0"),
    "two bodies": (PLAIN.replace("MOTION", "ROOT Other\n{\nOFFSET 0 0 0\n}\nMOTION", 1), "a second ROOT begins"),
    "commas in numbers": (PLAIN.replace(".", ","), "is not a number"),
    "not a number": (PLAIN.replace(ROWS[2].split()[4], "nan", 1), "'nan' is not a number"),
    "a missing number": (PLAIN.replace(ROWS[2], ROWS[2].rpartition(" ")[0], 1), "numbers stand here, but a frame has"),
    "channels that there are not": (PLAIN.replace("Xposition", "Xscale", 1), "'Xscale' is no channel"),
    "a packed file": (b"\x1f\x8b\x08\x00" + PLAIN.encode(), "this is binary data, not a BVH file"),
    "another format": ("Kaydara FBX Binary  \n" + PLAIN, "this is not a BVH file"),
    "nothing": ("", "the file is empty"),
}
