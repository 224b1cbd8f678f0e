"""Errors of Hydra, OmegaConf and the operating system, each as one sentence for the user."""

from __future__ import annotations

import re
import sys
import traceback

from hydra.errors import ConfigCompositionException, MissingConfigException, OverrideParseException
from omegaconf.errors import (
    ConfigAttributeError,
    ConfigKeyError,
    InterpolationResolutionError,
    OmegaConfBaseException,
    ValidationError,
)
from yaml import MarkedYAMLError
from yaml.reader import ReaderError

from hopdiff.composing import (
    choices_of,
    choices_with,
    known_settings,
    no_export,
    of_tasks,
    own_file,
    task_of,
    tasks_with,
)
from hopdiff.doors import config_folder
from hopdiff.extras import of_launcher
from hopdiff.graph.settings import GONE
from hopdiff.messages import near, one_line, unknown, wrong_value
from hopdiff.types import HopdiffError

_LAUNCHERS = {"ray": "ray", "submitit": "slurm"}  # that raise errors of their own, by package
_FOREIGN = ("/hydra/", "/omegaconf/", "/yaml/", "/antlr4/")


def sentence(error: BaseException) -> str | None:
    """What the user should read, or None if the error is none of theirs.

    Endless digits are cut short, and a mistake in a file of the user's own is told with the file's name.
    """
    said = _sentence(error)
    if said is None:
        return None
    said = re.sub(r"\d{41,}", lambda digits: f"{digits[0][:12]}... (many digits)", said)
    file = None if re.match(r"\S+\.yaml\b", said) else own_file(re.findall(r"[A-Za-z_][\w.]*", said))
    return said if file is None else f"{file}: {said}"


def _sentence(error: BaseException) -> str | None:
    match error:
        case HopdiffError():
            return str(error)
        case MissingConfigException():
            return _missing_choice(error)
        case OverrideParseException():
            return (
                f"The override {error.override!r} cannot be read: write NAME=VALUE, with quotes around unusual values."
            )
        case ConfigCompositionException():
            return _composition(error)
        case OmegaConfBaseException():
            return _setting(error, str(error.full_key or ""), str(error))
        case UnicodeDecodeError() | ReaderError():
            return f"One of the YAML files that were chosen is not text (UTF-8): {one_line(error).rstrip('.')}."
        case ValueError() if "integer string conversion" in str(error):
            return _endless_number()
        case _ if "Config group override must be a string or a list" in str(error):
            return _number_for_name()
        case MarkedYAMLError():
            mark = error.problem_mark
            where = f"{mark.name}, line {mark.line + 1}" if mark else "A configuration file"
            return f"{where}: not YAML ({error.problem})."
        case OSError() if error.filename is not None:
            return f"The run folder (hydra.run.dir) cannot be written: {error.filename}: {error.strerror}."
        case RuntimeError() if (said := of_launcher(str(error))) is not None:
            return said
        case ConnectionError() if "Ray" in str(error):
            return f"hydra/launcher=ray_cluster: {one_line(error).rstrip('.')}."
        case _ if (launcher := _LAUNCHERS.get(type(error).__module__.partition(".")[0])) is not None:
            again = "The same command with the same hydra.sweep.dir makes what is missing."
            return f"hydra/launcher={launcher}: {one_line(error).rstrip('.')}. {again}"
        case ValueError() if isinstance(error.__cause__, OSError):  # the log file in the run folder
            return sentence(error.__cause__)
    return f"{one_line(error)}." if _raised_abroad(error) else None


def _missing_choice(error: MissingConfigException) -> str:
    group, _, name = str(error.missing_cfg_file or "").rpartition("/")
    if group and not error.options:  # one of a list of choices, or the default of a file
        return unknown(group, name, choices_of(group))
    if not error.options:
        return f"Unknown group {group or name!r}: python -m hopdiff --help lists the groups."
    return unknown(group, name, error.options)


def _composition(error: ConfigCompositionException) -> str:
    text = str(error)
    if isinstance(error.__cause__, OmegaConfBaseException):
        key = str(error.__cause__.full_key or "")
        return _setting(error.__cause__, key, str(error.__cause__))
    if found := re.match(r"In '(.+?)': (\w+) raised while composing config:\s*(.*)", text, re.DOTALL):
        file, kind, rest = found.groups()
        name = re.search(r"full_key: (\S+)", rest)
        cause = {"ValidationError": ValidationError, "ConfigKeyError": ConfigKeyError}.get(kind, OmegaConfBaseException)
        return f"{file}.yaml: {_setting(cause(rest), name.group(1) if name else '', rest)}"
    if found := re.match(r"Could not override '(.+?)'\. No match in the defaults list", text):
        if tasks := tasks_with(found.group(1)):
            return of_tasks(found.group(1), tasks)
        return f"{found.group(1)} is not chosen by default: write +{found.group(1)}=NAME."
    if found := re.match(r"Could not append to config. An item is already at '(.+?)'", text):
        return f"{found.group(1)} has a value already: write {found.group(1)}=VALUE, without the plus."
    if found := re.match(r"Multiple values for (\S+)\.", text):
        return f"{found.group(1)} is chosen already: write {found.group(1)}=NAME, without the plus."
    if found := re.match(r"Ambiguous value for argument '(.+?)'", text):
        return f"{found.group(1)!r} lists several values: add -m to make a run of each, or put quotes around it."
    return f"{one_line(error).rstrip('.')}."


def _setting(error: OmegaConfBaseException, key: str, text: str) -> str:
    """The sentence for a setting with a wrong name or value."""
    if isinstance(error, ConfigAttributeError | ConfigKeyError):
        if key in GONE:
            return f"{key} is no setting any more; {GONE[key]}."
        if found := re.fullmatch(r"exports\.(\w+)", key):
            return no_export(found.group(1))
        if task := task_of(key):
            return f"{key} is a setting of task={task}: add task={task}."
        if tasks := tasks_with(key):
            return of_tasks(key, tasks)
        if choices := choices_with(key):
            return f"{key} is a setting of {', '.join(choices)}: add {'it' if len(choices) == 1 else 'one of these'}."
        if key in (known := known_settings(key)):
            return f"{key} is no setting of what is chosen here."
        guess = near(key, known)
        return f"Unknown setting {key!r}.{guess or ' python -m hopdiff --help lists the settings.'}"
    if found := re.search(r"Interpolation key '(.+?)' not found", text):
        return f"The setting {found.group(1)!r} is needed and missing."
    if isinstance(error, InterpolationResolutionError):
        return f"{key}: {one_line(error)}."
    if said := wrong_value(key, text):
        return said
    if "Missing mandatory value" in text:
        return f"{key} needs a value."
    first = text.strip().splitlines()[0].rstrip(".")
    return f"{key}: {first}." if key else f"{first}."


def _endless_number() -> str:
    """For digits that Python refuses to read."""
    named = [word.partition("=")[0] for word in sys.argv[1:] if re.search(r"\d{4000}", word)]
    return f"{named[0] if named else 'A setting of a YAML file'} is a number of too many digits."


def _number_for_name() -> str:
    """For a group that was given a number, as search=3."""
    for word in sys.argv[1:]:
        group, _, value = word.lstrip("+").partition("=")
        number = re.fullmatch(r"[-+.\d]\S*|nan|inf|true|false|null", value, re.IGNORECASE)
        if number and (config_folder() / group).is_dir():
            return unknown(group, value, choices_of(group))
    return "A choice must be a name, not a number."


def _raised_abroad(error: BaseException) -> bool:
    """Whether an error was raised by a library that reads settings, so that only the settings can be at fault."""
    frames = traceback.extract_tb(error.__traceback__)
    return bool(frames) and any(part in frames[-1].filename.replace("\\", "/") for part in _FOREIGN)
