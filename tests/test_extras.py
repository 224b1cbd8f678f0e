from __future__ import annotations

import importlib
import tomllib
from dataclasses import fields
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from typing import Any

import hydra
import pytest
from hydra.core.global_hydra import GlobalHydra
from hydra.core.plugins import Plugins
from omegaconf import OmegaConf

import hopdiff.extras
from hopdiff.cli import main
from hopdiff.composing import compose
from hopdiff.doors import config_folder
from hopdiff.errors import sentence
from hopdiff.extras import EXTRAS, enter_folder, missing_extras

LAUNCHERS = {"joblib": "parallel", "ray": "ray", "ray_cluster": "ray", "slurm": "slurm"}
# The settings class of the plugin that a file is for.
SCHEMES = {
    "joblib": ("hydra_plugins.hydra_joblib_launcher.config", "JobLibLauncherConf"),
    "slurm": ("hydra_plugins.hydra_submitit_launcher.config", "SlurmQueueConf"),
}


def launcher_file(name: str) -> Any:
    return OmegaConf.load(config_folder() / "hydra" / "launcher" / f"{name}.yaml")


def without(monkeypatch: pytest.MonkeyPatch, *packages: str) -> None:
    """As if these were not installed, and all others were."""

    def version(name: str) -> str:
        if name in packages:
            raise PackageNotFoundError(name)
        return "1"

    monkeypatch.setattr(hopdiff.extras, "version", version)


def test_extras_are_those_of_the_package() -> None:
    project = tomllib.loads((Path(__file__).resolve().parents[1] / "pyproject.toml").read_text())["project"]
    for name, extra in EXTRAS.items():
        assert any(wanted.startswith(extra.package) for wanted in project["optional-dependencies"][name])
    assert {path.stem for path in (config_folder() / "hydra" / "launcher").glob("*.yaml")} == set(LAUNCHERS)


def test_help_names_what_is_missing(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.argv", ["hopdiff", "--help"])
    without(monkeypatch, "hydra-ray-launcher")
    with pytest.raises(SystemExit):
        main()
    page = capsys.readouterr().out
    assert "Not installed here" in page
    assert "pip install -c constraints.txt -e '.[ray]'" in page
    assert "[slurm]" not in page
    without(monkeypatch)
    assert missing_extras() == ""
    with pytest.raises(SystemExit):
        main()
    assert "Not installed here" not in capsys.readouterr().out


@pytest.mark.parametrize(("launcher", "extra"), LAUNCHERS.items())
def test_a_launcher_that_is_missing_names_its_extra(
    launcher: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(Plugins.instance().class_name_to_class, launcher_file(launcher)._target_, raising=False)
    monkeypatch.setattr("sys.argv", ["hopdiff", "-m", f"hydra/launcher={launcher}", "speed=3,4"])
    assert main() == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert said.startswith(f"hopdiff: hydra/launcher={'ray' if extra == 'ray' else launcher}")
    assert said.endswith(f" needs the extra: pip install -c constraints.txt -e '.[{extra}]'.\n")
    assert not list(tmp_path.iterdir())


def test_other_plugins_are_left_to_hydra() -> None:
    assert "needs the extra" not in str(sentence(RuntimeError("Unknown plugin class : 'hydra_plugins.mine.Launcher'")))


@pytest.mark.parametrize("launcher", LAUNCHERS)
def test_our_file_is_what_is_chosen(launcher: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Plugins bring settings under the same names; Hydra warns where it holds ours against them, which fails here."""
    monkeypatch.chdir(tmp_path)
    compose()  # which lets Hydra look for plugins
    state = GlobalHydra.instance().hydra
    try:
        GlobalHydra.instance().clear()
        with hydra.initialize_config_dir(str(config_folder()), version_base=None):
            whole = hydra.compose("config", [f"hydra/launcher={launcher}"], return_hydra_config=True)
    finally:
        GlobalHydra.instance().hydra = state
    chosen, own = whole.hydra.launcher, launcher_file(launcher)
    assert set(chosen) == set(own)
    assert OmegaConf.to_container(chosen, resolve=False) == OmegaConf.to_container(own, resolve=False)


@pytest.mark.parametrize("launcher", SCHEMES)
def test_files_have_no_setting_that_their_plugin_lacks(launcher: str) -> None:
    module, name = SCHEMES[launcher]
    known = {entry.name for entry in fields(getattr(pytest.importorskip(module), name))}
    assert set(launcher_file(launcher)) <= known | {"_target_"}


@pytest.mark.parametrize("launcher", LAUNCHERS)
def test_files_name_classes_that_are_there(launcher: str) -> None:
    module, _, name = str(launcher_file(launcher)._target_).rpartition(".")
    pytest.importorskip(module)
    assert hasattr(importlib.import_module(module), name)


def test_a_worker_goes_where_it_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(Path(__file__).parent)
    monkeypatch.setenv("HOPDIFF_FOLDER", str(tmp_path))
    for launcher in ("ray", "ray_cluster"):
        environment = launcher_file(launcher).ray.init.runtime_env
        assert set(environment.env_vars) == {hopdiff.extras.FOLDER}
        module, _, name = str(environment.worker_process_setup_hook).rpartition(".")
        assert getattr(importlib.import_module(module), name) is enter_folder
    enter_folder()
    assert Path.cwd() == tmp_path


def test_outside_of_a_checkout_an_extra_is_that_of_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hopdiff.extras, "__file__", str(tmp_path / "hopdiff" / "extras.py"))
    assert hopdiff.extras.install("ray") == "pip install 'hopdiff[ray]'"
