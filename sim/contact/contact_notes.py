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
    shape = contact.command.tilted(contact.shape)
    reach_mm = max(shape.surface.x_mm[-1], shape.surface.y_mm[-1])
    if (
        reaches_beyond(shape.surface, contact.command, contact.x_mm, contact.y_mm)
        and abs(shape.triangles[0][:, :2]).max() > reach_mm
    ):
        beyond = f"beyond {reach_mm:.0f} mm from its middle"
        found.append(f"parts of the shape {beyond} are not pressed")
    return found
