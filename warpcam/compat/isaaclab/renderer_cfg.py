"""Configuration of the renderer in Isaac Lab."""

from typing import Any, Literal

import warp as wp
from isaaclab.renderers import RenderBufferKind, RenderBufferSpec
from isaaclab.renderers.renderer_cfg import RendererCfg
from isaaclab.utils import configclass

NAME = "warpcam"


@configclass
class WarpcamRendererCfg(RendererCfg):
    """Configuration of warpcam as a renderer of Isaac Lab."""

    class_type: type | str = "warpcam.compat.isaaclab.renderer:WarpcamRenderer"
    """What draws."""

    renderer_type: str = NAME
    """By this name it is known."""

    cloning_contexts: tuple[type | str, ...] = ("isaaclab_newton.cloner:NewtonReplicateContext",)
    """Environments are cloned as Newton's: the scene is its model."""

    enable_textures: bool = True
    """Whether meshes show their textures."""

    enable_shadows: bool = False
    """Whether the light casts shadows, in simple shading, too."""

    enable_ambient_lighting: bool = True
    """Whether there is light from everywhere."""

    create_default_light: bool = True
    """Whether there is a light from above."""

    antialiasing: int = 1
    """Samples of a pixel that an edge runs through: 1 or 4."""

    max_distance: float = 1000.0
    """Planar depth beyond which nothing is seen [m], for cameras without a clipping range."""

    depth_clipping_behavior: Literal["max", "zero", "none"] = "none"
    """What depth shows where nothing is hit: the far plane, 0, or inf, as with Isaac Lab's RTX renderer."""

    semantic_filter: str | list[str] = "*:*"
    """Which labels of the stage count: see ``isaaclab_newton.renderers.NewtonWarpRendererCfg``."""

    colorize_semantic_segmentation: bool = True
    """Colours, uint8 RGBA, or int32 ids."""

    colorize_instance_segmentation: bool = True
    """Colours, uint8 RGBA, or int32 ids."""

    colorize_instance_id_segmentation: bool = True
    """Colours, uint8 RGBA, or int32 ids."""

    semantic_segmentation_mapping: dict[str, Any] = {}  # noqa: RUF012, configclass copies it
    """Colour of each "type:label" in ``semantic_segmentation``."""

    def supported_output_types(self) -> dict[RenderBufferKind, RenderBufferSpec]:
        """Channels and Warp's scalar of each data type."""

        def labels(colorize: bool) -> RenderBufferSpec:
            return RenderBufferSpec(4, wp.uint8) if colorize else RenderBufferSpec(1, wp.int32)

        return {
            RenderBufferKind.RGBA: RenderBufferSpec(4, wp.uint8),
            RenderBufferKind.RGB: RenderBufferSpec(3, wp.uint8),
            RenderBufferKind.RGB_HDR: RenderBufferSpec(3, wp.float32),
            RenderBufferKind.ALBEDO: RenderBufferSpec(4, wp.uint8),
            RenderBufferKind.DEPTH: RenderBufferSpec(1, wp.float32),
            RenderBufferKind.DISTANCE_TO_CAMERA: RenderBufferSpec(1, wp.float32),
            RenderBufferKind.DISTANCE_TO_IMAGE_PLANE: RenderBufferSpec(1, wp.float32),
            RenderBufferKind.NORMALS: RenderBufferSpec(3, wp.float32),
            RenderBufferKind.SEMANTIC_SEGMENTATION: labels(self.colorize_semantic_segmentation),
            RenderBufferKind.INSTANCE_SEGMENTATION: labels(self.colorize_instance_segmentation),
            RenderBufferKind.INSTANCE_ID_SEGMENTATION_FAST: labels(self.colorize_instance_id_segmentation),
            RenderBufferKind.MOTION_VECTORS: RenderBufferSpec(2, wp.float32),
            RenderBufferKind.SIMPLE_SHADING_CONSTANT_DIFFUSE: RenderBufferSpec(3, wp.uint8),
            RenderBufferKind.SIMPLE_SHADING_DIFFUSE_MDL: RenderBufferSpec(3, wp.uint8),
            RenderBufferKind.SIMPLE_SHADING_FULL_MDL: RenderBufferSpec(3, wp.uint8),
        }
