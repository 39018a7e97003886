"""What facets reflect of light from everywhere, by the real-time look's formula beside the table of paths."""

import numpy as np
import warp as wp
from native_kernel import native_kernel

from warpcam.kernels.build.facet_albedo import CELLS, MIN_ROUGHNESS, facet_albedo


@wp.func_native("""
    float scale, offset;
    warpcam::facet_albedo(cosine, roughness, scale, offset);
    wp::index(shares, i) = wp::vec2(scale, offset);
""")
def reflect(cosine: float, roughness: float, shares: wp.array(dtype=wp.vec2), i: int): ...


@native_kernel("shading/ggx.h")
def reflect_all(
    cosines: wp.array(dtype=wp.float32), roughnesses: wp.array(dtype=wp.float32), shares: wp.array(dtype=wp.vec2)
):
    i = wp.tid()
    reflect(cosines[i], roughnesses[i], shares, i)


def test_beside_the_table(device: wp.Device) -> None:
    roots, roughnesses = np.meshgrid(np.linspace(0.0, 1.0, CELLS), np.linspace(0.0, 1.0, CELLS), indexing="ij")
    kept = (roots >= np.sqrt(0.02)) & (roughnesses >= MIN_ROUGHNESS)
    given = [wp.array(each[kept], dtype=wp.float32, device=device) for each in (roots**2, roughnesses)]
    shares = wp.zeros(int(kept.sum()), dtype=wp.vec2, device=device)
    wp.launch(reflect_all, shares.size, [*given, shares], device=device)
    error = np.abs(shares.numpy() - facet_albedo()[:CELLS][kept])
    assert (error.max(axis=0) < (0.055, 0.025)).all()
    assert (np.sqrt((error**2).mean(axis=0)) < (0.012, 0.003)).all()
    assert (shares.numpy() >= 0.0).all() and (shares.numpy().sum(axis=1) <= 1.0 + 1e-6).all()
