"""Rotation matrices and quaternions w x y z, many at once."""

import numpy as np


def rotation_matrices(quaternions: np.ndarray) -> np.ndarray:
    """Rotation matrices (n, 3, 3) of quaternions w x y z of any length, (n, 4); those of length 0 do not rotate."""
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    unit = np.where(length > 0.0, quaternions / np.where(length > 0.0, length, 1.0), (1.0, 0.0, 0.0, 0.0))
    w, x, y, z = unit.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.array(rows).transpose(2, 0, 1)


def rotation_quaternions(matrices: np.ndarray) -> np.ndarray:
    """Quaternions w x y z, not of length 1, of rotation matrices (n, 3, 3); the largest component is positive."""
    m = matrices
    diagonal = np.stack((m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]), axis=1)
    trace = diagonal.sum(axis=1)
    mixed = np.stack((m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]), axis=1)
    four = np.zeros((len(m), 4, 4))  # 4 q q^T, of which any row will do that is not small
    four[:, 0, 0] = 1.0 + trace
    four[:, 0, 1:] = four[:, 1:, 0] = mixed
    for i in range(3):
        for j in range(3):
            four[:, 1 + i, 1 + j] = m[:, i, j] + m[:, j, i]
        four[:, 1 + i, 1 + i] = 1.0 + 2.0 * diagonal[:, i] - trace
    best = np.argmax(np.diagonal(four, axis1=1, axis2=2), axis=1)
    return four[np.arange(len(m)), best]
