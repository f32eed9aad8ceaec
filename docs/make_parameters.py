"""Prints docs/parameters.md from the tables of parameters that the nodes and the command use.

python docs/make_parameters.py > docs/parameters.md
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from stab_ros.core.settings import Range, Value
from stab_ros.nodes.bag_player_node import PlayerSettings
from stab_ros.nodes.bag_recorder_node import RecorderSettings
from stab_ros.nodes.params import table_of
from stab_ros.parameters.discharge import DISCHARGE_PARAMETERS
from stab_ros.parameters.node_settings import (
    COMPRESSED_PREFIX,
    CompressedSettings,
    DischargeSettings,
    EvaluatorSettings,
    GeoreferenceSettings,
    ManagedSettings,
    PipelineSettings,
    TrackerSettings,
    VelocimetrySettings,
)
from stab_ros.parameters.presets import PRESETS
from stab_ros.parameters.table import (
    EVALUATOR_PARAMETERS,
    GEOREFERENCE_PARAMETERS,
    OWN_VELOCITY_PARAMETERS,
    PARAMETERS,
    Parameter,
    parameters_of,
)
from stab_ros.velocimetry.settings import PRESETS as VELOCITY_PRESETS

_HEAD = """# Parameters

**Answers:** name, default, range and meaning of each parameter, and what each preset sets. **For:** users.

A value out of range, of the wrong type or unknown is refused with the reason. In a running node, `ros2 param describe`
shows range and meaning, and `ros2 param get` the value. This page is made by
`python docs/make_parameters.py > docs/parameters.md`.
"""
_ENGINE = "The tracker's engine: `tracker_node`, and `-p name:=value` of `stab-ros stabilize`"
_PRESETS = """
## Presets of `method`

The tools of the papers with their parameters. Parameters that are given beside the name override them. A preset can
only be chosen at start; in a running node, change the single parameters.
"""
_EVALUATOR = "The evaluator: `evaluator_node`, and `-p name:=value` of `stab-ros evaluate`"
_GEOREFERENCE = "Georeferencing: `georeference_node`, and `-p name:=value` of `stab-ros georeference`"
_VELOCITY = ("Velocimetry: `velocimetry_node`, and `-p name:=value` of `stab-ros velocity`, which take those of "
             "georeferencing too")
_VELOCITY_PRESETS = """
## Presets of velocimetry's `method`

Parameters that are given beside the name override them.
"""
_DISCHARGE = "Discharge: `discharge_node`"
_NODES = {"tracker_node": TrackerSettings, "evaluator_node": EvaluatorSettings,
          "georeference_node": GeoreferenceSettings, "velocimetry_node": VelocimetrySettings,
          "discharge_node": DischargeSettings,
          "pipeline_node": PipelineSettings,
          "bag_player_node": PlayerSettings,
          "bag_recorder_node": RecorderSettings}
# a list of strings, which no settings dataclass holds: the recorder declares it by itself
_TOPICS = Parameter("topics", "", Range("Topics to record, a list of names such as `[/a,/b]`; none: all topics"))
_MORE = {"bag_recorder_node": [_TOPICS], "tracker_node": parameters_of(CompressedSettings, COMPRESSED_PREFIX)}


def _section(title: str, parameters: Iterable[Parameter]) -> str:
    rows = (f"| `{one.name}` | {_default(one)} | {_accepts(one.limits)} | {one.limits.doc} |" for one in parameters)
    return "\n".join([f"\n## {title}\n", "| name | default | accepts | meaning |", "|---|---|---|---|", *rows])


def _presets(head: str, presets: Mapping[str, Mapping[str, Value]]) -> str:
    rows = (f"| `{name}` | {_assignments(preset)} |" for name, preset in presets.items())
    return "\n".join([head, "| name | stands for |", "|---|---|", *rows])


def _assignments(preset: Mapping[str, Value]) -> str:
    return ", ".join(f"`{name}:={_shown(value)}`" for name, value in preset.items())


def _default(parameter: Parameter) -> str:
    return f"`{_shown(parameter.default)}`" if parameter.default != "" else "none"


def _shown(value: Value) -> str:
    return str(value).lower()


def _accepts(limits: Range) -> str:
    if limits.choices:
        return ", ".join(f"`{choice}`" for choice in limits.choices)
    if limits.low is not None and limits.high is not None:
        return f"{limits.low:g} to {limits.high:g}"
    return "" if limits.low is None else f"from {limits.low:g}"


if __name__ == "__main__":
    print(_HEAD + _section(_ENGINE, PARAMETERS.values()))
    print(_presets(_PRESETS, PRESETS))
    print(_section(_EVALUATOR, EVALUATOR_PARAMETERS.values()))
    print(_section(_GEOREFERENCE, GEOREFERENCE_PARAMETERS.values()))
    print(_section(_VELOCITY, OWN_VELOCITY_PARAMETERS.values()))
    print(_presets(_VELOCITY_PRESETS, VELOCITY_PRESETS))
    print(_section(_DISCHARGE, DISCHARGE_PARAMETERS.values()))
    print(_section("Every node", table_of(ManagedSettings).values()))
    for name, settings in _NODES.items():
        print(_section(f"`{name}` alone", [*table_of(settings).values(), *_MORE.get(name, [])]))
