"""Surveys as recordings: what is written is read back by rosbags and csv."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from survey_recording import write_checkpoints, write_gcps, write_recording, write_truth

from stab_ros.synthetic.geodetic import Origin
from stab_ros.synthetic.sensors import CONSUMER, PPK, measured
from stab_ros.synthetic.survey_flight import SurveyFlight
from stab_ros.synthetic.survey_scenes import survey

ORIGIN = Origin()


@pytest.fixture(scope="module")
def flight() -> SurveyFlight:
    return SurveyFlight(survey("oblique"), (128, 72), 3)


def messages(path: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(data, connection.msgtype))
    return found


@pytest.mark.parametrize(("attitude", "msgtype"), [("imu", "Imu"), ("gimbal", "QuaternionStamped")])
def test_a_recording_holds_what_camera_and_sensors_saw(tmp_path: Path, flight: SurveyFlight, attitude: str,
                                                       msgtype: str) -> None:
    write_recording(tmp_path / "survey.mcap", flight, CONSUMER, ORIGIN, seed=2, attitude=attitude)
    found = messages(tmp_path / "survey.mcap")
    samples = measured(flight.map_pose_at, flight.duration_s, CONSUMER, 2)
    for index, image in enumerate(found["/cam/image_raw"]):
        np.testing.assert_array_equal(image.data.reshape(72, 128), flight.image(index))
    info = found["/cam/camera_info"][0]
    np.testing.assert_array_equal(info.k.reshape(3, 3), flight.camera.K)
    assert (info.distortion_model, tuple(info.d)) == (flight.camera.model, tuple(flight.camera.D))
    fixes = np.array([(fix.latitude, fix.longitude, fix.altitude) for fix in found["/cam/fix"]])
    np.testing.assert_allclose(ORIGIN.to_map(fixes), samples.position_m, atol=1e-6)
    assert len(found[f"/cam/{attitude}"]) == len(samples.map_q_body)
    assert type(found[f"/cam/{attitude}"][0]).__name__.endswith(msgtype)
    assert [level.data for level in found["/cam/water_level"]] == [flight.wse_m]


def test_messages_are_in_the_order_of_their_stamps(tmp_path: Path, flight: SurveyFlight) -> None:
    write_recording(tmp_path / "survey.mcap", flight, PPK, ORIGIN)
    with AnyReader([tmp_path / "survey.mcap"]) as reader:
        times = [time_ns for _, time_ns, _ in reader.messages()]
    assert times == sorted(times)


def test_points_are_those_that_the_frame_shows(tmp_path: Path, flight: SurveyFlight) -> None:
    write_gcps(tmp_path / "gcps.csv", flight)
    write_checkpoints(tmp_path / "checkpoints.csv", flight)
    for name in ("gcps", "checkpoints"):
        rows = list(csv.DictReader((tmp_path / f"{name}.csv").open()))
        assert len(rows) >= 2
        places = np.array([[float(row[c]) for c in "XYZ"] for row in rows])
        pixels = np.array([[float(row[c]) for c in "xy"] for row in rows])
        np.testing.assert_allclose(flight.view(0).project(places), pixels, atol=1e-9)


def test_noise_of_marked_points_is_as_told(tmp_path: Path) -> None:
    flight = SurveyFlight(survey("nadir"), (128, 72), 1)
    offsets = []
    for seed in range(40):
        write_gcps(tmp_path / "gcps.csv", flight, sigma_px=0.3, seed=seed)
        rows = list(csv.DictReader((tmp_path / "gcps.csv").open()))
        exact = flight.view(0).project(np.array([[float(row[c]) for c in "XYZ"] for row in rows]))
        offsets += [np.array([[float(row[c]) for c in "xy"] for row in rows]) - exact]
    np.testing.assert_allclose(np.concatenate(offsets).std(), 0.3, rtol=0.1)


def test_the_truth_tells_pose_and_homography(tmp_path: Path, flight: SurveyFlight) -> None:
    write_truth(tmp_path / "truth.csv", flight)
    row = list(csv.DictReader((tmp_path / "truth.csv").open()))[2]
    H = np.array([float(row[f"h{i}{j}"]) for i in range(3) for j in range(3)]).reshape(3, 3)
    np.testing.assert_array_equal(H, flight.ref_H_cur(2))
    place = [float(row[name]) for name in ("east_m", "north_m", "up_m")]
    np.testing.assert_array_equal(place, flight.view(2).pose.position_m)
    assert int(row["stamp_ns"]) == flight.stamp_ns(2)
