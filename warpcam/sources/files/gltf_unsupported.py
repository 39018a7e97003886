"""Features of glTF files that are not drawn: trimesh, which reads the files, ignores them silently."""

from collections.abc import Mapping
from typing import Any

from warpcam.core.errors import WarpcamError
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.files.gltf_document import Document

# Extensions that are drawn, or told of by what they change.
READ = (
    "KHR_draco_mesh_compression",
    "KHR_mesh_quantization",
    "EXT_texture_webp",
    "EXT_mesh_gpu_instancing",
    "KHR_texture_transform",
    "KHR_lights_punctual",  # told of if there are any
)
MATERIALS = "KHR_materials_"  # extensions without which shapes and base colours are the same
UNREAD = ("cameras", "lights", "animations")


def tell(document: Document, collector: WarningCollector) -> None:
    """Warn of it.

    Raises:
        WarpcamError: The file needs an extension that is not known.
    """
    tree = document.tree
    needed = [str(name) for name in _listed(tree, "extensionsRequired")]
    unknown = [name for name in needed if name not in READ and not name.startswith(MATERIALS)]
    if unknown:
        raise WarpcamError(
            f"{document.path}: needs extensions of glTF that are not read here: {', '.join(unknown)}; read are "
            f"{', '.join(READ)}"
        )
    used = dict.fromkeys([*map(str, _listed(tree, "extensionsUsed")), *needed])
    unused = [name for name in used if name not in READ]
    if unused:
        collector.warn("uses extensions of glTF that are not drawn", ", ".join(unused))
    extensions = tree.get("extensions")
    lit = extensions.get("KHR_lights_punctual") if isinstance(extensions, Mapping) else None
    for kind in UNREAD:
        if _listed(lit if kind == "lights" else tree, kind):
            collector.warn("has things of glTF that are not read", kind)
    for place, texture in enumerate(_listed(tree, "textures")):
        names = list(texture.get("extensions") or ()) if isinstance(texture, Mapping) else []
        if names and "source" not in texture and not set(names) & set(READ):
            collector.warn(
                "has an image in a format that is not read", f"texture {place}: {', '.join(texture['extensions'])}"
            )


def _listed(tree: Any, name: str) -> list[Any]:
    found = tree.get(name) if isinstance(tree, Mapping) else None
    return found if isinstance(found, list) else []
