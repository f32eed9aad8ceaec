"""Rules of a command line that give topics and services other names (`-r FROM:=TO`), and those that nothing uses.

rcl applies a rule to the name as a node expands it, so `image_raw`, `~/image_raw` and `/camera/image_raw` may be the
same. A rule for one node names it as it is called after `__node`, but for the rule `__node` itself.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from stab_ros.core.settings import did_you_mean
from stab_ros.core.text import one_line
from stab_ros.io import topics
from stab_ros.nodes.parameter_files import in_words
from stab_ros.nodes.params import DeclaringNode
from stab_ros.nodes.ros_arguments import values_of

_FROM = re.compile(r"((?P<node>\w+):(?!//))?(ros(topic|service)://)?(?P<name>.*)")
_OWN_NAME, _OF_NODES = ("__node", "__name"), ("__node", "__name", "__ns")
# last parts of names of what rcl and rclpy make, or not, as parameters say
_OF_ROS = {"rosout", "parameter_events", "clock", "tf", "tf_static", "diagnostics", "transition_event", "change_state",
           "get_state", "get_available_states", "get_available_transitions", "get_transition_graph",
           "get_type_description", "get_logger_levels", "set_logger_levels"}
# topics of this package: a node may take one later, and a launch file may remap for all of its nodes
_TOPICS = [value for name, value in vars(topics).items() if name.endswith("_TOPIC")]
_NODES = [value for name, value in vars(topics).items() if name.endswith("_NAME")]


@dataclass(frozen=True)
class Rule:
    """word: as it was given. node: that it is for, "" for all. name: to which another one is given."""

    word: str
    node: str
    name: str


def rules_of(words: Sequence[str]) -> list[Rule]:
    """The rules of a command line that rcl has taken."""
    found = []
    for word in values_of(words, "-r", "--remap"):
        parts = _FROM.fullmatch(word.partition(":=")[0])
        if parts is not None:
            found.append(Rule(one_line(word)[:500], parts["node"] or "", parts["name"]))
    return found


def rules_for_others(words: Sequence[str], nodes: Sequence[DeclaringNode]) -> Iterator[str]:
    """A warning for each rule of a command line that is for another node than those of the process."""
    for rule in rules_of(words):
        names = [node.first_name if rule.name in _OWN_NAME else node.get_name() for node in nodes]
        if rule.node and rule.node not in names:
            meant = did_you_mean(rule.node, names)
            yield (f"-r {rule.word}: nothing of it applies, it is for a node {rule.node}, and "
                   f"{in_words([node.get_fully_qualified_name() for node in nodes])}{meant and f'; {meant}'}")


def unused_rules(words: Sequence[str], nodes: Sequence[DeclaringNode]) -> Iterator[str]:
    """A warning for each rule of a topic or service that these nodes do not have so far, with the nearest name."""
    for rule in rules_of(words):
        concerned = [node for node in nodes if rule.node in ("", node.get_name())]
        if concerned and _is_of_a_topic(rule) and not any(_uses(node, rule) for node in concerned):
            meant = did_you_mean(rule.name, {_written_as(rule, name, node) for node in concerned
                                             for name in node.names_in_use})
            names = ", ".join(node.get_fully_qualified_name() for node in concerned)
            yield (f"-r {rule.word} has had no effect: there is no topic or service {rule.name} of {names} so far"
                   f"{meant and f'; {meant}'}")


def _is_of_a_topic(rule: Rule) -> bool:
    return rule.name not in _OF_NODES and rule.name.rpartition("/")[2] not in _OF_ROS


def _uses(node: DeclaringNode, rule: Rule) -> bool:
    """Whether it uses the name, or might: what is below a topic belongs to it, as image_transport has it."""
    full, known = node.expanded(rule.name), node.names_in_use | (set() if node.OF_BAGS else _possible(node))
    return any(full == name or full.startswith(f"{name}/") for name in known)


def _possible(node: DeclaringNode) -> set[str]:
    """Topics of this package in the namespace of a node, also below the names of nodes."""
    above = ["", *(f"{name}/" for name in (node.get_name(), *_NODES))]
    return {node.expanded(f"{place}{topic}") for place in above for topic in _TOPICS if not topic.startswith("/")}


def _written_as(rule: Rule, full: str, node: DeclaringNode) -> str:
    """A full name as the user writes the one of the rule: whole, below the node's own, or in its namespace."""
    if rule.name.startswith("/"):
        return full
    own = f"{node.get_fully_qualified_name()}/"
    if rule.name.startswith("~"):
        return f"~/{full.removeprefix(own)}" if full.startswith(own) else full
    return full.removeprefix(f"{node.get_namespace().rstrip('/')}/")
