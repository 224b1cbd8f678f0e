"""BVH files made by hand, and a reader as small as can be that knows nothing of hopdiff's."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

PLAIN = """\
HIERARCHY
ROOT Hips
{
  OFFSET 0.0000 0.0000 0.0000
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT LeftLeg
  {
    OFFSET 9.5000 -4.0000 0.2500
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT LeftFoot
    {
      OFFSET 0.0000 -42.0000 1.0000
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 0.0000 -45.0000 12.0000
      }
    }
  }
  JOINT Head
  {
    OFFSET 0.0000 60.0000 -2.0000
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0.0000 18.0000 0.0000
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.0333333
1.5000 90.2500 -3.0000 4.0000 -8.0000 170.0000 11.0000 -30.0000 2.0000 0.5000 40.0000 -1.0000 3.0000 5.0000 -7.0000
2.5000 91.0000 4.0000 3.0000 -7.0000 178.0000 9.0000 -20.0000 1.0000 0.2500 30.0000 -2.0000 2.0000 4.0000 -6.0000
3.5000 90.5000 11.0000 2.0000 -6.0000 -174.0000 7.0000 -10.0000 0.0000 0.1250 20.0000 -3.0000 1.0000 3.0000 -5.0000
"""

ORDERS_OF_ALL_KINDS = """\
HIERARCHY
ROOT hip
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Yrotation Xrotation Zrotation
  JOINT a
  {
    OFFSET 10 0 0
    CHANNELS 3 Xrotation Yrotation Zrotation
    JOINT b
    {
      OFFSET 0 -40 0
      CHANNELS 3 Zrotation Yrotation Xrotation
      JOINT c
      {
        OFFSET 0 -40 5
        CHANNELS 3 Zrotation Xrotation Zrotation
        JOINT d
        {
          OFFSET 0 0 15
          CHANNELS 3 Yrotation Zrotation Yrotation
          End Site
          {
            OFFSET 1 2 3
          }
        }
      }
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.008333
5 80 7   10 20 30   -40 50 60   70 -80 90   15 25 35   -45 55 65
6 81 9   11 22 33   -44 55 66   77 -88 99   16 27 38   -49 50 61
"""

SIX_CHANNELS_EVERYWHERE = """\
HIERARCHY
ROOT Hips
{
  OFFSET 3 100 4
  CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
  JOINT Knee
  {
    OFFSET 1 -50 2
    CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
    JOINT Foot
    {
      OFFSET 0 -45 0
      CHANNELS 6 Zrotation Yrotation Xrotation Zposition Xposition Yposition
      End Site
      {
        OFFSET 0 0 15
      }
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.01
3 101 4  1 2 3   1.5 -50.5 2.5  40 50 60   10 20 30  0.5 0.25 -44
3 102 5  2 3 4   1.0 -51.0 2.0  41 52 63   11 21 31  0.0 0.75 -46
"""

FEWER_AND_MORE_CHANNELS = """\
HIERARCHY
ROOT Hips
{
  OFFSET 0 0.95 0
  CHANNELS 2 Yrotation Zposition
  JOINT Knee
  {
    OFFSET 0.1 -0.5 0
    CHANNELS 1 Xrotation
    JOINT Foot
    {
      OFFSET 0 -0.45 0
      CHANNELS 2 Yposition Zrotation
    }
  }
  JOINT Spine
  {
    OFFSET 0 0.2 0
    CHANNELS 0
    JOINT Neck
    {
      OFFSET 0 0.3 0
      JOINT Eye
      {
        OFFSET 0.03 0.1 0.1
        CHANNELS 4 Xrotation Xrotation Yrotation Zrotation
        End Site
        {
          OFFSET 0 0 0.1
        }
      }
    }
    JOINT Arm
    {
      OFFSET 0.2 0.3 0
      CHANNELS 5 Xrotation Yrotation Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 0.3 0 0
      }
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.04
30 1.25  -60  -0.5 20   10 20 30 40   5 15 25 35 45
31 1.50  -50  -0.4 10   11 21 31 41   6 16 26 36 46
"""

MANY_ENDS = """\
HIERARCHY
ROOT Pelvis
{
  OFFSET -1.5 2.5 3.5
  CHANNELS 3 Yrotation Xrotation Zrotation
  End Site
  {
    OFFSET 1 0 0
  }
  JOINT Hand
  {
    OFFSET 0 -30 0
    CHANNELS 3 Yrotation Xrotation Zrotation
    End Site
    {
      OFFSET 1 -10 0
    }
    End Site
    {
      OFFSET 0 -11 1
    }
    End Site
    {
      OFFSET -1 -10 0
    }
  }
  JOINT Stump
  {
    OFFSET 0 20 0
    CHANNELS 3 Yrotation Xrotation Zrotation
  }
}
MOTION
Frames: 1
Frame Time: 0.0416667
10 20 30 40 50 60 70 80 90
"""

# Height along z, walking towards -y, as drawing programs write it.
Z_UP = """\
HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0.9
  CHANNELS 6 Xposition Yposition Zposition Xrotation Yrotation Zrotation
  JOINT Left Thigh
  {
    OFFSET 0.1 0 -0.05
    CHANNELS 3 Xrotation Yrotation Zrotation
    JOINT Left Foot
    {
      OFFSET 0 0.02 -0.8
      CHANNELS 3 Xrotation Yrotation Zrotation
      End Site
      {
        OFFSET 0 -0.15 -0.05
      }
    }
  }
  JOINT Neck Head
  {
    OFFSET 0 0 0.6
    CHANNELS 3 Xrotation Yrotation Zrotation
    End Site
    {
      OFFSET 0 0 0.2
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0166667
0.1 0.0 0.91  1 2 3  -20 0 0  30 0 0  5 5 5
0.1 -0.1 0.92  2 3 4  -10 1 2  20 0 0  5 6 7
"""

FILES = {
    "plain": PLAIN,
    "orders of all kinds": ORDERS_OF_ALL_KINDS,
    "six channels everywhere": SIX_CHANNELS_EVERYWHERE,
    "fewer and more channels": FEWER_AND_MORE_CHANNELS,
    "many ends": MANY_ENDS,
    "z up": Z_UP,
}


def simple_positions(text: str) -> tuple[list[str], np.ndarray, list[np.ndarray]]:
    """Joint names, their positions (T, J, 3), and those of the end sites (T, 3), all in file units and axes."""
    head, motion = text.replace("\r\n", "\n").split("MOTION")
    rows = np.array([line.split() for line in motion.strip().splitlines()[2:]], float)
    names: list[str] = []
    positions: list[np.ndarray] = []
    turns: list[Rotation] = []
    ends: list[np.ndarray] = []
    stack: list[int | None] = []
    waiting: int | None = None
    column = 0
    for line in head.splitlines():
        word, *rest = line.split() or [""]
        parent = next((node for node in reversed(stack) if node is not None), None)
        match word:
            case "ROOT" | "JOINT":
                names.append(line.strip()[len(word) :].strip())
                waiting = len(names) - 1
            case "End":
                waiting = None
            case "{":
                stack.append(waiting)
            case "}":
                stack.pop()
            case "OFFSET" if stack[-1] is None:
                assert parent is not None
                ends.append(positions[parent] + turns[parent].apply(np.array(rest, float)))
            case "OFFSET":
                local = np.tile(np.array(rest, float), (len(rows), 1))
                place_joint(positions, turns, stack, local)
            case "CHANNELS":
                joint = stack[-1]
                assert joint is not None
                turn = Rotation.identity(len(rows))
                for channel in rest[1:]:
                    if channel.lower().endswith("position"):
                        local[:, "XYZ".index(channel[0])] = rows[:, column]
                    else:
                        turn = turn * Rotation.from_euler(channel[0], rows[:, [column]], degrees=True)
                    column += 1
                positions.pop()
                turns.pop()
                place_joint(positions, turns, stack, local, turn)
    assert column == rows.shape[1]
    return names, np.stack(positions, axis=1), ends


def place_joint(
    positions: list[np.ndarray],
    turns: list[Rotation],
    stack: list[int | None],
    local: np.ndarray,
    turn: Rotation | None = None,
) -> None:
    turn = Rotation.identity(len(local)) if turn is None else turn
    if len(stack) == 1:
        positions.append(local)
        turns.append(turn)
        return
    parent = stack[-2]
    assert parent is not None
    positions.append(positions[parent] + turns[parent].apply(local))
    turns.append(turns[parent] * turn)
