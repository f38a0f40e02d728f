"""Passes over the modules of a skin patch: from voltages to forces without crosstalk, and where pressure peaks."""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit


@njit(cache=True)
def felt_forces(dv, inverse, usable, felt):
    """Fill what each module seems to feel, A ψ(ΔV), (m, 3) in N, from voltages over the baseline (m, 4)."""
    psi = np.empty(14)
    for i in range(dv.shape[0]):
        felt[i] = 0.0
        if not usable[i]:
            continue
        n = 4
        for a in range(4):
            psi[a] = dv[i, a]
            for b in range(a, 4):
                psi[n] = dv[i, a] * dv[i, b]
                n += 1
        for c in range(3):
            for k in range(14):
                felt[i, c] += inverse[i, c, k] * psi[k]


@njit(cache=True)
def remove_crosstalk(felt, coupling, neighbours, usable, rounds, forces):
    """Solve f_i = felt_i − Σ Y_in f_n for the usable modules, (m, 3) in N, in place.

    By repetition, which contracts since the shares Y are small. `forces` holds a start for usable modules, and is kept
    for the others.
    """
    before = np.empty_like(forces)
    for _ in range(rounds):
        before[:] = forces
        for i in range(felt.shape[0]):
            if not usable[i]:
                continue
            for c in range(3):
                total = felt[i, c]
                for n in range(8):
                    j = neighbours[i, n]
                    if j >= 0:
                        for d in range(3):
                            total -= coupling[i, n, c, d] * before[j, d]
                forces[i, c] = total


@njit(cache=True)
def fill_unusable(neighbours, usable, values):
    """Give modules that are not usable the mean of the usable ones around, sides twice as much as corners."""
    for i in range(values.shape[0]):
        if usable[i]:
            continue
        values[i] = 0.0
        total = 0.0
        for n in range(8):
            j = neighbours[i, n]
            if j >= 0 and usable[j]:
                w = 2.0 if n < 4 else 1.0
                total += w
                for d in range(values.shape[1]):
                    values[i, d] += w * values[j, d]
        if total > 0.0:
            for d in range(values.shape[1]):
                values[i, d] /= total


@njit(cache=True)
def pressure_peaks(pressure, neighbours, threshold, prominence, label):
    """Divide the modules above a threshold into patches of pressure, and return the number of patches.

    Modules are taken in falling order of pressure: one without a labelled neighbour is a new peak, others join the
    highest neighbour's patch. Where two patches meet, they become one unless the lower peak rises above the pass
    between them by the given share of itself.

    Parameters
    ----------
    pressure : (m,) array
        Force into the surface of each module (N).
    neighbours : (m, 8) int array
    threshold : float
        N.
    prominence : float
        0–1.
    label : (m,) int array
        Filled with the patch of each module, −1 for none; patch 0 has the highest peak, and so on.
    """
    m = pressure.shape[0]
    label[:] = -1
    order = np.argsort(-pressure)
    peak, into = np.empty(m), np.empty(m, dtype=np.int64)
    count = 0
    for step in range(m):
        i = order[step]
        if not pressure[i] > threshold:
            break
        best, home = 0.0, -1
        for n in range(8):
            j = neighbours[i, n]
            if j >= 0 and label[j] >= 0 and pressure[j] > best:
                best, home = pressure[j], label[j]
        if home < 0:
            label[i], peak[count], into[count] = count, pressure[i], count
            count += 1
            continue
        label[i] = home
        a = home
        while into[a] != a:
            a = into[a]
        for n in range(8):
            j = neighbours[i, n]
            if j < 0 or label[j] < 0:
                continue
            b = label[j]
            while into[b] != b:
                b = into[b]
            if b != a:
                high, low = (a, b) if peak[a] >= peak[b] else (b, a)
                if peak[low] - pressure[i] < prominence * peak[low]:
                    into[low] = high
                    a = high
    number = np.full(count, -1, dtype=np.int64)
    patches = 0
    for k in range(count):
        if into[k] == k:
            number[k] = patches
            patches += 1
    for i in range(m):
        if label[i] >= 0:
            a = label[i]
            while into[a] != a:
                a = into[a]
            label[i] = number[a]
    return patches
