"""Isaac Gym's ``torch_utils``: rotations and small helpers for batches. Quaternions are x y z w.

Each function may be called from a program's own ``torch.jit.script``.
"""

import math
from typing import Any

import numpy as np
import torch

# With the two modules, which programs that import all of it count on.
__all__ = [
    "copysign",
    "get_axis_params",
    "get_basis_vector",
    "get_euler_xyz",
    "normalize",
    "normalize_angle",
    "np",
    "quat_apply",
    "quat_conjugate",
    "quat_from_angle_axis",
    "quat_from_euler_xyz",
    "quat_mul",
    "quat_rotate",
    "quat_rotate_inverse",
    "quat_unit",
    "scale",
    "tensor_clamp",
    "tf_apply",
    "tf_combine",
    "tf_inverse",
    "tf_vector",
    "to_torch",
    "torch",
    "torch_rand_float",
    "torch_random_dir_2",
    "unscale",
    "unscale_np",
]  # fmt: skip


def to_torch(
    x: Any, dtype: torch.dtype = torch.float, device: str = "cuda:0", requires_grad: bool = False
) -> torch.Tensor:
    """A copy of numbers as a tensor."""
    if isinstance(x, torch.Tensor):
        return x.detach().clone().to(dtype=dtype, device=device).requires_grad_(requires_grad)
    return torch.tensor(x, dtype=dtype, device=device, requires_grad=requires_grad)


def normalize(x: torch.Tensor, eps: float = 1e-9) -> torch.Tensor:
    """(..., n) of length 1, but for those that are shorter than ``eps``."""
    return x / x.norm(p=2, dim=-1, keepdim=True).clamp(min=eps)


def quat_unit(a: torch.Tensor) -> torch.Tensor:
    """(..., 4) of length 1."""
    return normalize(a)


def quat_mul(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """(..., 4): first ``b``, then ``a``."""
    a_xyz, a_w = a[..., :3], a[..., 3:]
    b_xyz, b_w = b[..., :3], b[..., 3:]
    xyz = a_w * b_xyz + b_w * a_xyz + torch.cross(a_xyz, b_xyz, dim=-1)
    return torch.cat([xyz, a_w * b_w - (a_xyz * b_xyz).sum(dim=-1, keepdim=True)], dim=-1)


def quat_conjugate(a: torch.Tensor) -> torch.Tensor:
    """(..., 4): the other way round."""
    return torch.cat([-a[..., :3], a[..., 3:]], dim=-1)


def quat_apply(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Vectors turned by as many quaternions, whatever the shapes that both lie in; the vectors' is kept."""
    turns, vectors = a.reshape(-1, 4), b.reshape(-1, 3)
    axes = turns[:, :3]
    aside = 2.0 * torch.cross(axes, vectors, dim=-1)
    turned = vectors + turns[:, 3:] * aside + torch.cross(axes, aside, dim=-1)
    return turned.view(b.shape)


def quat_rotate(q: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
    """(n, 3): vectors (n, 3), turned by (n, 4)."""
    return quat_apply(q, v)


def quat_rotate_inverse(q: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
    """(n, 3): vectors (n, 3), turned back by (n, 4)."""
    return quat_apply(quat_conjugate(q), v)


def quat_from_angle_axis(angle: torch.Tensor, axis: torch.Tensor) -> torch.Tensor:
    """(n, 4) of angles (n,) [rad] about axes (n, 3) of any length."""
    half = 0.5 * angle.unsqueeze(-1)
    return quat_unit(torch.cat([normalize(axis) * half.sin(), half.cos()], dim=-1))


def normalize_angle(x: torch.Tensor) -> torch.Tensor:
    """Wrap an angle to -pi to pi."""
    return torch.atan2(torch.sin(x), torch.cos(x))


def tf_inverse(q: torch.Tensor, t: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Rotations (n, 4) and translations (n, 3) of the poses the other way round."""
    back = quat_conjugate(q)
    return back, -quat_apply(back, t)


def tf_apply(q: torch.Tensor, t: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
    """Points (n, 3) of the poses' frames."""
    return quat_apply(q, v) + t


def tf_vector(q: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
    """Directions (n, 3) of the poses' frames."""
    return quat_apply(q, v)


def tf_combine(
    q1: torch.Tensor, t1: torch.Tensor, q2: torch.Tensor, t2: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Rotations and translations of the second poses, which are in the first ones' frames."""
    return quat_mul(q1, q2), quat_apply(q1, t2) + t1


def get_basis_vector(q: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
    """(n, 3): vectors (n, 3), turned by (n, 4)."""
    return quat_rotate(q, v)


def get_axis_params(
    value: float, axis_idx: int, x_value: float = 0.0, dtype: Any = float, n_dims: int = 3
) -> list[Any]:
    """A vector's numbers: the value along one axis, ``x_value`` along x, else 0."""
    numbers = np.zeros(n_dims)
    numbers[axis_idx] = value
    numbers[0] = x_value
    return list(numbers.astype(dtype))


def copysign(a: float, b: torch.Tensor) -> torch.Tensor:
    """(n,): the number with the signs of (n,)."""
    return abs(a) * torch.sign(b)


def get_euler_xyz(q: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Roll, pitch and yaw, (n,) each, of (n, 4), from 0 to 2 pi [rad]."""
    x, y, z, w = q[:, 0], q[:, 1], q[:, 2], q[:, 3]
    roll = torch.atan2(2.0 * (w * x + y * z), w * w - x * x - y * y + z * z)
    pitch = torch.asin(torch.clamp(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = torch.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    whole = 2.0 * math.pi
    return roll % whole, pitch % whole, yaw % whole


def quat_from_euler_xyz(roll: torch.Tensor, pitch: torch.Tensor, yaw: torch.Tensor) -> torch.Tensor:
    """(..., 4) of angles about the fixed axes x, then y, then z [rad]."""
    half = 0.5 * torch.stack([roll, pitch, yaw], dim=-1)
    zero = torch.zeros_like(roll)
    sin, cos = half.sin().unbind(dim=-1), half.cos().unbind(dim=-1)
    about_x = torch.stack([sin[0], zero, zero, cos[0]], dim=-1)
    about_y = torch.stack([zero, sin[1], zero, cos[1]], dim=-1)
    about_z = torch.stack([zero, zero, sin[2], cos[2]], dim=-1)
    return quat_mul(about_z, quat_mul(about_y, about_x))


def torch_rand_float(lower: float, upper: float, shape: tuple[int, int], device: str) -> torch.Tensor:
    """Uniform from ``lower`` to ``upper``."""
    return (upper - lower) * torch.rand(shape, device=device) + lower


def torch_random_dir_2(shape: tuple[int, int], device: str) -> torch.Tensor:
    """Directions in a plane: (n, 2) of a shape (n, 1)."""
    turns = 2.0 * math.pi * torch.rand(shape, device=device)
    return torch.stack([turns.cos(), turns.sin()], dim=-1).squeeze(-2)


def tensor_clamp(t: torch.Tensor, min_t: torch.Tensor, max_t: torch.Tensor) -> torch.Tensor:
    """Numbers between as many limits."""
    return torch.max(torch.min(t, max_t), min_t)


def scale(x: torch.Tensor, lower: torch.Tensor, upper: torch.Tensor) -> torch.Tensor:
    """From -1 to 1 to between limits."""
    return lower + (upper - lower) * (x + 1.0) / 2.0


def unscale(x: torch.Tensor, lower: torch.Tensor, upper: torch.Tensor) -> torch.Tensor:
    """From between limits to -1 to 1."""
    return 2.0 * (x - lower) / (upper - lower) - 1.0


def unscale_np(x: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Unscale numpy arrays."""
    return 2.0 * (x - lower) / (upper - lower) - 1.0
