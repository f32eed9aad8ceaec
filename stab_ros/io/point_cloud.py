"""sensor_msgs/PointCloud2: a table of numbers, a row for each point."""

from __future__ import annotations

from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.errors import MessageError
from stab_ros.io.cdr import POINT_CLOUD2, Header, deserialize, header_message, serialize, to_ns

_Field: TypeAlias = ros.sensor_msgs__msg__PointField
_Cloud: TypeAlias = ros.sensor_msgs__msg__PointCloud2
_TYPES = {"i1": _Field.INT8, "u1": _Field.UINT8, "i2": _Field.INT16, "u2": _Field.UINT16, "i4": _Field.INT32,
          "u4": _Field.UINT32, "f4": _Field.FLOAT32, "f8": _Field.FLOAT64}
_DTYPES = {number: dtype for dtype, number in _TYPES.items()}

Table: TypeAlias = NDArray[Any]  # (N,), of a structured dtype


def cloud_cdr(table: Table, header: Header) -> bytes:
    """The table (N,) of a packed structured dtype, its fields in order; no point is invalid."""
    fields = [_Field(name=name, offset=int(offset), datatype=_TYPES[dtype.str[1:]], count=1)
              for name, (dtype, offset, *_) in (table.dtype.fields or {}).items()]
    little = table.astype(table.dtype.newbyteorder("<"), copy=False)
    data = np.frombuffer(little.tobytes(), np.uint8)
    step = table.dtype.itemsize
    return serialize(_Cloud(
        header=header_message(header), height=1, width=len(table), fields=fields, is_bigendian=False, point_step=step,
        row_step=step * len(table), data=data, is_dense=True), POINT_CLOUD2)


def read_cloud(cdr: bytes | memoryview) -> tuple[Header, Table]:
    """Header and points, row by row, of a cloud whose fields are single numbers.

    Raises:
        MessageError: damaged, or its sizes contradict each other.
    """
    message = cast("_Cloud", deserialize(cdr, POINT_CLOUD2))
    header = Header(to_ns(message.header.stamp), message.header.frame_id)
    try:
        _check_sizes(message)
        table = np.ndarray((message.height, message.width), _dtype(message), np.ascontiguousarray(message.data).data,
                           strides=(message.row_step, message.point_step))
        return header, table.reshape(-1).copy()
    except (ValueError, TypeError, KeyError) as error:
        raise MessageError(f"a PointCloud2 of {message.width}x{message.height} points whose fields or sizes do not fit "
                           f"its {len(message.data)} bytes") from error


def _check_sizes(message: _Cloud) -> None:
    """Raises ValueError where points overlap, or the data are fewer: steps of 0 would make any number of points."""
    step, row = message.point_step, message.row_step
    if step < 1 or row < step * message.width or len(message.data) < row * message.height:
        raise ValueError("more points than data")


def _dtype(message: _Cloud) -> np.dtype[Any]:
    order = ">" if message.is_bigendian else "<"
    if any(field.count != 1 for field in message.fields):
        raise ValueError("a field of several numbers")
    layout: Any = {
        "names": [field.name for field in message.fields],
        "formats": [order + _DTYPES[field.datatype] for field in message.fields],
        "offsets": [field.offset for field in message.fields], "itemsize": message.point_step}
    dtype: np.dtype[Any] = np.dtype(layout)
    return dtype
