"""Compiled linear algebra of the field: the waves' part of normal equations, and their solution.

Products of cosines are sums of cosines, so that the waves' part of the normal equations needs a small table
of sums over tiles only, not a product of matrices as large as itself.
"""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel

ROWS = 4
"""Rows of a Cholesky factor that are computed together, two columns at a time."""


@kernel(
    "tables (3, A, B), numbers_x (K), numbers_y (K), scale (N), normal (N, N)",
    where="2 * K <= N",
    error_model="numpy",
)
def equations_of_waves(tables, numbers_x, numbers_y, scale, normal):  # type: ignore[no-untyped-def]
    """Write the lower triangle of the first rows of normal (n, n), those of waves, for unknowns of variance 1.

    Unknowns are in units of scale (n,), all waves across first, then all along. tables (3, a, b): sums over tiles of
    cosine number < a across times number < b along, by the tiles' precision xx, xy and yy. Wave i is number
    numbers_x[i] <= (a - 1) / 2 of the one times number numbers_y[i] <= (b - 1) / 2 of the other.
    """
    count = numbers_x.size
    for i in range(count):
        a, b = numbers_x[i], numbers_y[i]
        for j in range(count):
            plus, minus = a + numbers_x[j], abs(a - numbers_x[j])
            up, down = b + numbers_y[j], abs(b - numbers_y[j])
            for part in range(3):
                if part != 1 and j > i:  # above the diagonal
                    continue
                table = tables[part]
                mean = (table[plus, up] + table[plus, down] + table[minus, up] + table[minus, down]) / 4
                row, column = (part > 0) * count + i, (part > 1) * count + j
                normal[row, column] = mean * scale[row] * scale[column]
    for row in range(2 * count):
        normal[row, row] += 1


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
