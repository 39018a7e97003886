"""Rotation matrices and quaternions."""

import numpy as np

from warpcam.core.rotations import rotation_matrices, rotation_quaternions


def test_known_matrices() -> None:
    half = 0.5**0.5
    quaternions = np.array(((2.0, 0.0, 0.0, 0.0), (half, half, 0.0, 0.0), (half, 0.0, 0.0, half), (0.0,) * 4))
    expected = (np.eye(3), ((1, 0, 0), (0, 0, -1), (0, 1, 0)), ((0, -1, 0), (1, 0, 0), (0, 0, 1)), np.eye(3))
    np.testing.assert_allclose(rotation_matrices(quaternions), expected, atol=1e-15)


def test_quaternions_invert_matrices() -> None:
    quaternions = np.concatenate((np.random.default_rng(5).normal(size=(200, 4)), np.eye(4), -np.ones((1, 4))))
    found = rotation_quaternions(rotation_matrices(quaternions))
    for sign in (found, quaternions):
        sign /= np.linalg.norm(sign, axis=1, keepdims=True)
    np.testing.assert_allclose(np.abs(np.sum(found * quaternions, axis=1)), 1.0, atol=1e-12)
    assert (np.take_along_axis(found, np.abs(found).argmax(axis=1)[:, None], axis=1) > 0.0).all()


def test_matrices_are_rotations() -> None:
    matrices = rotation_matrices(np.random.default_rng(6).normal(size=(50, 4)))
    np.testing.assert_allclose(
        matrices @ matrices.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (50, 3, 3)), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(matrices), 1.0)
