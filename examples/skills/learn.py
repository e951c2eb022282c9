"""The learner: behavior cloning of the experts by a small recurrent network.

Shape letters: E episodes, T steps, A numbers of an action.
"""

import json
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import nn
from tqdm import tqdm

IMAGE_PX = (36, 48)  # columns and rows of the images of the network that learns from images
FEATURES, STATE = 64, 128  # of a finger, and of the recurrent network
COUNTS_SCALE, GREY_SCALE = 500.0, 32.0  # counts and grey levels that are scaled to about 1
HAND_SCALE = np.array([5.0, 10.0, 10.0, 10.0], np.float32)
BATCH, RATE, SPREAD = 32, 2e-3, 0.1  # episodes, learning rate, noise of the touch in training


def small_change(image: np.ndarray, background: np.ndarray) -> np.ndarray:
    """(rows, columns, 3) uint8: a small image of the change from the background frame."""
    small = [
        np.asarray(Image.fromarray(each).resize(IMAGE_PX, Image.Resampling.BOX), np.int16)
        for each in (image, background)
    ]
    return np.clip((small[0] - small[1]) // 2 + 128, 0, 255).astype(np.uint8)


class Policy(nn.Module):
    """Actions from what both fingers and the hand measured so far.

    touch: "counts", "translated" counts, "image" or "none". taxels: of a finger. low, high: limits
    of the actions.
    """

    def __init__(self, touch: str, taxels: int, low: np.ndarray, high: np.ndarray) -> None:
        super().__init__()
        self.made_with = [touch, taxels, low.tolist(), high.tolist()]
        self.touch, features = touch, FEATURES
        self.middle, self.reach = (torch.as_tensor(each) for each in (low + high, high - low))
        if touch in ("counts", "translated"):
            self.encoder = nn.Sequential(nn.Linear(taxels, FEATURES), nn.ReLU())
        elif touch == "image":
            self.encoder = nn.Sequential(
                nn.Conv2d(3, 16, 5, 2, 2), nn.ReLU(), nn.Conv2d(16, 32, 3, 2, 1), nn.ReLU(),
                nn.Conv2d(32, 32, 3, 2, 1), nn.ReLU(), nn.Flatten(),
                nn.Linear(32 * 5 * 6, FEATURES), nn.ReLU(),
            )  # fmt: skip
        else:
            self.encoder, features = nn.Identity(), 0
        self.mix = nn.Sequential(nn.Linear(2 * features + 4, STATE), nn.ReLU())
        self.memory = nn.GRU(STATE, STATE, batch_first=True)
        self.head = nn.Sequential(
            nn.Linear(2 * STATE, STATE), nn.ReLU(), nn.Linear(STATE, len(low))
        )

    def save(self, path: Path) -> None:
        """Write the weights, and with what the policy was made."""
        save_file(self.state_dict(), path, {"made_with": json.dumps(self.made_with)})

    @classmethod
    def load(cls, path: Path) -> "Policy":
        """A policy that was saved."""
        with safe_open(path, "pt") as file:
            touch, taxels, *limits = json.loads(file.metadata()["made_with"])
        policy = cls(touch, taxels, *(np.array(each, np.float32) for each in limits))
        policy.load_state_dict(load_file(path))
        return policy

    def forward(
        self, touch: torch.Tensor, hand: torch.Tensor, state: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Actions, (E, T, A), and the state after them. touch: of `scaled`. hand: (E, T, 4)."""
        parts = self.encoder(touch.flatten(0, 2)).reshape(*hand.shape[:2], -1)
        mixed = self.mix(torch.cat([parts, hand], dim=-1))
        past, after = self.memory(mixed, state)
        return (self.head(torch.cat([past, mixed], -1)) * self.reach + self.middle) / 2, after

    def scaled(self, touch: np.ndarray) -> torch.Tensor:
        """The network's input. touch: (E, T, 2, ...) counts or small images."""
        values = torch.as_tensor(touch).float()
        if self.touch == "image":
            return (values - 128.0).movedim(-1, -3) / GREY_SCALE
        return torch.log1p(values.clamp(min=0.0) / COUNTS_SCALE)

    @torch.inference_mode()
    def act(
        self, touch: np.ndarray, hand: np.ndarray, state: torch.Tensor | None
    ) -> tuple[np.ndarray, torch.Tensor]:
        """The action for one observation, and the next state."""
        scaled = torch.as_tensor(hand / HAND_SCALE)[None, None]
        actions, after = self(self.scaled(touch[None, None]), scaled, state)
        return actions[0, 0].numpy(), after


def learn(policy: Policy, shown: dict[str, np.ndarray], epochs: tqdm) -> None:
    """Trains a policy by what an expert did. shown: touch, (E, T, 2, ...), hand, (E, T, 4),
    actions, (E, T, A), and weights, (E, T), 0 after the end."""
    hand, actions = (torch.as_tensor(shown[name]).float() for name in ("hand", "actions"))
    hand, weights = hand / torch.as_tensor(HAND_SCALE), torch.as_tensor(shown["weights"])
    optimizer = torch.optim.AdamW(policy.parameters(), weight_decay=1e-3)
    batches = -(-len(hand) // BATCH)
    rates = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=len(epochs) * batches)
    for _ in epochs:
        losses = []
        for chosen in torch.randperm(len(hand)).tensor_split(batches):
            touch = policy.scaled(shown["touch"][chosen.numpy()])
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
            losses.append(loss.item())
        epochs.set_postfix(loss=f"{np.mean(losses):.5f}", refresh=False)
