"""Folders of images as people have them: order, hidden files, EXIF, pages, what lies beside the images."""

from __future__ import annotations

import itertools
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image as Pillow
from PIL import ImageOps
from recordings import entries, write_folder, write_mcap, write_rosbag2
from rosbags.rosbag2 import StoragePlugin

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.types import Frame
from stab_ros.io.image_folder import ImageFolder
from stab_ros.io.source import BagSource, Kind, kind_of, open_source
from stab_ros.synthetic.flight import Shot

SIZE = (48, 32)


def picture(number: int = 0) -> NDArray[np.uint8]:
    """RGB, without symmetry; the number is in its first pixel, which a PNG keeps."""
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    found = np.stack([4 * x, 6 * y, x + y], axis=-1).astype(np.uint8)
    found[0, 0] = number
    return found


def save(path: Path, number: int = 0, exif: Pillow.Exif | None = None) -> None:
    Pillow.fromarray(picture(number)).save(path, exif=exif or Pillow.Exif())


def exif(orientation: int = 1, taken: str = "", subseconds: str = "") -> Pillow.Exif:
    made = Pillow.Exif()
    made[0x0112] = orientation
    if taken:
        made.get_ifd(0x8769).update({0x9003: taken, 0x9291: subseconds})
    return made


def read(folder: Path, fps: float | None = None) -> tuple[list[Frame], list[str]]:
    """Frames and warnings, of a folder that can be read in full."""
    reader = ImageFolder(folder, fps)
    decoded = [one for _, one in reader.frames()]
    assert reader.count == len(decoded)
    frames = [one for one in decoded if isinstance(one, Frame)]
    assert len(frames) == len(decoded)
    return frames, reader.warnings


def numbers(frames: list[Frame]) -> list[int]:
    return [int(frame.image[0, 0, 0]) for frame in frames]


# --- which files, in which order -------------------------------------------------------------------------------------


def test_numbers_sort_as_people_count_and_that_is_said(tmp_path: Path) -> None:
    for number in range(12):
        save(tmp_path / f"frame{number}.png", number)
    frames, warnings = read(tmp_path)
    assert numbers(frames) == list(range(12))
    assert [frame.stamp_ns for frame in frames] == [10**9 + 40 * 10**6 * number for number in range(12)]
    (said,) = warnings
    assert said.startswith(f"{tmp_path}: the images are in the order of the numbers")
    assert "frame2.png before frame10.png" in said


@pytest.mark.parametrize("names", [
    ["a_08", "a_09", "a_10"], ["1700000000.25", "1700000000.75", "1700000001.25"],
    ["20230504_101500_0001", "20230504_101500_0002", "20230504_101501_0001"], ["view-1", "view-2", "view"],
    ["view", "view1", "view2"],
], ids=lambda names: names[1])
def test_names_that_sort_alike_either_way_stay_without_a_word(names: list[str], tmp_path: Path) -> None:
    for number, name in enumerate(names):
        save(tmp_path / f"{name}.png", number)
    frames, warnings = read(tmp_path)
    assert (numbers(frames), warnings) == ([0, 1, 2], [])


def test_companions_hidden_files_folders_and_other_files_are_no_frames(tmp_path: Path) -> None:
    for number in range(3):
        save(tmp_path / f"IMG_{number:04}.JPG", number)
        (tmp_path / f"._IMG_{number:04}.JPG").write_bytes(b"\0\5\x16\7" + bytes(4092))  # a Mac on another's disk
        (tmp_path / f"IMG_{number:04}.THM").write_bytes(b"\xff\xd8")
    for name in (".DS_Store", "Thumbs.db", "desktop.ini", "notes.txt", "flight.SRT"):
        (tmp_path / name).write_bytes(b"\0")
    (tmp_path / "thumbnails.jpg").mkdir()
    save(tmp_path / "thumbnails.jpg" / "IMG_0000.JPG")
    frames, warnings = read(tmp_path)
    assert len(frames) == 3
    assert warnings == [f"{tmp_path}: 3 hidden files, as ._IMG_0000.JPG, are left out"]


@pytest.mark.parametrize("taken", [
    ("IMG_9998.JPG", "IMG_9999.JPG", "IMG_0001.JPG", "IMG_0002.JPG"), ("DJI_0998.jpg", "DJI_0999.JPG", "DJI_0000.JPG"),
    ("f2_998.jpg", "f2_999.jpg", "f2_1.jpg"), ("G9985.png", "G9990.png", "G9995.png", "G0000.png", "G0005.png"),
], ids=lambda names: names[0])
def test_a_counter_that_began_again_is_said(taken: tuple[str, ...], tmp_path: Path) -> None:
    for name in taken:
        save(tmp_path / name)
    last = next(name for name, after in itertools.pairwise(taken) if "9" in name and "9" not in after)
    first = taken[taken.index(last) + 1]
    (said,) = read(tmp_path)[1]
    assert said == (f"{tmp_path}: the numbers jump from {taken[-1]} to {taken[0]}; if the counter of the camera went "
                    f"from {last} on to {first}, rename the images up to {taken[-1]} so that they come last")


@pytest.mark.parametrize("numbers_found", [
    (1, 2, 3), (9997, 9998, 9999), (0, 3333, 6666, 9999), (5, 6, 9999), (1, 9, 10), (0, 400, 999), (1, 98, 99),
    (0, 9999)])
def test_other_gaps_in_the_numbers_are_none_of_a_counter(numbers_found: tuple[int, ...], tmp_path: Path) -> None:
    for number in numbers_found:
        save(tmp_path / f"IMG_{number:04}.JPG")
    assert read(tmp_path)[1] == []


def test_two_series_in_one_folder_are_said(tmp_path: Path) -> None:
    for number in range(3):
        save(tmp_path / f"DJI_{number:04}.png", number)
        save(tmp_path / f"GOPR{number:04}.jpg", number)
    frames, warnings = read(tmp_path)
    assert len(frames) == 6
    assert [*map(str, warnings)] == [
        f"{tmp_path}: the names of the images follow 2 patterns, DJI_#.png (3), GOPR#.jpg (3); all are frames of one "
        "recording"]


def test_pictures_without_a_number_beside_a_series_are_left_out_and_said(tmp_path: Path) -> None:
    """A mean or a mask that somebody made from the frames; it sorts before them and would be the reference."""
    for number in range(3):
        save(tmp_path / f"frame_{number:04}.png", number)
    save(tmp_path / "average.png", 99)
    frames, warnings = read(tmp_path)
    assert numbers(frames) == [0, 1, 2]
    said = "image without a number in the name, average.png, is left out; 3 others have one"
    assert warnings == [f"{tmp_path}: 1 {said}"]
    cv2.imwrite(str(tmp_path / "mask.jp2"), picture())
    frames, warnings = read(tmp_path)
    assert numbers(frames) == [0, 1, 2]
    assert "2 images without a number in the name, average.png, mask.jp2, are left out" in warnings[0]


def test_as_many_pictures_without_a_number_as_with_one_are_frames_and_said(tmp_path: Path) -> None:
    for number, name in enumerate(("left", "right", "shot1", "shot2")):
        save(tmp_path / f"{name}.png", number)
    frames, warnings = read(tmp_path)
    assert numbers(frames) == [0, 1, 2, 3]
    assert warnings == [
        f"{tmp_path}: 2 images without a number in the name, left.png, right.png, count as frames; 2 others have one"]


@pytest.mark.parametrize("names", [
    ["dawn", "dusk", "noon"], ["bank", "dusk", "shot1"], ["view", "view (2)", "view (3)"]], ids=lambda names: names[2])
def test_pictures_without_numbers_stay_frames_where_there_is_no_series(names: list[str], tmp_path: Path) -> None:
    for name in names:
        cv2.imwrite(str(tmp_path / f"{name}.jp2"), picture())
    frames, warnings = read(tmp_path)
    assert (len(frames), warnings) == (3, [])


def test_pictures_that_cannot_be_read_are_named_unless_they_accompany_one_that_can(tmp_path: Path) -> None:
    save(tmp_path / "DJI_0001.jpg")
    (tmp_path / "DJI_0001.DNG").write_bytes(b"II*\0")
    assert read(tmp_path)[1] == []
    Pillow.fromarray(picture()).save(tmp_path / "DJI_0002.gif")
    (said,) = read(tmp_path)[1]
    assert "*.gif files are left out" in said
    (tmp_path / "DJI_0001.jpg").unlink()
    with pytest.raises(InputError, match=r"nor images .* but \*\.dng, \*\.gif, to be converted first"):
        kind_of(tmp_path)


def test_images_in_a_sub_folder_are_pointed_at(tmp_path: Path) -> None:
    (tmp_path / "100MEDIA").mkdir()
    save(tmp_path / "100MEDIA" / "DJI_0001.jpg")
    with pytest.raises(InputError, match=r"holds neither .*; its folder 100MEDIA holds images"):
        kind_of(tmp_path)


@pytest.mark.parametrize("name", ["\udcff\udcfe_1.png", "9" * 240 + ".png", "frame\n1.png", "1.PNG"])
def test_any_name_will_do(name: str, tmp_path: Path) -> None:
    save(tmp_path / "0.png")
    (tmp_path / "0.png").rename(tmp_path / name)
    assert len(read(tmp_path)[0]) == 1


def test_a_link_to_nothing_and_an_empty_file_are_lost_frames(tmp_path: Path) -> None:
    save(tmp_path / "0.png")
    (tmp_path / "1.png").symlink_to(tmp_path / "gone.png")
    (tmp_path / "2.tif").write_bytes(b"")
    decoded = [str(one) for _, one in ImageFolder(tmp_path, None).frames() if isinstance(one, MessageError)]
    assert decoded == [f"{tmp_path / name} cannot be decoded" for name in ("1.png", "2.tif")]


# --- EXIF ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp", "tif"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_images_are_turned_as_a_viewer_shows_them(suffix: str, orientation: int, tmp_path: Path) -> None:
    for number in range(2):
        save(tmp_path / f"{number}.{suffix}", exif=exif(orientation))
    with Pillow.open(tmp_path / f"0.{suffix}") as opened:
        shown = np.asarray(ImageOps.exif_transpose(opened).convert("RGB"))
    frames, warnings = read(tmp_path)
    for frame in frames:
        np.testing.assert_allclose(frame.image[:, :, ::-1].astype(int), shown.astype(int), atol=12)
    assert [f"{tmp_path}: the images are" in said for said in warnings] == ([] if orientation == 1 else [True])


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_one_flight_keeps_one_orientation(suffix: str, tmp_path: Path) -> None:
    """A camera that looks straight down: the sensor of gravity jumps, the picture does not."""
    for number, orientation in enumerate((6, 6, 1, 3)):
        save(tmp_path / f"{number}.{suffix}", number, exif(orientation))
    frames, warnings = read(tmp_path)
    assert {frame.size for frame in frames} == {SIZE[::-1]}
    np.testing.assert_array_equal(frames[3].image[1:, :-1], frames[0].image[1:, :-1])
    assert warnings == [f"{tmp_path}: all images are turned by 90 degrees clockwise, as the EXIF orientation of "
                        f"0.{suffix} says; 2 have another, the first of them 2.{suffix}"]


@pytest.mark.parametrize("options", [{}, {"byteorder": ">"}, {"bigtiff": True}, {"compression": "zlib"}], ids=str)
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32", "float64"])
def test_pages_and_values_of_any_type_are_turned_as_the_first_says(
    dtype: str, options: dict[str, Any], tmp_path: Path
) -> None:
    """What Pillow cannot open as well, as 64 bit; OpenCV would turn each by its own."""
    stored = picture()[:, :, 0].astype(dtype)
    for name, pages in (("0", 1), ("1", 3)):
        with tifffile.TiffWriter(tmp_path / f"{name}.tif", bigtiff="bigtiff" in options,
                                 byteorder=options.get("byteorder", "<")) as writer:
            for page in range(pages):
                writer.write(stored, photometric="minisblack", compression=options.get("compression"), metadata=None,
                             extratags=[(274, "H", 1, 8 if page == 0 else 3, True)])
    frames, warnings = read(tmp_path)
    assert len(frames) == 4
    for frame in frames:
        np.testing.assert_array_equal(frame.image, np.rot90(stored))
    assert warnings == [f"{tmp_path}: all images are turned by 90 degrees counterclockwise, as the EXIF orientation of "
                        "0.tif says; 2 have another, the first of them 1.tif page 2"]


def test_a_tiff_file_of_another_name_is_turned_once(tmp_path: Path) -> None:
    Pillow.fromarray(picture()).save(tmp_path / "0.jpg", "TIFF", exif=exif(6))
    (frame,), (said,) = read(tmp_path)
    np.testing.assert_array_equal(frame.image[:, :, ::-1], np.rot90(picture(), -1))
    assert "the images are turned by 90 degrees clockwise" in said


def photos(folder: Path, seconds: list[Fraction], digits: int) -> None:
    for number, second in enumerate(seconds):
        whole, rest = divmod(second, 1)
        taken = f"2023:05:04 {10 + whole // 3600:02}:{whole // 60 % 60:02}:{whole % 60:02}"
        fraction = f"{float(rest):.{digits}f}"[2:] if digits else ""
        save(folder / f"DJI_{number:04}.jpg", number, exif(taken=taken, subseconds=fraction))


@pytest.mark.parametrize(("step", "digits", "frames", "says"), [
    (Fraction(2), 0, 20, "give --fps 0.5"), (Fraction(1, 5), 3, 20, "give --fps 5"),
    (Fraction(1, 2), 0, 60, "give --fps 2.034"),
    (Fraction(1, 25), 2, 20, ""), (Fraction(1, 25), 0, 20, ""), (Fraction(1, 24), 3, 20, ""), (Fraction(0), 0, 20, ""),
])
def test_another_rate_in_exif_is_said_with_the_option_that_sets_it(
    step: Fraction, digits: int, frames: int, says: str, tmp_path: Path
) -> None:
    photos(tmp_path, [number * step for number in range(frames)], digits)
    found, warnings = read(tmp_path)
    assert [frame.stamp_ns for frame in found][:2] == [10**9, 104 * 10**7]  # as the contract says
    assert [says in said for said in warnings] == ([True] if says else [])
    if says:
        assert read(tmp_path, float(says.rsplit(maxsplit=1)[-1]))[1] == []


def test_the_rate_is_known_before_the_images_are_read(tmp_path: Path) -> None:
    photos(tmp_path, [Fraction(2 * number) for number in range(9)], 0)
    reader = ImageFolder(tmp_path, None)
    next(reader.frames())
    assert ["--fps 0.5" in said for said in reader.warnings] == [True]


def test_names_that_contradict_the_time_and_pauses_are_said(tmp_path: Path) -> None:
    """A counter that began again at 0000 in mid-flight, and two flights in one folder."""
    (tmp_path / "again").mkdir()
    photos(tmp_path / "again", [Fraction(number, 25) for number in (50, 51, 52, 0, 1, 2)], 2)
    (said,) = read(tmp_path / "again")[1]
    assert "DJI_0003.jpg comes after DJI_0002.jpg but was taken 2.08 s before it" in said
    (tmp_path / "two").mkdir()
    photos(tmp_path / "two", [Fraction(number) for number in (0, 1, 2, 3, 900, 901)], 0)
    (said,) = read(tmp_path / "two")[1]
    assert "DJI_0004.jpg was taken 897 s after DJI_0003.jpg" in said


# --- files with several pictures -------------------------------------------------------------------------------------


def test_pages_of_tiff_files_are_frames_among_others(tmp_path: Path) -> None:
    pages = [Pillow.fromarray(picture(number)) for number in range(15)]
    pages[0].save(tmp_path / "stack_1.tif", save_all=True, append_images=pages[1:12], compression="tiff_lzw")
    pages[12].save(tmp_path / "stack_2.tif", save_all=True, append_images=pages[13:14])
    pages[14].save(tmp_path / "stack_3.tif")
    frames, warnings = read(tmp_path)
    assert (numbers(frames), warnings) == (list(range(15)), [])


def test_a_page_that_is_damaged_is_lost_alone(tmp_path: Path) -> None:
    pages = [Pillow.fromarray(picture(number)) for number in range(4)]
    pages[0].save(tmp_path / "s.tif", save_all=True, append_images=pages[1:], compression="jpeg")
    with tifffile.TiffFile(tmp_path / "s.tif") as opened:
        (at,), (length,) = opened.pages[1].dataoffsets, opened.pages[1].databytecounts
    data = bytearray((tmp_path / "s.tif").read_bytes())
    data[at : at + length] = b"\xff" * length
    (tmp_path / "s.tif").write_bytes(data)
    decoded = [one for _, one in ImageFolder(tmp_path, None).frames()]
    assert [isinstance(one, Frame) for one in decoded] == [True, False, True, True]
    assert str(decoded[1]) == f"{tmp_path / 's.tif page 2'} cannot be decoded"


@pytest.mark.parametrize("suffix", ["png", "webp"])
def test_an_animation_is_refused_with_what_to_do(suffix: str, tmp_path: Path) -> None:
    pages = [Pillow.fromarray(picture(50 * number)) for number in range(3)]
    pages[0].save(tmp_path / f"a.{suffix}", save_all=True, append_images=pages[1:], duration=40)
    ((_, decoded),) = ImageFolder(tmp_path, None).frames()
    assert isinstance(decoded, MessageError)
    assert "is an animation of 3 pictures" in str(decoded)
    assert f"ffmpeg -i a.{suffix} frame%04d.png" in str(decoded)


def test_two_sizes_are_refused_by_name(tmp_path: Path) -> None:
    save(tmp_path / "0.png")
    Pillow.fromarray(picture()[:-4]).save(tmp_path / "1.png")
    with pytest.raises(InputError, match=r"0\.png is 48x32 and 1\.png is 48x28; all images must have one size"):
        read(tmp_path)


# --- bags and images in one folder -----------------------------------------------------------------------------------


@pytest.mark.parametrize("content", ["", "camera: {model: FC330}\n", "just text", "a: [", "\xff\xfe"])
def test_a_metadata_yaml_of_others_makes_no_bag(content: str, flight: list[Shot], tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "frames", flight[:2])
    (folder / "metadata.yaml").write_text(content, encoding="latin-1")
    assert kind_of(folder) is Kind.FOLDER
    with open_source(folder) as source:
        assert (source.count, source.warnings) == (2, [])


@pytest.mark.parametrize("storage", StoragePlugin)
def test_a_bag_that_holds_images_too_is_a_bag_and_says_so(
    storage: StoragePlugin, flight: list[Shot], tmp_path: Path
) -> None:
    bag = write_rosbag2(tmp_path / "bag", list(entries(flight[:2])), storage)
    save(bag / "preview.jpg")
    with open_source(bag) as source:
        assert isinstance(source, BagSource)
        assert len([*source.frames()]) == 2
        assert source.warnings == [f"{bag}: is taken as a bag, 1 image in it is left out"]


def test_images_with_a_recording_beside_them_are_images_and_say_so(flight: list[Shot], tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "frames", flight[:2])
    write_mcap(folder / "out.mcap", list(entries(flight[:3])))
    with open_source(folder) as source:
        assert source.count == 2
        assert source.warnings == [
            f"{folder}: is taken as a folder of images, out.mcap in it is left out; give it by its name"]


def test_a_folder_of_a_killed_recorder_is_a_bag(flight: list[Shot], tmp_path: Path) -> None:
    write_mcap(tmp_path / "bag_0.mcap", list(entries(flight[:2])))
    assert kind_of(tmp_path) is Kind.BAG


@pytest.mark.parametrize("end", ["", "\n", " \r\n"], ids=repr)
@pytest.mark.parametrize("top", [255, 65535])
def test_portable_maps_as_text_come_as_they_are(top: int, end: str, tmp_path: Path) -> None:
    grey, colour = picture()[:, :, 0].astype(np.uint16) * np.uint16(top // 255), picture()
    files = (("0.pgm", "P2", f"{top}\n", grey), ("1.ppm", "P3", "255\n", colour), ("2.pnm", "P1", "", grey > top // 2))
    for name, kind, most, values in files:
        head = f"{kind}\n# by hand\n{SIZE[0]} {SIZE[1]}\n{most}"
        (tmp_path / name).write_text(head + "\n".join(str(int(value)) for value in values.ravel()) + end, newline="")
    frames, warnings = read(tmp_path)
    np.testing.assert_array_equal(frames[0].image, grey)
    np.testing.assert_array_equal(frames[1].image, colour[:, :, ::-1])
    np.testing.assert_array_equal(frames[2].image, np.where(grey > top // 2, 0, 255))  # 1 is black
    assert ["follow 3 patterns" in said for said in warnings] == [True]


def test_grey_and_alpha_come_as_they_are(tmp_path: Path) -> None:
    for number, mode in enumerate(("RGB", "L", "RGBA", "LA")):
        Pillow.fromarray(picture()).convert(mode).save(tmp_path / f"{number}.png")
    frames, warnings = read(tmp_path)
    assert ([frame.encoding for frame in frames], warnings) == (["bgr8", "mono8", "bgra8", "bgra8"], [])
    assert cv2.countNonZero(frames[2].image[:, :, 3]) == SIZE[0] * SIZE[1]


def test_values_of_16_bits_and_floating_ones_come_as_they_are(tmp_path: Path) -> None:
    thermal = picture()[:, :, 1].astype(np.uint16) + np.uint16(7400)
    kelvin = (290 + picture()[:, :, 0] / 50).astype(np.float32)
    Pillow.fromarray(thermal).save(tmp_path / "1.tif")
    tifffile.imwrite(tmp_path / "2.tif", thermal)
    cv2.imwrite(str(tmp_path / "3.tif"), np.dstack([thermal] * 3))
    tifffile.imwrite(tmp_path / "4.tif", kelvin)
    frames, warnings = read(tmp_path)
    assert ([frame.encoding for frame in frames], warnings) == (["mono16", "mono16", "bgr16", "32FC1"], [])
    for frame, expected in zip(frames, (thermal, thermal, np.dstack([thermal] * 3), kelvin), strict=True):
        np.testing.assert_array_equal(frame.image, expected)
