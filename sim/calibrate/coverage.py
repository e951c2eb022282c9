"""The part of the image that presses cover, and where the next ones belong.

An optics file is fitted to the light around the presses. Farther away it is extrapolated.
"""

from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.optical.camera import Camera
from t2twin.sim.optical.optics import Optics

COVER_MM = 1.5
"""Distance to the middle of a press within which it covers the gel, mm. On a real DIGIT, presses
nearer than this to one of those fitted score 31 dB in the mean, farther ones 27 dB (measured)."""
STEPS = 40
"""Number of places across the shorter side of the image that are compared with the presses."""
ENOUGH = 0.97  # share of the image from which on no more presses are needed (assumed)
MOST = 12  # largest number of next presses
EDGE_MM = 1.2
"""Distance of presses to the edge of the image, mm (assumed: a contact is as wide). Nearer to it,
the gel is as covered as at this distance."""
BRIGHT_GREY, SHADE = 110.0, 0.35
"""Mean grey level of the picture's background, and the factor of its shaded part."""
PICTURE_PX = 720  # longer side of the picture, at least, px
PRESSED, NEXT = (255, 255, 255), (255, 220, 0)  # colors of the presses and of the next ones


@dataclass(frozen=True)
class Coverage:
    """Presses and the part of the image that they cover.

    poses: (n, 3) x_mm, y_mm, depth_mm of the presses. radii_mm: (n,) of their contacts.
    covered: share of the image near presses. next_mm: (m, 2) x_mm and y_mm of presses
    that would cover the rest, those that cover most first.
    """

    poses: np.ndarray
    radii_mm: np.ndarray
    covered: float
    next_mm: np.ndarray


def coverage_of(
    camera: Camera, gel: Elastomer, poses: np.ndarray, diameters_mm: np.ndarray
) -> Coverage:
    """The coverage by presses (n, 3) of balls (n,)."""
    radii_mm, depths_mm = diameters_mm / 2.0, np.minimum(poses[:, 2], diameters_mm / 2.0)
    contacts_mm = np.sqrt(radii_mm**2 - (radii_mm - depths_mm) ** 2)
    step = max(min(camera.rows, camera.columns) // STEPS, 1)
    places = _places(camera, gel, step)
    candidates = np.unique(places.round(3), axis=0)
    bare = ~_near(places, poses[:, :2]).any(axis=1)
    covered, near = 1.0 - float(bare.mean()), _near(places, candidates)
    chosen = []
    while len(chosen) < MOST and bare.mean() > 1.0 - ENOUGH:
        best = int(np.argmax(near[bare].sum(axis=0)))
        chosen.append(candidates[best])
        bare &= ~near[:, best]
    return Coverage(poses, contacts_mm, covered, np.array(chosen).reshape(-1, 2))


def _places(camera: Camera, gel: Elastomer, step: int) -> np.ndarray:
    """(n, 2) mm: the place of each step-th pixel along both axes, moved to where presses can be."""
    columns, rows = (np.arange(step / 2, count, step) for count in (camera.columns, camera.rows))
    moved = []
    for along_mm in camera.gel_points(gel, columns, rows)[:2]:
        low, high = along_mm.min() + EDGE_MM, along_mm.max() - EDGE_MM
        moved.append(np.clip(along_mm, low, max(low, high)).ravel())
    return np.stack(moved, axis=1)


def _near(places: np.ndarray, presses: np.ndarray) -> np.ndarray:
    """(places, presses) bool: whether presses (n, 2) cover places (m, 2)."""
    return np.hypot(*np.moveaxis(places[:, None] - presses, -1, 0)) <= COVER_MM


def coverage_sentences(coverage: Coverage) -> list[str]:
    """Which part of the image no press covers, and where the next ones belong."""
    bare = 100.0 * (1.0 - coverage.covered)
    if not len(coverage.next_mm):
        return [f"The presses cover the image, except for {bare:.0f} % of it."]
    places = [
        f"{abs(x_mm):.1f} {'left' if x_mm < 0 else 'right'}, "
        f"{abs(y_mm):.1f} {'up' if y_mm < 0 else 'down'}"
        for x_mm, y_mm in coverage.next_mm.tolist()
    ]
    return [
        f"No press lies within {COVER_MM:g} mm of {bare:.0f} % of the image. There, the light is "
        "extrapolated.",
        f"Press next, in mm from the middle of the image: {'; '.join(places)}.",
    ]


def coverage_picture(coverage: Coverage, optics: Optics, gel: Elastomer) -> Image.Image:
    """The background with the contacts, the uncovered part shaded, and the next presses."""
    background, camera = optics.background, optics.camera
    places = _places(camera, gel, 1)
    covered = np.zeros(len(places), dtype=bool)
    for pose in coverage.poses:
        covered |= _near(places, pose[None, :2])[:, 0]
    light = background * np.clip(BRIGHT_GREY / max(float(background.mean()), 1.0), 1.0, 4.0)
    shown = np.where(covered.reshape(*light.shape[:2], 1), light, SHADE * light)
    zoom = -(-PICTURE_PX // max(shown.shape[:2]))
    image = Image.fromarray(np.clip(np.rint(shown), 0, 255).astype(np.uint8))
    image = image.resize((zoom * camera.columns, zoom * camera.rows))
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(14)
    pressed = zip(coverage.poses[:, :2], coverage.radii_mm, strict=True)
    circles = [
        *((*each, PRESSED, f"{number}") for number, each in enumerate(pressed, start=1)),
        *((place, EDGE_MM, NEXT, f"next {n + 1}") for n, place in enumerate(coverage.next_mm)),
    ]
    for place, radius_mm, color, label in circles:
        x_mm, y_mm = place
        row, column = (zoom * float(at) for at in camera.project(x_mm, y_mm, np.zeros(())))
        radius = zoom * float(radius_mm) * camera.scale_px_per_mm
        pen.circle((column, row), radius, outline=color, width=2)
        pen.text((column, row), label, fill=color, font=font, anchor="mm")
    return image
