"""Reflections of the real-time look: what smooth surfaces mirror, and what is seen through clear ones."""

from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.passes.lit_rays import bind_lit_rays
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.paths import ReflectionKey
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.runtime.launch import Stage


@register("reflections", needs=("shape",))
def bind(planned: PlannedPass[ReflectionKey], frame: CameraFrame) -> Stage:
    """Bind the rays that write light to be added to a pixel's, and in w what its own is multiplied by before."""
    return bind_lit_rays(planned, frame, "trace_reflections", "path/reflections.h", "reflections")
