"""The losses that training reduces; logits are (N, classes, H, W)."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional

from agribot.lab.train.network import CLASS_COUNT

# Order weed, crop, soil. A crop taken for a weed is as bad as a weed taken for a crop.
CLASS_WEIGHTS = (1.0, 1.0, 0.6)
# Label of a pixel that does not count: above the horizon, or outside an augmented crop.
IGNORED = 255
# Added to the classes of crops whose labels come from drawn rows: they have weights of their own.
OF_ROWS = 16


def dice_loss(logits: Tensor, target: Tensor) -> Tensor:
    """Compute 1 - mean overlap of the classes in the batch; `target` (N, H, W) int64.

    It sees small classes as large as big ones, which cross-entropy does not.
    Source: Milletari et al. 2016.
    """
    guess, truth = _mask_shares(logits, target)
    overlap = (guess * truth).sum(dim=(0, 2, 3))
    total = guess.sum(dim=(0, 2, 3)) + truth.sum(dim=(0, 2, 3))
    present = truth.sum(dim=(0, 2, 3)) > 0
    ratio = (2.0 * overlap + 1.0) / (total + 1.0)
    return 1.0 - ratio[present].mean()


def pooled_dice_loss(logits: Tensor, target: Tensor) -> Tensor:
    """Compute 1 - overlap of all classes pooled, as one mask; `target` (N, H, W) int64.

    Large classes rule it.
    """
    guess, truth = _mask_shares(logits, target)
    return 1.0 - (2.0 * (guess * truth).sum() + 1.0) / (guess.sum() + truth.sum() + 1.0)


def squared_dice_loss(logits: Tensor, target: Tensor) -> Tensor:
    """Compute 1 - mean overlap of the classes of each picture, over sums of squares.

    `target` (N, H, W) int64; a class that a picture lacks does not count there. Unsure pixels add
    less to the denominator than in `dice_loss`. Source: Milletari et al. 2016, equation 3.
    """
    guess, truth = _mask_shares(logits, target)
    overlap = (guess * truth).sum(dim=(2, 3))
    total = (guess**2).sum(dim=(2, 3)) + truth.sum(dim=(2, 3))
    present = truth.sum(dim=(2, 3)) > 0
    ratio = (2.0 * overlap + 1.0) / (total + 1.0)
    return 1.0 - ratio[present].mean() if present.any() else logits.sum() * 0.0


def generalised_dice_loss(logits: Tensor, target: Tensor) -> Tensor:
    """Compute 1 - overlap with each class weighted by 1 / its area squared; `target` (N, H, W).

    A class that the batch lacks has no weight. Source: Sudre et al. 2017.
    """
    guess, truth = _mask_shares(logits, target)
    area = truth.sum(dim=(0, 2, 3)).float()
    weight = torch.where(area > 0, area.clamp(min=1.0) ** -2, torch.zeros_like(area))
    overlap = (weight * (guess * truth).sum(dim=(0, 2, 3))).sum()
    total = (weight * (guess.sum(dim=(0, 2, 3)) + area)).sum()
    return 1.0 - 2.0 * overlap / total.clamp(min=torch.finfo(total.dtype).tiny)


def _mask_shares(logits: Tensor, target: Tensor) -> tuple[Tensor, Tensor]:
    """Return probabilities and one-hot truth, (N, classes, H, W), 0 on pixels without class."""
    valid = (target != IGNORED).unsqueeze(1)
    truth = functional.one_hot(target.clamp(max=CLASS_COUNT - 1), CLASS_COUNT)
    return logits.softmax(dim=1) * valid, truth.permute(0, 3, 1, 2) * valid


def lovasz_softmax(logits: Tensor, target: Tensor, most_px: int = 65_536) -> Tensor:
    """Compute a surrogate of 1 - mean IoU of the classes present; `target` (N, H, W) int64.

    Of a large batch, `most_px` random pixels stand for all: the sort is the cost on a CPU.
    Source: Berman et al. 2018.
    """
    counted = target != IGNORED
    guess = logits.softmax(dim=1).permute(0, 2, 3, 1)[counted]
    truth = target[counted]
    if len(truth) > most_px:
        chosen = torch.randint(0, len(truth), (most_px,)).to(truth.device)
        guess, truth = guess[chosen], truth[chosen]
    losses = []
    for kind in range(CLASS_COUNT):
        is_kind = (truth == kind).to(guess.dtype)
        if not is_kind.any():
            continue
        errors, order = (is_kind - guess[:, kind]).abs().sort(descending=True)
        hit = is_kind[order]
        union = hit.sum() + (1.0 - hit).cumsum(0)
        jaccard = 1.0 - (hit.sum() - hit.cumsum(0)) / union
        steps = torch.cat([jaccard[:1], jaccard[1:] - jaccard[:-1]])
        losses.append((errors * steps).sum())
    return torch.stack(losses).mean() if losses else logits.sum() * 0.0


def weighted_cross_entropy(
    logits: Tensor, target: Tensor, class_weights: tuple[float, float, float]
) -> Tensor:
    """Average -weight(class) log p(class) over pixels (N, H, W), as the original's loss.

    PyTorch's own divides by the sum of the weights instead, which the batch decides.
    """
    weights = torch.tensor(class_weights, device=logits.device)
    total = functional.cross_entropy(logits, target, weights, ignore_index=IGNORED, reduction="sum")
    return total / (target != IGNORED).sum().clamp(min=1)


def iou_loss(logits: Tensor, target: Tensor) -> Tensor:
    """Compute 1 - mean soft intersection over union of the classes; `target` (N, H, W) int64.

    Source: Rahman and Wang 2016.
    """
    guess, truth = _mask_shares(logits, target)
    overlap = (guess * truth).sum(dim=(0, 2, 3))
    total = (guess + truth - guess * truth).sum(dim=(0, 2, 3))
    present = truth.sum(dim=(0, 2, 3)) > 0
    ratio = (overlap + 1.0) / (total + 1.0)
    return 1.0 - ratio[present].mean()


def segmentation_loss(
    logits: Tensor,
    target: Tensor,
    class_weights: tuple[float, float, float] = CLASS_WEIGHTS,
    overlap: Callable[[Tensor, Tensor], Tensor] | None = dice_loss,
) -> Tensor:
    """Add weighted cross-entropy and a loss of overlap; `target` (N, H, W), logits of any size.

    Without the latter it is the original's loss.
    """
    if logits.shape[2:] != target.shape[1:]:
        size = tuple(target.shape[1:])
        logits = functional.interpolate(logits, size, mode="bilinear", align_corners=False)
    if overlap is None:
        return weighted_cross_entropy(logits, target, class_weights)
    weights = torch.tensor(class_weights, device=logits.device)
    entropy = functional.cross_entropy(logits, target, weights, ignore_index=IGNORED)
    return entropy + overlap(logits, target)


def mixed_loss(
    logits: Tensor,
    target: Tensor,
    class_weights: tuple[float, float, float],
    row_weights: tuple[float, float, float],
    overlap: Callable[[Tensor, Tensor], Tensor] | None,
) -> Tensor:
    """Average the losses of crops labelled by rows and of all others, each by its own weights.

    `target` (N, H, W) has classes, OF_ROWS added in crops labelled by rows.
    """
    shows_rows = ((target >= OF_ROWS) & (target != IGNORED)).flatten(1).any(dim=1)
    classes = torch.where(target == IGNORED, target, target % OF_ROWS)
    total = logits.sum() * 0.0
    for chosen, weights in ((shows_rows, row_weights), (~shows_rows, class_weights)):
        if chosen.any():
            loss = segmentation_loss(logits[chosen], classes[chosen], weights, overlap)
            total = total + loss * chosen.float().mean()
    return total


OVERLAP_LOSSES: dict[str, Callable[[Tensor, Tensor], Tensor] | None] = {
    "dice": dice_loss,
    "dice-pooled": pooled_dice_loss,
    "dice-squared": squared_dice_loss,
    "dice-generalised": generalised_dice_loss,
    "lovasz": lovasz_softmax,
    "iou": iou_loss,
    "none": None,
}
