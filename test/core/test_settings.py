"""Parameters and their files: what is refused, with which words, and what comes through."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from stab_ros.core.errors import ConfigError, InputError
from stab_ros.core.settings import Checked, Range, checked, setting
from stab_ros.imaging.camera import Camera
from stab_ros.methods import METHODS
from stab_ros.parameters.discharge import running_config
from stab_ros.parameters.engines import make_evaluator, make_georeferencer, make_stabilizer
from stab_ros.parameters.file import DISCHARGE, EVALUATOR, GEOREFERENCE, TRACKER, VELOCIMETRY, read_config
from stab_ros.parameters.table import PARAMETERS, Parameter, checked_values, stabilizer_config
from stab_ros.parameters.velocimeters import check_velocimetry

CONFIG = Path(__file__).resolve().parents[2] / "config"
NUMBERS = [p for p in PARAMETERS.values() if isinstance(p.default, (int, float)) and not isinstance(p.default, bool)]
CHOICES = [p for p in PARAMETERS.values() if p.limits.choices]


def name_of(parameter: Parameter) -> str:
    return parameter.name


@dataclass(frozen=True)
class Example(Checked):
    """Settings of every kind."""

    share: float = setting(0.5, "a share", 0.0, 1.0)
    count: int = setting(3, "a count", 1, 9)
    free: float = setting(0.0, "any number")
    kind: str = setting("a", "a kind", choices=("a", "b"))
    flag: bool = setting(False, "a flag")


def test_the_whole_contract_is_there() -> None:
    names = {"method", "model", "estimator", "reference", "on_lost", "roi", "exclude", "interpolation",
             "use_camera_info"}
    assert names <= set(PARAMETERS)
    assert all(any(name.startswith(f"{method}.") for name in PARAMETERS) for method in METHODS)
    assert all(parameter.limits.doc for parameter in PARAMETERS.values())


def test_defaults_pass_their_own_check() -> None:
    defaults = {name: parameter.default for name, parameter in PARAMETERS.items()}
    assert checked_values(defaults) == defaults


@pytest.mark.parametrize("parameter", NUMBERS, ids=name_of)
def test_numbers_end_at_their_limits(parameter: Parameter) -> None:
    low, high = parameter.limits.low, parameter.limits.high
    assert low is not None
    assert high is not None
    kind = type(parameter.default)
    assert checked_values({parameter.name: kind(low)}) == {parameter.name: low}
    assert checked_values({parameter.name: kind(high)}) == {parameter.name: high}
    for beyond in (low - 1, high + 1):
        with pytest.raises(ConfigError, match=rf"{parameter.name}: .* it must lie in \["):
            checked_values({parameter.name: kind(beyond)})


@pytest.mark.parametrize("parameter", NUMBERS, ids=name_of)
@pytest.mark.parametrize("value", [
    float("nan"), float("inf"), float("-inf"), True, "3", None, [3], pytest.param(10**400, id="too long for a float")
])
def test_numbers_are_finite_numbers(parameter: Parameter, value: object) -> None:
    with pytest.raises(ConfigError, match=f"^{parameter.name}: ") as error:
        checked_values({parameter.name: value})
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("parameter", CHOICES, ids=name_of)
def test_choices_are_named(parameter: Parameter) -> None:
    for choice in parameter.limits.choices:
        assert checked_values({parameter.name: choice}) == {parameter.name: choice}
    with pytest.raises(ConfigError, match=f"'wrong' is unknown, .*{', '.join(parameter.limits.choices)}"):
        checked_values({parameter.name: "wrong"})
    for wrong in (3, [parameter.limits.choices[0]]):
        with pytest.raises(ConfigError, match=f"it must be one of {', '.join(parameter.limits.choices)}"):
            checked_values({parameter.name: wrong})


@pytest.mark.parametrize("parameter", CHOICES, ids=name_of)
def test_choices_are_what_yaml_makes_of_their_plain_words(parameter: Parameter) -> None:
    for choice in parameter.limits.choices:
        assert checked_values({parameter.name: yaml.safe_load(choice)}) == {parameter.name: choice}


@pytest.mark.parametrize(("word", "choices", "taken"), [
    ("off", ("auto", "off"), "off"), ("no", ("auto", "no"), "no"), ("yes", ("yes", "off"), "yes"),
    ("on", ("on", "off"), "on"), ("false", ("true", "false"), "false"),
    ("on", ("auto", "off"), None), ("off", ("auto", "Off!"), None), ("off", ("off", "no"), None), ("off", (), None),
])
def test_a_bool_is_the_one_choice_that_yaml_reads_so(word: str, choices: tuple[str, ...], taken: str | None) -> None:
    limits = Range("", choices=choices)
    if taken is not None:
        assert checked("name", yaml.safe_load(word), choices[0], limits) == taken
        return
    must = f"one of {', '.join(choices)}" if choices else "a str"
    with pytest.raises(ConfigError, match=f"name: (True|False) is a bool, it must be {must}$"):
        checked("name", yaml.safe_load(word), "text", limits)


def test_a_whole_number_serves_as_a_float_but_no_float_as_an_int() -> None:
    found = checked_values({"threshold": 2})
    assert found == {"threshold": 2.0}
    assert type(found["threshold"]) is float
    with pytest.raises(ConfigError, match=r"min_inliers: 12\.0 is a float, it must be a int"):
        checked_values({"min_inliers": 12.0})
    with pytest.raises(ConfigError, match="use_camera_info: 1 is a int, it must be a bool"):
        checked_values({"use_camera_info": 1})


def test_text_may_look_like_a_whole_number() -> None:
    assert checked_values({"klt.passes": 21, "fft.passes": "32,16"}) == {"klt.passes": "21", "fft.passes": "32,16"}


def test_an_unknown_name_gets_near_ones() -> None:
    with pytest.raises(ConfigError, match=r"'direct\.patchs' is unknown, did you mean direct\.patches"):
        checked_values({"direct.patchs": 300})


@given(st.text(max_size=30).filter(lambda name: name not in PARAMETERS))
def test_any_other_name_is_refused_in_one_line(name: str) -> None:
    with pytest.raises(ConfigError, match="is unknown") as error:
        checked_values({name: 1})
    assert len(str(error.value).splitlines()) == 1


@given(share=st.floats(), count=st.integers(), free=st.floats())
def test_settings_hold_what_lies_in_range_and_refuse_the_rest(share: float, count: int, free: float) -> None:
    if 0 <= share <= 1 and 1 <= count <= 9 and not math.isnan(free):
        found = Example(share=share, count=count, free=free)
        assert (found.share, found.count, found.free) == (share, count, free)
    else:
        with pytest.raises(ConfigError):
            Example(share=share, count=count, free=free)


def test_settings_refuse_wrong_kinds() -> None:
    wrong: list[dict[str, Any]] = [{"kind": "c"}, {"kind": 1}, {"flag": 1}, {"count": 2.0}, {"count": True}]
    for values in wrong:
        with pytest.raises(ConfigError, match=f"^{next(iter(values))}: "):
            Example(**values)


def test_values_reach_the_settings_of_their_method() -> None:
    config = stabilizer_config({"method": "klt", "threshold": 2.0, "klt.corners": 77, "direct.patches": 100})
    assert (config.method, config.threshold) == ("klt", 2.0)
    assert config.method_config == METHODS["klt"].Config(corners=77)


def test_an_engine_is_not_made_of_wrong_values() -> None:
    with pytest.raises(ConfigError, match="model"):
        make_stabilizer({"model": "rubber"})


# --- files ---------------------------------------------------------------------------------------------------------


def written(folder: Path, text: str) -> Path:
    path = folder / "tracker.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("node", ["/**", "tracker_node", "/uas/tracker_node"])
def test_a_file_gives_its_parameters(tmp_path: Path, node: str) -> None:
    values = {"method": "klt", "klt": {"corners": 300}, "direct.patches": 500, "threshold": 1}
    path = written(tmp_path, yaml.safe_dump({node: {"ros__parameters": values}}))
    assert read_config(path) == {"method": "klt", "klt.corners": 300, "direct.patches": 500, "threshold": 1.0}


def test_what_the_node_alone_reads_is_passed_over(tmp_path: Path) -> None:
    values = {"queue_depth": 0, "image_transport": "raw", "wait_for_subscribers": 1, "use_sim_time": True,
              "model": "affine"}
    assert read_config(written(tmp_path, yaml.safe_dump({"/**": {"ros__parameters": values}}))) == {"model": "affine"}


@pytest.mark.parametrize(("text", "complaint"), [
    ("", "not a ROS parameter file"),
    ("just words", "not a ROS parameter file"),
    ("- a\n- b\n", "not a ROS parameter file"),
    ("method: klt\n", "not a ROS parameter file"),
    ("/**: {ros__parameters: {method: klt}", "not a readable YAML file"),
    ("/**:\n\tros__parameters: {}\n", "not a readable YAML file"),
    ("/**:\n  method: klt\n", "must hold .*ros__parameters|ros__parameters must hold"),
    ("/**:\n  ros__parameters: [method, klt]\n", "ros__parameters must hold"),
    ("/**: {ros__parameters: {methd: klt}}", "'methd' is unknown, did you mean method"),
    ("/**: {ros__parameters: {threshold: .nan}}", "threshold: nan is out of range"),
    ("/**: {ros__parameters: {threshold: 2026-01-01}}", "threshold: .* must be a float"),
    ("/**: {ros__parameters: {direct: {patches: [1, 2]}}}", "direct.patches: .* must be a int"),
    ("/**: {ros__parameters: {on_lost: no}}", "on_lost: False is a bool"),
    ("/**: {ros__parameters: {1: 2}}", "'1' is unknown"),
    ("camera: {ros__parameters: {method: klt}}", "camera.*tracker_node"),
    pytest.param("[" * 2000, "not a readable YAML file", id="nested too deep"),
    ("!!python/object/apply:os.getcwd []", "not a readable YAML file"),
])
def test_a_bad_file_is_one_line(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint) as error:
        read_config(written(tmp_path, text))
    assert len(str(error.value).splitlines()) == 1


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(bytes(range(256)))
    for path in (tmp_path / "missing.yaml", tmp_path, binary):
        with pytest.raises(InputError, match="not a readable YAML file") as error:
            read_config(path)
        assert str(path) in str(error.value)


def test_our_own_files_make_an_engine() -> None:
    make_stabilizer(read_config(CONFIG / "tracker.yaml", TRACKER))
    make_evaluator(read_config(CONFIG / "evaluator.yaml", EVALUATOR))
    camera = Camera(np.diag([1000.0, 1000.0, 1.0]), np.zeros(0), "plumb_bob", (640, 480))
    make_georeferencer(read_config(CONFIG / "georeference.yaml", GEOREFERENCE), camera, camera.size)
    check_velocimetry(read_config(CONFIG / "velocimetry.yaml", VELOCIMETRY))
    running_config(read_config(CONFIG / "discharge.yaml", DISCHARGE))
    make_stabilizer(read_config(CONFIG / "pipeline.yaml", TRACKER))
    check_velocimetry(read_config(CONFIG / "pipeline.yaml", VELOCIMETRY))
    assert {path.stem for path in CONFIG.glob("*.yaml")} == {
        "tracker", "evaluator", "georeference", "velocimetry", "discharge", "pipeline"}
