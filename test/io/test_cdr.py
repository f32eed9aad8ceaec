"""Headers and stamps in CDR bytes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from message_makers import HEADER, complaint, damaged

from stab_ros.core.errors import MessageError
from stab_ros.io.cdr import IMAGE, Header, read_stamp
from stab_ros.io.diagnostics_message import diagnostics_cdr
from stab_ros.io.image_message import image_cdr, read_image


@pytest.mark.parametrize("stamp_ns", [2**31 * 10**9, -(2**31) * 10**9 - 1])
def test_stamp_that_no_ros_time_holds_is_refused(stamp_ns: int) -> None:
    with pytest.raises(MessageError, match="ROS time"):
        Header(stamp_ns)


@settings(deadline=None)
@given(stamp_ns=st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1))
def test_stamps_survive(stamp_ns: int) -> None:
    cdr = image_cdr(np.zeros((1, 1), np.uint8), "mono8", Header(stamp_ns))
    assert read_stamp(cdr) == read_image(cdr, IMAGE).stamp_ns == stamp_ns


@settings(max_examples=150, deadline=None, derandomize=True)
@given(data=st.data())
def test_no_damage_raises_anything_but_message_error(data: st.DataObject) -> None:
    sound = diagnostics_cdr(HEADER.stamp_ns, "a", "b", 0, "c", {"key": "value"})
    assert len(complaint(read_stamp, data.draw(damaged(sound))).splitlines()) <= 1
