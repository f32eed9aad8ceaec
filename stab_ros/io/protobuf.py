"""The wire format of protobuf, without a schema: values by the number of their field."""

from __future__ import annotations

from stab_ros.core.errors import MessageError

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5  # wire types; 3 and 4, groups, are out of use
_FIXED = {_FIXED64: 8, _FIXED32: 4}
_VARINT_BYTES = 10  # for 64 bits, 7 in each


def protobuf_fields(data: bytes) -> dict[int, int | bytes]:
    """Numbers as unsigned int; texts, bytes and messages as bytes. The last value of a field counts.

    Raises:
        MessageError: cut short, or not protobuf.
    """
    found: dict[int, int | bytes] = {}
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        found[key >> 3], at = _value(data, at, key & 7)
    return found


def number_field(number: int, value: int) -> bytes:
    """A field that holds an unsigned number."""
    return _as_varint(number << 3 | _VARINT) + _as_varint(value)


def bytes_field(number: int, value: bytes) -> bytes:
    """A field that holds a text, bytes or a message. Behind a message, it replaces an earlier value of the field."""
    return _as_varint(number << 3 | _BYTES) + _as_varint(len(value)) + value


def _as_varint(value: int) -> bytes:
    found = bytearray()
    while value > 0x7F:
        found.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*found, value])


def _value(data: bytes, at: int, wire_type: int) -> tuple[int | bytes, int]:
    """A value and where it ends."""
    if wire_type == _VARINT:
        return _varint(data, at)
    if wire_type != _BYTES and wire_type not in _FIXED:
        raise MessageError(f"not protobuf: wire type {wire_type} at byte {at}")
    length, at = _varint(data, at) if wire_type == _BYTES else (_FIXED[wire_type], at)
    if at + length > len(data):
        raise MessageError(f"cut short: a value ends at byte {at + length} of {len(data)}")
    value = data[at : at + length]
    return value if wire_type == _BYTES else int.from_bytes(value, "little"), at + length


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = 0
    for place, byte in enumerate(data[at : at + _VARINT_BYTES]):
        value |= (byte & 0x7F) << 7 * place
        if byte < 0x80:
            return value, at + place + 1
    raise MessageError(f"cut short or not protobuf: no number at byte {at}")
