"""What limits a contact, in words."""

from t2twin.sim.contact.heights import reaches_beyond
from t2twin.sim.contact.types import Contact

UNSETTLED = "the contact did not settle, so its pressure and depth are approximate"
SMALL = "the contact is smaller than the grid, so its pressure and depth are approximate"
BOTTOMED = "the shape bottomed out: its base plate (the lowest flat face) is in contact"


def contact_notes(contact: Contact) -> list[str]:
    """A clause for each limit of a contact; none for an ordinary one."""
    found = []
    if contact.smaller_than_grid:
        found.append(SMALL)
    elif not contact.settled:
        found.append(UNSETTLED)
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
    corners, reach_mm = shape.triangles[0], max(shape.surface.x_mm[-1], shape.surface.y_mm[-1])
    if (
        len(corners)
        and reaches_beyond(shape.surface, contact.command, contact.x_mm, contact.y_mm)
        and abs(corners[:, :2]).max() > reach_mm
    ):
        beyond = f"beyond {reach_mm:.0f} mm from its middle"
        found.append(f"parts of the shape {beyond} are not pressed")
    return found
