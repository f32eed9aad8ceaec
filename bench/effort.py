"""How much is measured: enough for figures to quote, or just enough to see that everything runs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Effort:
    """Numbers of frames. rendered: different ones, which the longer runs walk back and forth.

    timed: per-frame times, at 1080p and at 4K. peer_every: how often the slow peers take part in them. profiled: for
    the shares of a track. flight: error against truth. stream: memory, at 1080p and at 4K. video: of the real
    recording (None: all of it), of which SIFT looks at every `sift_every`. delivered: messages over DDS. looped: there
    and back, live, for `live_s`. recorded: in a bag that is stabilised. methods: of the error of every method and
    preset. speckled: the same under speckle, at 960x540 and at 1080p. packages: beside stabilo and OpenPIV. uhd:
    of 4K beside the slow ones. rivers: scenes, seeds and rounds of time of velocities beside other packages. plots:
    whether those in docs/ are made anew.
    """

    rendered: int
    timed: tuple[int, int]
    peer_every: int
    profiled: int
    flight: int
    stream: tuple[int, int]
    video: int | None
    sift_every: int
    delivered: int
    looped: int
    live_s: float
    recorded: int
    methods: int
    speckled: tuple[int, int]
    packages: int
    uhd: int
    rivers: tuple[int, int, int]
    plots: bool


FULL = Effort(rendered=40, timed=(240, 160), peer_every=16, profiled=60, flight=40, stream=(2000, 10000), video=None,
              sift_every=1, delivered=240, looped=31, live_s=60.0, recorded=400, methods=30, speckled=(10, 10),
              packages=30, uhd=17, rivers=(3, 1, 2), plots=True)
QUICK = Effort(rendered=8, timed=(24, 12), peer_every=12, profiled=12, flight=10, stream=(200, 20), video=12,
               sift_every=4, delivered=48, looped=6, live_s=8.0, recorded=60, methods=4, speckled=(3, 0),
               packages=6, uhd=4, rivers=(1, 1, 1), plots=False)
