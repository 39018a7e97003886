"""What of a model Newton's settings have drawn, as far as it is there."""

from dataclasses import replace
from typing import Any

import newton

from warpcam.sources.newton.options import NewtonOptions

MESHES = (newton.GeoType.MESH, newton.GeoType.CONVEX_MESH)


class VisibilityState:
    """What of a model can be chosen.

    Args:
        model: The model.
        simulated: Whether triangles of cloth and soft bodies are drawn.
        visual: Whether deformable visual meshes are.
        textures: Whether the model's own textures are there.

    Attributes:
        splats: Whether some of its shapes are Gaussian splats.
        usual: What is drawn unless settings say otherwise.
    """

    def __init__(self, model: newton.Model, simulated: bool, visual: bool, textures: bool):
        types = set(model.shape_type.numpy().tolist()) if model.shape_count else set()
        visuals = getattr(model, "deformable_visual_meshes", ()) if visual else ()
        self.splats = int(newton.GeoType.GAUSSIAN) in types
        variants = getattr(model, "body_variant", None) is not None
        self._sides = bool(
            types.intersection(map(int, MESHES)) or (simulated and model.tri_count) or visuals or variants
        )
        self._particles = bool(model.particle_count)
        worlds = [model.shape_world] * bool(model.shape_count) + [model.particle_world] * bool(model.particle_count)
        self._shared = any((rows.numpy() < 0).any() for rows in worlds) or any(mesh.world < 0 for mesh in visuals)
        self.usual = NewtonOptions(
            simulated=simulated,
            visual=visual,
            smooth=False,
            backs=False,
            solid=True,
            lit_normals=True,
            textures=textures,
        )

    def choice(self, config: Any, triplanar: bool) -> NewtonOptions:
        """What a RenderConfig of Newton's says.

        Args:
            config: It.
            triplanar: How textures lie, if none are shown.
        """
        return replace(
            self.usual,
            backs=self._sides and not config.enable_backface_culling,
            particles=bool(config.enable_particles) or not self._particles,
            shared=bool(config.enable_global_world) or not self._shared,
            triplanar=bool(config.texture_projection_mode) if config.enable_textures else triplanar,
        )
