"""The camera's geometry: scale, round trip, the optical grid."""

from dataclasses import replace

import numpy as np
import pytest
from kinds import gel_camera

from t2twin.core.errors import T2TwinError
from t2twin.sim.optical.camera import optical_grid

GEL, CAMERA = gel_camera().own_gel, gel_camera().camera
ROWS, COLUMNS = CAMERA.rows, CAMERA.columns


def test_one_millimeter_at_the_apex_is_the_stated_scale():
    x = np.array([0.0, 1.0])
    rows, columns = CAMERA.project(x, np.zeros(2), np.zeros(2))
    assert columns[1] - columns[0] == pytest.approx(19.2)
    assert rows[0] == (ROWS - 1) / 2


def test_the_optical_grid_covers_the_gel_symmetrically():
    x, y = optical_grid(GEL)
    assert (x.size, y.size) == (184, 250)
    np.testing.assert_allclose(x, -x[::-1], atol=1e-12)
    np.testing.assert_allclose(np.diff(y), 0.1)
    assert y[-1] + 0.05 == pytest.approx(GEL.length_mm / 2)


@pytest.mark.parametrize("camera", [{"scale_px_per_mm": 0.0}, {"distance_mm": -3.0}, {"rows": 241}])
def test_impossible_cameras_are_refused(camera):
    with pytest.raises(T2TwinError, match=r"expected a(n even)? number"):
        replace(CAMERA, **camera)
