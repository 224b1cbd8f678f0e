from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from hopdiff.io.events import write_events
from hopdiff.types import HopdiffError


def test_events_read_back(tmp_path: Path) -> None:
    Image.new("RGBA", (6, 4), (255, 0, 0, 255)).save(tmp_path / "red.png")
    rows = [{"search/best": 1.0 / (step + 1)} for step in range(5)]
    write_events(tmp_path, rows, {"speed": 5.0, "search": "ga"}, {"cost": 0.25}, {"red": tmp_path / "red.png"})

    read = EventAccumulator(str(tmp_path), size_guidance={"scalars": 0})
    read.Reload()
    best = read.Scalars("search/best")
    assert [event.step for event in best] == [0, 1, 2, 3, 4]
    assert [event.value for event in best] == pytest.approx([row["search/best"] for row in rows])
    assert read.Scalars("cost")[0].value == 0.25
    image = read.Images("red")[0]
    assert (image.width, image.height) == (6, 4)
    assert "_hparams_/session_start_info" in read.PluginTagToContent("hparams")


def test_nothing_but_events_stays(tmp_path: Path) -> None:
    write_events(tmp_path, [{"a": 1.0}], {"speed": 5.0})
    names = [path.name for path in tmp_path.iterdir()]
    assert names
    assert all(name.startswith("events.out.tfevents") for name in names)


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(HopdiffError, match="nowhere"):
        write_events(tmp_path / "nowhere", [{"a": 1.0}])
