"""Fields of the displacement by shear: means, motion with the bodies, tolerance, and no folds."""

import numpy as np

from t2twin.core.jit import compiled
from t2twin.sim.contact.grid import interpolated

# Convergence of a step: mean error, weighted with the pressure, of the displacement by shear that
# the normal contact sees. Along the surface: mm, or a share of the mean displacement where that is
# more. Into the sensor: a share of the depth.
COUPLING_TOLERANCE_MM, COUPLING_SHARE, DEFLECTION_SHARE = 5e-3, 1e-2, 5e-3
MIN_MOVE = 0.1  # motion of a contact, cells, below which its displacement does not move (assumed)
# Largest shortening of the surface in one direction, as a share of its length. A rubber's surface
# that is shortened more forms creases instead (Hong, Zhao and Suo 2009, doi 10.1063/1.3211917: 0.35
# in plane strain). With this limit contacts settle under a body that sinks into most of a layer.
MAX_SHORTENING = 0.35
FAR_SHARE = 0.2  # of the displacement that MAX_SHORTENING may change without a note (assumed)


def is_small(
    error_mm: np.ndarray, sheared_mm: np.ndarray, pressure: np.ndarray, depth_mm: float
) -> bool:
    """Whether an error of the displacement by shear, (3, rows, columns), is in the tolerance."""
    weights = pressure / pressure.sum()
    along_x, along_y, into = (np.abs(error_mm) * weights).sum(axis=(1, 2))
    displacement = (np.hypot(*sheared_mm[:2]) * weights).sum()
    allowed = max(COUPLING_TOLERANCE_MM, COUPLING_SHARE * displacement)
    return max(along_x, along_y) <= allowed and into <= DEFLECTION_SHARE * depth_mm


def is_far(
    displacement_mm: np.ndarray, weights: np.ndarray, pitch_mm: float, far_mm: float
) -> bool:
    """Whether the mean displacement along the surface, weighted, is above far_mm, or `unfolded`
    changes it by a mean of FAR_SHARE of it. displacement_mm: (3, rows, columns).
    """
    limited = unfolded(displacement_mm, pitch_mm)
    x, y, _ = np.stack((limited, limited - displacement_mm), axis=1)
    size, change = (np.hypot(x, y) * weights).sum(axis=(1, 2)) / weights.sum()
    return bool(size > far_mm or change > max(FAR_SHARE * size, COUPLING_TOLERANCE_MM))


def means(values: np.ndarray, pressure: np.ndarray, over: list[np.ndarray]) -> np.ndarray:
    """(bodies, 2) means along x and y over the cells nearest to each body, by pressure."""
    weights = [pressure * here for here in over]
    return np.array([(values * each).sum(axis=(1, 2)) / (each.sum() or 1.0) for each in weights])


def moved(
    values: np.ndarray, by_mm: np.ndarray, pitch_mm: float, over: list[np.ndarray]
) -> np.ndarray:
    """Values, (n, rows, columns), moved along x and y by those of the nearest body."""
    found, (y, x) = values, (np.arange(float(size)) for size in values.shape[1:])
    for (along_x, along_y), here in zip(by_mm.tolist(), over, strict=True):
        if np.hypot(along_x, along_y) >= MIN_MOVE * pitch_mm:
            shifted = interpolated(values, y, x, y - along_y / pitch_mm, x - along_x / pitch_mm)
            found = np.where(here, shifted, found)
    return found


@compiled(nogil=True)
def unfolded(displacement_mm, pitch_mm):
    """A displacement near the given one that does not shorten the surface by MAX_SHORTENING.

    displacement_mm: (2 or 3, rows, columns) along x, along y, and perhaps into the sensor, mm. The
    component along each line of cells is limited, in turn along x, y and both diagonals. The
    limit is an isotonic regression of the places to which the points move (Barlow et al.,
    Statistical Inference under Order Restrictions, 1972), continuous in the displacement.
    """
    # The largest decrease from one column or row to the next.
    moved, most = displacement_mm.astype(np.float64), MAX_SHORTENING * pitch_mm
    _, rows, columns = moved.shape
    places = np.empty(max(rows, columns))
    means, sizes = np.empty(places.size), np.empty(places.size, np.int64)
    for down, across in ((0, 1), (1, 0), (1, 1), (1, -1)):
        norm, folds = down * down + across * across, False
        for i in range(down, rows):
            for j in range(max(across, 0), columns + min(across, 0)):
                n, m = i - down, j - across
                apart = across * (moved[0, i, j] - moved[0, n, m])
                apart += down * (moved[1, i, j] - moved[1, n, m])
                folds |= apart < -most * norm
        if not folds:
            continue
        for first in range(rows * columns):
            i, j = first // columns, first % columns
            if i - down >= 0 and 0 <= j - across < columns:
                continue  # not the first cell of a line
            count, blocks = 0, 0
            while i < rows and 0 <= j < columns:
                place = (across * moved[0, i, j] + down * moved[1, i, j]) / norm + most * count
                places[count] = place
                i, j, count = i + down, j + across, count + 1
            # Pools adjacent violators: all points of a block move to their mean place.
            for n in range(count):
                means[blocks], sizes[blocks] = places[n], 1
                blocks += 1
                while blocks > 1 and means[blocks - 2] > means[blocks - 1]:
                    blocks -= 1
                    size = sizes[blocks - 1] + sizes[blocks]
                    total = means[blocks - 1] * sizes[blocks - 1] + means[blocks] * sizes[blocks]
                    means[blocks - 1], sizes[blocks - 1] = total / size, size
            i, j, n = first // columns, first % columns, 0
            for block in range(blocks):
                for _ in range(sizes[block]):
                    change = means[block] - places[n]
                    moved[0, i, j] += across * change
                    moved[1, i, j] += down * change
                    i, j, n = i + down, j + across, n + 1
    return moved
