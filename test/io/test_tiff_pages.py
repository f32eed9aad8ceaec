"""TIFF files page by page: what PIL and tifffile write comes back as it was, one page in memory."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image as Pillow

from stab_ros.io.stored_image import StoredImage, stored_images
from stab_ros.io.tiff_pages import DamagedTiffError, TiffFile

PAGES, HEIGHT, WIDTH = 5, 40, 64


def stack(dtype: str, channels: int = 1) -> NDArray[Any]:
    """Pages that differ everywhere."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    top = np.iinfo(dtype).max if np.dtype(dtype).kind == "u" else 1
    pages = [((x + 3 * y + 50 * page) % 256) / 255 * top for page in range(PAGES)]
    grey = np.stack(pages).astype(dtype)
    return grey if channels == 1 else np.stack([grey, grey[:, ::-1], grey[:, :, ::-1]], axis=-1)


def pixels(image: StoredImage) -> NDArray[Any]:
    """As RGB."""
    found = np.asarray(cv2.imdecode(np.frombuffer(image.read(), np.uint8), cv2.IMREAD_UNCHANGED))
    return found if found.ndim == 2 else found[:, :, ::-1]


@pytest.mark.parametrize("options", [
    {}, {"bigtiff": True}, {"byteorder": ">"}, {"bigtiff": True, "byteorder": ">", "rowsperstrip": 7},
    {"rowsperstrip": 3}, {"tile": (32, 32)}, {"compression": "zlib"}, {"compression": "zlib", "predictor": True},
], ids=str)
@pytest.mark.parametrize(("dtype", "channels"), [("uint8", 1), ("uint16", 1), ("uint8", 3), ("uint16", 3)])
def test_pages_of_tifffile_come_back(options: dict[str, Any], dtype: str, channels: int, tmp_path: Path) -> None:
    written = stack(dtype, channels)
    if "bigtiff" in options and "byteorder" in options:  # older readers take no other
        options = {**options, "metadata": None}
    tifffile.imwrite(tmp_path / "s.tif", written, photometric="rgb" if channels == 3 else "minisblack", **options)
    images, remark = stored_images(tmp_path / "s.tif")
    assert (len(images), remark) == (PAGES, "")
    assert [image.name for image in images[:2]] == ["s.tif page 1", "s.tif page 2"]
    for image, page in zip(images, written, strict=True):
        np.testing.assert_array_equal(pixels(image), page)


def test_a_stack_of_imagej_comes_back(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "s.tif", stack("uint16"), imagej=True)
    images, _ = stored_images(tmp_path / "s.tif")
    np.testing.assert_array_equal([pixels(image) for image in images], stack("uint16"))


def with_one_directory(path: Path, **options: Any) -> None:
    """A stack as ImageJ writes it above 4 GB, where tifffile would write a directory for each page."""
    written = stack("uint16")
    tifffile.imwrite(path, written, imagej=True, **options)
    data = bytearray(path.read_bytes())
    with tifffile.TiffFile(path) as file:
        first, order = file.pages.first.offset, file.byteorder
    (entries,) = struct.unpack_from(f"{order}H", data, first)
    struct.pack_into(f"{order}I", data, first + 2 + 12 * entries, 0)
    path.write_bytes(data)


@pytest.mark.parametrize("options", [{}, {"byteorder": "<"}, {"rowsperstrip": 7}], ids=str)
def test_a_stack_of_imagej_with_one_directory_comes_back(options: dict[str, Any], tmp_path: Path) -> None:
    with_one_directory(tmp_path / "s.tif", **options)
    with tifffile.TiffFile(tmp_path / "s.tif") as file:
        assert len(file.pages) == 1
    images, remark = stored_images(tmp_path / "s.tif")
    assert ([image.name for image in images], remark) == ([f"s.tif page {number + 1}" for number in range(PAGES)], "")
    np.testing.assert_array_equal([pixels(image) for image in images], stack("uint16"))


def test_one_directory_of_imagej_that_cannot_be_followed_is_said(tmp_path: Path) -> None:
    with_one_directory(tmp_path / "s.tif")
    whole = (tmp_path / "s.tif").read_bytes()
    (tmp_path / "s.tif").write_bytes(whole[: len(whole) // 2])  # cut off
    images, remark = stored_images(tmp_path / "s.tif")
    np.testing.assert_array_equal([pixels(image) for image in images], stack("uint16")[: len(images)])
    assert (len(images), remark) == (2, f"{tmp_path / 's.tif'}: is cut short after page 2, what follows is lost")

    with_one_directory(tmp_path / "c.tif", compression="zlib")
    images, remark = stored_images(tmp_path / "c.tif")
    np.testing.assert_array_equal(pixels(images[0]), stack("uint16")[0])
    assert (len(images), remark) == (1, f"{tmp_path / 'c.tif'}: lacks the directories of its {PAGES} images "
                                        "(ImageJ saves an image sequence) after page 1, what follows is lost")


def test_one_image_with_the_description_of_a_stack_is_one(tmp_path: Path) -> None:
    """As other programs leave it when they take a stack apart."""
    tifffile.imwrite(tmp_path / "s.tif", stack("uint16")[0], description="ImageJ=1.53t\nimages=5\nslices=5\n",
                     metadata=None)
    images, remark = stored_images(tmp_path / "s.tif")
    assert (len(images), remark) == (1, "")
    np.testing.assert_array_equal(pixels(images[0]), stack("uint16")[0])


def test_a_page_is_a_file_of_its_own_and_no_larger(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "s.tif", stack("uint16"), photometric="minisblack", rowsperstrip=7)
    for image, page in zip(stored_images(tmp_path / "s.tif")[0], stack("uint16"), strict=True):
        with tifffile.TiffFile(io.BytesIO(image.read())) as alone:
            assert len(alone.pages) == 1
            np.testing.assert_array_equal(alone.pages.first.asarray(), page)
        assert len(image.read()) < 1.3 * page.nbytes


@pytest.mark.parametrize("compression", ["tiff_lzw", "tiff_deflate", "packbits", "jpeg", None])
def test_pages_of_pillow_come_back(compression: str | None, tmp_path: Path) -> None:
    pages = [Pillow.fromarray(page) for page in stack("uint8", 3)]
    pages[0].save(tmp_path / "s.tiff", save_all=True, append_images=pages[1:], compression=compression)
    images, _ = stored_images(tmp_path / "s.tiff")
    assert len(images) == PAGES
    with Pillow.open(tmp_path / "s.tiff") as opened:
        for number, image in enumerate(images):
            opened.seek(number)
            np.testing.assert_allclose(pixels(image), np.asarray(opened), atol=2 if compression == "jpeg" else 0)


def entry_of(path: Path, tag: int, page: int = 0) -> int:
    """Where in the file the field lies in the directory of a page."""
    with tifffile.TiffFile(path) as file:
        return file.pages[page].aspage().tags[tag].offset


@pytest.mark.parametrize("kind", [2, 5, 9, 12, 99])  # text, rational, signed, float, none
def test_an_orientation_of_another_type_is_none(kind: int, tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "s.tif", stack("uint8"), photometric="minisblack", metadata=None,
                     extratags=[(274, 3, 1, 6, False)])
    data = bytearray((tmp_path / "s.tif").read_bytes())
    for page in range(PAGES):
        struct.pack_into("<H", data, entry_of(tmp_path / "s.tif", 274, page) + 2, kind)
    (tmp_path / "s.tif").write_bytes(data)
    images, remark = stored_images(tmp_path / "s.tif")
    assert ([image.orientation for image in images], remark) == ([1] * PAGES, "")
    np.testing.assert_array_equal([pixels(image) for image in images], stack("uint8"))


def test_a_description_beyond_the_file_is_none(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "s.tif", stack("uint8")[0], description="of a river", metadata=None)
    data = bytearray((tmp_path / "s.tif").read_bytes())
    struct.pack_into("<I", data, entry_of(tmp_path / "s.tif", 270) + 8, len(data) + 100)
    (tmp_path / "s.tif").write_bytes(data)
    images, remark = stored_images(tmp_path / "s.tif")
    assert (len(images), remark) == (1, "")
    np.testing.assert_array_equal(pixels(images[0]), stack("uint8")[0])


def test_thumbnails_masks_and_pages_of_another_size_are_no_frames(tmp_path: Path) -> None:
    """As in a GeoTIFF with overviews, or with a preview that does not say that it is one."""
    frames = stack("uint8")[:2]
    with tifffile.TiffWriter(tmp_path / "s.tif") as writer:
        for frame in frames:
            writer.write(frame, photometric="minisblack")
            writer.write(frame[::2, ::2].copy(), photometric="minisblack", subfiletype=1)
            writer.write(frame > 9, photometric="minisblack", subfiletype=4)
    images, remark = stored_images(tmp_path / "s.tif")
    assert ([image.number for image in images], remark) == ([1, 4], "")
    np.testing.assert_array_equal(pixels(images[1]), frames[1])

    with tifffile.TiffWriter(tmp_path / "p.tif") as writer:
        writer.write(frames[0], photometric="minisblack")
        writer.write(frames[0][::4, ::4].copy(), photometric="minisblack")
    images, remark = stored_images(tmp_path / "p.tif")
    np.testing.assert_array_equal(pixels(images[0]), frames[0])
    assert (len(images), "1 of its 2 pages is of another size" in remark) == (1, True)


def test_a_stack_that_was_cut_off_gives_the_pages_before(tmp_path: Path) -> None:
    pages = [Pillow.fromarray(page) for page in stack("uint8")]
    pages[0].save(tmp_path / "s.tif", save_all=True, append_images=pages[1:])
    whole = (tmp_path / "s.tif").read_bytes()
    (tmp_path / "s.tif").write_bytes(whole[: len(whole) * 3 // 5])
    images, remark = stored_images(tmp_path / "s.tif")
    assert 2 <= len(images) < PAGES
    np.testing.assert_array_equal(pixels(images[1]), stack("uint8")[1])
    assert remark == f"{tmp_path / 's.tif'}: is cut short after page {len(images)}, what follows is lost"


def test_directories_in_a_circle_end(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "s.tif", stack("uint8"), photometric="minisblack")
    data = bytearray((tmp_path / "s.tif").read_bytes())
    with tifffile.TiffFile(tmp_path / "s.tif") as file:
        offsets = [page.offset for page in file.pages]
    entries = struct.unpack_from("<H", data, offsets[-1])[0]
    struct.pack_into("<I", data, offsets[-1] + 2 + 12 * entries, offsets[0])
    (tmp_path / "s.tif").write_bytes(data)
    assert len(stored_images(tmp_path / "s.tif")[0]) == PAGES


def test_strips_that_overlap_are_refused() -> None:
    """Else a small file could ask for any amount of memory."""
    file = io.BytesIO()
    tifffile.imwrite(file, stack("uint8")[0], photometric="minisblack", rowsperstrip=1)
    data = bytearray(file.getvalue())
    with tifffile.TiffFile(io.BytesIO(data)) as opened:
        counts_at = opened.pages.first.tags[279].valueoffset
    for strip in range(HEIGHT):
        struct.pack_into("<H", data, counts_at + 2 * strip, len(data) // 2)
    damaged = TiffFile(io.BytesIO(data))
    with pytest.raises(DamagedTiffError, match="contradict"):
        damaged.cut(next(damaged.pages()))
