"""Seeded damage to bytes: the same seed gives the same input on every machine."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

LONGEST = 2**16  # bytes of an input: blocks that are doubled again and again must not slow the run down
NUMBERS = (0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 2**27, 2**30, 2**31 - 1, 2**31, 2**32 - 1, 2**62,
           2**63 - 1, 2**63, 2**64 - 1)  # where lengths, counts and times overflow
_WIDTHS = (1, 2, 4, 8)
_BLOCK = 64  # bytes, most often

Damage = Callable[[bytearray, random.Random, Sequence[bytes]], None]


def mutated(seeds: Sequence[bytes], seed: int, tokens: Sequence[bytes] = ()) -> bytes:
    """One of `seeds` with one to eight damages; `tokens` are words of a text format, which then get into the text."""
    rng = random.Random(seed)
    data = bytearray(rng.choice(seeds))
    damages: Sequence[Damage] = _DAMAGES
    for _ in range(1 + min(7, int(rng.expovariate(0.7)))):
        if tokens and rng.random() < 0.6:
            _put_token(data, rng, tokens)
        else:
            rng.choice(damages)(data, rng, seeds)
    return bytes(data[:LONGEST])


def _place(data: bytearray, rng: random.Random) -> int:
    """Headers lie at the beginning and the end, so these are hit more often."""
    near = min(len(data), 100)
    kind = rng.random()
    if kind < 0.3:
        return rng.randrange(near + 1)
    return len(data) - rng.randrange(near + 1) if kind < 0.4 else rng.randrange(len(data) + 1)


def _block(data: bytearray, rng: random.Random) -> slice:
    start = _place(data, rng)
    return slice(start, start + (rng.randrange(1, _BLOCK) if rng.random() < 0.8 else rng.randrange(len(data) + 1)))


def _flip_bit(data: bytearray, rng: random.Random, _: Sequence[bytes]) -> None:
    at = _place(data, rng)
    if at < len(data):
        data[at] ^= 1 << rng.randrange(8)


def _change_byte(data: bytearray, rng: random.Random, _: Sequence[bytes]) -> None:
    at = _place(data, rng)
    if at < len(data):
        data[at] = rng.randrange(256)


def _put_number(data: bytearray, rng: random.Random, _: Sequence[bytes]) -> None:
    """Where a number may stand: at any byte, or aligned as CDR does it."""
    width = rng.choice(_WIDTHS)
    number = rng.choice(NUMBERS) % 2 ** (8 * width)
    at = _place(data, rng)
    at -= at % width if rng.random() < 0.5 else 0
    data[at : at + width] = number.to_bytes(width, "big" if rng.random() < 0.1 else "little")


def _add_to_number(data: bytearray, rng: random.Random, _: Sequence[bytes]) -> None:
    width, at = rng.choice(_WIDTHS), _place(data, rng)
    old = int.from_bytes(data[at : at + width], "little")
    data[at : at + width] = ((old + rng.randrange(-20, 21)) % 2 ** (8 * width)).to_bytes(width, "little")


def _cut_off(data: bytearray, rng: random.Random, _: Sequence[bytes]) -> None:
    del data[_place(data, rng) :]


def _take_out(data: bytearray, rng: random.Random, _: Sequence[bytes]) -> None:
    del data[_block(data, rng)]


def _double(data: bytearray, rng: random.Random, _: Sequence[bytes]) -> None:
    at = _place(data, rng)
    data[at:at] = data[_block(data, rng)] * rng.choice((1, 1, 1, 2, 30))
    del data[LONGEST:]


def _put_garbage(data: bytearray, rng: random.Random, _: Sequence[bytes]) -> None:
    block = _block(data, rng)
    data[block] = rng.randbytes(min(block.stop - block.start, _BLOCK))


def _put_zeros(data: bytearray, rng: random.Random, _: Sequence[bytes]) -> None:
    block = _block(data, rng)
    data[block] = bytes(len(data[block]))


def _insert_garbage(data: bytearray, rng: random.Random, _: Sequence[bytes]) -> None:
    at = _place(data, rng)
    data[at:at] = rng.randbytes(rng.randrange(1, _BLOCK))


def _splice(data: bytearray, rng: random.Random, seeds: Sequence[bytes]) -> None:
    """The rest, or a block, of another seed."""
    other = bytearray(rng.choice(seeds))
    if rng.random() < 0.5:
        data[_place(data, rng) :] = other[_place(other, rng) :]
    else:
        data[_block(data, rng)] = other[_block(other, rng)]


def _put_token(data: bytearray, rng: random.Random, tokens: Sequence[bytes]) -> None:
    """In place of what stands between two separators, or anywhere."""
    start = _place(data, rng)
    end = start
    if rng.random() < 0.7:
        while end < len(data) and data[end] not in b",:\n []{}\"":
            end += 1
    data[start:end] = rng.choice(tokens)


_DAMAGES: tuple[Damage, ...] = (
    _flip_bit, _flip_bit, _change_byte, _change_byte, _put_number, _put_number, _put_number, _add_to_number, _cut_off,
    _take_out, _double, _put_garbage, _put_zeros, _insert_garbage, _splice, _splice,
)
