"""The file of `reference_path`: read when the tracker starts, written whenever its reference changes, or by request."""

from __future__ import annotations

from pathlib import Path
from threading import Lock

from rclpy.impl.rcutils_logger import RcutilsLogger

from stab_ros.core.errors import InputError, StabRosError, WorkError
from stab_ros.io.saved_reference import SavedReference, load_reference, save_reference
from stab_ros.tracking.stabilizer import Stabilizer


class ReferenceFile:
    """path: "" for none. saved: the reference of an earlier run, until the stabilizer has resumed from it.

    `save` may be called from another thread than the rest.

    Raises:
        InputError: the file cannot be used, or its folder is missing.
    """

    def __init__(self, path: str, logger: RcutilsLogger) -> None:
        self._path = Path(path) if path else None
        self._logger = logger
        self._written: tuple[object, int] | None = None  # the reference and the reset counter that the file holds
        self._present: SavedReference | None = None  # as the last frame left it
        self._writing = Lock()
        if self._path is not None and (self._path.suffix != ".mcap" or not self._path.parent.is_dir()):
            raise InputError(f"reference_path: {path} must name an .mcap file in a folder that exists")
        self.saved = load_reference(self._path) if self._path else None

    @property
    def is_pending(self) -> bool:
        """Whether there is a saved reference that the stabilizer has not resumed from yet."""
        return self.saved is not None

    def discard(self) -> None:
        """Drops a pending reference, and the present one: the stabilizer starts anew."""
        self.saved = self._present = None

    def check_camera(self, undistorts: bool) -> None:
        """Raises InputError if lens distortion is removed from either the saved reference or the images, not both."""
        if self.saved is not None and undistorts != (self.saved.camera_info is not None):
            other = "false" if undistorts else "true"
            raise InputError(f"reference_path: {self._path} was saved with use_camera_info {other}, "
                             "it must be used with the same setting")

    def resume(self, stabilizer: Stabilizer) -> None:
        """Lets the stabilizer resume from the saved reference, if there is one."""
        saved = self.saved
        if saved is None:
            return
        stabilizer.resume(saved.frame, saved.static_map, saved.reset_counter)
        self.saved = None
        self._written = stabilizer.reference, stabilizer.reset_counter
        self._logger.info(f"resuming from the reference of stamp {saved.frame.stamp_ns} ns in {self._path}")

    def update(self, stabilizer: Stabilizer, camera_info: bytes | None) -> str:
        """Writes the reference if it is new and its ground is known; returns why that failed, "" if it did not."""
        self._present = present = _present(stabilizer, camera_info)
        state = stabilizer.reference, stabilizer.reset_counter
        if self._path is None or present is None or state == self._written:
            return ""
        self._written = state
        try:
            self._write(self._path, present)
        except StabRosError as error:
            self._logger.error(f"reference_path: the reference is not saved: {error}")
            return f"the reference is not saved: {error}"
        return ""

    def save(self) -> str:
        """Writes the reference and the static map as they are now; returns what was written, for people.

        Raises:
            InputError: no file is named, or it cannot be written. WorkError: there is no reference, the disk is full.
        """
        if self._path is None:
            raise InputError("reference_path names no file; start the tracker with -p reference_path:=FILE.mcap")
        present = self._present
        if present is None:
            raise WorkError("there is no reference yet whose ground is known; ask again once frames are TRACKED")
        self._write(self._path, present)
        return f"the reference of stamp {present.frame.stamp_ns} ns is saved in {self._path}"

    def _write(self, path: Path, reference: SavedReference) -> None:
        with self._writing:
            save_reference(path, reference)


def _present(stabilizer: Stabilizer, camera_info: bytes | None) -> SavedReference | None:
    """What can be saved; None: there is no reference, or its ground is not known yet."""
    reference, static_map = stabilizer.reference, stabilizer.static_map
    if stabilizer.buffering or reference is None or static_map is None:
        return None
    return SavedReference(reference, static_map, stabilizer.reset_counter, camera_info)
