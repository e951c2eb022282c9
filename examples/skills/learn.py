"""The learner: behavior cloning of the experts by a small recurrent network.

Shape letters: E episodes, T steps, A numbers of an action.
"""

from typing import Any

import numpy as np
import torch
from PIL import Image
from torch import nn

IMAGE_PX = (36, 48)  # columns and rows of the images of the network that learns from images
FEATURES, STATE = 64, 128  # of a finger, and of the recurrent network
COUNTS_SCALE, GREY_SCALE = 500.0, 32.0  # counts and grey levels that are scaled to about 1
HAND_SCALE = torch.tensor([5.0, 10.0, 10.0, 10.0])
BATCH, RATE, SPREAD = 32, 2e-3, 0.1  # episodes, learning rate, noise of the touch in training


def small_change(image: np.ndarray, background: np.ndarray) -> np.ndarray:
    """(rows, columns, 3) uint8: a small image of the change from the background frame."""
    small = [
        np.asarray(Image.fromarray(each).resize(IMAGE_PX, Image.Resampling.BOX), np.int16)
        for each in (image, background)
    ]
    return np.clip((small[0] - small[1]) // 2 + 128, 0, 255).astype(np.uint8)


class Policy(nn.Module):
    """Actions, of a space, from what both fingers and the hand measured so far.

    kind: "none", "image", or another name for counts.
    """

    def __init__(self, kind: str, space: Any) -> None:
        super().__init__()
        self.kind, layers = kind, list[nn.Module]()
        self.middle, self.reach = map(
            torch.as_tensor, (space.low + space.high, space.high - space.low)
        )
        if kind == "image":
            for before, after, size in ((3, 16, 5), (16, 32, 3), (32, 32, 3)):
                layers += [nn.Conv2d(before, after, size, 2, size // 2), nn.ReLU()]
            layers.append(nn.Flatten())
        if kind != "none":
            layers += [nn.LazyLinear(FEATURES), nn.ReLU()]
        self.encoder = nn.Sequential(*layers)
        self.mix = nn.Sequential(nn.LazyLinear(STATE), nn.ReLU())
        self.memory = nn.GRU(STATE, STATE, batch_first=True)
        out = nn.Linear(STATE, len(space.low))
        self.head = nn.Sequential(nn.Linear(2 * STATE, STATE), nn.ReLU(), out)

    def forward(
        self, touch: torch.Tensor, hand: torch.Tensor, state: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Actions, (E, T, A), and the state after them. touch: of `scaled`. hand: (E, T, 4)."""
        parts = self.encoder(touch.flatten(0, 2)).reshape(*hand.shape[:2], -1)
        mixed = self.mix(torch.cat([parts, hand / HAND_SCALE], dim=-1))
        past, after = self.memory(mixed, state)
        return (self.head(torch.cat([past, mixed], -1)) * self.reach + self.middle) / 2, after

    def scaled(self, touch: torch.Tensor) -> torch.Tensor:
        """The network's input. touch: (E, T, 2, ...) counts or small images."""
        if self.kind == "image":
            return (touch.float() - 128.0).movedim(-1, -3) / GREY_SCALE
        return torch.log1p(touch.clamp(min=0.0) / COUNTS_SCALE)

    @torch.inference_mode()
    def act(
        self, touch: np.ndarray, hand: np.ndarray, state: torch.Tensor | None
    ) -> tuple[np.ndarray, torch.Tensor]:
        """The action for one observation, and the next state."""
        inputs = [torch.as_tensor(each)[None, None] for each in (touch, hand)]
        actions, after = self(self.scaled(inputs[0]), inputs[1], state)
        return actions[0, 0].numpy(), after


def learn(policy: Policy, episodes: list[dict[str, np.ndarray]], epochs: int) -> None:
    """Trains a policy by what an expert did.

    episodes: of each the touch, (T, 2, ...), by the policy's kind, the hand, (T, 4), and the
    actions, (T, A).
    """
    touches, hand, actions = (
        nn.utils.rnn.pad_sequence([torch.as_tensor(each[key]) for each in episodes], True)
        for key in (policy.kind, "hand", "actions")
    )
    steps = torch.tensor([len(each["hand"]) for each in episodes])
    weights = (torch.arange(hand.shape[1]) < steps[:, None]).float()
    policy(policy.scaled(touches[:1]), hand[:1])  # sets the sizes of the layers
    optimizer = torch.optim.AdamW(policy.parameters(), weight_decay=1e-3)
    batches = -(-len(hand) // BATCH)
    rates = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=epochs * batches)
    for _ in range(epochs):
        for chosen in torch.randperm(len(hand)).tensor_split(batches):
            touch = policy.scaled(touches[chosen])
            gains = torch.randn(len(chosen), 1, 2, *[1] * (touch.dim() - 3))
            touch = touch * (1 + SPREAD * gains) + SPREAD / 2 * torch.randn_like(touch)
            errors = (policy(touch, hand[chosen])[0] - actions[chosen]) / policy.reach
            bounded = nn.functional.huber_loss(errors, 0 * errors, reduction="none", delta=0.1)
            loss = (bounded.mean(-1) * weights[chosen]).sum() / weights[chosen].sum()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(policy.parameters(), 1.0)
            optimizer.step()
            rates.step()
