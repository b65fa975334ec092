"""Compiled linear algebra of the field: normal equations of pose, planes and waves, and their solution.

Products of cosines are sums of cosines, so that the waves' part of the normal equations needs a small table
of sums over tiles only, not a product of matrices. Plain loops on one core: libraries would start threads for
so little.
"""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel

ROWS = 4
"""Rows of a Cholesky factor that are computed together, two columns at a time."""


@kernel(
    "cosines_x (N, _), cosines_y (N, _), numbers_x (K), numbers_y (K), waves (N, M), "
    "fixed (2, N, F), precision (N, 2, 2), moves (N, 2), scale (F + 2 * K), begin, normal (F + 2 * K, F + 2 * K)",
    where="0 < K, K <= M",
    fastmath=True,
    error_model="numpy",
)
def normal_equations(  # type: ignore[no-untyped-def]
    cosines_x, cosines_y, numbers_x, numbers_y, waves, fixed, precision, moves, scale, begin, normal
):
    """Compute normal equations (lower triangle); return their right-hand side. Unknowns: waves across, along, f fixed.

    They are in units of ``scale``, of variance 1. cosines_x (n, 2 A + 1), cosines_y (n, 2 B + 1): cos(pi k u) at n
    tiles; wave i is number numbers_x[i] <= A of the one times number numbers_y[i] <= B of the other, waves (n, all of
    them or more) their values. fixed (2, n, f): derivatives of displacements across and along by the last f unknowns.
    precision (n, 2, 2), moves (n, 2): of tiles. begin: 0, or the number of waves across and along, whose rows of normal
    then stay as they are.
    """
    count, f = numbers_x.size, fixed.shape[2]
    size = f + 2 * count
    wide, high = 2 * numbers_x.max() + 1, 2 * numbers_y.max() + 1
    tables = np.zeros((3, wide, high))
    right_side = np.zeros(size)
    normal[2 * count :] = 0
    for t in range(moves.shape[0]):
        xx, xy, yy = precision[t, 0, 0], precision[t, 0, 1], precision[t, 1, 1]
        if xx + yy == 0:
            continue
        g = waves[t, :count]
        across, along = xx * moves[t, 0] + xy * moves[t, 1], xy * moves[t, 0] + yy * moves[t, 1]
        for m in range(wide if begin == 0 else 0):
            cosine = cosines_x[t, m]
            a, b, c = xx * cosine, xy * cosine, yy * cosine
            for q in range(high):
                other = cosines_y[t, q]
                tables[0, m, q] += a * other
                tables[1, m, q] += b * other
                tables[2, m, q] += c * other
        for i in range(count):
            right_side[i] += across * g[i]
            right_side[count + i] += along * g[i]
        for k in range(f):
            dx, dy = fixed[0, t, k], fixed[1, t, k]
            if dx == 0 and dy == 0:
                continue
            by_x, by_y = xx * dx + xy * dy, xy * dx + yy * dy
            right_side[2 * count + k] += by_x * moves[t, 0] + by_y * moves[t, 1]
            row = normal[2 * count + k]
            for j in range(k + 1):
                row[2 * count + j] += by_x * fixed[0, t, j] + by_y * fixed[1, t, j]
            for i in range(count):
                row[i] += by_x * g[i]
                row[count + i] += by_y * g[i]
    for i in range(count if begin == 0 else 0):
        a, b = numbers_x[i], numbers_y[i]
        for j in range(count):
            plus, minus = a + numbers_x[j], abs(a - numbers_x[j])
            up, down = b + numbers_y[j], abs(b - numbers_y[j])
            for part in range(3):
                if part != 1 and j > i:  # above the diagonal
                    continue
                table = tables[part]
                mean = (table[plus, up] + table[plus, down] + table[minus, up] + table[minus, down]) / 4
                normal[(part > 0) * count + i, (part > 1) * count + j] = mean
    for i in range(begin, size):
        for j in range(i + 1):
            normal[i, j] *= scale[i] * scale[j]
        normal[i, i] += 1
    for i in range(size):
        right_side[i] *= scale[i]
    return right_side


@inner_kernel(fastmath=True, error_model="numpy")
def dot(a, b, count):  # type: ignore[no-untyped-def]
    """Return the dot product of the first ``count`` numbers of two vectors."""
    total = 0.0
    for k in range(count):
        total += a[k] * b[k]
    return total


@kernel("a (N, N), begin", where="begin % 2 == 0", fastmath=True, error_model="numpy")
def cholesky(a, begin):  # type: ignore[no-untyped-def]
    """Compute the lower factor of a positive definite matrix, in place of its lower triangle; the upper one is kept.

    begin: number of rows from the first on, even, that are the factor's already.
    """
    n = a.shape[0]
    for first in range(begin, n, ROWS):
        last = min(first + ROWS, n)
        if last - first == ROWS:
            r0, r1, r2, r3 = a[first], a[first + 1], a[first + 2], a[first + 3]
            for j in range(0, first, 2):
                one, other = a[j], a[j + 1]
                s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
                t0, t1, t2, t3 = 0.0, 0.0, 0.0, 0.0
                for k in range(j):
                    v, w = one[k], other[k]
                    s0 += v * r0[k]
                    s1 += v * r1[k]
                    s2 += v * r2[k]
                    s3 += v * r3[k]
                    t0 += w * r0[k]
                    t1 += w * r1[k]
                    t2 += w * r2[k]
                    t3 += w * r3[k]
                per, next_per, between = 1 / one[j], 1 / other[j + 1], other[j]
                for r, s, t in ((r0, s0, t0), (r1, s1, t1), (r2, s2, t2), (r3, s3, t3)):
                    r[j] = (r[j] - s) * per
                    r[j + 1] = (r[j + 1] - t - between * r[j]) * next_per
        else:
            for i in range(first, last):
                for j in range(first):
                    a[i, j] = (a[i, j] - dot(a[i], a[j], j)) / a[j, j]
        for i in range(first, last):
            for j in range(first, i):
                a[i, j] = (a[i, j] - dot(a[i], a[j], j)) / a[j, j]
            a[i, i] = np.sqrt(a[i, i] - dot(a[i], a[i], i))


@kernel("root (N, N), b (_, N)", fastmath=True, error_model="numpy")
def forward(root, b):  # type: ignore[no-untyped-def]
    """Compute root^-1 b of each vector of b (vectors, n), in place."""
    for i in range(b.shape[1]):
        for k in range(b.shape[0]):
            b[k, i] = (b[k, i] - dot(root[i], b[k], i)) / root[i, i]


@kernel("root (N, N), b (N)", fastmath=True, error_model="numpy")
def backward(root, b):  # type: ignore[no-untyped-def]
    """Compute root'^-1 b, in place of b (n,)."""
    for i in range(b.size - 1, -1, -1):
        b[i] /= root[i, i]
        v = b[i]
        row = root[i]
        for k in range(i):
            b[k] -= v * row[k]
