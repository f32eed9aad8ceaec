"""The complete result of the demo: its files, which promises hold, and what to open first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from stab_ros.core.errors import StabRosError
from stab_ros.core.settings import Value
from stab_ros.demo.checks import Check, checks, flow_checks, judging_check
from stab_ros.demo.command import apart, as_command
from stab_ros.demo.flow import Flow, measure
from stab_ros.demo.flow_picture import draw_flow
from stab_ros.demo.judgement import Judgement, judge
from stab_ros.demo.pictures import show
from stab_ros.demo.result import ReplayResult, compare, read_answers, write_table
from stab_ros.demo.water import KnownWater
from stab_ros.io.homographies import HomographyRow


@dataclass(frozen=True)
class Files:
    """The output files of the demo."""

    folder: Path

    @property
    def bag(self) -> Path:
        return self.folder / "stabilized.mcap"

    @property
    def log(self) -> Path:
        return self.folder / "log"

    @property
    def errors(self) -> Path:
        return self.folder / "errors.txt"

    @property
    def report(self) -> Path:
        return self.folder / "report" / "index.html"

    @property
    def all(self) -> Mapping[str, Path]:
        """All files for the user, by description."""
        named = {"homographies": "H.csv", "the command's": "H_command.csv", "video": "before_after.mp4",
                 "picture": "before_after.png", "velocities": "velocities.png", "their page": "velocities.html",
                 "vectors": "V.csv", "cross-section": "section.csv"}
        return {"stabilised bag": self.bag, **{what: self.folder / name for what, name in named.items()},
                "errors": self.errors, "report": self.report}

    def remove(self) -> None:
        """Removes the files of an earlier run."""
        for path in self.all.values():
            path.unlink(missing_ok=True)


@dataclass(frozen=True, eq=False)
class DemoResult:
    """The result of the demo. broken: further failures, one line each."""

    files: Files
    result: ReplayResult
    judgement: Judgement | None
    flow: Flow | None
    checks: Sequence[Check]
    broken: Sequence[str]

    @property
    def failures(self) -> list[str]:
        """One line for each failure; empty if all promises hold."""
        return [*self.broken, *(check.failure for check in self.checks if check.failure)]

    def text(self) -> str:
        """Measurements, promises and files, as text."""
        made = [f"{what:<16}{path}" for what, path in self.files.all.items() if path.exists()]
        parts = (self.result, self.judgement, self.flow)
        told = [line for part in parts if part is not None for line in (part.text(), "")]
        return "\n".join([*told, *(check.text() for check in self.checks), "", *made])

    def what_to_open(self) -> str:
        """The last lines of the output."""
        video = self.files.all["video"]
        if self.failures:
            return (f"open first: {self.files.errors} (what did not hold), then\n"
                    f"            {self.files.log} (what the nodes said)")
        return (f"open first: {self.files.report} (how still it stands), then\n"
                f"            {video} (as recorded and stabilised, side by side) and\n"
                f"            {self.files.all['velocities']} (how fast the water runs)")


def reach(recording: Path, truth: Sequence[HomographyRow], water: KnownWater, files: Files,
          judging: Mapping[str, Value], broken: str) -> DemoResult:
    """Evaluates the recorded bag, as far as it is complete; missing parts are reported as failures.

    water: how it is known to move. judging: parameters of the evaluator. broken: why the replay failed; "" if it did
    not.

    Raises:
        InputError: the bag is unreadable. WorkError: a table cannot be written.
    """
    answers = read_answers(files.bag)
    write_table(files.all["homographies"], truth, answers)
    result, troubles = compare(truth, answers), [broken] if broken else []
    command = apart(as_command(recording, files.all["the command's"]), answers)
    found, judgement, flow = [*checks(result, answers, command, files.folder)], None, None
    with _noted(troubles):
        show(recording, files.bag, files.folder)
    with _noted(troubles):
        judgement = judge(files.bag, files.report.parent, judging)
        found.append(judging_check(judgement, files.log))
    with _noted(troubles):
        page = files.all["their page"]
        flow = measure(files.bag, water, files.all["vectors"], page, files.all["cross-section"])
        found += flow_checks(flow, page)
        draw_flow(files.all["velocities"], files.bag, flow)
    verdict = DemoResult(files, result, judgement, flow, found, troubles)
    lines = [result.text(), "", *(check.text() for check in found), "", *verdict.failures]
    files.errors.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return verdict


@contextmanager
def _noted(troubles: list[str]) -> Iterator[None]:
    """Adds the error of the block to `troubles`."""
    try:
        yield
    except StabRosError as error:
        troubles.append(str(error))
