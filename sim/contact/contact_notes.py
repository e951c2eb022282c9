"""What limits a contact, in words."""

from t2twin.sim.contact.heights import is_cut, reaches_beyond
from t2twin.sim.contact.tangential.displacements import is_far
from t2twin.sim.contact.types import Contact

UNSETTLED = "the contact did not settle, so its pressure and depth are approximate"
SMALL = "the contact is smaller than the grid, so its pressure and depth are approximate"
BOTTOMED = "the shape bottomed out: its base plate (the lowest flat face) is in contact"
FAR_SHEARED = (
    "the surface is sheared beyond what the model describes, so its displacement is approximate"
)


def contact_notes(contact: Contact) -> list[str]:
    """A clause for each limit of a contact; none for an ordinary one."""
    found = []
    if contact.smaller_than_grid:
        found.append(SMALL)
    elif not contact.settled:
        found.append(UNSETTLED)
    if _is_far_sheared(contact):
        found.append(FAR_SHEARED)
    if contact.bottomed:
        found.append(BOTTOMED)
    places = (contact.command.x_mm, contact.x_mm), (contact.command.y_mm, contact.y_mm)
    half_x, half_y = (abs(axis).max() for _, axis in places)
    if any(abs(at) > abs(axis).max() for at, axis in places):
        found.append(
            "the shape's middle lies off the sensor, whose soft layer reaches "
            f"{half_x:.1f} mm to each side and {half_y:.1f} mm up and down"
        )
    shape = contact.command.tilted(contact.shape)
    # Only then its solid is needed, which is slow to make.
    if is_cut(shape.surface) and reaches_beyond(
        shape.surface, contact.command, contact.x_mm, contact.y_mm
    ):
        corners, reach_mm = shape.triangles[0], max(shape.surface.x_mm[-1], shape.surface.y_mm[-1])
        if len(corners) and abs(corners[:, :2]).max() > reach_mm:
            beyond = f"beyond {reach_mm:.0f} mm from its middle"
            found.append(f"parts of the shape {beyond} are not pressed")
    return found


def _is_far_sheared(contact: Contact) -> bool:
    """Whether the mean shear strain is above 1, up to which the linear response is that of a rubber
    (assumed), or the surface would shorten too much."""
    if contact.motion is None or contact.motion.response is None:
        return False
    known = contact.motion.response
    weights, thickness_mm = contact.pressure_kpa[known.window], contact.elastomer.thickness_mm
    return is_far(known.parts_mm.sum(axis=0), weights, contact.pitch_mm, thickness_mm)
