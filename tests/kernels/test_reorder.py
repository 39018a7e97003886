"""Trees of meshes that move: their boxes hold the faces, and are put in order again where they have grown."""

import numpy as np
import pytest
import warp as wp

from warpcam.accel.meshes import Mesh, pack_meshes
from warpcam.kernels.update.refit import DeformingTree

SIDE = 24  # vertices along a side of the sheet


def sheet() -> tuple[np.ndarray, np.ndarray]:
    """Vertices in the unit square, and faces."""
    x, y = np.meshgrid(*2 * (np.linspace(0.0, 1.0, SIDE),), indexing="ij")
    vertices = np.stack((x, y, np.zeros_like(x)), axis=-1).reshape(-1, 3).astype(np.float32)
    number = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    a, b, c, d = (part.reshape(-1) for part in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    faces = np.concatenate((np.stack((a, b, c), axis=1), np.stack((a, c, d), axis=1)))
    return vertices, faces.astype(np.int32)


def crumpled() -> np.ndarray:
    return np.random.default_rng(0).normal(0.0, 1.0, (SIDE * SIDE, 3)).astype(np.float32)


class Sheets:
    """Two instances of one mesh."""

    def __init__(self, start: np.ndarray, device: wp.Device):
        vertices, self.faces = sheet()
        mesh = Mesh("sheet", start, self.faces, moves=True)
        self.device, self.meshes = device, pack_meshes([mesh, mesh], device)[0]
        bases = np.array((0, len(vertices)))
        self.tree = DeformingTree(self.meshes, np.arange(2), bases, self.faces, device)
        self.points = wp.array(np.concatenate((start, start)), dtype=wp.vec3, device=device)
        self.stages = self.tree.record(self.points)

    def frames(self, count: int, *states: np.ndarray) -> None:
        self.points.assign(np.concatenate(states))
        for _ in range(count):
            for stage in self.stages:
                stage.launch()

    def boxes(self, instance: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Lower and upper corners of the children that are there, (child, 3), and their codes."""
        first = int(self.meshes.node_start.numpy()[instance])
        wide = 8 if self.device.is_cuda else 7
        end = first + wide * self.tree._moving.num_nodes
        rows = self.meshes.nodes.numpy()[first:end].reshape(-1, wide, 4)
        if self.device.is_cuda:
            low, high = rows[:, 0::2, :3], rows[:, 1::2, :3]
            codes = np.ascontiguousarray(rows[:, 0::2, 3]).view(np.int32)
        else:
            low, high = rows[:, 0:3].transpose(0, 2, 1), rows[:, 3:6].transpose(0, 2, 1)
            codes = np.ascontiguousarray(rows[:, 6]).view(np.int32)
        there = low[..., 0] < 1e29
        return low[there], high[there], codes[there]

    def area(self, instance: int) -> float:
        low, high, _ = self.boxes(instance)
        size = high - low
        return float((size[:, 0] * size[:, 1] + size[:, 1] * size[:, 2] + size[:, 2] * size[:, 0]).sum())

    def check(self, instance: int, vertices: np.ndarray) -> None:
        """Each face stands in a leaf, with its own corners, inside the leaf's box."""
        first = int(self.meshes.face_start.numpy()[instance])
        rows = self.meshes.faces.numpy()[first : first + 3 * self.tree._moving.order.shape[1]].reshape(-1, 3, 4)
        given = np.ascontiguousarray(rows[:, 0, 3]).view(np.int32)
        assert set(given) == set(range(len(self.faces)))
        assert (rows[..., :3] == vertices[self.faces[given]]).all()
        for low, high, code in zip(*self.boxes(instance), strict=True):
            if code < 0:
                start, count = (-code - 1) >> 4, (-code - 1) & 15
                corners = rows[start : start + count, :, :3]
                assert (corners >= low).all() and (corners <= high).all()


def test_a_tree_of_what_was_crumpled_is_put_in_order_when_it_lies_flat(device: wp.Device) -> None:
    flat, start = sheet()[0], crumpled()
    sheets = Sheets(start, device)
    sheets.frames(48, start, start)
    before = [sheets.area(instance) for instance in range(2)]
    sheets.frames(1, flat, start)
    poor = sheets.area(0)
    sheets.frames(48, flat, start)
    assert sheets.area(0) < 0.2 * poor
    assert sheets.area(1) == pytest.approx(before[1])  # each by itself
    fresh = Sheets(flat, device)
    assert sheets.area(0) < 4.0 * fresh.area(0)
    for instance, vertices in enumerate((flat, start)):
        sheets.check(instance, vertices)


def test_a_good_tree_keeps_its_order(device: wp.Device) -> None:
    flat = sheet()[0]
    sheets = Sheets(flat, device)
    before = sheets.tree._moving.order.numpy().copy()
    bent = flat + 0.1 * np.sin(6.0 * flat[:, (1, 2, 0)]).astype(np.float32)
    turned = flat[:, (2, 0, 1)] * np.float32(20.0)  # neither where it lies nor its size counts
    for state in (flat, bent, turned):
        sheets.frames(48, state, state)
    assert (sheets.tree._moving.order.numpy() == before).all()
    sheets.check(0, turned)


def test_faces_that_are_no_numbers_harm_nobody(device: wp.Device) -> None:
    flat, start = sheet()[0], crumpled()
    sheets = Sheets(start, device)
    sheets.frames(48, start, start)
    broken = flat.copy()
    broken[5] = np.nan
    sheets.frames(48, broken, flat)
    sheets.frames(48, flat, flat)
    for instance in range(2):
        sheets.check(instance, flat)
