"""What names of joints tell, whoever gave them: the side of the body, and the part."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping

SIDES = ("left", "right")
# What follows an l or r that means a side, as in lfemur, RThigh, LHipJoint; L5 and LowerBack lie in the middle.
_LIMBS = (
    "hip|thigh|femur|up|leg|low|knee|shin|calf|tibia|ankle|foot|heel|ball|toe|clav|coll|scap|should|shldr|arm|fore"
    "|humer|elbow|radi|ulna|wrist|hand|palm|finger|thumb|index|mid|ring|pink|butt|eye"
)
_MARKS = (
    re.compile(r"(left|(?<!up)right)", re.IGNORECASE),
    re.compile("([左右])"),  # MikuMikuDance: 左足
    re.compile(r"(?:^|[^a-z0-9])([lr])(?:[^a-z0-9]|$)", re.IGNORECASE),  # hip_l, Bip01 L Thigh
    re.compile(rf"(?:^|[^a-z])([lr])(?={_LIMBS})", re.IGNORECASE),
    re.compile(r"[a-z]([LR])(?:[^A-Za-z]|$)"),  # handL
    re.compile(r"(?:^|[^A-Za-z])([LRlr])(?=[A-Z][a-z])"),  # lEar, RPocket
)
# What programs put before all names of a skeleton, and behind those of joints that carry the skin.
_BEFORE = (
    *("mixamorig", "valve", "bip", "biped", "character", "skeleton", "human", "cc", "base", "j", "jnt", "joint"),
    *("b", "bn", "c", "def", "org", "sk"),
)
_BEHIND = ("bend", "stretch", "jnt", "jt", "bone", "bn")
# What joints are called, without the side, letters only; a joint is named after the bone that hangs on it or after
# itself. Of several words the first counts more. The last in a row, in Japanese, are those of MikuMikuDance; of two
# chains, the one with a D carries the skin.
WORDS: Mapping[str, tuple[str, ...]] = {
    "hip": ("upleg", "upperleg", "legupper", "thigh", "hip", "femur", "足d", "足", "leg"),
    "knee": ("leg", "lowleg", "lowerleg", "leglower", "loleg", "calf", "shin", "knee", "tibia", "ひざd", "ひざ", "膝"),
    "ankle": ("ankle", "foot", "足首d", "足首"),
    "toe": ("toe", "toes", "toebase", "ball", "足先ex", "つま先"),
    "collar": ("clavicle", "collar", "collarbone", "shoulder", "scapula", "肩"),
    "shoulder": ("arm", "upperarm", "uparm", "armupper", "humerus", "shoulder", "shldr", "shld", "腕"),
    "elbow": ("forearm", "lowerarm", "lowarm", "armlower", "loarm", "elbow", "radius", "ひじ", "肘"),
    "wrist": ("hand", "wrist", "手首", "palm", "fist"),
    "pelvis": ("hips", "pelvis", "hip", "腰", "センター"),
    "neck": ("neck", "necktwist", "necklower", "首"),
    "head": ("head", "skull", "頭"),
}
# Words of joints that help others to move, hold things, or end a chain: none of them is a part of a body. Some copy the
# parts' own: they are taken where there is nothing else.
_HELP = (
    *("twist", "roll", "ik", "fk", "pole", "target", "ctrl", "control", "null", "helper"),
    *("corrective", "prop", "weapon", "socket", "attachment", "dummy", "sec", "effector", "mch", "tweak"),
)
_COPY = ("org",)
# What a name that is split by colons may begin with.
_PIECES = frozenset(("leg", "arm", "foot", "hand", "left", "right", "upper", "lower", "spine", "body", "head", "neck"))
_END = ("nub", "end", "leaf")
# What names have in them that may be of a part, also of its ends and of what lies in it.
_LIKE = {
    "head": re.compile(r"head|skull", re.IGNORECASE),
    "neck": re.compile(r"neck", re.IGNORECASE),
    "face": re.compile(r"jaw|eye|brow|nose|lip|mouth|tongue|chin|hair", re.IGNORECASE),
    "foot": re.compile(r"foot|feet|toe|ankle", re.IGNORECASE),
    "finger": re.compile(r"finger(?!base)|thumb|index|pink(y|ie)|(middle|mid|ring|little)(?![a-z])", re.IGNORECASE),
}


def side_of(name: str) -> str:
    """ "left" or "right" as a joint's name says in any of the usual ways, otherwise "middle"."""
    side, _ = _split(_bare(name))
    return side or "middle"


def plain_name(name: str) -> tuple[str | None, str]:
    """Side and bare word of a joint's name: ("left", "upleg") of "mixamorig:LeftUpLeg"."""
    side, rest = _split(_bare(name))
    parts = _words(rest)
    while len(parts) > 1 and parts[0] in _BEFORE:
        parts = parts[1:]
    while len(parts) > 1 and parts[-1] in _BEHIND:
        parts = parts[:-1]
    return side, "".join(parts)


def is_helper(name: str) -> bool:
    """Whether a name has a word of joints that are no part of a body, such as those that share a twist."""
    return not set(_HELP + _END).isdisjoint(_words(_split(_bare(name))[1]))


def is_end(name: str) -> bool:
    """Whether a name has a word of joints that mark where a bone ends."""
    return not set(_END).isdisjoint(_words(_split(_bare(name))[1]))


def is_copy(name: str) -> bool:
    """Whether a joint copies the one that carries the skin, as its name says."""
    return not set(_COPY).isdisjoint(_words(_split(_bare(name))[1])[:1])


def is_like(part: str, name: str) -> bool:
    """Whether a name has a word of a part in it: head, neck, face, foot or finger."""
    return _LIKE[part].search(name) is not None


def named(names: tuple[str, ...], part: str, side: str | None = None) -> list[int]:
    """Numbers of the names of a part, better words first. side: None for parts in the middle."""
    plain = [plain_name(name) for name in names]
    found = [
        (WORDS[part].index(word), at) for at, (own, word) in enumerate(plain) if own == side and word in WORDS[part]
    ]
    return [at for _, at in sorted(found)]


def _bare(name: str) -> str:
    """Without the names of skeletons before it, and with letters of half and full width alike."""
    pieces = unicodedata.normalize("NFKC", name).split(":")
    # Leg:Left:Upper is a name in three pieces, and no Upper of a skeleton called Leg.
    own = next((k for k, piece in enumerate(pieces) if not _PIECES.isdisjoint(_words(piece))), len(pieces) - 1)
    return "_".join(pieces[own:])


def _words(name: str) -> list[str]:
    """In small letters: ["upper", "arm"] of "UpperArm_01"."""
    apart = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)
    return [word.lower() for word in re.split(r"[\W\d_]+", apart) if word]


def _split(name: str) -> tuple[str | None, str]:
    """Side, and the name without what tells it."""
    for mark in _MARKS:
        if found := mark.search(name):
            start, end = found.span(1)
            return ("left" if found[1][0] in "lL左" else "right"), f"{name[:start]}_{name[end:]}"
    return None, name
