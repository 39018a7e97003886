"""Many rays at a mesh on a CPU, which test its nodes and leaves together, against the same rays in small groups."""

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

ROWS, COLUMNS, SPREAD = 24, 48, 0.9  # rays of an image, and how far they look aside
GROUPS = 4  # of a tile's 32 rays: fewer than go together


def bumpy_ball(random: np.random.Generator) -> str:
    """A mesh of 4,512 faces, small ones beside the poles."""
    rings, around = 48, 48
    polar, azimuth = np.pi * np.arange(1, rings) / rings, 2.0 * np.pi * np.arange(around) / around
    radii = 0.4 + 0.05 * np.sin(5.0 * polar)[:, None] * np.cos(7.0 * azimuth) + random.uniform(0.0, 0.002, (47, 48))
    points = np.stack(
        (
            np.outer(np.sin(polar), np.cos(azimuth)),
            np.outer(np.sin(polar), np.sin(azimuth)),
            np.cos(polar)[:, None] + 0.0 * azimuth,
        ),
        -1,
    )
    faces = []
    for ring in range(rings - 2):
        for i in range(around):
            a, b, j = ring * around, (ring + 1) * around, (i + 1) % around
            faces += [(a + i, b + i, b + j), (a + i, b + j, a + j)]
    numbers = [" ".join(map(str, np.ravel(values))) for values in (points * radii[..., None], faces)]
    return f'<mesh name="mesh" vertex="{numbers[0]}" face="{numbers[1]}"/>'


@pytest.mark.parametrize("position", [(0.9, 0.2, 0.1), (0.45, -0.1, 0.0), (0.05, 0.02, 0.0)])
def test_rays_meet_together_what_they_meet_in_groups(position: tuple[float, ...], device: wp.Device) -> None:
    """From afar, at its surface, and from within, where only the outsides of other meshes are met."""
    random = np.random.default_rng(0)
    bodies = '<geom type="mesh" mesh="mesh"/>' + "".join(
        f'<geom type="mesh" mesh="mesh" pos="{x} {y} {z}"/>' for x, y, z in random.uniform(-1.2, 1.2, (16, 3))
    )
    mjm = scenes.compile_xml(bodies, assets=bumpy_ball(random))
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    up, aside = np.meshgrid(np.linspace(SPREAD, -SPREAD, ROWS), np.linspace(-SPREAD, SPREAD, COLUMNS), indexing="ij")
    rays = np.stack((aside, up, -np.ones_like(up)), axis=-1).astype(np.float32)
    pose = {"position": position, "rotation": scenes.looking(position, (0.0, 0.0, 0.05))}

    def seen(directions: np.ndarray) -> dict[str, np.ndarray]:
        settings = {"width": COLUMNS, "height": ROWS, "outputs": ("depth", "segmentation", "normals")}
        return scenes.look(scene, scenes.own_camera(lens=wc.Rays(directions), **settings, **pose))

    whole = seen(rays)
    assert np.mean(whole["segmentation"] >= 0) > 0.2
    group = np.arange(ROWS)[:, None] // 2 % 2 * 2 + np.arange(COLUMNS) % 2
    for number in range(GROUPS):
        mine = group == number
        part = seen(np.where(mine[..., None], rays, 0.0).astype(np.float32))
        for name, image in part.items():
            np.testing.assert_array_equal(image[:, mine], whole[name][:, mine], err_msg=name)
