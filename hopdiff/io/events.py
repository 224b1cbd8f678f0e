"""TensorBoard events: scalars a step, final numbers, pictures, and what the HParams table is made from."""

from __future__ import annotations

import math
import os
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image
from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.plugins.hparams import api_pb2, metadata, plugin_data_pb2
from tensorboard.summary.writer.event_file_writer import EventFileWriter

from hopdiff.types import HopdiffError

RESULT = "result/"
# Final numbers of a run that are shown; metrics.json has all.
FINAL = (
    *("cost", "eval", "energy_rate", "energy_target", "contact_time", "flight_time", "flight_share", "step_frequency"),
    *("com_oscillation", "peak_leg_force_bw", "friction_needed", "cost_of_transport", "arm_swing_deg", "wall_seconds"),
)
SUFFIX = ".hopdiff"  # of the names of our own event files
_CHANNELS = {"L": 1, "RGB": 3, "RGBA": 4}


@dataclass(frozen=True)
class Columns:
    """The HParams table of several runs. settings: those that differ, with their values among the runs. results: names
    of final numbers."""

    settings: Mapping[str, Sequence[Any]]
    results: Sequence[str]


def write_events(
    folder: Path,
    scalars: Sequence[Mapping[str, float]] = (),
    settings: Mapping[str, Any] | None = None,
    results: Mapping[str, float] | None = None,
    pictures: Mapping[str, Path] | None = None,
    columns: Columns | None = None,
) -> None:
    """Write an event file into a folder in place of our older ones; it appears there when it is complete.

    scalars: one table of tag -> value a step. settings: of a run, its row of the HParams table. results: its final
    numbers, tagged result/NAME. pictures: tag -> PNG file. columns: of a comparison, those of the HParams table,
    written once for a folder of runs, which have the rows in their own folders.
    Raises HopdiffError if the folder cannot be written.
    """
    summaries = [(step, _scalars(row)) for step, row in enumerate(scalars)]
    if results:
        summaries.append((0, _scalars({f"{RESULT}{name}": value for name, value in results.items()})))
    if settings:
        summaries += [(0, _row(settings)), (0, _end())]
    if columns:
        summaries.append((0, _table(columns)))
    try:
        summaries += [(0, _picture(tag, path)) for tag, path in (pictures or {}).items()]
        old = list(folder.glob(f"events.out.tfevents.*{SUFFIX}"))
        with tempfile.TemporaryDirectory(prefix=".events-", dir=folder) as draft:
            writer = EventFileWriter(draft, filename_suffix=SUFFIX)
            try:
                for step, summary in summaries:
                    writer.add_event(Event(wall_time=time.time(), step=step, summary=summary))
            finally:
                writer.close()
            for file in Path(draft).iterdir():
                os.replace(file, folder / file.name)
        for file in old:
            file.unlink(missing_ok=True)
    except OSError as error:
        raise HopdiffError(f"cannot write TensorBoard events to {folder}: {error.strerror or error}.") from error


def final_numbers(metrics: Mapping[str, Any]) -> dict[str, float]:
    """Those of a run's metrics that are shown as its results."""
    found = {name: metrics.get(name) for name in FINAL}
    return {name: float(value) for name, value in found.items() if isinstance(value, int | float)}


def _scalars(row: Mapping[str, float]) -> Summary:
    return Summary(value=[Summary.Value(tag=tag, simple_value=value) for tag, value in row.items()])


def _picture(tag: str, path: Path) -> Summary:
    """A PNG file as it is: unpacking and packing it again takes a second for a large one."""
    data = path.read_bytes()
    with Image.open(path) as image:
        width, height, channels = image.width, image.height, _CHANNELS.get(image.mode, 3)
    picture = Summary.Image(width=width, height=height, colorspace=channels, encoded_image_string=data)
    return Summary(value=[Summary.Value(tag=tag, image=picture)])


def _row(settings: Mapping[str, Any]) -> Summary:
    # Without a group name every folder is a row of its own.
    start = plugin_data_pb2.SessionStartInfo(start_time_secs=time.time())
    for name, value in settings.items():
        kind, value = _typed(value)
        setattr(start.hparams[name], _FIELDS[kind], value)
    return _hparams(metadata.SESSION_START_INFO_TAG, session_start_info=start)


def _end() -> Summary:
    end = plugin_data_pb2.SessionEndInfo(status=api_pb2.STATUS_SUCCESS, end_time_secs=time.time())
    return _hparams(metadata.SESSION_END_INFO_TAG, session_end_info=end)


def _table(columns: Columns) -> Summary:
    named = [(name, api_pb2.MetricName(tag=f"{RESULT}{name}")) for name in columns.results]
    experiment = api_pb2.Experiment(
        hparam_infos=[_column(name, values) for name, values in columns.settings.items()],
        metric_infos=[api_pb2.MetricInfo(name=tag, display_name=name) for name, tag in named],
    )
    return _hparams(metadata.EXPERIMENT_TAG, experiment=experiment)


def _column(name: str, values: Sequence[Any]) -> api_pb2.HParamInfo:
    typed = [_typed(value) for value in values]
    kinds = {kind for kind, _ in typed}
    info = api_pb2.HParamInfo(name=name)
    if "differs" in info.DESCRIPTOR.fields_by_name:  # not in every TensorBoard
        info.differs = True
    info.type = kinds.pop() if len(kinds) == 1 else api_pb2.DATA_TYPE_STRING
    if info.type == api_pb2.DATA_TYPE_FLOAT64:
        numbers = [value for _, value in typed]
        info.domain_interval.min_value, info.domain_interval.max_value = min(numbers), max(numbers)
    elif info.type == api_pb2.DATA_TYPE_BOOL:
        info.domain_discrete.extend(sorted({value for _, value in typed}))
    else:
        info.domain_discrete.extend(sorted({str(value) for _, value in typed}))
    return info


_FIELDS = {
    api_pb2.DATA_TYPE_BOOL: "bool_value",
    api_pb2.DATA_TYPE_FLOAT64: "number_value",
    api_pb2.DATA_TYPE_STRING: "string_value",
}


def _typed(value: Any) -> tuple[int, Any]:
    """A value with the type that TensorBoard has for it."""
    if isinstance(value, bool):
        return api_pb2.DATA_TYPE_BOOL, value
    if isinstance(value, int | float) and math.isfinite(value):
        return api_pb2.DATA_TYPE_FLOAT64, float(value)
    return api_pb2.DATA_TYPE_STRING, "null" if value is None else str(value)


def _hparams(tag: str, **content: Any) -> Summary:
    data = plugin_data_pb2.HParamsPluginData(**content)
    about = metadata.create_summary_metadata(data)
    return Summary(value=[Summary.Value(tag=tag, metadata=about, tensor=metadata.NULL_TENSOR)])
