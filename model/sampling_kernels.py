"""Compiled loops that read a picture between its pixels: nearest, linear, cubic and Lanczos-3, points or footprints.

A source is a flat array of texels with a border, so that no tap can miss it.  Positions are taken `_CHUNK` at a time:
fractions and indices are computed, texels are gathered (the only loop that is not vectorised), and weights are applied.
Eight-bit colour comes as four bytes in one 32-bit texel, so that one load brings a whole pixel.
"""

from __future__ import annotations

import numpy as np

from fullsphere.model.kernels import compiled

NEAREST, LINEAR, CUBIC, LANCZOS3 = 0, 1, 2, 3
TAPS = (1, 2, 4, 6)
"""Taps along a side of each kernel."""

SHARP_PX = 1.2
"""A footprint of fewer source pixels is not averaged, unless a caller says otherwise."""

_CHUNK = 256  # a chunk and its weights stay in the innermost cache
_MOST = 64  # samples along a side of one pixel's footprint

_HALF, _ONE = np.float32(0.5), np.float32(1)
_BYTE, _EIGHT, _SIXTEEN, _TWENTY_FOUR = np.uint32(255), np.uint32(8), np.uint32(16), np.uint32(24)
_THIRD_TURN = np.float32(np.sqrt(0.75))  # sin of 120 degrees
# Taylor series of sin(y)/y and cos(y) in y^2, exact to rounding in float32 for |y| <= pi/3
_S1, _S2, _S3, _S4, _S5 = (np.float32(s) for s in (-1 / 6, 1 / 120, -1 / 5040, 1 / 362880, -1 / 39916800))
_C1, _C2, _C3, _C4, _C5 = (np.float32(c) for c in (-1 / 2, 1 / 24, -1 / 720, 1 / 40320, -1 / 3628800))
_SHARP = np.float32(SHARP_PX**2)
_SLOPE = np.float32(-0.6)
_PI = np.float32(np.pi)
_SHARE = np.float32(1 / 24)
_APART, _MUCH = 8, 4.0  # of positions looked at for where they are; source pixels for one of the target's
_TINY = np.float32(1e-9)  # at a distance of zero the other taps are nothing beside the one there


@compiled
def _split(u: np.ndarray, v: np.ndarray, stride: int, shift: int, first: np.ndarray, fraction: np.ndarray) -> None:
    """The texel `first` (n,) of each position's taps, which start `shift` before it, and the fractions (2 chunks).

    A position that is NaN reads from the corner of the picture; what is read there is not used.
    """
    corner = u.dtype.type(shift)
    for k in range(u.shape[0]):
        inside = u[k] == u[k]
        p, q = u[k] if inside else corner, v[k] if inside else corner
        x, y = np.int32(p), np.int32(q)  # positions are positive: truncation is the floor
        fraction[k] = p - u.dtype.type(x)
        fraction[_CHUNK + k] = q - u.dtype.type(y)
        first[k] = np.uint32(y - shift) * np.uint32(stride) + np.uint32(x - shift)


@compiled
def _cubic_weights(a: np.ndarray, weights: np.ndarray) -> None:
    """Parametric cubic convolution (Keys 1981) of slope -0.6 at the first zero: weights of 4 taps at fractions (n,).

    The slope that keeps most of the detail of photographs (Park and Schowengerdt 1983); -1/2 blurs more, -3/4 rings.
    """
    for k in range(a.shape[0]):
        t = a[k]
        far, near = t * (_ONE - t) * (_ONE - t), t * t * (_ONE - t)
        weights[k] = _SLOPE * far
        weights[3 * _CHUNK + k] = _SLOPE * near
        step = t * t * (np.float32(3) - t - t)
        weights[_CHUNK + k] = (_ONE - step) - _SLOPE * near
        weights[2 * _CHUNK + k] = step - _SLOPE * far


@compiled
def _lanczos_weights(a: np.ndarray, weights: np.ndarray) -> None:
    """sinc(x) sinc(x/3) at the distances x of 6 taps from fractions (n,), made to sum to 1.

    sin(pi x) is the same at all taps but for its sign, and sin(pi x/3) follows from the values at the fraction by
    turns of 60 degrees; the common factor drops out with the sum.
    """
    for k in range(a.shape[0]):
        t = a[k]
        y = _PI / np.float32(3) * t
        q = y * y
        s = y * (_ONE + q * (_S1 + q * (_S2 + q * (_S3 + q * (_S4 + q * _S5)))))
        c = _ONE + q * (_C1 + q * (_C2 + q * (_C3 + q * (_C4 + q * _C5))))
        # sin(pi (t + n)/3) = s cos(60 n) + c sin(60 n) at distances t + 2, t + 1, t, t - 1, t - 2, t - 3
        near = _HALF * s
        far = _THIRD_TURN * c
        d0, d1, d4, d5 = t + np.float32(2), t + _ONE, t - np.float32(2), t - np.float32(3)
        d3 = min(t - _ONE, -_TINY)
        d2 = max(t, _TINY)
        s2 = max(s, _PI / np.float32(3) * _TINY)
        # signs of sin(pi (t + n)) alternate with n
        w0 = (far - near) / (d0 * d0)
        w1 = -(near + far) / (d1 * d1)
        w2 = s2 / (d2 * d2)
        w3 = (far - near) / (d3 * d3)
        w4 = -(near + far) / (d4 * d4)
        w5 = s / (d5 * d5)
        total = _ONE / (w0 + w1 + w2 + w3 + w4 + w5)
        weights[k] = w0 * total
        weights[_CHUNK + k] = w1 * total
        weights[2 * _CHUNK + k] = w2 * total
        weights[3 * _CHUNK + k] = w3 * total
        weights[4 * _CHUNK + k] = w4 * total
        weights[5 * _CHUNK + k] = w5 * total


@compiled
def _weights_of(kind: int, fraction: np.ndarray, count: int, across: np.ndarray, down: np.ndarray) -> int:
    """The weights of the taps of `count` positions, across and down (6 chunks each); answers the taps along a side."""
    a, b = fraction[:count], fraction[_CHUNK : _CHUNK + count]
    if kind == LINEAR:
        for k in range(count):
            across[k] = _ONE - a[k]
            across[_CHUNK + k] = a[k]
        for k in range(count):
            down[k] = _ONE - b[k]
            down[_CHUNK + k] = b[k]
        return 2
    if kind == CUBIC:
        _cubic_weights(a, across)
        _cubic_weights(b, down)
        return 4
    _lanczos_weights(a, across)
    _lanczos_weights(b, down)
    return 6


@compiled
def _take_off_curvature(weights: np.ndarray, a: np.ndarray, share: np.ndarray) -> None:
    """Take a share (n,) of the second difference at fractions (n,) off the value of the four inner taps."""
    for k in range(a.shape[0]):
        t, s = a[k], share[k]
        weights[k] -= s * (_ONE - t)
        weights[_CHUNK + k] += s * (np.float32(2) - np.float32(3) * t)
        weights[2 * _CHUNK + k] += s * (np.float32(3) * t - _ONE)
        weights[3 * _CHUNK + k] -= s * t


@compiled
def _sums(
    texels: np.ndarray,
    values: np.ndarray,
    stride: int,
    channels: int,
    kind: int,
    u: np.ndarray,
    v: np.ndarray,
    scratch: tuple,
    sums: np.ndarray,
) -> None:
    """Interpolated values at a chunk of positions or less: `sums` (4 chunks) holds a chunk for each channel."""
    first, fraction, across, down, weight, gathered, read, finer = scratch
    count = u.shape[0]
    _split(u, v, stride, kind - 1, first, fraction)
    if kind == LINEAR and texels.size > 0:
        _linear_sums(texels, stride, count, first, fraction, gathered, sums)
        return
    side = _weights_of(kind, fraction, count, across, down)
    if kind >= CUBIC:
        inner = (side // 2 - 2) * _CHUNK
        _take_off_curvature(across[inner:], fraction[:count], finer[:count])
        _take_off_curvature(down[inner:], fraction[_CHUNK : _CHUNK + count], finer[_CHUNK : _CHUNK + count])
    for k in range(4 * _CHUNK):
        sums[k] = 0
    for j in range(side):
        row = down[j * _CHUNK : j * _CHUNK + count]
        for i in range(side):
            column = across[i * _CHUNK : i * _CHUNK + count]
            for k in range(count):
                weight[k] = row[k] * column[k]
            if texels.size > 0:
                _add_texels(texels, np.uint32(j * stride + i), first, weight, gathered, sums, count)
            else:
                for channel in range(channels):
                    part = sums[channel * _CHUNK : channel * _CHUNK + count]
                    offset = np.int64(j * stride + i) * channels + channel
                    for k in range(count):
                        read[k] = values[np.uint64(np.int64(first[k]) * channels + offset)]
                    for k in range(count):
                        part[k] += weight[k] * read[k]


@compiled
def _add_texels(
    texels: np.ndarray,
    step: int,
    first: np.ndarray,
    weight: np.ndarray,
    gathered: np.ndarray,
    sums: np.ndarray,
    count: int,
) -> None:
    """Add one tap of four bytes, `step` texels after the first, to the sums of four channels."""
    for k in range(count):
        gathered[k] = texels[first[k] + step]
    for k in range(count):
        t, w = gathered[k], weight[k]
        sums[k] += w * np.float32(np.int32(t & _BYTE))
        sums[_CHUNK + k] += w * np.float32(np.int32((t >> _EIGHT) & _BYTE))
        sums[2 * _CHUNK + k] += w * np.float32(np.int32((t >> _SIXTEEN) & _BYTE))
        sums[3 * _CHUNK + k] += w * np.float32(np.int32(t >> _TWENTY_FOUR))


@compiled
def _linear_sums(
    texels: np.ndarray,
    stride: int,
    count: int,
    first: np.ndarray,
    fraction: np.ndarray,
    gathered: np.ndarray,
    sums: np.ndarray,
) -> None:
    """The four taps of linear interpolation in one pass."""
    below, right = np.uint32(stride), np.uint32(1)
    for k in range(count):
        t = first[k]
        gathered[k] = texels[t]
        gathered[_CHUNK + k] = texels[t + right]
        gathered[2 * _CHUNK + k] = texels[t + below]
        gathered[3 * _CHUNK + k] = texels[t + below + right]
    for k in range(count):
        a, b = fraction[k], fraction[_CHUNK + k]
        w11 = a * b
        w10, w01 = a - w11, b - w11
        w00 = (_ONE - a) - w01
        p, q = gathered[k], gathered[_CHUNK + k]
        r, s = gathered[2 * _CHUNK + k], gathered[3 * _CHUNK + k]
        sums[k] = (
            w00 * np.float32(np.int32(p & _BYTE))
            + w10 * np.float32(np.int32(q & _BYTE))
            + w01 * np.float32(np.int32(r & _BYTE))
            + w11 * np.float32(np.int32(s & _BYTE))
        )
        sums[_CHUNK + k] = (
            w00 * np.float32(np.int32((p >> _EIGHT) & _BYTE))
            + w10 * np.float32(np.int32((q >> _EIGHT) & _BYTE))
            + w01 * np.float32(np.int32((r >> _EIGHT) & _BYTE))
            + w11 * np.float32(np.int32((s >> _EIGHT) & _BYTE))
        )
        sums[2 * _CHUNK + k] = (
            w00 * np.float32(np.int32((p >> _SIXTEEN) & _BYTE))
            + w10 * np.float32(np.int32((q >> _SIXTEEN) & _BYTE))
            + w01 * np.float32(np.int32((r >> _SIXTEEN) & _BYTE))
            + w11 * np.float32(np.int32((s >> _SIXTEEN) & _BYTE))
        )
        sums[3 * _CHUNK + k] = (
            w00 * np.float32(np.int32(p >> _TWENTY_FOUR))
            + w10 * np.float32(np.int32(q >> _TWENTY_FOUR))
            + w01 * np.float32(np.int32(r >> _TWENTY_FOUR))
            + w11 * np.float32(np.int32(s >> _TWENTY_FOUR))
        )


@compiled
def _scratch() -> tuple:
    """Room for a chunk: first texels, fractions, weights across and down, of a tap, what was read of it, curvature."""
    return (
        np.zeros(_CHUNK, np.uint32),
        np.zeros(2 * _CHUNK, np.float32),
        np.zeros(6 * _CHUNK, np.float32),
        np.zeros(6 * _CHUNK, np.float32),
        np.zeros(_CHUNK, np.float32),
        np.zeros(4 * _CHUNK, np.uint32),
        np.zeros(_CHUNK, np.float32),
        np.zeros(2 * _CHUNK, np.float32),
    )


@compiled
def _store(value: float, top: float) -> float:
    """A value as it is stored: rounded (by the cast that follows) and clipped to 0..top, if top is not zero."""
    return min(max(value, np.float32(0)), np.float32(top)) + _HALF if top > 0 else value


@compiled
def sample_tile(
    texels: np.ndarray,
    values: np.ndarray,
    stride: int,
    channels: int,
    kind: int,
    u: np.ndarray,
    v: np.ndarray,
    limits: np.ndarray,
    top: float,
    left: int,
    width: int,
    out: np.ndarray,
) -> None:
    """Values of a picture at the positions of a rectangle of a target's pixels.

    Parameters
    ----------
    texels
        (h w,) uint32 of a picture with four bytes a pixel, else empty; `stride` is w.
    values
        (h w channels,) samples of a picture of any other type, else empty.
    kind
        NEAREST, LINEAR, CUBIC or LANCZOS3.
    u, v
        Positions in the bordered picture, float32 or float64, so that all taps are in it; NaN where nothing is read.
        (h, w), or (h + 2, w + 2) with the pixels around the rectangle: then a pixel is taken for the average over its
        square in source and target, as `_average` and `_mark_finer` say.
    limits
        Least u, least v, greatest u, greatest v of the picture; how its edges meet (0 not, 1 left and right, 2 as a
        sphere); centre u, centre v, aspect and radius of the disc outside which nothing is seen; pixels around, a huge
        number where the edges do not meet; the longest step that is no jump; the square of the footprint, in source
        pixels, up to which nothing is averaged.  Of the positions' type.
    top
        The largest code of an integer type, to which values are clipped; zero for floating point.
    left, width
        The rectangle's columns in `out`.
    out
        (h, W, c) rows of the target of which the columns are written, c at most `channels`; zero where the position
        is NaN.
    """
    height = out.shape[0]
    halo = (u.shape[0] - height) // 2
    scratch = _scratch()
    sums = np.zeros(4 * _CHUNK, np.float32)
    if texels.size > 0:
        scratch[5][0] = np.uint32(_fetched(texels, stride, 1, u, v))
    else:
        scratch[6][0] = np.float32(_fetched(values, stride, channels, u, v))
    for j in range(height):
        for start in range(0, width, _CHUNK):
            count = min(_CHUNK, width - start)
            part_u = u[j + halo, start + halo : start + halo + count]
            part_v = v[j + halo, start + halo : start + halo + count]
            row = out[j, left + start : left + start + count]
            seen = 0
            for k in range(count):
                seen += np.int32(part_u[k] == part_u[k])
            if seen == 0:
                row[:] = 0
                continue
            if kind == NEAREST:
                _nearest(texels, values, stride, channels, part_u, part_v, row)
                continue
            if halo == 1 and kind >= CUBIC:
                _mark_finer(u, v, j, start, count, limits, scratch[7])
            _sums(texels, values, stride, channels, kind, part_u, part_v, scratch, sums)
            if texels.size > 0:
                _pack(sums, part_u, scratch[5], count)
                _unpack(scratch[5], row)
                continue
            for channel in range(row.shape[1]):
                for k in range(count):
                    value = _store(sums[channel * _CHUNK + k], top)
                    row[k, channel] = value if part_u[k] == part_u[k] else np.float32(0)
    if halo == 1 and kind != NEAREST:
        _average(texels, values, stride, channels, kind, u, v, limits, top, out[:, left : left + width], scratch, sums)


@compiled
def mark_seen(u: np.ndarray, left: int, width: int, weight: np.ndarray) -> None:
    """1 where a position is not NaN, else 0, in columns of `weight` (h, W); u (h, w), or a pixel more all around."""
    halo = (u.shape[0] - weight.shape[0]) // 2
    for j in range(weight.shape[0]):
        places, marks = u[j + halo, halo : halo + width], weight[j, left : left + width]
        for k in range(width):
            marks[k] = _ONE if places[k] == places[k] else np.float32(0)


@compiled
def some_are_large(u: np.ndarray, v: np.ndarray) -> bool:
    """Whether any two neighbours of positions (h, w) may be so far apart that a pixel is averaged; no if not."""
    found = 0
    for j in range(u.shape[0] - 1):
        above_u, above_v, below_u, below_v = u[j], v[j], u[j + 1], v[j + 1]
        for i in range(u.shape[1] - 1):
            du, dv = above_u[i + 1] - above_u[i], above_v[i + 1] - above_v[i]
            eu, ev = below_u[i] - above_u[i], below_v[i] - above_v[i]
            found += np.int32((du * du + dv * dv > _SHARP) | (eu * eu + ev * ev > _SHARP))
        if found > 0:
            return True
    return False


@compiled
def _fetched(samples: np.ndarray, stride: int, channels: int, u: np.ndarray, v: np.ndarray) -> float:
    """Read the part of the picture that the positions are in, a row after the other; what comes back means nothing.

    Processors fetch ahead along rows, but not along the bent paths that positions take: this brings the part into the
    cache at a fraction of the time.
    """
    u0, v0, u1, v1 = np.inf, np.inf, -np.inf, -np.inf
    for j in range(0, u.shape[0], _APART):
        for i in range(0, u.shape[1], _APART):
            if u[j, i] == u[j, i]:
                u0, u1 = min(u0, u[j, i]), max(u1, u[j, i])
                v0, v1 = min(v0, v[j, i]), max(v1, v[j, i])
    total = samples[0]
    if not (u1 - u0) * (v1 - v0) <= _MUCH * u.size:
        return total
    line = max(64 // samples.itemsize, 1)  # bytes that the cache takes at once
    for y in range(int(v0), int(v1) + 1):
        for k in range((y * stride + int(u0)) * channels, (y * stride + int(u1)) * channels, line):
            total = max(total, samples[np.uint64(k)])
    return total


@compiled
def _nearest(
    texels: np.ndarray, values: np.ndarray, stride: int, channels: int, u: np.ndarray, v: np.ndarray, out: np.ndarray
) -> None:
    """The nearest pixel's samples (n, c) at positions (n,); zero where the position is NaN."""
    for k in range(u.shape[0]):
        if u[k] == u[k]:
            at = np.int64(v[k] + _HALF) * stride + np.int64(u[k] + _HALF)
            if texels.size > 0:
                texel = texels[np.uint64(at)]
                for channel in range(out.shape[1]):
                    out[k, channel] = (texel >> np.uint32(8 * channel)) & _BYTE
            else:
                for channel in range(out.shape[1]):
                    out[k, channel] = values[np.uint64(at * channels + channel)]
        else:
            for channel in range(out.shape[1]):
                out[k, channel] = 0


@compiled
def _pack(sums: np.ndarray, u: np.ndarray, packed: np.ndarray, count: int) -> None:
    """Four channels of sums as the bytes of a texel, rounded and clipped; zero where u is NaN."""
    for k in range(count):
        texel = (
            _code(sums[k])
            | (_code(sums[_CHUNK + k]) << _EIGHT)
            | (_code(sums[2 * _CHUNK + k]) << _SIXTEEN)
            | (_code(sums[3 * _CHUNK + k]) << _TWENTY_FOUR)
        )
        packed[k] = texel if u[k] == u[k] else np.uint32(0)


@compiled
def _code(value: float) -> int:
    return np.uint32(np.int32(min(max(value, np.float32(0)), np.float32(255)) + _HALF))


@compiled
def _unpack(packed: np.ndarray, rows: np.ndarray) -> None:
    """The bytes of texels as rows (n, c)."""
    if rows.shape[1] == 3:
        for k in range(rows.shape[0]):
            texel = packed[k]
            rows[k, 0] = texel & _BYTE
            rows[k, 1] = (texel >> _EIGHT) & _BYTE
            rows[k, 2] = (texel >> _SIXTEEN) & _BYTE
        return
    for k in range(rows.shape[0]):
        texel = packed[k]
        for channel in range(rows.shape[1]):
            rows[k, channel] = (texel >> np.uint32(8 * channel)) & _BYTE


@compiled
def _average(
    texels: np.ndarray,
    values: np.ndarray,
    stride: int,
    channels: int,
    kind: int,
    u: np.ndarray,
    v: np.ndarray,
    limits: np.ndarray,
    top: float,
    out: np.ndarray,
    scratch: tuple,
    sums: np.ndarray,
) -> None:
    """Average each target pixel (h, w, c) that is larger than a source pixel over its footprint.

    The footprint is the parallelogram of the steps to the neighbours, taken from the positions themselves.  A source
    pixel is itself an average over its square, and an average over less than a pixel changes nothing that a camera
    resolves: a footprint of s pixels is averaged over sqrt(s^2 - 1.2^2) (or what `limits` say).  So this goes over into
    the value at the point where s falls to 1.2, and is the whole of the footprint where s is large.
    """
    height, width, kept = out.shape
    around, longest, sharp = limits[9], limits[10], limits[11]
    large = np.zeros(width, np.uint8)
    at_u, at_v, owner = np.zeros(_CHUNK, u.dtype), np.zeros(_CHUNK, u.dtype), np.zeros(_CHUNK, np.int32)
    total, number = np.zeros((width, 4), np.float32), np.zeros(width, np.int32)
    for j in range(height):
        if _mark_large(u, v, j, limits, large) == 0:
            continue
        total[:] = 0
        number[:] = 0
        filled = 0
        for i in range(width):
            if large[i] == 0:
                continue
            p, q = u[j + 1, i + 1], v[j + 1, i + 1]
            xu, xv, x = _shorter(u[j + 1, i], p, u[j + 1, i + 2], v[j + 1, i], q, v[j + 1, i + 2], around, longest)
            yu, yv, y = _shorter(u[j, i + 1], p, u[j + 2, i + 1], v[j, i + 1], q, v[j + 2, i + 1], around, longest)
            across, down = min(int(np.ceil(x)), _MOST), min(int(np.ceil(y)), _MOST)
            wide, high = x * 0, y * 0
            if x * x > sharp:
                wide = np.sqrt(_ONE - sharp / (x * x))
            else:
                across = 1
            if y * y > sharp:
                high = np.sqrt(_ONE - sharp / (y * y))
            else:
                down = 1
            for m in range(across * down + 1):
                a = ((np.float32(m % across) + _HALF) / np.float32(across) - _HALF) * wide
                b = ((np.float32(m // across) + _HALF) / np.float32(down) - _HALF) * high
                s, t = p + a * xu + b * yu, q + a * xv + b * yv
                if m == across * down:
                    if number[i] > 0:
                        break
                    s, t = p, q  # nothing around it is seen: the middle is
                elif not _placed(s, t, limits):
                    s, t = _met(s, t, limits)
                    if not _placed(s, t, limits):
                        continue
                at_u[filled], at_v[filled], owner[filled] = s, t, i
                scratch[7][filled] = max(_ONE - (xu * xu + yu * yu), np.float32(0)) * _SHARE
                scratch[7][_CHUNK + filled] = max(_ONE - (xv * xv + yv * yv), np.float32(0)) * _SHARE
                number[i] += 1
                filled += 1
                if filled == _CHUNK:
                    _sums(texels, values, stride, channels, kind, at_u, at_v, scratch, sums)
                    _share(sums, owner, filled, total)
                    filled = 0
        if filled > 0:
            _sums(texels, values, stride, channels, kind, at_u[:filled], at_v[:filled], scratch, sums)
            _share(sums, owner, filled, total)
        for i in range(width):
            if large[i]:
                for channel in range(kept):
                    out[j, i, channel] = _store(total[i, channel] / np.float32(number[i]), top)


@compiled
def _mark_finer(
    u: np.ndarray, v: np.ndarray, j: int, start: int, count: int, limits: np.ndarray, share: np.ndarray
) -> None:
    """How much of the second difference is to be taken off where the target is finer: across, then down, a chunk each.

    A pixel is the average over its square, f + f''/24, and over s source pixels it is f + s^2 f''/24: with d what the
    source holds, d - (1 - s^2) d''/24.  Nothing where s is 1 or more.  So detail keeps the contrast that it would have
    had in a picture taken with the finer pixels.
    """
    around, longest = limits[9], limits[10]
    for k in range(count):
        i = start + k
        p, q = u[j + 1, i + 1], v[j + 1, i + 1]
        xu, xv, _ = _shorter(u[j + 1, i], p, u[j + 1, i + 2], v[j + 1, i], q, v[j + 1, i + 2], around, longest)
        yu, yv, _ = _shorter(u[j, i + 1], p, u[j + 2, i + 1], v[j, i + 1], q, v[j + 2, i + 1], around, longest)
        share[k] = max(_ONE - (xu * xu + yu * yu), np.float32(0)) * _SHARE
        share[_CHUNK + k] = max(_ONE - (xv * xv + yv * yv), np.float32(0)) * _SHARE


@compiled
def _mark_large(u: np.ndarray, v: np.ndarray, j: int, limits: np.ndarray, large: np.ndarray) -> int:
    """Mark the pixels of row j whose footprint is clearly more than a source pixel wide or high; answers how many."""
    around, longest, sharp = limits[9], limits[10], limits[11]
    above_u, row_u, below_u = u[j], u[j + 1], u[j + 2]
    above_v, row_v, below_v = v[j], v[j + 1], v[j + 2]
    count = 0
    for i in range(large.shape[0]):
        p, q = row_u[i + 1], row_v[i + 1]
        left = _squared(p - row_u[i], q - row_v[i], around, longest)
        right = _squared(row_u[i + 2] - p, row_v[i + 2] - q, around, longest)
        up = _squared(p - above_u[i + 1], q - above_v[i + 1], around, longest)
        down = _squared(below_u[i + 1] - p, below_v[i + 1] - q, around, longest)
        # where one step is NaN (outside) or jumps (to another face of a cube) the other decides
        wide = (not left <= sharp) & (not right <= sharp) & ((left > sharp) | (right > sharp))
        high = (not up <= sharp) & (not down <= sharp) & ((up > sharp) | (down > sharp))
        large[i] = wide | high
        count += np.int32(wide | high)
    return count


@compiled
def _squared(du: float, dv: float, around: float, longest: float) -> float:
    """The square of a step; across the edge of a picture that goes round it is the short way.  NaN if it is a jump."""
    du -= around * np.floor(du / around + _HALF)
    squared = du * du + dv * dv
    return squared if squared <= longest * longest else du * np.nan


@compiled
def _shorter(
    before: float,
    at: float,
    after: float,
    other_before: float,
    other: float,
    other_after: float,
    around: float,
    longest: float,
) -> tuple:
    """The shorter of the steps to a position from the one before and to the one after, and its length.

    Where neighbours lie on two faces of a cube a step jumps across the picture, and is none.
    """
    du, dv = at - before, other - other_before
    eu, ev = after - at, other_after - other
    d, e = _squared(du, dv, around, longest), _squared(eu, ev, around, longest)
    if e < d or d != d:
        du, dv, d = eu, ev, e
    if d != d:
        return at * 0, at * 0, at * 0
    return du - around * np.floor(du / around + _HALF), dv, np.sqrt(d)


@compiled
def _placed(s: float, t: float, limits: np.ndarray) -> bool:
    """Whether a position is in the picture and on its disc."""
    ds, dt = s - limits[5], (t - limits[6]) / limits[7]
    inside = s >= limits[0] and s <= limits[2] and t >= limits[1] and t <= limits[3]
    return inside and ds * ds + dt * dt <= limits[8] * limits[8]


@compiled
def _met(s: float, t: float, limits: np.ndarray) -> tuple:
    """A position past an edge that is none, where it comes in again."""
    around = limits[2] - limits[0]
    if limits[4] > _ONE:
        if t < limits[1]:
            s, t = s + around * _HALF, limits[1] + limits[1] - t
        elif t > limits[3]:
            s, t = s + around * _HALF, limits[3] + limits[3] - t
    if limits[4] > 0:
        if s < limits[0]:
            s += around
        elif s > limits[2]:
            s -= around
    return s, t


@compiled
def _share(sums: np.ndarray, owner: np.ndarray, count: int, total: np.ndarray) -> None:
    """Add the first `count` samples of a chunk to the pixels that own them."""
    for channel in range(total.shape[1]):
        for k in range(count):
            total[owner[k], channel] += sums[channel * _CHUNK + k]


@compiled
def fill_rim(pixels: np.ndarray, centre_u: float, centre_v: float, aspect: float, radius: float, reach: float) -> None:
    """Give the pixels (h, w, c) within `reach` outside a disc the values of those next to them inside its rim.

    So a kernel that reaches over the rim reads no dark.  Lengths are those across; down they are `aspect` times that.
    """
    height, width = pixels.shape[:2]
    rounding = np.sqrt(0.25 + 0.25 / aspect**2) + 0.05  # half a pixel across and down
    for y in range(height):
        dy = (y - centre_v) / aspect
        outer = (radius + reach) ** 2 - dy * dy
        if outer < 0:
            continue
        half = np.sqrt(outer)
        inner = radius * radius - dy * dy
        hole = np.sqrt(inner) if inner >= 0 else -1.0
        x = max(0, int(np.ceil(centre_u - half)))
        last = min(width - 1, int(np.floor(centre_u + half)))
        while x <= last:
            dx = x - centre_u
            if abs(dx) <= hole:
                x = int(np.floor(centre_u + hole)) + 1
                continue
            r = np.sqrt(dx * dx + dy * dy)
            inward = (radius - rounding) / r  # the nearest whole pixel to there is on the disc
            u = min(max(int(np.floor(centre_u + inward * dx + 0.5)), 0), width - 1)
            v = min(max(int(np.floor(centre_v + aspect * inward * dy + 0.5)), 0), height - 1)
            for channel in range(pixels.shape[2]):
                pixels[y, x, channel] = pixels[v, u, channel]
            x += 1
