"""Parameter files that a node and a command share: what belongs to the nodes alone does not disturb the commands."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from stab_ros.core.errors import ConfigError, InputError
from stab_ros.core.settings import settings_of
from stab_ros.parameters.file import EVALUATOR, TRACKER, read_config
from stab_ros.parameters.node_settings import EvaluatorSettings, TrackerSettings


def written(tmp_path: Path, **values: object) -> Path:
    path = tmp_path / "parameters.yaml"
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": values}}), encoding="utf-8")
    return path


@pytest.mark.parametrize("node", [TRACKER, EVALUATOR])
def test_every_setting_of_a_node_is_skipped(node: str, tmp_path: Path) -> None:
    of_nodes = {name: default for settings in (TrackerSettings, EvaluatorSettings)
                for name, default, _ in settings_of(settings)}
    qos = {"qos_overrides": {"/camera/image_raw": {"subscription": {"depth": 3}}}, "use_sim_time": True}
    assert read_config(written(tmp_path, **of_nodes, **qos), node) == {}


def test_a_name_that_only_begins_like_a_setting_of_a_node_is_unknown(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"parameter 'queue_depths' is unknown"):
        read_config(written(tmp_path, queue_depths=1))


def test_a_file_of_another_node_alone_is_refused() -> None:
    """Though it is for nodes of any name, it holds nothing of this one."""
    shipped = Path(__file__).parents[2] / "config"
    assert read_config(shipped / "tracker.yaml", TRACKER) == {"method": "direct"}
    with pytest.raises(InputError, match=r"holds orientation, height_m, which are of other nodes; .* tracker_node"):
        read_config(shipped / "georeference.yaml", TRACKER)
