"""The whitening of many columns at once: the filter's recursion over blocks of nodes, each a matrix.

Over a block of B nodes the filter is linear in the deviation it begins with and in what is put in at its nodes,

    [whitened innovations (B nc), deviation after it] = [of the deviation (size), of the inputs] [deviation, inputs]

so that hundreds of columns are products of matrices, block by block, where a triangular solve takes one column after
the other. The same sums as `kalman_filter.predicted`; worth it from some tens of columns on.

Rules of this file: numbers in, numbers out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Nodes in a block: more multiply more zeros, fewer are more calls.
BLOCK = 8
# Columns that are whitened at once: their inputs stay near the processor.
AT_ONCE = 128
# Fewer columns are solved one by one.
FEW = 32


@dataclass(frozen=True)
class WhiteningBlocks:
    """The filter of n nodes in blocks.

    Attributes
    ----------
    nodes : int
        n.
    begin : ndarray, shape (blocks, B nc + size, size)
        By the deviation that a block begins with: whitened innovations of its nodes, then the deviation after it.
    step : ndarray, shape (blocks, B nc + size, B, nz)
        The same by an addition to the one-step map from each node to the next.
    reading : ndarray, shape (blocks, B nc + size, B, nc)
        The same by an addition to what the readings miss at each node.
    """

    nodes: int
    begin: Array
    step: Array
    reading: Array

    @classmethod
    def of(cls, closed: Array, drive: Array, whiten: Array, c: Array) -> WhiteningBlocks:
        """Of d_k+1 = closed d_k + drive eps_k + f_k and whiten (eps_k - c d_k); closed, drive (n-1), whiten, c (n)."""
        n, nc, nz = c.shape
        size, count = closed.shape[1], -(-n // BLOCK)
        closed, drive, whiten = (_in_blocks(one, count) for one in (closed, drive, whiten))
        seen = whiten @ _in_blocks(c, count)
        inputs = size + BLOCK * (nz + nc)
        here, out = np.zeros((count, size, inputs)), np.zeros((count, BLOCK * nc + size, inputs))
        here[:, range(size), range(size)] = 1.0
        step, reading = size + nz * np.arange(BLOCK), size + BLOCK * nz + nc * np.arange(BLOCK)
        for j in range(BLOCK):
            rows, put = slice(j * nc, (j + 1) * nc), slice(reading[j], reading[j] + nc)
            out[:, rows] = -seen[:, j] @ here[:, :nz]
            out[:, rows, put] += whiten[:, j]
            here = closed[:, j] @ here
            here[:, :, put] += drive[:, j]
            here[:, range(nz), step[j] + np.arange(nz)] += 1.0
        out[:, BLOCK * nc :] = here
        ends = (size, reading[0])
        return cls(
            n, out[:, :, :size], out[:, :, slice(*ends)].reshape(count, -1, BLOCK, nz),
            out[:, :, reading[0] :].reshape(count, -1, BLOCK, nc),
        )  # fmt: skip

    def whitened(self, f: Array, eps: Array) -> Array:
        """(n, nc, m) of columns f (n-1, nz, m) and eps (n, nc, m)."""
        out = np.empty(eps.shape)
        for first in range(0, eps.shape[2], AT_ONCE):
            some = slice(first, first + AT_ONCE)
            out[:, :, some] = self._whitened(f[:, :, some], eps[:, :, some])
        return out

    def _whitened(self, f: Array, eps: Array) -> Array:
        (_, nz, m), nc, blocks = f.shape, eps.shape[1], len(self.begin)
        # node by node of a block: its steps, then its readings
        put = np.zeros((blocks * BLOCK, nz + nc, m))
        put[: len(f), :nz], put[: len(eps), nz:] = f, eps
        found = self._together @ put.reshape(blocks, -1, m)
        starts = self._starts(found[:, BLOCK * nc :])
        white = found[:, : BLOCK * nc]
        white += self.begin[:, : BLOCK * nc] @ starts
        return white.reshape(-1, nc, m)[: self.nodes]

    def rows(self, inputs: Array, by: Array) -> Array:
        """(m, n nc) whitened columns, each a row.

        Parameters
        ----------
        inputs : ndarray, shape (blocks, m, k)
            What is put in during each block.
        by : ndarray, shape (blocks, k, B nc + size)
            What that does to the block's innovations and to the deviation after it.
        """
        (count, m, k), size = inputs.shape, self.begin.shape[2]
        wide = BLOCK * self.reading.shape[3]
        both, found = np.empty((count, m, k + size)), np.empty((m, count, wide))
        both[:, :, :k] = inputs
        both[:, :, k:] = self._starts((inputs @ by[:, :, wide:]).transpose(0, 2, 1)).transpose(0, 2, 1)
        np.matmul(both, np.concatenate([by[:, :, :wide], self._begin], axis=1), out=found.transpose(1, 0, 2))
        return found.reshape(m, -1)[:, : self.nodes * self.reading.shape[3]]

    def _starts(self, added: Array) -> Array:
        """(blocks, size, m) deviations with which the blocks begin; `added`: within each, (blocks, size, m)."""
        found, onward = np.zeros(added.shape), self.begin[:, -added.shape[1] :]
        for k in range(len(added) - 1):
            np.matmul(onward[k], found[k], out=found[k + 1])
            found[k + 1] += added[k]
        return found

    @cached_property
    def _begin(self) -> Array:
        """(blocks, size, B nc) of `begin`, the innovations."""
        return np.ascontiguousarray(self.begin[:, : -self.begin.shape[2]].transpose(0, 2, 1))

    @cached_property
    def _together(self) -> Array:
        """(blocks, B nc + size, B (nz + nc)) by steps and readings, node by node."""
        both = np.concatenate([self.step, self.reading], axis=3)
        return both.reshape(len(both), both.shape[1], -1)


def _in_blocks(x: Array, count: int) -> Array:
    """(count, BLOCK, ...) filled up with zeros."""
    out = np.zeros((count * BLOCK, *x.shape[1:]))
    out[: len(x)] = x
    return out.reshape(count, BLOCK, *x.shape[1:])
