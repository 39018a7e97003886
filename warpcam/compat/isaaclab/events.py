"""Events of Isaac Lab that ask for renderers by name."""

from functools import wraps
from types import SimpleNamespace
from typing import Any

from warpcam.compat.isaaclab.renderer_cfg import NAME

NEWTONS = "newton_warp"  # Isaac Lab's own, which draws the same model


def offer_shape_colors() -> None:
    """Have ``randomize_visual_shape`` write colours of shapes beside our renderer, which reads them in each frame."""
    try:
        from isaaclab.envs.mdp.visual_events import randomize_visual_shape
    except ImportError:  # of what environments need and renderers do not
        return
    chosen = getattr(getattr(randomize_visual_shape, "_get_backend", None), "__func__", None)
    if chosen is None or hasattr(chosen, "_of_warpcam"):
        return

    @wraps(chosen)
    def get_backend(cls: Any, cfg: Any, env: Any) -> str:
        names = tuple(NEWTONS if name == NAME else name for name in env.sim.render_context.renderer_types)
        context = SimpleNamespace(renderer_types=names)
        sim = SimpleNamespace(render_context=context, resolve_visualizer_types=env.sim.resolve_visualizer_types)
        backend: str = chosen(cls, cfg, SimpleNamespace(sim=sim))
        return backend

    get_backend._of_warpcam = True  # type: ignore[attr-defined]
    randomize_visual_shape._get_backend = classmethod(get_backend)
