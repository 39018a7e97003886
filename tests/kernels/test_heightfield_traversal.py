"""The walk over a height field against every one of its triangles, in float64."""

import functools
from dataclasses import dataclass

import numpy as np
import warp as wp
from hypothesis import example, given, settings
from hypothesis import strategies as st
from native_kernel import native_kernel

from warpcam.accel.heightfields import HeightField, pack_height_fields
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.types import HeightFields

RAYS = 400
PACKET = wp.constant(8)  # rays that a CPU thread walks at once; accel/heightfield_simd.h has the same number
SHAPE = 5
FAR_AWAY = 3.0e38
NUDGE = 3e-5  # [m]
NUDGES = NUDGE * np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z])
# Of depth, for rays of unit length that start a few metres away. More than a nudge: a ray may start at the surface.
TOLERANCE = 1.3 * NUDGE


@wp.func_native("""
    warpcam::ShapeRecord record {};
    record.axis_x = { 1.0f, 0.0f, 0.0f, warpcam::HEIGHT_FIELD };
    record.axis_y = { 0.0f, 1.0f, 0.0f, 5 };
    record.axis_z = { 0.0f, 0.0f, 1.0f, 1 };
    record.size.z = wp::index(fields.size, 1)[3];
    const auto o = wp::index(origins, i), d = wp::index(directions, i);
    const warpcam::WorldRay ray { { o[0], o[1], o[2] }, { d[0], d[1], d[2] } };
    warpcam::Hit hit { wp::index(limits, i)[1], -1, -1 };
    warpcam::walk_height_field(fields, record, ray, wp::index(limits, i)[0], hit);
    depth.data[i] = hit.depth;
    wp::address(found, i)[0] = wp::vec2i(hit.shape, hit.face);
""")
def walk_one(
    fields: HeightFields,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    limits: wp.array(dtype=wp.vec2),
    depth: wp.array(dtype=wp.float32),
    found: wp.array(dtype=wp.vec2i),
    i: int,
): ...


@wp.kernel(module="unique", enable_backward=False, module_options=native_module("shadow/shadow_pass.h"))
def walk_all(
    fields: HeightFields,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    limits: wp.array(dtype=wp.vec2),
    depth: wp.array(dtype=wp.float32),
    found: wp.array(dtype=wp.vec2i),
):
    walk_one(fields, origins, directions, limits, depth, found, wp.tid())


@wp.func_native("""
    warpcam::ShapeRecord record {};
    record.axis_z.w = 1;
    record.size.z = wp::index(fields.size, 1)[3];
    warpcam::RayPacket ray;
    warpcam::Float8 near;
    warpcam::PacketHit hit { {}, 0, 0 };
    for (int k = 0; k < warpcam::SIMD_WIDTH; ++k) {
        const auto o = wp::index(origins, first + k), d = wp::index(directions, first + k);
        ray.ox[k] = o[0], ray.oy[k] = o[1], ray.oz[k] = o[2];
        ray.dx[k] = d[0], ray.dy[k] = d[1], ray.dz[k] = d[2];
        near[k] = wp::index(limits, first + k)[0];
        hit.depth[k] = wp::index(limits, first + k)[1];
    }
    warpcam::walk_packet(fields, record, ray, near, hit);
    for (int k = 0; k < warpcam::SIMD_WIDTH; ++k) {
        depth.data[first + k] = hit.depth[k];
        wp::address(found, first + k)[0] = wp::vec2i(hit.met[k] ? 5 : -1, hit.face[k]);
    }
""")
def walk_eight(
    fields: HeightFields,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    limits: wp.array(dtype=wp.vec2),
    depth: wp.array(dtype=wp.float32),
    found: wp.array(dtype=wp.vec2i),
    first: int,
): ...


@wp.kernel(module="unique", enable_backward=False, module_options=native_module("traversal/trace_tile.h"))
def walk_all_on_cpu(
    fields: HeightFields,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    limits: wp.array(dtype=wp.vec2),
    depth: wp.array(dtype=wp.float32),
    found: wp.array(dtype=wp.vec2i),
):
    walk_eight(fields, origins, directions, limits, depth, found, PACKET * wp.tid())


@wp.func_native("""
    warpcam::ShapeRecord record {};
    record.axis_z.w = 1;
    record.size.z = wp::index(fields.size, 1)[3];
    const auto o = wp::index(origins, i), d = wp::index(directions, i);
    const auto limit = wp::index(limits, i);
    const warpcam::Ray ray { { o[0], o[1], o[2] }, { d[0], d[1], d[2] } };
    out.data[i] = warpcam::comes_out(fields, record, ray, limit[0], limit[1]);
""")
def comes_out_one(
    fields: HeightFields,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    limits: wp.array(dtype=wp.vec2),
    out: wp.array(dtype=wp.int32),
    i: int,
): ...


@native_kernel("accel/heightfield.h")
def come_out(
    fields: HeightFields,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    limits: wp.array(dtype=wp.vec2),
    out: wp.array(dtype=wp.int32),
):
    comes_out_one(fields, origins, directions, limits, out, wp.tid())


@dataclass(frozen=True)
class Walker:
    """One of the walks that are tested, and where."""

    kernel: wp.Kernel
    device: wp.Device
    rays: int  # of a thread


def packed(field: HeightField, rays: tuple, device: wp.Device) -> list:
    """The field, of index 1, and rays (origin, direction, near and far) as kernels take them."""
    other = HeightField("other", np.ones((4, 3), np.float32), (1.0, 1.0), 1.0, 0.1)
    types = (wp.vec3, wp.vec3, wp.vec2)
    arrays = [wp.array(np.float32(part), dtype=kind, device=device) for part, kind in zip(rays, types, strict=True)]
    return [pack_height_fields([other, field], device), *arrays]


def walk(field: HeightField, rays: tuple, walker: Walker) -> tuple[np.ndarray, np.ndarray]:
    """Depth (ray,) and shape and face (ray, 2) of rays (origin, direction, near and far)."""
    device = walker.device
    count = len(rays[0])
    depth, found = wp.zeros(count, dtype=wp.float32, device=device), wp.zeros(count, dtype=wp.vec2i, device=device)
    wp.launch(walker.kernel, count // walker.rays, [*packed(field, rays, device), depth, found], device=device)
    return depth.numpy(), found.numpy()


class Truth:
    """A height field as a heap of triangles and a box."""

    def __init__(self, field: HeightField):
        self.heights = field.heights.astype(np.float64)
        rows, columns = self.heights.shape
        self.half = np.array(field.half_size, np.float64)
        self.base, self.top = field.base, self.heights.max()
        x, y = np.linspace(-1, 1, columns) * self.half[0], np.linspace(-1, 1, rows) * self.half[1]
        points = np.stack((*np.meshgrid(x, y), self.heights), axis=-1)
        a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
        # the face of a cell's triangle is twice the cell, and one more for that above the diagonal
        self.triangles = np.stack((np.stack((a, b, c), -2), np.stack((a, c, d), -2)), axis=2).reshape(-1, 3, 3)

    def tops(self, o: np.ndarray, d: np.ndarray, slack: float = 0.0) -> np.ndarray:
        """Return where each ray enters each triangle through its front, (ray, triangle); inf where it does not."""
        a = self.triangles[:, 0]
        first, second = self.triangles[:, 1] - a, self.triangles[:, 2] - a
        across = np.cross(d[:, None], second)
        facing = np.einsum("rtk,tk->rt", across, first)
        away = o[:, None] - a
        turned = np.cross(away, first[None])
        with np.errstate(all="ignore"):
            u, v = np.einsum("rtk,rtk->rt", away, across) / facing, np.einsum("rtk,rk->rt", turned, d) / facing
            t = np.einsum("rtk,tk->rt", turned, second) / facing
            met = (facing > 1e-12) & (u >= -slack) & (v >= -slack) & (u + v <= 1 + slack)
        return np.where(met, t, np.inf)

    def box(self, o: np.ndarray, d: np.ndarray) -> np.ndarray:
        """Return where each ray enters the sides or the base, (ray,)."""
        low, high = np.array([*-self.half, -self.base]), np.array([*self.half, self.top])
        with np.errstate(all="ignore"):
            t0, t1 = (low - o) / d, (high - o) / d
        # along an axis: always or never between the two
        always = np.where((o >= low) & (o <= high), np.inf, -np.inf)
        enter = np.where(d == 0, -always, np.minimum(t0, t1))
        leave = np.where(d == 0, always, np.maximum(t0, t1)).min(axis=1)
        sideways = enter[:, :2].max(axis=1)
        t = np.maximum(sideways, enter[:, 2])
        by_base = (enter[:, 2] > sideways) & (d[:, 2] > 0)
        place = o + np.where(np.isfinite(t), t, 0.0)[:, None] * d
        by_side = (enter[:, 2] <= sideways) & (place[:, 2] <= self.ground(place[:, :2]))
        return np.where((t <= leave) & (by_base | by_side), t, np.inf)

    def ground(self, place: np.ndarray) -> np.ndarray:
        rows, columns = self.heights.shape
        steps = (place + self.half) / (2 * self.half) * (columns - 1, rows - 1)
        cell = np.clip(np.floor(steps), 0, (columns - 2, rows - 2)).astype(int)
        (u, v), (i, j), h = (steps - cell).T, cell.T, self.heights
        corner, opposite = h[j, i], h[j + 1, i + 1]
        below = corner + u * (h[j, i + 1] - corner) + v * (opposite - h[j, i + 1])
        return np.where(u > v, below, corner + v * (h[j + 1, i] - corner) + u * (opposite - h[j + 1, i]))

    def cast(self, o: np.ndarray, d: np.ndarray, limits: np.ndarray) -> np.ndarray:
        """Nearest of all between the limits, (ray,); inf where there is none."""
        t = np.concatenate((self.tops(o, d), self.box(o, d)[:, None]), axis=1)
        return np.where((t > limits[:, :1]) & (t < limits[:, 1:]), t, np.inf).min(axis=1)


def rays_at(field: HeightField, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays of all sorts, as float32 has them: some along axes, some from within or below, some that end early."""
    reach = np.array([*field.half_size, 0.5])
    steps = np.array(field.heights.shape)[::-1] - 1
    o = random.uniform(-2.5, 2.5, (RAYS, 3)) * reach
    aim = random.uniform(-1.1, 1.1, (RAYS, 3)) * reach
    # every third at a grid line, from over one every ninth
    line = (np.floor(random.uniform(0, 1, (RAYS, 2)) * (steps + 1)) / steps * 2 - 1) * field.half_size
    aim[::3, :2] = line[::3]
    o[::9, :2] = line[::9]
    d = aim - o
    kind = random.integers(0, 8, RAYS)
    for axis in range(3):  # in a plane along two axes, or along one
        d[kind == axis, axis] = 0.0
        d[kind == axis + 3] = np.eye(3)[axis] * np.where(d[kind == axis + 3, axis, None] < 0, -1.0, 1.0)
    d[(d == 0).all(axis=1)] = (0.0, 0.0, -1.0)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    near = np.where(random.uniform(size=RAYS) < 0.2, random.uniform(0, 3, RAYS), 0.0)
    far = np.where(random.uniform(size=RAYS) < 0.2, near + random.uniform(0, 3, RAYS), FAR_AWAY)
    return tuple(np.float32(part).astype(np.float64) for part in (o, d, np.stack((near, far), 1)))


@functools.cache
def walkers() -> list[Walker]:
    single = [Walker(walk_all, device, 1) for device in wp.get_devices()]
    return [*single, Walker(walk_all_on_cpu, wp.get_device("cpu"), PACKET)]


@settings(max_examples=60, deadline=None)
@given(
    rows=st.integers(2, 14),
    columns=st.integers(2, 14),
    seed=st.integers(0, 2**16),
    roughness=st.sampled_from((0.0, 0.05, 0.5)),
    half_size=st.sampled_from(((1.0, 1.0), (0.4, 2.0), (3.0, 1.5))),
)
@example(rows=5, columns=8, seed=1, roughness=0.0, half_size=(0.4, 2.0))  # starts at a side
def test_every_ray_meets_the_nearest(rows: int, columns: int, seed: int, roughness: float, half_size: tuple) -> None:
    random = np.random.default_rng(seed)
    heights = np.float32(0.2 + roughness * random.uniform(-0.4, 1.0, (rows, columns)))
    field = HeightField("any", heights, tuple(map(float, np.float32(half_size))), 1.0, float(np.float32(0.1)))
    truth = Truth(field)
    rays = rays_at(field, random)
    true = truth.cast(*rays)
    # What rays close by meet: near an edge, in the plane of a side, or along the ground any of it is right.
    close = np.stack([truth.cast(rays[0] + nudge, rays[1], rays[2]) for nudge in NUDGES] + [true])
    nearest, farthest = close.min(axis=0), close.max(axis=0)
    for walker in walkers():
        depth, found = walk(field, rays, walker)
        hit = found[:, 0] == SHAPE
        assert (depth[~hit] == np.float32(rays[2][~hit, 1])).all()
        seen = np.where(hit, depth, np.inf)
        slack = TOLERANCE * (1 + np.where(np.isfinite(seen), seen, 0))
        wrong = ~((seen >= nearest - slack) & (seen <= farthest + slack))
        at = np.flatnonzero(wrong)
        assert not wrong.any(), (walker, at[:5], seen[at[:5]], true[at[:5]], [part[at[:5]] for part in rays])
        # The face is one whose plane the ray meets there, within or just beside it; sides and base have none.
        clear = hit & (farthest < nearest + 1e-3)
        top, side = clear & (found[:, 1] >= 0), clear & (found[:, 1] < 0)
        meets = truth.tops(rays[0][top], rays[1][top], slack=1e-3)[np.arange(top.sum()), found[top, 1]]
        assert (np.abs(meets - depth[top]) < 1e-4 * (1 + depth[top])).all(), walker
        assert (np.abs(truth.box(rays[0][side], rays[1][side]) - depth[side]) < 1e-4 * (1 + depth[side])).all(), walker


def test_no_ray_slips_through() -> None:
    """Rays steeper than the ground, at its samples and the edges between them: each meets it there and only there."""
    random = np.random.default_rng(11)
    rows, columns, count = 34, 21, 200_000
    field = HeightField("any", np.float32(random.uniform(0.1, 0.2, (rows, columns))), (4.0, 7.0), 1.0, 0.1)
    # from an inner sample to a neighbour, among them across the cell's diagonal; a quarter stays at the sample
    place = np.stack((random.integers(1, columns - 2, count), random.integers(1, rows - 2, count)), 1).astype(float)
    place += np.array([(1, 0), (0, 1), (1, 1), (0, 0)])[np.arange(count) % 4] * random.uniform(size=(count, 1))
    place = (place / (columns - 1, rows - 1) * 2 - 1) * field.half_size
    aim = np.concatenate((place, Truth(field).ground(place)[:, None]), axis=1)
    back = random.uniform(-1.0, 1.0, (count, 3)) + np.array((0.0, 0.0, 2.0))
    back[::5, :2] *= 1e-7  # nearly upright
    back[::7, 0] = 0.0
    back *= np.where(np.arange(count) % 3 == 0, 20.0, 0.2)[:, None]  # from far, and from just above
    rays = aim + back, -back, np.tile((0.0, FAR_AWAY), (count, 1))
    for walker in walkers():
        depth, found = walk(field, rays, walker)
        assert (found[:, 0] == SHAPE).all() and (found[:, 1] >= 0).all(), walker
        assert np.abs(depth - 1.0).max() < 1e-4, walker


def test_what_is_in_the_ground_comes_out(device: wp.Device) -> None:
    random = np.random.default_rng(5)
    half, base = np.array((2.0, 3.0)), 0.25
    field = HeightField("any", np.float32(random.uniform(0.1, 0.4, (9, 6))), tuple(half), 1.0, base)
    ends = random.uniform(-1.2, 1.2, (2, 20_000, 3)) * (*half, 0.4)
    ends[1, ::4] *= 1e25  # as where light comes from far away
    limits = np.tile((0.25, 1.5), (len(ends[0]), 1))
    d = (ends[1] - ends[0]) / (limits[:, 1:] - limits[:, :1])
    o = ends[0] - limits[:, :1] * d
    rays = [np.float32(part).astype(np.float64) for part in (o, d, limits)]
    inside, near_border = [], np.zeros(len(o), bool)
    for k in range(2):
        place = rays[0] + rays[2][:, k : k + 1] * rays[1]
        z, top = place[:, 2], Truth(field).ground(np.clip(place[:, :2], -half, half))
        within = np.min((*(half - np.abs(place[:, :2])).T, z + base, top - z), axis=0)
        inside.append(within > 0)
        near_border |= np.abs(within) < 1e-5
    truth = inside[0] & ~inside[1]
    assert 0.1 < truth.mean() < 0.9 and near_border.mean() < 0.01
    out = wp.zeros(len(o), dtype=wp.int32, device=device)
    wp.launch(come_out, len(o), [*packed(field, rays, device), out], device=device)
    assert ((out.numpy() > 0) == truth)[~near_border].all()
