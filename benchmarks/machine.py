"""Description of the machine of a measurement."""

import importlib.metadata
import os
import platform
import re
import subprocess
from pathlib import Path
from typing import Any

import warp as wp

PACKAGES = ("warpcam", "warp-lang", "mujoco", "mujoco-warp", "newton", "mujoco-warp-pbr", "mjlab", "torch", "numpy")


def describe(device: wp.Device) -> dict[str, Any]:
    found: dict[str, Any] = {"device": device.name, "python": platform.python_version(), "system": platform.platform()}
    cpuinfo = Path("/proc/cpuinfo")
    model = re.search(r"model name\s*:\s*(.+)", cpuinfo.read_text()) if cpuinfo.exists() else None
    found["cpu"] = f"{model[1] if model else platform.processor()} ({os.cpu_count()} cores)"
    if device.is_cuda:
        query = ["nvidia-smi", f"--id={device.uuid}", "--query-gpu=driver_version", "--format=csv,noheader"]
        try:
            found["driver"] = subprocess.run(query, capture_output=True, text=True, check=True).stdout.strip()
        except (OSError, subprocess.CalledProcessError) as error:
            found["driver"] = f"unknown: {error}"
    for package in PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found
