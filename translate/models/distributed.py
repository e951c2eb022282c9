"""Several processes in one training, started by torchrun; with one process nothing here acts.

Gradients are averaged with gloo, which supports several processes on one GPU, as nccl does not.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

import torch
import torch.distributed as dist

from t2twin.core.machine import cores


def process_count() -> int:
    """Number of processes of the training."""
    return int(os.environ.get("WORLD_SIZE", "1"))


@contextmanager
def processes() -> Iterator[int]:
    """Joins the processes of torchrun, if any, on a GPU each if there are GPUs. Yields the rank."""
    if process_count() == 1:
        yield 0
        return
    own = device()
    if own.type == "cuda":
        torch.cuda.set_device(own)
    dist.init_process_group("gloo")
    try:
        yield dist.get_rank()
        dist.barrier()  # wait until the others have received everything
    finally:
        dist.destroy_process_group()


def device() -> torch.device:
    """The device of this process: the CPU, or a GPU in turn, which several processes may share."""
    gpus = torch.cuda.device_count() if torch.cuda.is_available() else 0
    local_rank = int(os.environ.get("LOCAL_RANK", "0"))
    return torch.device("cuda", local_rank % gpus) if gpus else torch.device("cpu")


def use_all_cores() -> None:
    """Gives torch the cores of this machine, shared by its processes, or OMP_NUM_THREADS."""
    local = int(os.environ.get("LOCAL_WORLD_SIZE", "1"))
    threads = str(max(1, cores() // local))
    if local == 1:  # torchrun sets OMP_NUM_THREADS itself
        threads = os.environ.get("OMP_NUM_THREADS", threads)
    torch.set_num_threads(int(threads))


def wait() -> None:
    """Waits for all processes."""
    if dist.is_initialized():
        dist.barrier()


def reduced(value: float, how: Literal["SUM", "MAX"]) -> float:
    """Sum or maximum over the processes; with a maximum all of them take the same decision."""
    if not dist.is_initialized():
        return value
    tensor = torch.tensor(value, dtype=torch.float64)
    dist.all_reduce(tensor, getattr(dist.ReduceOp, how))
    return float(tensor)


def average(tensors: list[torch.Tensor]) -> None:
    """Averages tensors over the processes, in one message, which is faster than one per tensor."""
    if not dist.is_initialized():
        return
    flat = torch.cat([tensor.detach().reshape(-1) for tensor in tensors])
    dist.all_reduce(flat)
    flat /= dist.get_world_size()
    for tensor, mean in zip(tensors, flat.split([t.numel() for t in tensors]), strict=True):
        tensor.detach().copy_(mean.view_as(tensor))
