"""Presets: each a name for a method with its paper's parameters, which are defaults that the user overrides."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Value
from stab_ros.methods import METHODS
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.parameters.file import read_config
from stab_ros.parameters.presets import PRESETS
from stab_ros.parameters.table import (
    PARAMETERS,
    check_change,
    checked_values,
    resolved,
    stabilizer_config,
    table_with_preset,
)

OF_THE_ISSUE = {
    "fft_cuas", "fft_cuas_alpine", "fft_cuas_basento", "fft_dch", "ssims", "ssims_alpine", "ssims_basento", "klt_iv",
    "klt_iv_basento", "vision_fast", "flowvelo_akaze", "flowvelo_akaze_alpine", "ed_ransac", "blender_manual",
    "blender_manual_alpine", "blender_manual_basento", "blender_auto",
}
every_preset = pytest.mark.parametrize("name", list(PRESETS))


def test_all_tools_of_the_papers_are_there() -> None:
    assert set(PRESETS) == OF_THE_ISSUE
    assert not set(PRESETS) & set(METHODS)


@every_preset
def test_a_preset_is_made_of_valid_parameters(name: str) -> None:
    preset = PRESETS[name]
    assert checked_values(preset) == preset
    own = f"{preset['method']}."
    assert all("." not in parameter or parameter.startswith(own) for parameter in preset)
    make_stabilizer({"method": name})


@every_preset
def test_a_preset_gives_its_values(name: str) -> None:
    config, preset = stabilizer_config({"method": name}), PRESETS[name]
    for parameter, value in preset.items():
        group, _, field = parameter.rpartition(".")
        assert getattr(config.method_config if group else config, field) == value


@every_preset
def test_a_declared_preset_is_the_same_as_a_chosen_one(name: str) -> None:
    """The node declares all parameters: with the defaults of the table, they say what the name alone says."""
    declared: dict[str, Value] = {key: one.default for key, one in table_with_preset(name).items()}
    assert declared["method"] == name
    assert stabilizer_config(declared) == stabilizer_config({"method": name})


def own_values(name: str) -> dict[str, Any]:
    """The values a preset gives the parameters of its method, without the prefix."""
    return {parameter.partition(".")[2]: value for parameter, value in PRESETS[name].items() if "." in parameter}


def test_explicit_values_override_a_preset() -> None:
    config = stabilizer_config({"method": "ssims", "model": "affine", "ssim.area": 15})
    assert (config.method, config.model, config.estimator) == ("ssim", "affine", "least_squares")
    assert config.method_config == METHODS["ssim"].Config(**{**own_values("ssims"), "area": 15})


def test_a_file_and_the_command_line_override_a_preset_alike(tmp_path: Path) -> None:
    path = tmp_path / "tracker.yaml"
    values = {"method": "ssims", "ssim": {"search": 31}}
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": values}}), encoding="utf-8")
    read = read_config(path)
    assert stabilizer_config(read) == stabilizer_config({"method": "ssims", "ssim.search": 31})
    chosen: dict[str, Value] = {**read, "method": "ssims_basento"}
    assert stabilizer_config(chosen) == stabilizer_config({"method": "ssims_basento", "ssim.search": 31})


def test_a_method_is_no_preset() -> None:
    assert resolved({"method": "klt", "klt.block": 15}) == {"method": "klt", "klt.block": 15}
    for name in ("klt", "nothing", 3, None):
        assert table_with_preset(name) == PARAMETERS


@pytest.mark.parametrize(("name", "near"), [
    ("ssim_s", "ssims"), ("klt-iv", "klt_iv"), ("fftcuas", "fft_cuas"), ("flowvelo", "flowvelo_akaze"), ("kl", "klt"),
])
def test_an_unknown_preset_gets_near_ones(name: str, near: str) -> None:
    with pytest.raises(ConfigError, match=f"method: '{name}' is unknown, did you mean .*{near}.*? It must be one of"
                       ) as refused:
        make_stabilizer({"method": name})
    assert len(str(refused.value).splitlines()) == 1


def test_a_preset_is_chosen_at_the_start_only() -> None:
    old: dict[str, Value] = {"method": "ssims"}
    with pytest.raises(ConfigError, match="the preset ed_ransac can only be chosen at the start; set method to sift"):
        check_change(old, {"method": "ed_ransac"})
    check_change(old, {"method": "ssims"})
    check_change(old, {"method": "klt"})
    check_change(old, {"ssim.area": 15})
