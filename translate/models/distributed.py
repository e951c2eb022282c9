"""Several processes on one training, started by torchrun; with one process all of it does nothing.

Every process holds the same weights and takes its part of each batch; gradients are averaged after
each backward pass, which serves two networks in one step without a wrapper. They are averaged over
gloo, which adds up tensors of CPUs and of GPUs alike: one way for both, and several processes may
share a GPU, which nccl refuses.
"""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import torch
import torch.distributed as dist
from torch import nn

from t2twin.core.machine import cores

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3
"""glibc's numbers for these settings of its memory (mallopt(3))."""


@contextmanager
def processes() -> Iterator[tuple[int, int]]:
    """Joins the processes of torchrun, if any, each on its own GPU where the machine has some.

    Gives this one's rank and how many there are.
    """
    if int(os.environ.get("WORLD_SIZE", "1")) == 1:
        yield 0, 1
        return
    own = device()
    if own.type == "cuda":
        torch.cuda.set_device(own)
    dist.init_process_group("gloo")
    try:
        yield dist.get_rank(), dist.get_world_size()
        dist.barrier()  # none leaves while another may still be heard
    finally:
        dist.destroy_process_group()


def device() -> torch.device:
    """Where this process computes: on a GPU where there is one; under torchrun each on its own."""
    gpus = torch.cuda.device_count() if torch.cuda.is_available() else 0
    return device_for(int(os.environ.get("LOCAL_RANK", "0")), gpus)


def device_for(local_rank: int, gpus: int) -> torch.device:
    """Where a process of a machine computes; more processes than GPUs share them in turn.

    local_rank: the process's number on its machine, from 0. gpus: how many the machine has.
    """
    return torch.device("cuda", local_rank % gpus) if gpus else torch.device("cpu")


def use_all_cores() -> None:
    """Threads for torch: the cores this process may use, shared by the processes of the machine.

    OMP_NUM_THREADS, where the user has set it, is left to decide; torchrun sets it unasked.
    """
    here = int(os.environ.get("LOCAL_WORLD_SIZE", "1"))
    if here == 1 and "OMP_NUM_THREADS" in os.environ:
        torch.set_num_threads(int(os.environ["OMP_NUM_THREADS"]))
        return
    torch.set_num_threads(max(1, cores() // here))


def keep_memory() -> None:
    """Has glibc keep what is freed for the next step, up to a GB; elsewhere does nothing.

    Given back, the system clears it page by page when it is asked for again: a tenth of a step.
    """
    if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "mallopt"):
        for setting in (MMAP_THRESHOLD, TRIM_THRESHOLD):
            libc.mallopt(setting, 2**30)


def average_gradients(network: nn.Module) -> None:
    """Every gradient becomes its mean over the processes."""
    if dist.is_initialized():
        _average([p.grad for p in network.parameters() if p.grad is not None])


def average_statistics(network: nn.Module) -> None:
    """Batch norm's running statistics become their mean over the processes."""
    if dist.is_initialized():
        _average([b for b in network.buffers() if b.is_floating_point()])


def total(value: float) -> float:
    """Sum over the processes."""
    return _reduced(value, dist.ReduceOp.SUM) if dist.is_initialized() else value


def largest(value: float) -> float:
    """Maximum over the processes, so that all of them decide alike."""
    return _reduced(value, dist.ReduceOp.MAX) if dist.is_initialized() else value


def wait() -> None:
    """Until every process is here."""
    if dist.is_initialized():
        dist.barrier()


def _reduced(value: float, how: dist.ReduceOp.RedOpType) -> float:
    tensor = torch.tensor(value, dtype=torch.float64)
    dist.all_reduce(tensor, how)
    return float(tensor)


def _average(tensors: list[torch.Tensor]) -> None:
    """In place. One message for all of them: a message each would cost more than their bytes."""
    flat = torch.cat([tensor.detach().reshape(-1) for tensor in tensors])
    dist.all_reduce(flat)
    flat /= dist.get_world_size()
    for tensor, mean in zip(tensors, flat.split([t.numel() for t in tensors]), strict=True):
        tensor.detach().copy_(mean.view_as(tensor))
