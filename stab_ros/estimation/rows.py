"""Rolling shutter: a homography and the displacements of the current frame's rows, estimated together.

A camera that reads its rows one after the other while it vibrates shifts them against each other. The model is
`reference = H (current + s(y))`, with s a cubic B-spline of the row y (as Ringaby and Forssen 2012 model the motion
during the readout by splines; here of the image itself, since rows that swing by a few px leave only a translation).

What of s a homography can express belongs to the homography: a weak prior keeps the coefficients small, so that the
part that both explain goes to the plane. Where no feature lies the prior makes s nought.

The model is only taken if it holds on features that it was not fitted to. The picture is divided into upright strips,
and the curve of every other strip must explain the residuals of those between, and the reverse: rows are shifted along
their whole length, while relief, water and a lens differ from strip to strip.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from stab_ros.core.geometry import point_jacobian
from stab_ros.core.kernels import F64, I64, kernel, read
from stab_ros.core.row_shifts import RowShifts, spline_weights
from stab_ros.core.types import BoolArray, Correspondences, Fit, FloatArray, Homography, IdArray
from stab_ros.estimation import gauss_newton as gn
from stab_ros.estimation.covariance import make_fit
from stab_ros.estimation.models import PARAMETERS, Basis
from stab_ros.estimation.problem import MAGSAC, TRUSTED, EstimationProblem

_INTERVALS = 36  # of the spline: three for each of the fastest waves
_COUNT = _INTERVALS + 3  # of its coefficients
_LENGTHS = (0.03, 0.05, 0.08, 0.13, 0.2)  # of smooth curves, in heights of the frame
_CYCLES = tuple(0.5 * k for k in range(1, 21))  # of waves, down the frame
_COHERENCE = (1.2, 0.4)  # length over which a wave keeps its phase, in heights of the frame
_NUGGET = 1e-3  # of the variance: what no shape holds
_START_SHAPES, _START_PX = (1, 1), 0.5
_RMS_RANGE_PX = (0.03, 2.0)
_DESIGN_EFFECT = 4.0  # the errors of neighbouring features are alike, so they say less than they claim
_LIMITS_PX = (6.0, 4.0, 2.0, 1.0)  # inlier thresholds of the first passes, then that of the fit
_FLOOR_SHARE = 0.2  # isotropic error added to each feature, as a share of the threshold; see `search`
_STRIPS = 8
_GAIN = 0.25  # of the squared residuals of held-out features, explained both ways
_STRIP_SHARE = 0.75  # of the strips in which held-out features must be nearer with the rows
_LEAST_RMS_PX, _MOST_PX = 0.02, 6.0
_LEAST_FEATURES = 48
_EVERY, _ODD = np.ones(_STRIPS, bool), np.arange(_STRIPS) % 2 == 1

_BANDS = 32  # of rows
_REACH_PX = 2.5  # what is off by more does not count in the first look
_LEAST_IN_BAND, _LEAST_BANDS = 3, 8
_LOOK_PX, _HINT_PX = 0.04, 0.02  # RMS of what both halves show alike


@dataclass(frozen=True, eq=False)
class RowFit:
    """A homography with displacements of the rows, and how well they hold.

    Attributes:
        fit: its `rows` are the displacements, its homography is the best plane over all rows.
        gain: share of the squared residuals of held-out features that the rows explain, the smaller of both ways.
        strips: share of the strips in which they explain some.
    """

    fit: Fit
    gain: float
    strips: float

    @property
    def holds(self) -> bool:
        """Whether held-out features confirm the rows."""
        rows = self.fit.rows
        return (rows is not None and self.gain >= _GAIN and self.strips >= _STRIP_SHARE
                and rows.rms_px >= _LEAST_RMS_PX and rows.most_px <= _MOST_PX)


@dataclass(frozen=True, eq=False)
class RowResiduals:
    """Mean residuals over bands of rows, of either half of the strips.

    Attributes:
        halves: (2, bands, 2) px; 0 in bands that hold too few features.
        shared: mean product of both halves, px^2: what they have in common.
    """

    halves: FloatArray
    shared: float

    @property
    def show(self) -> bool:
        """Whether both halves show something, and the same."""
        return self.shared > _LOOK_PX**2

    @property
    def hint(self) -> bool:
        """Whether there may be something, where rows are known to swing."""
        return self.shared > _HINT_PX**2


def straightened(pairs: Correspondences, rows: RowShifts | None) -> Correspondences:
    """The correspondences with the current frame's rows put back to where they belong."""
    if rows is None:
        return pairs
    return replace(pairs, current_px=pairs.current_px + rows.at(pairs.current_px[:, 1]))


def residuals_by_rows(pairs: Correspondences, trust: FloatArray, H: Homography, size: tuple[int, int]) -> RowResiduals:
    """A first look, which costs next to nothing: the residuals of trusted features over the current frame's rows.

    pairs: N correspondences. trust: (N,). H: fitted to them. size: width and height, px.
    """
    halves, shared = _first_look(H, pairs.reference_px, pairs.current_px, trust, size[0] / _STRIPS, size[1] / _BANDS)
    return RowResiduals(halves, float(shared))


def independent_share(one: FloatArray, other: FloatArray) -> float:
    """Share of the common variance of two measurements of curves over F frames that no single shape explains.

    Relief shows one shape, larger or smaller as the camera moves, and water one that grows; rows that swing show waves
    of any phase. 0 where the measurements have nothing in common.

    Args:
        one: (F, bands, 2), along x and along y.
        other: the same, with independent errors.
    """
    one, other = (each.transpose(0, 2, 1).reshape(-1, each.shape[1]) for each in (one, other))
    one, other = one - one.mean(axis=0), other - other.mean(axis=0)
    common = one.T @ other
    values = np.linalg.eigvalsh((common + common.T) / 2)
    return float(1 - values[-1] / values.sum()) if values.sum() > 0 else 0.0


def changing_share(one: FloatArray, other: FloatArray) -> float:
    """Variance of the change from frame to frame over that of two curves that have nothing to do with each other.

    1 for curves that are new in every frame, near 0 for those of relief under a camera that moves smoothly. Arguments
    as for `independent_share`.
    """
    one, other = one - one.mean(axis=0), other - other.mean(axis=0)
    variance = float(np.mean(one * other))
    change = float(np.mean(np.diff(one, axis=0) * np.diff(other, axis=0)))
    return change / (2 * variance) if variance > 0 else 0.0


def fit_rows(pairs: Correspondences, trust: FloatArray, model: str, threshold_px: float, guess: Homography,
             size: tuple[int, int], rows: RowShifts | None = None) -> RowFit | None:
    """Fits a homography and rows to all features within a few px; None where they do not determine them.

    Args:
        pairs: N correspondences.
        trust: (N,) prior weights in [0, 1].
        model: one of `models.MODELS`.
        threshold_px: inlier threshold, reference side.
        guess: initial `ref_H_cur`.
        size: width and height of the frame, px.
        rows: initial displacements; None for nought.
    """
    if np.count_nonzero(trust > TRUSTED) < _LEAST_FEATURES:
        return None
    joint = _Joint(pairs, trust, model, threshold_px, size)
    start = joint.started(guess) if rows is None else (guess, rows)
    return None if start is None else joint.finished(*start)


@dataclass(frozen=True, eq=False)
class _Prior:
    """What is expected of the curves along x and along y: numbers of shapes, see `_shapes`, and (2,) RMS, px."""

    shapes: tuple[int, int]
    rms_px: FloatArray

    def with_shape(self, axis: int, shape: int) -> _Prior:
        """Another shape along x (axis 0) or y (1)."""
        return replace(self, shapes=(shape, self.shapes[1]) if axis == 0 else (self.shapes[0], shape))

    @property
    def precisions(self) -> FloatArray:
        """(2, K, K) inverse covariances of the coefficients, 1/px^2."""
        return np.asarray(_shapes().precision[list(self.shapes)] / self.rms_px[:, None, None] ** 2)


@dataclass(frozen=True, eq=False)
class _Shapes:
    """S shapes of curves: inverse correlations (S, K, K) of the coefficients, and logarithms of their determinants."""

    precision: FloatArray
    log_determinant: FloatArray


@cache
def _shapes() -> _Shapes:
    """Smooth curves of several lengths, and waves of several frequencies that keep their phase for some length.

    Gaussian processes (Rasmussen and Williams 2006, eq. 4.9; with a cosine, eq. 4.14 of a narrow spectrum).
    """
    apart = np.subtract.outer(np.arange(_COUNT), np.arange(_COUNT)) / _INTERVALS
    smooth = [np.exp(-(apart**2) / (2 * length**2)) for length in _LENGTHS]
    waves = [np.exp(-(apart**2) / (2 * length**2)) * np.cos(2 * np.pi * cycles * apart)
             for length in _COHERENCE for cycles in _CYCLES]
    precision = np.linalg.inv(np.stack([*smooth, *waves]) + _NUGGET * np.eye(_COUNT))
    return _Shapes(precision, np.linalg.slogdet(precision)[1])


@dataclass(frozen=True, eq=False)
class _Equations:
    """Normal equations of each strip at a homography without rows: (S, p, p), (S, p) and (S,) squared residuals."""

    normal: FloatArray
    right: FloatArray
    squares: FloatArray
    plane: int  # the first so many unknowns are those of the homography

    @property
    def total(self) -> _Equations:
        """Those of all strips as of one."""
        return replace(self, normal=self.normal.sum(axis=0, keepdims=True), right=self.right.sum(axis=0, keepdims=True),
                       squares=self.squares.sum(axis=0, keepdims=True))

    def solved(self, strips: BoolArray, prior: _Prior) -> FloatArray | None:
        """The unknowns by some of the strips, (S,) bool."""
        found, out, _ = _solve(self.normal[strips].sum(axis=0), self.right[strips].sum(axis=0), prior.precisions,
                               self.plane)
        return out if found else None

    def evidence(self, prior: _Prior) -> float:
        """Twice the logarithm of the marginal likelihood of all strips (Rasmussen and Williams 2006, eq. 5.8)."""
        found, out, log_determinant = _solve(self.normal.sum(axis=0), self.right.sum(axis=0), prior.precisions,
                                             self.plane)
        curves = _shapes().log_determinant[list(prior.shapes)].sum() - 2 * _COUNT * np.log(prior.rms_px).sum()
        return float(out @ self.right.sum(axis=0) - log_determinant + curves) if found else -np.inf

    def flat(self, strips: BoolArray) -> FloatArray | None:
        """The unknowns if the rows do not move."""
        out, which = np.zeros(self.normal.shape[1]), slice(self.plane)
        normal, right = self.normal[strips, which, which].sum(axis=0), self.right[strips, which].sum(axis=0)
        found, out[which] = gn.solve(normal, right)
        return out if found else None

    def losses(self, unknowns: FloatArray) -> FloatArray:
        """(S,) squared residuals of each strip."""
        quadratic = (self.normal @ unknowns) @ unknowns
        return np.asarray(self.squares - 2 * self.right @ unknowns + quadratic)


@dataclass(frozen=True, eq=False)
class _Weights:
    """weight (N,), information (N, 2, 2) of each feature at the present estimate; inlier (N,) bool."""

    weight: FloatArray
    information: FloatArray
    inlier: BoolArray


@dataclass(frozen=True, eq=False)
class _Joint:
    """The estimation problem of `fit_rows`."""

    pairs: Correspondences
    trust: FloatArray
    model: str
    threshold_px: float
    size: tuple[int, int]

    def started(self, H: Homography) -> tuple[Homography, RowShifts] | None:
        """A rough estimate, with limits that become narrower."""
        rows: RowShifts | None = None
        for limit_px in _LIMITS_PX:
            equations = self._equations(H, self._weighted(H, rows, max(limit_px, self.threshold_px)))
            unknowns = equations.solved(_EVERY, _Prior(_START_SHAPES, np.full(2, _START_PX)))
            if unknowns is None:
                return None
            H, rows = self._moved(H, unknowns)
        return None if rows is None else (H, rows)

    def finished(self, H: Homography, rows: RowShifts) -> RowFit | None:
        """The estimate with the shapes that the features make most likely."""
        equations = self._equations(H, self._weighted(H, rows, None))
        prior = self._likeliest(equations, _Prior(_START_SHAPES, self._rms_px(rows)))
        judged, unknowns = self._judged(equations, prior), equations.solved(_EVERY, prior)
        if unknowns is None:
            return None
        H, rows = self._moved(H, unknowns)
        unknowns = self._equations(H, self._weighted(H, rows, None)).solved(_EVERY, prior)
        fit = None if unknowns is None else self._fit(*self._moved(H, unknowns))
        return None if fit is None else RowFit(fit, *judged)

    def _likeliest(self, equations: _Equations, prior: _Prior) -> _Prior:
        """The prior with the most likely shape along x, then along y."""
        total, smooth, waves = equations.total, len(_LENGTHS), len(_CYCLES)
        for axis in range(2):
            tried = [prior.with_shape(axis, k) for k in range(smooth + waves)]
            prior = max(tried, key=total.evidence)
            if prior.shapes[axis] >= smooth:
                prior = max(prior, prior.with_shape(axis, prior.shapes[axis] + waves), key=total.evidence)
        return prior

    def _rms_px(self, rows: RowShifts) -> FloatArray:
        """(2,) RMS of the displacements at the trusted features."""
        shown = rows.at(self.pairs.current_px[self.trust > TRUSTED, 1])
        return np.asarray(np.clip(np.sqrt((shown**2).mean(axis=0)), *_RMS_RANGE_PX))

    def _judged(self, equations: _Equations, prior: _Prior) -> tuple[float, float]:
        """Gain and share of the strips, see `RowFit`."""
        with_rows, without = np.zeros(_STRIPS), np.zeros(_STRIPS)
        for half in (_ODD, ~_ODD):
            rows, flat = equations.solved(half, prior), equations.flat(half)
            if rows is None or flat is None:
                return -1.0, 0.0
            with_rows[~half], without[~half] = equations.losses(rows)[~half], equations.losses(flat)[~half]
        gain = min(1 - with_rows[half].sum() / max(without[half].sum(), 1e-12) for half in (_ODD, ~_ODD))
        used = equations.squares > 0
        return float(gain), float(np.mean((with_rows < without)[used])) if used.any() else 0.0

    def _fit(self, H: Homography, rows: RowShifts) -> Fit | None:
        problem = EstimationProblem.of(straightened(self.pairs, rows), self.trust, self.model, self.threshold_px)
        limit_px = problem.inlier_threshold_px(MAGSAC, problem.excess_scatter_px(H))
        problem = problem.noise_inflated(problem.excess_scatter_px(H))
        ratios = problem.squared_ratios(H, limit_px)
        weight = gn.weights_of(ratios, MAGSAC.weight, MAGSAC.beyond) * self.trust
        fit = make_fit(problem, H, weight, ratios < 1)
        return None if fit is None else replace(fit, rows=rows)

    def _weighted(self, H: Homography, rows: RowShifts | None, limit_px: float | None) -> _Weights:
        """limit_px: inlier threshold; None: by the scatter."""
        problem = EstimationProblem.of(straightened(self.pairs, rows), self.trust, self.model, self.threshold_px)
        noise_px = problem.excess_scatter_px(H) if limit_px is None else _FLOOR_SHARE * limit_px
        limit_px = problem.inlier_threshold_px(MAGSAC, problem.excess_scatter_px(H)) if limit_px is None else limit_px
        ratios = problem.squared_ratios(H, limit_px)
        weight = gn.weights_of(ratios, MAGSAC.weight, MAGSAC.beyond) * self.trust
        return _Weights(weight, problem.noise_inflated(noise_px).pairs.information, ratios < 1)

    def _equations(self, H: Homography, weights: _Weights) -> _Equations:
        current = self.pairs.current_px
        first, spline = spline_weights(current[:, 1], _COUNT, self.size[1])
        strip = np.clip(current[:, 0] * (_STRIPS / self.size[0]), 0, _STRIPS - 1).astype(np.int64)
        normal, right, squares = _accumulate(
            H, self.pairs.reference_px, current, weights.information / _DESIGN_EFFECT, weights.weight,
            self._basis.centre, self._basis.radius, self._plane, point_jacobian(H, current), first, spline, _COUNT,
            strip, _STRIPS)
        return _Equations(normal, right, squares, self._plane)

    def _moved(self, H: Homography, unknowns: FloatArray) -> tuple[Homography, RowShifts]:
        moved = gn.compose(unknowns[: self._plane], H, self._basis.centre, self._basis.radius)
        return moved, RowShifts(unknowns[self._plane :].reshape(-1, 2), self.size[1])

    @property
    def _plane(self) -> int:
        return PARAMETERS[self.model]

    @cached_property
    def _basis(self) -> Basis:
        return Basis.around(self.model, self.pairs.reference_px)


_ROW, _TABLE, _STACK = read(F64, 1), read(F64, 2), read(F64, 3)


@kernel((_TABLE, _TABLE, _TABLE, _ROW, F64, F64))
def _first_look(H: Homography, reference: FloatArray, current: FloatArray, trust: FloatArray, strip_px: float,
                band_px: float) -> tuple[FloatArray, float]:
    """Both values of `RowResiduals`; 0 where too few bands hold features of both halves."""
    count, mean = np.zeros((2, _BANDS)), np.zeros((2, _BANDS, 2))
    for i in range(len(current)):
        if trust[i] <= TRUSTED:
            continue
        x, y = current[i, 0], current[i, 1]
        w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
        ex = reference[i, 0] - (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / w
        ey = reference[i, 1] - (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / w
        if abs(ex) < _REACH_PX and abs(ey) < _REACH_PX:
            half, k = int(max(x, 0.0) / strip_px) % 2, min(int(max(y, 0.0) / band_px), _BANDS - 1)
            count[half, k] += 1
            mean[half, k, 0] += ex
            mean[half, k, 1] += ey
    bands, shared = 0, 0.0
    for k in range(_BANDS):
        enough = min(count[0, k], count[1, k]) >= _LEAST_IN_BAND
        bands += enough
        for d in range(2):
            for half in range(2):
                mean[half, k, d] *= enough / max(count[half, k], 1.0)
            shared += mean[0, k, d] * mean[1, k, d]
    return mean, shared / bands if bands >= _LEAST_BANDS else 0.0


@kernel((_TABLE, _TABLE, _TABLE, _STACK, _ROW, _ROW, F64, I64, _STACK, read(I64, 1), _TABLE, I64, read(I64, 1), I64))
def _accumulate(H: Homography, reference: FloatArray, current: FloatArray, information: FloatArray, weight: FloatArray,
                centre: FloatArray, radius: float, plane: int, point_jacobian: FloatArray, first: IdArray,
                spline: FloatArray, count: int, strip: IdArray,
                strips: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Normal equations of each strip: the first `plane` unknowns as in `gauss_newton.accumulate`, then coefficients."""
    unknowns = plane + 2 * count
    normal, right, squares = np.zeros((strips, unknowns, unknowns)), np.zeros((strips, unknowns)), np.zeros(strips)
    along_x, along_y, place = np.empty(16), np.empty(16), np.empty(16, np.int64)
    for i in range(len(current)):
        if weight[i] <= 0:
            continue
        w = H[2, 0] * current[i, 0] + H[2, 1] * current[i, 1] + H[2, 2]
        mapped_x = (H[0, 0] * current[i, 0] + H[0, 1] * current[i, 1] + H[0, 2]) / w
        mapped_y = (H[1, 0] * current[i, 0] + H[1, 1] * current[i, 1] + H[1, 2]) / w
        x, y = (mapped_x - centre[0]) / radius, (mapped_y - centre[1]) / radius
        along_x[0], along_x[1], along_x[2], along_x[3] = 1.0, 0.0, -y, x
        along_x[4], along_x[5], along_x[6], along_x[7] = x, y, x * x, x * y
        along_y[0], along_y[1], along_y[2], along_y[3] = 0.0, 1.0, x, y
        along_y[4], along_y[5], along_y[6], along_y[7] = -y, x, x * y, y * y
        for a in range(plane):
            place[a] = a
        used = plane
        for k in range(4):
            for d in range(2):
                place[used] = plane + 2 * (first[i] + k) + d
                along_x[used] = point_jacobian[i, 0, d] * spline[i, k]
                along_y[used] = point_jacobian[i, 1, d] * spline[i, k]
                used += 1
        xx, xy = weight[i] * information[i, 0, 0], weight[i] * information[i, 0, 1]
        yy = weight[i] * information[i, 1, 1]
        ex, ey = reference[i, 0] - mapped_x, reference[i, 1] - mapped_y
        s = strip[i]
        squares[s] += xx * ex * ex + 2 * xy * ex * ey + yy * ey * ey
        for a in range(used):  # places ascend, so this fills the lower triangle
            weighted_x, weighted_y = xx * along_x[a] + xy * along_y[a], xy * along_x[a] + yy * along_y[a]
            right[s, place[a]] += weighted_x * ex + weighted_y * ey
            for b in range(a + 1):
                normal[s, place[a], place[b]] += weighted_x * along_x[b] + weighted_y * along_y[b]
    for s in range(strips):
        for a in range(unknowns):
            for b in range(a):
                normal[s, b, a] = normal[s, a, b]
    return normal, right, squares


@kernel((_TABLE, _ROW, _STACK, I64))
def _solve(normal: FloatArray, right: FloatArray, precisions: FloatArray, plane: int) -> tuple[bool, FloatArray, float]:
    """Solution (p,) by Cholesky decomposition with precisions (2, K, K) added, and the logarithm of the determinant.

    False where it is singular.
    """
    p, count = len(right), precisions.shape[1]
    lower, x, log_determinant = normal.copy(), right.copy(), 0.0
    for d in range(2):
        for i in range(count):
            for k in range(count):
                lower[plane + 2 * i + d, plane + 2 * k + d] += precisions[d, i, k]
    for a in range(p):
        for b in range(a + 1):
            rest = lower[a, b]
            for c in range(b):
                rest -= lower[a, c] * lower[b, c]
            if a != b:
                lower[a, b] = rest / lower[b, b]
            elif rest > 0:
                lower[a, a] = np.sqrt(rest)
                log_determinant += 2 * np.log(lower[a, a])
            else:
                return False, x, log_determinant
        for c in range(a):
            x[a] -= lower[a, c] * x[c]
        x[a] /= lower[a, a]
    for a in range(p - 1, -1, -1):
        for c in range(a + 1, p):
            x[a] -= lower[c, a] * x[c]
        x[a] /= lower[a, a]
    return True, x, log_determinant
