from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from tensorboard.backend.event_processing.data_provider import MultiplexerDataProvider
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.backend.event_processing.plugin_event_multiplexer import EventMultiplexer
from tensorboard.context import RequestContext
from tensorboard.data.provider import ListHyperparametersResult
from tensorboard.plugins.base_plugin import TBContext
from tensorboard.plugins.hparams import api_pb2
from tensorboard.plugins.hparams.backend_context import Context
from tensorboard.plugins.hparams.list_session_groups import Handler

from hopdiff.io.events import Columns, final_numbers, write_events
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
    # Every tag has a prefix, so that single points make no groups of their own.
    assert set(read.Tags()["scalars"]) == {"search/best", "result/cost"}
    assert read.Scalars("result/cost")[0].value == 0.25
    image = read.Images("red")[0]
    assert (image.width, image.height) == (6, 4)
    assert image.encoded_image_string == (tmp_path / "red.png").read_bytes()


def test_nothing_but_events_stays_and_old_ones_go(tmp_path: Path) -> None:
    others = "events.out.tfevents.1.of.others"
    (tmp_path / others).touch()
    seen = []
    for value in (1.0, 2.0):
        write_events(tmp_path, [{"a": value}], {"speed": 5.0})
        names = {path.name for path in tmp_path.iterdir()}
        assert others in names
        seen += names - {others}
    first, second = seen
    assert first != second
    assert second.startswith("events.out.tfevents")


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(HopdiffError, match="nowhere"):
        write_events(tmp_path / "nowhere", [{"a": 1.0}])


def test_final_numbers_are_some_of_the_metrics() -> None:
    metrics = {"cost": 1, "search": "ga", "trunk_side_deg": 2.0, "friction_needed": None, "contact_time": 0.2}
    assert final_numbers(metrics) == {"cost": 1.0, "contact_time": 0.2}


def hparams(folder: Path) -> tuple[dict[str, int], list[str], dict[str, dict[str, Any]]]:
    """The HParams table as TensorBoard shows it: settings with their types, names of results, and the rows."""
    events = EventMultiplexer()
    events.AddRunsFromDirectory(str(folder))
    events.Reload()
    data = MultiplexerDataProvider(events, str(folder))
    context = Context(TBContext(data_provider=data, logdir=str(folder)))
    none = ListHyperparametersResult(hyperparameters=[], session_groups=[])
    found = context.hparams_metadata(RequestContext(), "")
    table = context.experiment_from_metadata(RequestContext(), "", True, found, none)
    every = [api_pb2.STATUS_UNKNOWN, api_pb2.STATUS_SUCCESS, api_pb2.STATUS_FAILURE, api_pb2.STATUS_RUNNING]
    request = api_pb2.ListSessionGroupsRequest(slice_size=100, allowed_statuses=every)
    groups = Handler(RequestContext(), context, "", request).run().session_groups
    rows = {
        group.name: {name: getattr(value, value.WhichOneof("kind")) for name, value in group.hparams.items()}
        | {value.name.tag: value.value for value in group.metric_values}
        for group in groups
    }
    return {info.name: info.type for info in table.hparam_infos}, [info.name.tag for info in table.metric_infos], rows


@pytest.fixture
def sweep(tmp_path: Path) -> Path:
    for k, search in enumerate(("ga", "gradient")):
        (tmp_path / str(k)).mkdir()
        typed = {"search": search, "seed": 0, "pictures": False, "budget.target": None}
        write_events(tmp_path / str(k), [{"search/best": 3.0}], typed, {"cost": 1.0 + k, "eval": 0.5})
    return tmp_path


def test_a_run_on_its_own_is_a_row_of_what_was_typed(sweep: Path) -> None:
    settings, results, rows = hparams(sweep / "0")
    assert sorted(settings) == ["budget.target", "pictures", "search", "seed"]
    assert {"result/cost", "result/eval"} <= set(results)
    assert rows["."]["search"] == "ga"
    assert rows["."]["pictures"] is False
    assert rows["."]["budget.target"] == "null"


def test_a_comparison_says_which_columns_count_and_adds_no_row(sweep: Path) -> None:
    (sweep / "compare").mkdir()
    varied = {"search": ["ga", "gradient"], "beta": [0.2, 0.7], "mixed": [True, 3], "on": [True, False]}
    write_events(sweep / "compare", columns=Columns(varied, ["cost"]))
    settings, results, rows = hparams(sweep)
    assert settings == {
        "search": api_pb2.DATA_TYPE_STRING,
        "beta": api_pb2.DATA_TYPE_FLOAT64,
        "mixed": api_pb2.DATA_TYPE_STRING,
        "on": api_pb2.DATA_TYPE_BOOL,
    }
    assert results == ["result/cost"]
    assert {name: (row["search"], row["result/cost"]) for name, row in rows.items()} == {
        "0": ("ga", 1.0),
        "1": ("gradient", 2.0),
    }
