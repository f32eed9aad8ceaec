"""The promises of the demo about the water, on vectors that are made up; and that the truth is one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.demo.__main__ import GSD_M, SIZE, WATER
from stab_ros.demo.checks import flow_checks
from stab_ros.demo.flow import Flow
from stab_ros.demo.flow_picture import draw_flow
from stab_ros.demo.replay import STABILIZED
from stab_ros.demo.water import SECTION_FROM_M, SECTION_TO_M, KnownWater, read_water, write_section
from stab_ros.discharge.settings import DischargeConfig
from stab_ros.io.bag import BagWriter, Message, topic_of
from stab_ros.io.cdr import IMAGE, Header
from stab_ros.io.image_message import image_cdr
from stab_ros.io.velocity_csv import VelocityWriter
from stab_ros.jobs.discharge import DischargeJob, discharge_from_files
from stab_ros.velocimetry.bank import BankVelocity
from stab_ros.velocimetry.vectors import Vectors

STILL = BankVelocity(50, np.array([1e-4, 0.0]), np.eye(2) * 1e-8)


def vectors_of(known: KnownWater, factor: float = 1.0) -> Vectors:
    """One every 0.7 m, each with the known velocity times a factor."""
    x, y = (side.ravel() for side in np.meshgrid(np.arange(-22, 22, 0.7), np.arange(-12.5, 13, 0.7)))
    middle_m = np.column_stack([x, y])
    way_m, n = factor * known.velocity_m_s(middle_m), len(x)
    return Vectors(middle_m - way_m / 2, middle_m + way_m / 2, np.zeros(n, np.int64), np.full(n, 10**9),
                   np.tile(np.eye(2) * 1e-4, (n, 1, 1)), np.zeros((n, 2, 0)), np.arange(n))


def flow_of(folder: Path, factor: float = 1.0) -> Flow:
    known = read_water(WATER, GSD_M, SIZE)
    water = vectors_of(known, factor)
    table, section = folder / "V.csv", folder / "section.csv"
    writer = VelocityWriter(table)
    writer.write(water)
    writer.close()
    write_section(section)
    found = discharge_from_files(DischargeJob(table, section, DischargeConfig(search_m=1.5))).discharge
    return Flow(water, STILL, known, found, known.discharge_m3_s(0.85))


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory) -> Flow:
    return flow_of(tmp_path_factory.mktemp("flow"))


def failures(flow: Flow) -> list[str]:
    return [check.failure for check in flow_checks(flow, Path("velocities.html")) if check.failure]


def test_the_known_velocities_keep_all_promises(right: Flow) -> None:
    assert failures(right) == []
    assert right.discharge.q_m3_s == pytest.approx(right.true_m3_s, rel=0.02)
    assert right.discharge.shares.measured > 0.95
    assert right.medians_m_s[0] == pytest.approx(right.medians_m_s[1], rel=1e-9)
    assert len(right.text().splitlines()) == 4


def test_water_that_is_measured_a_twentieth_too_fast_is_named(tmp_path: Path) -> None:
    (failure,) = failures(flow_of(tmp_path, 1.05))
    assert "within 3%, it is" in failure


def test_a_discharge_that_is_a_quarter_too_small_is_named(tmp_path: Path) -> None:
    assert "the discharge should have the true" in failures(flow_of(tmp_path, 0.75))[-1]


@pytest.mark.parametrize("bank", [replace(STILL, median_m_s=np.array([0.0, -0.002])),
                                  BankVelocity(0, np.full(2, np.nan), np.full((2, 2), np.nan))])
def test_a_bank_that_moves_or_is_unknown_is_named(right: Flow, bank: BankVelocity) -> None:
    (failure,) = failures(replace(right, bank=bank))
    assert failure.startswith("the bank should move by at most 0.001 m/s, it moves by")


def test_no_vectors_keep_no_promise_of_speed(right: Flow) -> None:
    none = replace(right, water=right.water[:0])
    assert "of the 0 vectors" in failures(none)[0]
    assert "no vectors" in none.text()


def test_the_known_discharge_is_depth_times_velocity() -> None:
    """Uniform flow, for which the area of two half parabolas is known in closed form."""
    x_px, y_px = np.array([-100.0, 1100.0]), np.array([-100.0, 700.0])
    uniform = RegularGridInterpolator((x_px, y_px), np.tile([1.2, 0.3], (2, 2, 1)))
    above_m, below_m = 0.05, 1.4
    top, edge = above_m + below_m, np.sqrt(below_m / (above_m + below_m))
    width_m: FloatArray = SECTION_TO_M - SECTION_FROM_M
    area_m2 = float(np.hypot(*width_m)) * (top * (edge - edge**3 / 3) - above_m * edge)
    assert KnownWater(uniform, GSD_M, SIZE).discharge_m3_s(0.9) == pytest.approx(0.9 * 1.2 * area_m2, rel=1e-5)


def test_both_ends_of_the_section_lie_on_land() -> None:
    known = read_water(WATER, GSD_M, SIZE)
    assert not known.velocity_m_s(np.stack([SECTION_FROM_M, SECTION_TO_M])).any()
    assert known.velocity_m_s((SECTION_FROM_M + SECTION_TO_M)[None] / 2)[0, 0] > 1.2


@pytest.mark.parametrize("content", [None, "x_px,y_px\n1,2\n", "x_px,y_px,vx_m_s,vy_m_s\n0,0,a,b\n"])
def test_a_damaged_truth_is_one_line(tmp_path: Path, content: str | None) -> None:
    path = tmp_path / "water.csv"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match=f"^{path}: holds no table of velocities") as caught:
        read_water(path, GSD_M, SIZE)
    assert "\n" not in str(caught.value)


def test_arrows_are_as_blue_or_red_as_the_water_is_fast(tmp_path: Path, right: Flow) -> None:
    bag, path = tmp_path / "bag.mcap", tmp_path / "velocities.png"
    grey = np.full((SIZE[1], SIZE[0], 3), 128, np.uint8)
    with BagWriter(bag) as writer:
        writer.add_topic(topic_of(STABILIZED, IMAGE))
        writer.write(*Message(STABILIZED, 0, 0, image_cdr(grey, "bgr8", Header(0))))
    draw_flow(path, bag, right)
    image = cv2.imread(str(path))
    assert image is not None
    assert image.shape[0] > SIZE[1]
    assert image.shape[1] == SIZE[0]
    fast, slow = ((int(x), int(y)) for x, y in right.known.pixels(np.array([[-15.0, 1.0], [-15.0, -7.0]])))
    assert is_drawn(image, fast, red=True)
    assert not is_drawn(image, slow, red=True)


def is_drawn(image: FloatArray, at: tuple[int, int], red: bool) -> bool:
    """Whether an arrow near a place is reddish."""
    x, y = at
    blue, _, reddish = image[y - 15:y + 15, x - 15:x + 15].reshape(-1, 3).astype(int).T
    return bool((reddish - blue > 80).any()) is red
