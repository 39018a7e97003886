"""Features of glTF files that are not drawn: trimesh, which reads the files, ignores them silently."""

from collections.abc import Iterator, Mapping
from typing import Any

from warpcam.core.errors import WarpcamError
from warpcam.sources.common.warnings import WarningCollector
from warpcam.sources.files.gltf_document import Document

# Extensions that are drawn, or told of by what they change.
READ = (
    "KHR_draco_mesh_compression",
    "KHR_mesh_quantization",
    "EXT_texture_webp",
    "EXT_texture_avif",
    "MSFT_texture_dds",
    "EXT_mesh_gpu_instancing",
    "KHR_texture_transform",
    "KHR_materials_unlit",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_transmission",  # a map of it is told of
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_node_visibility",
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
    used = dict.fromkeys([*map(str, _listed(tree, "extensionsUsed")), *needed, *_found(tree)])
    unused = [name for name in used if name not in READ]
    if unused:
        collector.warn("uses extensions of glTF that are not drawn", ", ".join(unused))
    extensions = tree.get("extensions")
    lit = extensions.get("KHR_lights_punctual") if isinstance(extensions, Mapping) else None
    for kind in UNREAD:
        if _listed(lit if kind == "lights" else tree, kind):
            collector.warn("has things of glTF that are not read", kind)


def _found(entry: Any) -> Iterator[str]:
    """Names of the extensions that things of a description have, whether it lists them or not."""
    is_tree = isinstance(entry, Mapping)
    below = [part for key, part in entry.items() if key != "extras"] if is_tree else entry
    extensions = entry.get("extensions") if is_tree else None
    if isinstance(extensions, Mapping):
        yield from map(str, extensions)
    for part in below:
        if isinstance(part, Mapping | list):
            yield from _found(part)


def _listed(tree: Any, name: str) -> list[Any]:
    found = tree.get(name) if isinstance(tree, Mapping) else None
    return found if isinstance(found, list) else []
