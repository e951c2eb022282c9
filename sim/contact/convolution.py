"""Response of a layer to a pressure on a window of its grid, in compiled code.

The response is a convolution with a kernel, computed by FFTs in single precision, which has an
error of 1e-6 and is twice as fast as double precision. A domed layer has further kernels, with
weights that depend on the place. They are smooth over several cells and are applied on coarser
nodes: cubic interpolation has an error of 1e-5 there. The kernels are even along both axes, so that
their transforms are real.

Shape letters: R rows and C columns of the window, M rows and N columns of its nodes.
"""

from typing import NamedTuple

import numpy as np
from rocket_fft import c2c, c2r, r2c

from t2twin.core.jit import compiled

Shape = tuple[int, int]

PADDING = 2
"""Nodes around a window on each side, which cubic interpolation needs."""


class Transforms(NamedTuple):
    """Real transforms of the kernels for windows of one size.

    kernel: (D, A // 2 + 1) float32 of transforms of D >= 2 R - 1 rows and A >= 2 C - 1 columns.
    columns: A. smooth: the same of the further kernels on the nodes, (kernels, D', A' // 2 + 1).
    node_columns: A'.
    """

    kernel: np.ndarray
    columns: int
    smooth: np.ndarray
    node_columns: int

    @property
    def nbytes(self) -> int:
        """Memory of the transforms."""
        return self.kernel.nbytes + self.smooth.nbytes


def interpolation(per_node: int) -> tuple[np.ndarray, np.ndarray]:
    """Cubic interpolation from nodes at the centers of blocks of per_node cells to the cells.

    Returns for each cell of a block the first of its four nodes, (per_node,), counted from the
    block's node less PADDING, and their weights, (per_node, 4) float32.
    """
    place = (np.arange(per_node) + 0.5) / per_node - 0.5
    first = np.where(place < 0, 0, 1)
    u = place + (1 - first)
    weights = [
        -u * (u - 1) * (u - 2) / 6,
        (u + 1) * (u - 1) * (u - 2) / 2,
        -(u + 1) * u * (u - 2) / 2,
        (u + 1) * u * (u - 1) / 6,
    ]
    return first, np.ascontiguousarray(np.stack(weights, axis=1), np.float32)


def work_arrays(transforms: Transforms, shape: Shape, nodes: Shape) -> tuple[np.ndarray, ...]:
    """Arrays that `convolve` works in, of types WORK. shape: R, C. nodes: M, N."""
    kernel, columns, smooth, node_columns = transforms
    half, node_half = columns // 2 + 1, node_columns // 2 + 1
    return (
        np.empty((shape[0], half), np.complex64),
        np.empty((kernel.shape[0], half), np.complex64),
        np.empty((shape[0], columns), np.float32),
        np.zeros((nodes[0], node_columns), np.float32),
        np.empty((nodes[0], node_half), np.complex64),
        np.empty((smooth.shape[1], node_half), np.complex64),
        np.empty((smooth.shape[1], node_half), np.complex64),
        np.empty(nodes, np.float32),
        np.empty((nodes[0], shape[1]), np.float32),
    )


REAL, COMPLEX = "f4[:, ::1]", "c8[:, ::1]"
WORK = ", ".join([COMPLEX, COMPLEX, REAL, REAL, COMPLEX, COMPLEX, COMPLEX, REAL, REAL])
OPERATOR = f"{REAL}, i8, f4[:, :, ::1], i8, f4[:, :, :], i8[::1], {REAL}, Tuple(({WORK}))"
"""Types of the arguments of `convolve` from kernel to work."""


@compiled(f"void({REAL}, {OPERATOR}, {REAL})", nogil=True)
def convolve(
    pressure, kernel, columns, smooth, node_columns, weights, first, taps, work, linear
):  # fmt: skip
    """Write the response to a pressure, linear, (R, C) float32, mm.

    pressure: (R, A) float32, MPa, zero from column C on. kernel, columns, smooth, node_columns: see
    Transforms. weights: (kernels, M, N) of the further kernels. first, taps: see `interpolation`.
    work: see `work_arrays`.
    """
    rows, spectrum, back, node_pressure, node_rows, node_spectrum, part, nodes, lines = work
    along, down = np.array([1]), np.array([0])
    r2c(pressure, rows, along, True, 1.0, 1)
    c2c(rows, spectrum, down, True, 1.0, 1)
    _multiply(spectrum, kernel, spectrum)
    c2c(spectrum, spectrum, down, False, 1.0, 1)
    scale = 1.0 / (spectrum.shape[0] * columns)
    c2r(spectrum[: rows.shape[0]], back, along, False, scale, 1)
    # Element by element: assigning an array compiles its error messages too, for seconds.
    for i in range(linear.shape[0]):
        for j in range(linear.shape[1]):
            linear[i, j] = back[i, j]
    if smooth.shape[0] == 0:
        return
    _to_nodes(pressure, first, taps, lines, node_pressure)
    r2c(node_pressure, node_rows, along, True, 1.0, 1)
    c2c(node_rows, node_spectrum, down, True, 1.0, 1)
    scale = 1.0 / (node_spectrum.shape[0] * node_columns)
    for k in range(smooth.shape[0]):
        _multiply(node_spectrum, smooth[k], part)
        c2c(part, part, down, False, 1.0, 1)
        c2r(part[: node_rows.shape[0]], node_pressure, along, False, scale, 1)
        for i in range(nodes.shape[0]):
            for j in range(nodes.shape[1]):
                before = nodes[i, j] if k > 0 else np.float32(0.0)
                nodes[i, j] = before + weights[k, i, j] * node_pressure[i, j]
    _add_from_nodes(nodes, first, taps, lines, linear)


@compiled(nogil=True)
def _multiply(spectrum, kernel, product):
    for i in range(spectrum.shape[0]):
        for j in range(spectrum.shape[1]):
            product[i, j] = spectrum[i, j] * kernel[i, j]


@compiled(nogil=True)
def _clear(values):
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            values[i, j] = 0.0


@compiled(nogil=True)
def _to_nodes(pressure, first, taps, lines, nodes):
    """Write the pressure, (R, >= C), distributed to the nodes, (M, >= N), MPa cells.

    lines: (M, C) work array.
    """
    per_node, columns = first.size, lines.shape[1]
    _clear(lines)
    for i in range(pressure.shape[0]):
        row, weights = i // per_node + first[i % per_node], taps[i % per_node]
        for t in range(4):
            for j in range(columns):
                lines[row + t, j] += weights[t] * pressure[i, j]
    _clear(nodes)
    for i in range(lines.shape[0]):
        for block in range(columns // per_node):
            for cell in range(per_node):
                value, at = lines[i, block * per_node + cell], block + first[cell]
                for t in range(4):
                    nodes[i, at + t] += taps[cell, t] * value


@compiled(nogil=True)
def _add_from_nodes(nodes, first, taps, lines, values):
    """Add the interpolated nodes, (M, N), to values, (R, C). lines: (M, C) work array."""
    per_node = first.size
    for i in range(lines.shape[0]):
        for block in range(lines.shape[1] // per_node):
            for cell in range(per_node):
                at, total = block + first[cell], np.float32(0.0)
                for t in range(4):
                    total += taps[cell, t] * nodes[i, at + t]
                lines[i, block * per_node + cell] = total
    for i in range(values.shape[0]):
        row, weights = i // per_node + first[i % per_node], taps[i % per_node]
        for j in range(values.shape[1]):
            values[i, j] += (
                weights[0] * lines[row, j]
                + weights[1] * lines[row + 1, j]
                + weights[2] * lines[row + 2, j]
                + weights[3] * lines[row + 3, j]
            )
