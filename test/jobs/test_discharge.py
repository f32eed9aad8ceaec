"""`stab-ros discharge` on real files: tables and recordings, sections of both kinds, outputs, rating curves."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from analytic_river import PROFILES, WIDTH_M, WSE_M, River, parabola_m
from report_page import Page
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.cli import main
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.io.bag import BagWriter, topic_of
from stab_ros.io.cdr import FLOAT64, NAV_SAT_FIX, POINT_CLOUD2, Header, serialize
from stab_ros.io.fix_message import Fix, fix_cdr
from stab_ros.io.velocity_csv import VelocityWriter
from stab_ros.io.velocity_message import velocity_cdr

RIVER = River(PROFILES["froude"])
NS = 1_000_000_000
LINE = ["--from", "0,0", "--to", "0,20"]


@pytest.fixture
def velocity(tmp_path: Path) -> Path:
    with VelocityWriter(tmp_path / "V.csv") as table:
        table.write(RIVER.vectors(np.random.default_rng(0), 1500, WIDTH_M * 2 / 3))
    return tmp_path / "V.csv"


def survey(path: Path, header: str = "X,Y,Z", depths: bool = False) -> Path:
    s = np.concatenate([[-1.0], np.linspace(0, WIDTH_M, 25), [WIDTH_M + 1]])
    s = s[1:-1] if depths else s
    height = parabola_m(s) if depths else WSE_M - parabola_m(s)
    rows = ([0.0, one, h] if header.startswith("X") else [one, h] for one, h in zip(s, height, strict=True))
    path.write_text("\n".join([header, *(",".join(map(repr, map(float, row))) for row in rows)]) + "\n")
    return path


def recording(path: Path, levels: list[tuple[int, float]], frame_id: str = "map", origin: LocalFrame | None = None,
              others: tuple[LocalFrame, ...] = (), first_s: int = 100,
              surface_m: tuple[float, float] = (WSE_M, WSE_M)) -> Path:
    """Velocities of three seconds and water levels, as a node records them. surface_m: where, and of which scale."""
    with BagWriter(path) as bag:
        bag.add_topic(topic_of("/camera/velocity", POINT_CLOUD2))
        bag.add_topic(topic_of("/water_level", FLOAT64))
        if origin is not None:
            bag.add_topic(topic_of("/camera/georeference_node/origin", NAV_SAT_FIX))
            for frame in (origin, *others):
                fix = fix_cdr(Fix(0, frame.latitude_deg, frame.longitude_deg, frame.height_m))
                bag.write("/camera/georeference_node/origin", 0, 0, fix)
        for second, wse_m in levels:
            bag.write("/water_level", second * NS, second * NS, serialize(ros.std_msgs__msg__Float64(wse_m), FLOAT64))
        for second in range(first_s, first_s + 3):
            vectors = RIVER.vectors(np.random.default_rng(second), 500, start_s=float(second))
            stamp_ns = (second + 1) * NS
            cloud = velocity_cdr(vectors, surface_m[0], Header(stamp_ns, frame_id), surface_m[1])
            bag.write("/camera/velocity", stamp_ns, stamp_ns, cloud)
    return path


def q_of(path: Path) -> dict[str, float]:
    figures: dict[str, float] = json.loads(path.read_text())
    return figures


def test_table_json_csv_and_page(velocity: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    section = survey(tmp_path / "S.csv")
    assert main(["discharge", str(velocity), str(section), "--wse", "10", "--json", str(tmp_path / "Q.json"), "--csv",
                 str(tmp_path / "Q.csv"), "--html", str(tmp_path / "page")]) == 0
    figures, told = q_of(tmp_path / "Q.json"), capsys.readouterr().out
    assert figures["q_m3_s"] == pytest.approx(RIVER.discharge_m3_s(), rel=0.05)
    assert figures["low_m3_s"] < RIVER.discharge_m3_s() < figures["high_m3_s"]
    assert f"discharge {figures['q_m3_s']:.4g} m3/s, with 95 % between" in told
    assert "extrapolated 2" in told
    assert told.count("filled") == 7
    with (tmp_path / "Q.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert sum(float(row["part_m3_s"]) for row in rows) == pytest.approx(figures["q_m3_s"])
    page = Page(tmp_path / "page" / "index.html")
    assert len(page.images) == 6
    assert all(image["alt"] for image in page.images)
    assert ("/q_m3_s", f"{figures['q_m3_s']:.3f}") in page.numbers
    assert figures["measured_width_share"] == pytest.approx(2 / 3, abs=0.05)
    assert f"vectors over {figures['measured_width_share']:.1%} of the width, at" in told
    assert "/measured_width_share" in [where for where, _ in page.numbers]


def test_water_on_dry_ground_is_said_everywhere(velocity: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
                                                ) -> None:
    section = survey(tmp_path / "S.csv")
    assert main(["discharge", str(velocity), str(section), "--wse", "9.5", "--json", str(tmp_path / "Q.json"), "--html",
                 str(tmp_path / "page")]) == 0
    warning = next(one for one in json.loads((tmp_path / "Q.json").read_text())["warnings"] if "calls dry" in one)
    assert warning in capsys.readouterr().err
    assert warning in (tmp_path / "page" / "index.html").read_text()


@pytest.mark.parametrize(("header", "depths", "more"), [
    ("chainage,Z", False, ["--wse", "10", *LINE]), ("chainage,depth", True, LINE), ("X,Y,depth", True, []),
    ("X,Y,Z/Depth", True, ["--depth"]), ("X,Y,Z/Depth", False, ["--elevation", "--wse", "10"])])
def test_every_kind_of_section_gives_one_discharge(velocity: Path, tmp_path: Path, header: str, depths: bool,
                                                   more: list[str]) -> None:
    section = survey(tmp_path / "S.csv", header, depths)
    assert main(["discharge", str(velocity), str(section), "--json", str(tmp_path / "Q.json"), *more]) == 0
    assert q_of(tmp_path / "Q.json")["q_m3_s"] == pytest.approx(RIVER.discharge_m3_s(), rel=0.05)


@pytest.mark.parametrize(("more", "says"), [
    (LINE, "has places of its own, so --from and --to must not be given"),
    (["--from-chainage", "5"], "--from-chainage is the chainage at --from")])
def test_a_line_is_for_distances_alone(velocity: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                       more: list[str], says: str) -> None:
    assert main(["discharge", str(velocity), str(survey(tmp_path / "S.csv")), "--wse", "10", *more]) == 2
    assert says in capsys.readouterr().err


def test_each_point_twice_is_the_same_discharge(velocity: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
                                                ) -> None:
    once, twice = survey(tmp_path / "S.csv"), tmp_path / "T.csv"
    header, *rows = once.read_text().splitlines()
    twice.write_text("\n".join([header, *(row for row in rows for _ in range(2))]))
    found = []
    for path in (once, twice):
        assert main(["discharge", str(velocity), str(path), "--wse", "10", "--json", str(tmp_path / f"{path.stem}.json")
                     ]) == 0
        figures = q_of(tmp_path / f"{path.stem}.json")
        found.append((figures["q_m3_s"], figures["sigma_m3_s"], figures["search_m"]))
    assert found[0] == found[1]
    assert "27 rows repeat a point, which counts once" in capsys.readouterr().err


def test_a_recording_with_its_water_level(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = recording(tmp_path / "v.mcap", [(90, WSE_M), (101, WSE_M + 0.01), (500, 99.0)])
    assert main(["discharge", str(bag), str(survey(tmp_path / "S.csv")), "--json", str(tmp_path / "Q.json")]) == 0
    figures = q_of(tmp_path / "Q.json")
    assert figures["wse_m"] == WSE_M + 0.01
    assert figures["vectors"] > 100
    assert "(recorded)" in capsys.readouterr().out


def test_a_stale_level_and_another_level_are_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    section = survey(tmp_path / "S.csv")
    bag = recording(tmp_path / "v.mcap", [(10, WSE_M + 0.2)], first_s=1000)
    assert main(["discharge", str(bag), str(section)]) == 0
    said = capsys.readouterr().err
    assert "the water level is 993 s old, it must not be older than 900 s" in said
    assert "the velocities were measured on a water surface at 10 m" in said


def test_velocities_of_a_given_scale_contradict_no_level_and_tell_none(tmp_path: Path,
                                                                       capsys: pytest.CaptureFixture[str]) -> None:
    """As of `gsd_m`: their map lies at 0 m because nobody told a level."""
    section, bag = survey(tmp_path / "S.csv"), recording(tmp_path / "v.mcap", [], surface_m=(0.0, np.nan))
    assert main(["discharge", str(bag), str(section), "--wse", "10"]) == 0
    assert "water surface at" not in capsys.readouterr().err
    assert main(["discharge", str(bag), str(section)]) == 2
    assert "bed elevations need the water surface elevation; give --wse" in capsys.readouterr().err


@pytest.mark.parametrize(("second", "says"), [
    (10, ""), (500, ""), (2000, "the first water level comes 1897 s after the velocities")])
def test_levels_of_the_last_quarter_of_an_hour_are_taken(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                                         second: int, says: str) -> None:
    bag, section = recording(tmp_path / "v.mcap", [(second, WSE_M)]), survey(tmp_path / "S.csv")
    assert main(["discharge", str(bag), str(section)]) == 0
    said = capsys.readouterr().err
    assert says in said if says else "water level" not in said


def test_without_a_topic_of_levels_that_of_the_velocities_counts(tmp_path: Path) -> None:
    bag, section = recording(tmp_path / "v.mcap", []), survey(tmp_path / "S.csv")
    assert main(["discharge", str(bag), str(section), "--json", str(tmp_path / "Q.json")]) == 0
    assert q_of(tmp_path / "Q.json")["wse_m"] == WSE_M


def test_a_section_of_a_survey_in_utm(tmp_path: Path, velocity: Path, capsys: pytest.CaptureFixture[str]) -> None:
    origin = LocalFrame(46.1, 7.2, 0.0)
    s = np.concatenate([[-1.0], np.linspace(0, WIDTH_M, 25), [WIDTH_M + 1]])
    utm = origin.to_crs("EPSG:32632", np.column_stack([0 * s, s, 0 * s]))
    rows = (f"{x!r},{y!r},{z!r}" for (x, y, _), z in zip(utm.tolist(), (WSE_M - parabola_m(s)).tolist(), strict=True))
    (tmp_path / "S.csv").write_text("\n".join(["easting,northing,Z", *rows]))
    call = ["discharge", str(velocity), str(tmp_path / "S.csv"), "--wse", "10", "--json", str(tmp_path / "Q.json")]
    assert main(call) == 2
    assert "in the coordinates of the map" in capsys.readouterr().err
    assert main([*call, "--crs", "EPSG:32632"]) == 2
    assert "--origin" in capsys.readouterr().err
    assert main([*call, "--crs", "EPSG:32632", "--origin", "46.1,7.2"]) == 0
    assert q_of(tmp_path / "Q.json")["q_m3_s"] == pytest.approx(RIVER.discharge_m3_s(), rel=0.05)
    bag = recording(tmp_path / "v.mcap", [], origin=origin)
    assert main(["discharge", str(bag), *call[2:-1], str(tmp_path / "Q2.json"), "--crs", "EPSG:32632"]) == 0
    assert q_of(tmp_path / "Q2.json")["q_m3_s"] == pytest.approx(RIVER.discharge_m3_s(), rel=0.05)
    call = ["discharge", str(bag), *call[2:-2], "--crs", "EPSG:32632"]
    assert main([*call, "--origin", "46.2,7.2"]) == 0
    assert "the origin that is given lies 1.11e+04 m from that of its map, 46.1,7.2, which is taken" in (
        capsys.readouterr().err)
    recording(tmp_path / "two.mcap", [], origin=origin, others=(LocalFrame(46.2, 7.2, 0.0),))
    assert main(["discharge", str(tmp_path / "two.mcap"), *call[2:]]) == 2
    assert "the origin of its map changes" in capsys.readouterr().err


def test_a_rating_curve_grows(tmp_path: Path, velocity: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rating, section = tmp_path / "R.csv", survey(tmp_path / "S.csv")
    call = ["discharge", str(velocity), str(section), "--wse", "10", "--rating", str(rating)]
    assert main(call) == 0
    assert "none yet: 1 different stage tells no rating curve" in capsys.readouterr().out
    assert main(call) == 0  # the same velocities again
    assert "note: " in (told := capsys.readouterr().err)
    assert "of the same velocities" in told
    assert len(rating.read_text().splitlines()) == 2
    with rating.open("a") as file:
        file.write("9.2,6.4,0.4,0.047,a\n9.5,11,0.6,0.047,b\n9.8,15.5,0.8,0.047,c\n")
    assert main(["discharge", "--rating", str(rating), "--json", str(tmp_path / "R.json"), "--html",
                 str(tmp_path / "page")]) == 0
    assert "rating curve Q = " in capsys.readouterr().out
    assert 0.3 < json.loads((tmp_path / "R.json").read_text())["rating"]["b"] < 3
    assert len(Page(tmp_path / "page" / "index.html").images) == 1


def rows_of(table: Path) -> list[dict[str, str]]:
    with table.open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_gauging_is_known_by_its_velocities(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                              capsys: pytest.CaptureFixture[str]) -> None:
    """Files of one name are two gaugings where their velocities differ; one file by two names, or a copy, is one."""
    survey(tmp_path / "S.csv")
    for day in (1, 2):
        (tmp_path / f"day{day}").mkdir()
        with VelocityWriter(tmp_path / f"day{day}" / "V.csv") as table:
            table.write(RIVER.vectors(np.random.default_rng(day), 900))
        monkeypatch.chdir(tmp_path / f"day{day}")
        assert main(["discharge", "V.csv", "../S.csv", "--wse", "10", "--rating", "../R.csv"]) == 0
    first, second = rows_of(tmp_path / "R.csv")
    assert "replaced" not in capsys.readouterr().err
    second_again = str(tmp_path / "day2" / "V.csv")
    assert main(["discharge", second_again, "../S.csv", "--wse", "10.1", "--rating", "../R.csv"]) == 0
    assert "is replaced" in capsys.readouterr().err
    assert rows_of(tmp_path / "R.csv")[0] == first
    again = rows_of(tmp_path / "R.csv")[1]
    assert (again["source"], again["recording"], again["stage_m"]) == (second["source"], second["recording"], "10.1")
    shutil.copy(tmp_path / "day1" / "V.csv", "copy.csv")
    assert main(["discharge", "copy.csv", "../S.csv", "--wse", "10", "--rating", "../R.csv"]) == 0
    assert len(rows_of(tmp_path / "R.csv")) == 2


def test_other_velocities_of_one_file_are_kept_and_doubted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    call = ["discharge", str(tmp_path / "V.csv"), str(survey(tmp_path / "S.csv")), "--wse", "10", "--rating",
            str(tmp_path / "R.csv")]
    for seed in (1, 2):
        with VelocityWriter(tmp_path / "V.csv") as table:
            table.write(RIVER.vectors(np.random.default_rng(seed), 900))
        assert main(call) == 0
    assert "not of the same velocities; both count" in capsys.readouterr().err
    assert len(rows_of(tmp_path / "R.csv")) == 2


def test_table_and_recording_of_one_measurement_are_one_gauging(tmp_path: Path) -> None:
    bag, section = recording(tmp_path / "V.mcap", [(100, WSE_M)]), survey(tmp_path / "S.csv")
    with VelocityWriter(tmp_path / "V.csv") as table:
        for second in range(100, 103):
            table.write(RIVER.vectors(np.random.default_rng(second), 500, start_s=float(second)))
    for source in (bag, tmp_path / "V.csv"):
        assert main(["discharge", str(source), str(section), "--wse", "10", "--rating", str(tmp_path / "R.csv")]) == 0
    assert [Path(row["source"]).name for row in rows_of(tmp_path / "R.csv")] == ["V.csv"]


def test_own_sigma_of_a_gauging_is_that_with_alpha_known(tmp_path: Path, velocity: Path) -> None:
    call = ["discharge", str(velocity), str(survey(tmp_path / "S.csv")), "--wse", "10", "--rating"]
    assert main([*call, str(tmp_path / "R.csv")]) == 0
    assert main([*call, str(tmp_path / "K.csv"), "--alpha-sigma", "0"]) == 0
    row, = rows_of(tmp_path / "R.csv")
    known, = rows_of(tmp_path / "K.csv")
    total = float(known["sigma_m3_s"]) / float(known["discharge_m3_s"])
    assert float(row["own_sigma"]) == pytest.approx(total, rel=0.05)  # standard deviations of 1000 draws
    assert float(row["own_sigma"]) == pytest.approx(float(known["own_sigma"]))


@pytest.mark.parametrize("name", ["seed", "verticals", "search"])
def test_the_default_may_be_given(tmp_path: Path, velocity: Path, capsys: pytest.CaptureFixture[str], name: str
                                  ) -> None:
    call = ["discharge", str(velocity), str(survey(tmp_path / "S.csv")), "--wse", "10"]
    assert main(call) == 0
    without = capsys.readouterr().out
    assert main([*call, f"--{name}", "0"]) == 0
    assert capsys.readouterr().out == without


@pytest.mark.parametrize(("header", "depths", "more", "says"), [
    ("X,Y,Z", False, [], "give --wse"), ("X,Y,Z/Depth", False, ["--wse", "10"], "--elevation or --depth"),
    ("chainage,Z", False, ["--wse", "10"], "--from X,Y --to X,Y"), ("X,Y,Z", False, ["--wse", "3"], "is dry"),
    ("chainage,Z", False, ["--wse", "10", "--from", "0,300", "--to", "0,320"], "the nearest is 28"),
    ("X,Y,Z", False, ["--wse", "10", "--filling", "linear"], "froude"),
    ("X,Y,Z", False, ["--wse", "10", "--from", "0,0"], "belong together"),
])
def test_faults_are_one_line(velocity: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], header: str,
                             depths: bool, more: list[str], says: str) -> None:
    section = survey(tmp_path / "S.csv", header, depths)
    assert main(["discharge", str(velocity), str(section), *more]) == 2
    told = capsys.readouterr()
    assert says in told.err
    assert told.err.count("\n") == 1
    assert not told.out.strip()


def test_elevations_given_as_depths_are_doubted(velocity: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
                                                ) -> None:
    assert main(["discharge", str(velocity), str(survey(tmp_path / "S.csv")), "--depth"]) == 0
    assert "must be named Z" in capsys.readouterr().err


def test_pixels_and_recordings_without_velocities_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]
                                                              ) -> None:
    section = survey(tmp_path / "S.csv")
    assert main(["discharge", str(recording(tmp_path / "px.mcap", [], "camera")), str(section)]) == 2
    assert "px/s" in capsys.readouterr().err
    with BagWriter(tmp_path / "none.mcap") as bag:
        bag.add_topic(topic_of("/water_level", FLOAT64))
    assert main(["discharge", str(tmp_path / "none.mcap"), str(section)]) == 2
    assert "has no velocities (no PointCloud2 at all)" in capsys.readouterr().err
    assert main(["discharge", str(tmp_path / "none.mcap")]) == 2
    assert "SECTION.csv" in capsys.readouterr().err
