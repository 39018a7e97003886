"""torch is imported when something of it is asked for, and is then found as if it had been there."""

import inspect
import subprocess
import sys
from typing import get_type_hints

import pytest
import torch
import warp as wp

import warpcam as wc
from warpcam.core import torch_interop
from warpcam.sensors import Rig
from warpcam.tools import self_test

PROJECT = "wc.Pinhole(fovy=60.0).project((0.0, 0.0, -1.0), width=8, height=8)"


@pytest.mark.parametrize(
    ("then", "expected"),
    [
        ("wc.Camera('own', width=8, height=8, lens=wc.Pinhole(fovy=60.0), position=(0.0, 0.0, 1.0))", False),
        (PROJECT, True),
        ("from warpcam.core.torch_interop import Tensor", True),
    ],
)
def test_a_process_imports_torch_for_tensors_alone(then: str, expected: bool) -> None:
    code = f"import sys, warpcam as wc; before = 'torch' in sys.modules; {then}; print(before, 'torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.stdout.split() == ["False", str(expected)], done.stderr


def test_what_is_late_is_torchs_own() -> None:
    assert torch_interop.torch.where is torch.where and torch_interop.Tensor is torch.Tensor
    assert "where" in vars(torch_interop.torch)  # found without a call from now on
    with pytest.raises(AttributeError, match="no attribute 'wher'"):
        torch_interop.torch.wher  # noqa: B018
    with pytest.raises(AttributeError, match=r"torch_interop' has no attribute 'Tenso'"):
        torch_interop.Tenso  # type: ignore[attr-defined]  # noqa: B018


def test_hints_of_public_names_are_torchs_classes() -> None:
    lenses = [kind for _, kind in inspect.getmembers(wc, inspect.isclass) if issubclass(kind, wc.Lens)]
    for kind in lenses:
        assert get_type_hints(kind.project)["return"] is get_type_hints(kind.unproject)["return"] is torch.Tensor
    assert len(lenses) > 10
    images = dict[str | int, dict[str, torch.Tensor]]
    assert get_type_hints(wc.Renderer.render)["return"] == get_type_hints(Rig.read)["return"] == images
    assert get_type_hints(wc.CameraLabels)["visible_boxes"] is torch.Tensor
    assert get_type_hints(wc.denoise)["return"] is get_type_hints(wc.Scene.vary)["return"] is torch.Tensor


def test_arrays_of_a_camera_are_listed_and_the_same_at_each_look(device: wp.Device) -> None:
    eye = wc.Camera("eye", width=8, height=8, outputs=("depth",), lens=wc.Pinhole(fovy=60.0), position=(0.0, 0.0, 3.0))
    arrays = wc.Renderer(self_test.scene(device, 2), [eye]).camera("eye")
    assert {"position", "rotation", "fovy", "near", "far"} == set(arrays) <= set(dir(arrays))
    assert arrays.position is arrays.position and arrays.position.shape == (2, 3)
