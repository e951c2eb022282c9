"""How unlike two tactile images are in shape: one less the overlap of their contacts, made soft.

The contact IoU of an evaluation asks which pixels lie above a tenth of their own image's maximum,
and does not ask how much is felt there. Most of a contact's outline lies where counts are small, so
L1 hardly weighs it. Its overlap is a step at every pixel and has no gradient; here a pixel belongs
to the contact by a part that rises from 0 where nothing is felt over a half at that level to nearly
1 at the maximum.

An intersection over union as a loss: Rahman and Wang 2016. Their intersection is the product of the
two parts; here intersection and union are minimum and maximum (Zadeh 1965), so that an image
overlaps itself wholly, however many of its pixels belong by a part.

Shape letters: B batch, S image side.
"""

import torch

CONTACT_LEVEL = 0.1
"""A pixel is half in contact at this part of its own image's maximum: where the contact IoU of an
evaluation (evaluation.metrics.CONTACT_LEVEL) takes it to begin."""

SHARPNESS = 2
"""Power by which that part rises about the level (assumed: it is 0.2 at half the level and 0.8 at
twice; the higher the power, the fewer pixels have a gradient)."""

MIN_FELT = 0.01
"""A real image with no pixel above this part of full scale has no shape (assumed: a few times the
counts that noise makes of nothing)."""

MIN_UNION = 0.5
"""Keeps the overlap of two images of nothing from being divided by nothing, pixels: less than the
highest pixel of any image with a shape."""


def shape_loss(drawn: torch.Tensor, real: torch.Tensor) -> torch.Tensor:
    """1 - soft IoU, the mean over the real images that have a shape: (), 0 if none has.

    drawn, real: (B, 1, S, S), 0 where nothing is felt and 1 at full scale. 0 for two images with
    the same parts in contact, 1 for two whose contacts lie apart.
    """
    ours, wanted = _in_contact(drawn), _in_contact(real)
    across = (1, 2, 3)
    both = torch.minimum(ours, wanted).sum(across)
    either = torch.maximum(ours, wanted).sum(across)
    has_shape = real.amax(across) > MIN_FELT
    apart = 1.0 - both / either.clamp(min=MIN_UNION)
    return (apart * has_shape).sum() / has_shape.sum().clamp(min=1)


def _in_contact(images: torch.Tensor) -> torch.Tensor:
    """(B, 1, S, S): the part by which each pixel is in contact. An image's maximum is taken as it
    is: making the highest pixel higher is no way to draw another shape."""
    most = images.detach().amax((1, 2, 3), keepdim=True).clamp(min=MIN_FELT)
    height = (images / (CONTACT_LEVEL * most)) ** SHARPNESS
    return height / (1.0 + height)
