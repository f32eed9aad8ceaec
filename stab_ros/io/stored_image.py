"""The images that the files of a folder hold: one each, but of a TIFF file every page that is a frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stab_ros.core.text import are, counted
from stab_ros.io.tiff_pages import DamagedTiffError, TiffFile, TiffPage, upright

_TIFF = (".tif", ".tiff")


@dataclass(frozen=True)
class StoredImage:
    """An image in a file. page: of a TIFF file with several frames, and its number, from 1; None: all of the file.

    orientation: as that of EXIF, of a TIFF file; None: what its EXIF says.
    """

    file: Path
    page: TiffPage | None = None
    number: int = 1
    orientation: int | None = None

    @property
    def name(self) -> str:
        """For messages."""
        return self.file.name if self.page is None else f"{self.file.name} page {self.number}"

    def read(self) -> bytes:
        """The image as a file of its own, a TIFF file without orientation: OpenCV turns those whatever its flags say.

        Raises:
            OSError, DamagedTiffError: it cannot be read.
        """
        if self.page is None:
            return upright(self.file.read_bytes())
        with self.file.open("rb") as file:
            return TiffFile(file).cut(self.page)


def stored_images(file: Path) -> tuple[list[StoredImage], str]:
    """The images in a file, and a remark on what is left out of it; an empty string: nothing.

    Pages of another size than the first frame are previews of it, as thumbnails and masks are.
    """
    pages, damage = _pages(file) if file.name.lower().endswith(_TIFF) else ([], "")
    frames = [StoredImage(file, page, number, page.orientation)
              for number, page in enumerate(pages, 1) if page.is_frame]
    fitting = [image for image in frames if image.page and frames[0].page and image.page.size == frames[0].page.size]
    if len(pages) < 2 or not fitting:
        return [StoredImage(file, orientation=pages[0].orientation if pages else None)], damage
    other = len(frames) - len(fitting)
    pages_left = f"{other} of its {counted(len(pages), 'page')} {are(other)}"
    sizes = f"{file}: {pages_left} of another size than the first, and left out"
    return fitting, damage or (sizes if other else "")


def _pages(file: Path) -> tuple[list[TiffPage], str]:
    """Those before any damage, and what that is; where it is the first page, the decoder will say so."""
    pages: list[TiffPage] = []
    try:
        with file.open("rb") as opened:
            pages.extend(TiffFile(opened).pages())
    except (OSError, DamagedTiffError) as error:
        return pages, f"{file}: {error} after page {len(pages)}, what follows is lost" if pages else ""
    return pages, ""
