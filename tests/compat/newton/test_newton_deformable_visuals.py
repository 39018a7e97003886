"""Deformable visual meshes that ``SensorCamera`` is given beside a state, and the warnings of Newton's older names."""

from typing import Any

import numpy as np
import pytest
import warp as wp

newton = pytest.importorskip("newton", reason="pip install 'warpcam[newton]'")
if not hasattr(newton.geometry, "DeformableVisuals"):
    pytest.skip("this version of Newton has no deformable visual meshes", allow_module_level=True)
import newton_scenes  # noqa: E402, newton may be missing
import scenes  # noqa: E402
from newton.sensors import SensorCamera as TheirCamera  # noqa: E402

from warpcam.compat.newton import SensorCamera, SensorTiledCamera  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own
SIZE = (32, 24)
CORNERS = np.array(((-0.6, -0.5, 0.0), (0.6, -0.5, 0.0), (0.6, 0.5, 0.0), (-0.6, 0.5, 0.0)), np.float32)
FACES = np.array((0, 1, 2, 0, 2, 3))


def sheets(device: wp.Device) -> tuple[Any, Any]:
    """Two worlds, each with two sheets on bodies; one of them has more vertices."""
    builder = newton.ModelBuilder()
    for world in range(2):
        part = newton.ModelBuilder()
        for number, x in enumerate((-0.5, 0.5)):
            body = part.add_body(xform=newton_scenes.pose(x, 0.1 * world, 0.4 + 0.3 * number), mass=1.0)
            corners = np.concatenate((CORNERS, CORNERS[:1])) if number else CORNERS
            place = corners * 0.6 + (x, 0.1 * world, 0.4 + 0.3 * number)
            part.add_deformable_visual_mesh(place.astype(np.float32), FACES, kind="body", bodies=[body])
        builder.add_world(part)
    return newton_scenes.finalize(builder, device)


def lifted(model: Any, by: float) -> Any:
    state = model.state()
    poses = state.body_q.numpy()
    poses[:, 2] += by
    state.body_q.assign(poses)
    return state


def depths(kind: Any, model: Any, calls: Any) -> list[np.ndarray]:
    """Depth after each call of ``update``, with a state and the rest of its arguments."""
    sensor = kind(model)
    rays = kind.compute_camera_rays_pinhole(*SIZE, camera_fov=0.9, device=model.device)
    w, x, y, z = (float(part) for part in scenes.looking((0.0, -1.0, 2.6), (0.0, 0.0, 0.5)))
    views = wp.array(
        [wp.transform(wp.vec3(0.0, -1.0, 2.6), wp.quat(x, y, z, w))] * 2, dtype=wp.transformf, device=model.device
    )
    image = sensor.allocate_image_depth(2, *SIZE)
    seen = []
    for state, more in calls:
        sensor.update(state, views, rays, depth_image=image, **more)
        seen.append(image.numpy().copy())
    return seen


def test_what_is_given_is_drawn(device: wp.Device) -> None:
    """Newton's own draws the points that are given, also if they are those of another state."""
    model, state = sheets(device)
    other = lifted(model, 0.3)
    given = newton.geometry.DeformableVisuals(model).update(other)
    calls = [
        (state, {}),
        (other, {}),
        (state, {"deformable_visuals": given}),
        (state, {"sync_deformables": False}),
        (state, {}),
    ]
    theirs, ours = depths(TheirCamera, model, calls), depths(SensorCamera, model, calls)
    for one, two in zip(theirs, ours, strict=True):
        assert (np.isclose(one, two, atol=1e-3)).mean() > 0.99 and (two > 0.0).mean() > 0.05
    plain, moved, stale, kept, again = ours
    assert (stale == moved).all() and (kept == moved).all() and (again == plain).all() and (plain != moved).any()
    given.update(state)
    assert (depths(SensorCamera, model, [(other, {"deformable_visuals": given})])[0] == plain).all()


def test_what_was_never_updated_is_refused(device: wp.Device) -> None:
    model, state = sheets(device)
    fresh = newton.geometry.DeformableVisuals(model)
    for kind in (TheirCamera, SensorCamera):
        with pytest.raises(RuntimeError, match="has not been updated"):
            depths(kind, model, [(state, {"deformable_visuals": fresh})])
        with pytest.raises(ValueError, match="requires sync_deformables=True"):
            depths(kind, model, [(state, {"deformable_visuals": fresh.update(state), "sync_deformables": False})])
        fresh = newton.geometry.DeformableVisuals(model)


@pytest.mark.filterwarnings("error")
def test_older_names_warn_as_newtons_do(device: wp.Device) -> None:
    with pytest.warns(newton.NewtonDeprecationWarning, match="SensorTiledCamera is deprecated as of Newton 1.7"):
        sensor = SensorTiledCamera(sheets(device)[0])
    with pytest.warns(newton.NewtonDeprecationWarning, match="render_config is deprecated as of Newton 1.4"):
        assert sensor.render_config is sensor.default_render_config
    assert not sensor.default_render_config.enable_textures
