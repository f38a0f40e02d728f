"""Dual active-set solver (Goldfarb and Idnani, 1983) for the quadratic programs of a prediction horizon.

Minimize gᵀδ + ½ δᵀHδ + ρ Σ (s_r + ½ s_r²) over δ and s ≥ 0, subject to cᵢᵀδ ≥ bᵢ for limits of position and velocity,
c_rᵀδ + s_r ≥ b_r for the distance rows, and equalities. H = L Lᵀ is block tridiagonal, so that L has two blocks a
stage, and only constraints that ever become active are transformed, w = L⁻¹c.

The price ρ of the slacks bounds the multipliers of the distance rows instead of adding variables: with λ < ρ a row
holds exactly, s = 0; at λ ≥ ρ it is soft, s = λ/ρ − 1. That is the exact ℓ1 penalty, with a small quadratic part that
makes
the solution unique. In y = Lᵀδ = y_0 + Σ λᵢwᵢ, the multipliers of the active set solve (WᵀW + D)λ = b − cᵀδ_0 with
D = 1/ρ for soft rows.
"""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit

_TOLERANCE = 1.0e-9
_DEPENDENT = 1.0e-10


@njit(cache=True)
def _forward(L, B, first, w):
    """Overwrite `w` (N, n) by L⁻¹w; its blocks before `first` are zero."""
    N, n = w.shape
    for k in range(first, N):
        if k > first:
            for i in range(n):
                total = w[k, i]
                for j in range(i, n):
                    total -= B[k, i, j] * w[k - 1, j]
                w[k, i] = total
        for i in range(n):
            total = w[k, i]
            for j in range(i):
                total -= L[k, i, j] * w[k, j]
            w[k, i] = total / L[k, i, i]


@njit(cache=True)
def _backward(L, B, y, x):
    """Write L⁻ᵀy into `x` (N, n)."""
    N, n = y.shape
    for k in range(N - 1, -1, -1):
        x[k] = y[k]
        if k < N - 1:
            for i in range(n):
                for j in range(i, n):
                    x[k, j] -= B[k + 1, i, j] * x[k + 1, i]
        for i in range(n - 1, -1, -1):
            x[k, i] /= L[k, i, i]
            for j in range(i):
                x[k, j] -= L[k, i, j] * x[k, i]


@njit(cache=True)
def _load(qp, index, c):
    """Write constraint `index` as c (N, n) of cᵀδ ≥ b; return b and the first stage that it touches."""
    N, n = qp.g.shape
    c[:] = 0.0
    limits = 2 * N * n
    if index < 2 * limits:
        half = index % limits
        side, k, j = half % 2, half // 2 // n, half // 2 % n
        sign = -1.0 if side == 0 else 1.0
        c[k, j] = sign
        if index < limits:
            if k > 0:
                c[k - 1, j] = -sign
            return (-qp.v_high[k, j] if side == 0 else qp.v_low[k, j]), max(k - 1, 0)
        return (-qp.high[k, j] if side == 0 else qp.low[k, j]), k
    r = index - 2 * limits
    rows = qp.rows
    if r >= rows.z.shape[0]:
        r -= rows.z.shape[0]
        rows = qp.slip
    k = rows.stage[r] - 1
    c[k] = rows.b[r]
    if k > 0:
        c[k - 1] = rows.a[r]
    return -rows.z[r], max(k - 1, 0)


@njit(cache=True)
def _most_violated(qp, x, active):
    """Return the index of the most violated inequality that is not active, and cᵀx − b there; −1 if none is."""
    N, n = x.shape
    limits = 2 * N * n
    worst, found = -_TOLERANCE, -1
    for k in range(N):
        for j in range(n):
            i = 2 * (k * n + j)
            step = x[k, j] - (x[k - 1, j] if k > 0 else 0.0)
            for index, s in (
                (i, qp.v_high[k, j] - step),
                (i + 1, step - qp.v_low[k, j]),
                (limits + i, qp.high[k, j] - x[k, j]),
                (limits + i + 1, x[k, j] - qp.low[k, j]),
            ):
                if s < worst and not active[index]:
                    worst, found = s, index
    for r in range(qp.rows.z.shape[0]):
        k = qp.rows.stage[r] - 1
        s = qp.rows.z[r]
        for j in range(n):
            s += qp.rows.b[r, j] * x[k, j]
        if k > 0:
            for j in range(n):
                s += qp.rows.a[r, j] * x[k - 1, j]
        if s < worst and not active[2 * limits + r]:
            worst, found = s, 2 * limits + r
    return found, worst


@njit(cache=True)
def _refactor(gram, soft, penalty, first, count, R):
    """Cholesky factor R of the Gram matrix of the active set plus D, from row `first` on; False if it is singular."""
    for i in range(first, count):
        for j in range(i + 1):
            total = gram[i, j]
            if i == j and soft[i]:
                total += 1.0 / penalty
            for l in range(j):
                total -= R[i, l] * R[j, l]
            if i == j:
                if total <= _DEPENDENT * gram[i, i]:
                    return False
                R[i, i] = np.sqrt(total)
            else:
                R[i, j] = total / R[j, j]
    return True


@njit(cache=True)
def _solve(R, count, right, out):
    """Write (R Rᵀ)⁻¹ right into `out`."""
    for i in range(count):
        total = right[i]
        for j in range(i):
            total -= R[i, j] * out[j]
        out[i] = total / R[i, i]
    for i in range(count - 1, -1, -1):
        out[i] /= R[i, i]
        for j in range(i):
            out[j] -= R[i, j] * out[i]


@njit(cache=True)
def _inner(a, b, first):
    """Inner product of two (N, n) arrays from block `first` on."""
    total = 0.0
    for k in range(first, a.shape[0]):
        for j in range(a.shape[1]):
            total += a[k, j] * b[k, j]
    return total


@njit(cache=True)
def solve_qp(qp, penalty, guess):
    """Solve the `iteration.Subproblem`.

    Parameters
    ----------
    qp : Subproblem
    penalty : float
        ρ, price of a slack.
    guess : (any,) int array
        Constraints that may be active; others follow, wrong ones go.

    Returns
    -------
    delta : (N, n) array
    multipliers : (rows,) array
        Of the distance rows.
    slack : (rows,) array
    largest : float
        Largest multiplier (absolute) of a distance or slip row.
    ok : bool
        False if hard constraints contradict each other.
    active : int array
        Constraints that are active at the solution.
    steps : int
        Changes of the active set.
    """
    N, n = qp.g.shape
    size = N * n
    rows, equalities = qp.rows.z.shape[0], qp.slip.z.shape[0]
    first_row = 4 * size
    total = first_row + rows + equalities
    most = size + 1 + min(rows, size)
    W, start = np.empty((most, N, n)), np.empty(most, np.int64)
    gram, R = np.empty((most, most)), np.empty((most, most))
    lam, bound, right, r = np.zeros(most), np.empty(most), np.empty(most), np.empty(most)
    member, soft = np.empty(most, np.int64), np.zeros(most, np.bool_)
    active = np.zeros(total, np.bool_)
    y, x, w, u = np.empty((N, n)), np.empty((N, n)), np.empty((N, n)), np.empty((N, n))
    y[:] = -qp.g
    _forward(qp.L, qp.B, 0, y)
    y_0 = y.copy()
    count, steps, ok = 0, 0, True

    # Equalities and the guess at once; whatever has a multiplier of the wrong sign goes again.
    for e in range(equalities + guess.shape[0]):
        index = first_row + rows + e if e < equalities else guess[e - equalities]
        if active[index] or count >= size:
            continue
        bound[count] = _load(qp, index, W[count])[0]
        if not np.isfinite(bound[count]):
            continue
        start[count] = 0
        for k in range(N):
            if np.any(W[count, k] != 0.0):
                start[count] = k
                break
        _forward(qp.L, qp.B, start[count], W[count])
        for i in range(count + 1):
            gram[count, i] = _inner(W[i], W[count], start[count])
            gram[i, count] = gram[count, i]
        soft[count] = False
        if _refactor(gram, soft, penalty, count, count + 1, R):
            member[count] = index
            active[index] = True
            count += 1
        elif e < equalities:
            ok = False
    while count > 0:
        for i in range(count):
            right[i] = bound[i] - _inner(W[i], y_0, start[i]) + (1.0 if soft[i] else 0.0)
        _solve(R, count, right, lam)
        changed, i = -1, 0
        while i < count:
            softable = first_row <= member[i] < first_row + rows
            if member[i] >= first_row + rows:
                pass
            elif lam[i] < 0.0 or (soft[i] and lam[i] < penalty):
                active[member[i]] = False
                _remove(i, count, member, lam, bound, soft, start, W, gram)
                count -= 1
                changed = i if changed < 0 else min(changed, i)
                continue
            elif softable and not soft[i] and lam[i] > penalty:
                soft[i] = True
                changed = i if changed < 0 else min(changed, i)
            i += 1
        if changed < 0:
            break
        steps += 1
        _refactor(gram, soft, penalty, changed, count, R)
    for i in range(count):
        for k in range(start[i], N):
            for j in range(n):
                y[k, j] += lam[i] * W[i, k, j]
    _backward(qp.L, qp.B, y, x)

    while ok and steps < 20 * size:
        p, s = _most_violated(qp, x, active)
        if p < 0:
            break
        b_p, first = _load(qp, p, w)
        _forward(qp.L, qp.B, first, w)
        square = _inner(w, w, first)
        softable, p_soft = first_row <= p, False
        lam_p = 0.0
        while True:
            steps += 1
            for i in range(count):
                right[i] = _inner(W[i], w, max(first, start[i]))
            _solve(R, count, right, r)
            rate = square
            for i in range(count):
                rate -= right[i] * r[i]
            if p_soft:
                rate += 1.0 / penalty
            full = -s / rate if rate > _DEPENDENT * square else np.inf
            length, blocking = full, -1
            for i in range(count):
                if member[i] >= first_row + rows:
                    continue
                room = np.inf
                if r[i] > 0.0:
                    room = (lam[i] - (penalty if soft[i] else 0.0)) / r[i]
                elif r[i] < 0.0 and not soft[i] and member[i] >= first_row:
                    room = (penalty - lam[i]) / -r[i]
                if room < length:
                    length, blocking = max(room, 0.0), i
            if softable and not p_soft and penalty - lam_p < length:
                length, blocking = penalty - lam_p, -2
            if not np.isfinite(length) or steps >= 20 * size:
                ok = False
                break
            for i in range(count):
                lam[i] -= length * r[i]
            lam_p += length
            if np.isfinite(full):
                s += length * rate
                u[:] = w
                for i in range(count):
                    for k in range(start[i], N):
                        for j in range(n):
                            u[k, j] -= r[i] * W[i, k, j]
                for k in range(N):
                    for j in range(n):
                        y[k, j] += length * u[k, j]
            if blocking == -1:
                if count == most:
                    ok = False
                    break
                W[count], start[count], bound[count] = w, first, b_p
                member[count], lam[count], soft[count] = p, lam_p, p_soft
                for i in range(count):
                    gram[count, i] = right[i]
                    gram[i, count] = right[i]
                gram[count, count] = square
                active[p] = True
                _refactor(gram, soft, penalty, count, count + 1, R)
                count += 1
                break
            if blocking == -2:
                p_soft = True
                continue
            if r[blocking] > 0.0 and not soft[blocking]:
                active[member[blocking]] = False
                _remove(blocking, count, member, lam, bound, soft, start, W, gram)
                count -= 1
            else:
                soft[blocking] = not soft[blocking]
                lam[blocking] = penalty
            _refactor(gram, soft, penalty, blocking, count, R)
        _backward(qp.L, qp.B, y, x)

    multipliers, slack = np.zeros(rows), np.zeros(rows)
    largest = 0.0
    for i in range(count):
        if member[i] >= first_row:
            largest = max(largest, abs(lam[i]))
            if member[i] < first_row + rows:
                multipliers[member[i] - first_row] = lam[i]
                if soft[i]:
                    slack[member[i] - first_row] = lam[i] / penalty - 1.0
    return x, multipliers, slack, largest, ok, member[:count].copy(), steps


@njit(cache=True)
def _remove(i, count, member, lam, bound, soft, start, W, gram):
    """Take constraint i out of the active set."""
    for a in range(i, count - 1):
        member[a], lam[a], bound[a] = member[a + 1], lam[a + 1], bound[a + 1]
        soft[a], start[a] = soft[a + 1], start[a + 1]
        W[a] = W[a + 1]
        for b in range(count):
            gram[a, b] = gram[a + 1, b]
    for a in range(i, count - 1):
        for b in range(count):
            gram[b, a] = gram[b, a + 1]
