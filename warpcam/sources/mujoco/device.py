"""MuJoCo-Warp: worlds whose state already lies in Warp arrays. They are read where they are."""

from collections.abc import Collection, Mapping, Sequence
from operator import attrgetter
from typing import Any

import mujoco
import mujoco_warp as mjw
import warp as wp

from warpcam.core import device as device_rule
from warpcam.core.errors import WarpcamError
from warpcam.scene.layers import Transparency
from warpcam.scene.scene import Scene
from warpcam.sources.common.splats import Splats
from warpcam.sources.common.with_splats import with_splats
from warpcam.sources.mujoco import model
from warpcam.sources.mujoco.layers import with_layers
from warpcam.sources.mujoco.shape_tables import ModelSource, VisualGeomArrays, names_of
from warpcam.sources.mujoco.visual_geoms import check_kinds, with_visual_geoms

NAMES = (*model.DATA_NAMES, *model.MODEL_NAMES, "headlight")
# Asked every frame: one call for all.
of_data, of_model = attrgetter(*model.DATA_NAMES.values()), attrgetter(*model.MODEL_NAMES.values())


class MujocoWarpSource(ModelSource):
    """The live arrays of a MuJoCo-Warp Model and Data, and the host's model for what they lack."""

    live_on_device = True

    def __init__(
        self,
        mjm: mujoco.MjModel,
        m: mjw.Model,
        d: mjw.Data,
        groups: model.Groups,
        draw: Collection[str] = model.DRAWN,
        reflections: bool | None = None,
        transparency: Transparency = None,
        geoms: Collection[int] | None = None,
        planes_from_behind: bool = False,
    ):
        model.check_model(mjm, "mjm")
        if not isinstance(m, mjw.Model):
            raise WarpcamError(f"m must be a mujoco_warp.Model, got {type(m).__name__}")
        if not isinstance(d, mjw.Data):
            raise WarpcamError(f"d must be a mujoco_warp.Data, got {type(d).__name__}")
        for name in ("ngeom", "nbody"):
            if getattr(m, name) != getattr(mjm, name):
                raise WarpcamError(
                    f"m was made from another model than mjm: {name} is {getattr(m, name)} there, "
                    f"{getattr(mjm, name)} in mjm"
                )
        self.device: wp.Device = d.geom_xpos.device
        device_rule.require_same(self.device, "d is", m.geom_size.device, "m")
        self._m, self._d = m, d
        parts = model.read_description(mjm, d.nworld, groups, geoms)
        self.parts, extras = with_visual_geoms(parts, mjm, groups, check_kinds(draw))
        self.parts = with_layers(
            self.parts,
            mjm,
            extras=extras,
            reflections=reflections,
            transparency=transparency,
            colors=m.geom_rgba.numpy(),
            materials=m.geom_matid.numpy(),
            material_colors=m.mat_rgba.numpy(),
            planes_from_behind=planes_from_behind,
        )
        self._tables = (
            VisualGeomArrays(extras, d.nworld, len(parts.meshes), self.device) if extras is not None else None
        )
        names = names_of(extras)
        self._names = (*NAMES, *names)
        self._of_extras = attrgetter(*names.values(), "nworld", "nworld")  # never less than two: always a tuple
        self._headlight = wp.array(model.headlight(mjm), dtype=wp.vec3, device=self.device)
        self._ambient = model.global_ambient(mjm)

    def arrays(self) -> Mapping[str, wp.array]:
        if self._tables is None:
            return dict(zip(NAMES, (*of_data(self._d), *of_model(self._m), self._headlight), strict=True))
        return self._tables.arrays(self._live())

    def _live(self) -> Mapping[str, wp.array]:
        """The simulator's own arrays, with those of what is no geom."""
        extras = self._of_extras(self._d)[:-2]
        values = (*of_data(self._d), *of_model(self._m), self._headlight, *extras)
        return dict(zip(self._names, values, strict=True))

    def user_owned(self, field: str) -> bool:
        return field in model.MODEL_NAMES and not (self._tables is not None and field.startswith("shape_"))

    def user_name(self, field: str) -> str:
        return f"d.{model.DATA_NAMES[field]}" if field in model.DATA_NAMES else f"m.{model.MODEL_NAMES[field]}"

    def global_ambient(self) -> float:
        return self._ambient

    def clock(self) -> wp.array | None:
        return self._d.time

    def refresh(self) -> None:
        pass

    def forward(self) -> None:
        with wp.ScopedDevice(self.device):  # MuJoCo-Warp launches on Warp's current device
            mjw.kinematics(self._m, self._d)
            mjw.com_pos(self._m, self._d)
            mjw.camlight(self._m, self._d)
            if self._tables is not None:
                mjw.flex(self._m, self._d)
                mjw.tendon(self._m, self._d)


def load(
    mjm: Any,
    m: Any,
    d: Any,
    groups: model.Groups,
    draw: Collection[str] = model.DRAWN,
    reflections: bool | None = None,
    transparency: Transparency = None,
    geoms: Collection[int] | None = None,
    planes_from_behind: bool = False,
    splats: Sequence[Splats] = (),
) -> Scene:
    source = MujocoWarpSource(
        mjm,
        m,
        d,
        groups=groups,
        draw=draw,
        reflections=reflections,
        transparency=transparency,
        geoms=geoms,
        planes_from_behind=planes_from_behind,
    )
    return Scene(with_splats(source, splats))
