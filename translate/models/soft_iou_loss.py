"""A differentiable intersection over union of the contacts of two tactile images, as a loss.

The contact IoU of an evaluation counts pixels above a tenth of the maximum of their image, whatever
their value. L1 gives little weight to the outline of a contact, where counts are small. The contact
IoU is a step function of each pixel. Here the membership of a pixel in the contact rises smoothly
from 0 at zero, over one half at that level, to almost 1 at the maximum.

IoU as a loss: Rahman and Wang 2016, who use products of memberships. Here intersection and union
are minimum and maximum (Zadeh 1965), so that the IoU of an image with itself is 1.

Shape letters: B batch, S image side.
"""

import torch

CONTACT_LEVEL = 0.1
"""Fraction of the maximum at which the membership is one half; the contact IoU of an evaluation has
its threshold there (evaluation.metrics.array_errors.CONTACT_LEVEL)."""

SHARPNESS = 2
"""Exponent of the membership (assumed: 0.2 at half the level and 0.8 at twice the level; with a
higher exponent, fewer pixels have a gradient)."""

MIN_CONTACT = 0.01
"""A target image with no pixel above this fraction of full scale has no contact (assumed: a few
times the counts of noise)."""

MIN_UNION = 0.5
"""Lower bound of the union, pixels, against division by zero: less than the membership of the
maximum of any image with a contact."""


def soft_iou_loss(predicted: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """1 - soft IoU, averaged over the targets with a contact: (), 0 if there are none.

    predicted, target: (B, 1, S, S), 0 at zero and 1 at full scale. The loss is 0 for images with
    equal memberships and 1 for disjoint contacts.
    """
    ours, theirs = _membership(predicted), _membership(target)
    pixels = (1, 2, 3)
    intersection = torch.minimum(ours, theirs).sum(pixels)
    union = torch.maximum(ours, theirs).sum(pixels)
    has_contact = target.amax(pixels) > MIN_CONTACT
    loss = 1.0 - intersection / union.clamp(min=MIN_UNION)
    return (loss * has_contact).sum() / has_contact.sum().clamp(min=1)


def _membership(images: torch.Tensor) -> torch.Tensor:
    """(B, 1, S, S): membership of each pixel in the contact.

    The maximum is detached: a higher maximum would shrink all memberships without a change of
    shape.
    """
    maximum = images.detach().amax((1, 2, 3), keepdim=True).clamp(min=MIN_CONTACT)
    height = (images / (CONTACT_LEVEL * maximum)) ** SHARPNESS
    return height / (1.0 + height)
