"""Memory of a process over time, on the host and on a device."""

import resource
import statistics
from pathlib import Path

import torch
import warp as wp

SETTLED = 0.25  # of a run, after which pools and caches have grown to their size


def host_bytes() -> int:
    """What the process has of the host's memory."""
    statm = Path("/proc/self/statm")
    if statm.is_file():
        return int(statm.read_text().split()[1]) * resource.getpagesize()
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def device_bytes(device: wp.Device) -> dict[str, int]:
    """What the process holds, and what all processes have taken; nothing on a CPU."""
    if not device.is_cuda:
        return {}
    own = torch.cuda.memory_allocated(wp.device_to_torch(device))
    pooled = wp.get_mempool_used_mem_current(device) if device.is_mempool_enabled else 0
    return {"held": own + pooled, "taken": device.total_memory - device.free_memory}


def growth(samples: list[dict[str, float]], name: str) -> int:
    """Bytes that the last quarter of the samples has more than that after which a process is settled."""
    settled = [int(sample[name]) for sample in samples if name in sample][int(SETTLED * len(samples)) :]
    quarter = max(1, len(settled) // 4)
    return int(statistics.median(settled[-quarter:]) - statistics.median(settled[:quarter])) if settled else 0
