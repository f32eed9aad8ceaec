"""Messages in XCDR2, as DDS implementations other than those of ROS write them, into the CDR that ROS reads.

OMG DDS-XTYPES 1.3, 7.4: a type that cannot be extended differs only in that members of 8 bytes lie at multiples of 4.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from rosbags.interfaces import Nodetype

from stab_ros.core.errors import MessageError

if TYPE_CHECKING:
    from rosbags.interfaces.typing import FieldDesc, Typesdict

_HEAD_BYTES = 4  # encapsulation: zero, kind, two bytes of options
_PLAIN_CDR, _PLAIN_CDR2 = (0, 1), (6, 7)  # big and little endian
_OTHERS = {2: "PL_CDR", 3: "PL_CDR", 8: "D_CDR2", 9: "D_CDR2", 10: "PL_CDR2", 11: "PL_CDR2"}
_ALIGNMENT = 4
_BYTES: Mapping[str, int] = {
    "bool": 1, "byte": 1, "char": 1, "octet": 1, "int8": 1, "uint8": 1, "int16": 2, "uint16": 2, "int32": 4,
    "uint32": 4, "float32": 4, "int64": 8, "uint64": 8, "float64": 8,
}


def is_little_endian(data: bytes | memoryview) -> bool:
    """Of a message that is plain CDR or XCDR2.

    Raises:
        MessageError: it is another kind of CDR, or none.
    """
    if len(data) < _HEAD_BYTES or data[0] != 0 or data[1] not in (*_PLAIN_CDR, *_PLAIN_CDR2):
        kind = _OTHERS.get(data[1], "") if len(data) > 1 and data[0] == 0 else ""
        raise MessageError(f"its serialisation is {kind or 'unknown'}, it must be CDR or XCDR2 of a final type")
    return data[1] % 2 == 1


def as_cdr(data: bytes | memoryview, msgtype: str, types: Typesdict) -> bytes | memoryview:
    """The message in plain CDR, which most are already. types: the definitions of `msgtype` and its dependencies.

    Raises:
        MessageError: it is cut short, or not plain CDR or XCDR2 of a type whose sequences hold numbers.
    """
    is_little_endian(data)
    return data if data[1] in _PLAIN_CDR else _Converter(memoryview(data), types).converted(msgtype)


class _Converter:
    def __init__(self, data: memoryview, types: Typesdict) -> None:
        self._kind, self._data, self._types = data[1], data[_HEAD_BYTES:], types
        self._at, self._length = 0, 0  # in what is read, and in what is made
        self._made: list[bytes | memoryview] = [bytes((0, self._kind - _PLAIN_CDR2[0], 0, 0))]

    def converted(self, msgtype: str) -> bytes:
        self._message(msgtype)
        return b"".join(self._made)

    def _message(self, msgtype: str) -> None:
        for _, field in self._types[msgtype][1]:
            self._field(field)

    def _field(self, field: FieldDesc) -> None:
        match field:
            case (Nodetype.NAME, str(msgtype)):
                self._message(msgtype)
            case (Nodetype.BASE, ("string", _)):
                self._copy(1, self._number())
            case (Nodetype.BASE, (str(name), _)) if name in _BYTES:
                self._copy(_BYTES[name], 1)
            case (Nodetype.ARRAY, ((Nodetype.BASE, (str(name), _)), int(count))) if name in _BYTES:
                self._copy(_BYTES[name], count)
            case (Nodetype.SEQUENCE, ((Nodetype.BASE, (str(name), _)), _)) if name in _BYTES:
                self._copy(_BYTES[name], self._number())
            case _:
                raise MessageError("it is XCDR2 with several structures or strings in a row, it must be plain CDR")

    def _number(self) -> int:
        """A length, which is copied."""
        return int.from_bytes(self._copy(4, 1), "little" if self._kind % 2 else "big")

    def _copy(self, size: int, count: int) -> bytes | memoryview:
        """`count` values of `size` bytes; none need no alignment."""
        if not count:
            return b""
        self._at += -self._at % min(size, _ALIGNMENT)
        piece = self._data[self._at : self._at + size * count]
        if len(piece) < size * count:
            raise MessageError("it is XCDR2 and cut short")
        padding = bytes(-self._length % size)
        self._made += (padding, piece)
        self._at += len(piece)
        self._length += len(padding) + len(piece)
        return piece
