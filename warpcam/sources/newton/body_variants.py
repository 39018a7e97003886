"""Shape types of a Newton model, with those that body variants may change a shape to.

Newton calls variants experimental and has no public list of what a shape may become; where it keeps that otherwise than
it does now, shapes are drawn as they are when the scene is made, and a warning says so.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import newton
import numpy as np


@dataclass(frozen=True, eq=False)
class VariantEntries:
    """Each shape, or one after another all that it may be.

    Attributes:
        shapes: (entry,) int32, ascending.
        types: (entry,) int32, Newton's.
        pointers: (entry,) uint64, as ``shape_source_ptr`` has them.
        sources: Of each entry, or None.
        chosen: (entry,) bool, whether the shape may be something else.
    """

    shapes: np.ndarray
    types: np.ndarray
    pointers: np.ndarray
    sources: Sequence[Any]
    chosen: np.ndarray


def read_entries(model: newton.Model) -> VariantEntries:
    count = model.shape_count
    shapes = np.arange(count, dtype=np.int32)
    kinds = model.shape_type.numpy() if count else np.zeros(0, np.int32)
    pointers = model.shape_source_ptr.numpy() if count else np.zeros(0, np.uint64)
    plain = VariantEntries(shapes, kinds, pointers, model.shape_source, np.zeros(count, bool))
    if getattr(model, "body_variant", None) is None or not (model.body_variant.numpy() >= 0).any():
        return plain
    try:
        rows, held = model._variant_row_options()
        own = model._variant_shape_geometry
        held_kinds, held_pointers = own["shape_type"].numpy()[held], own["shape_source_ptr"].numpy()[held]
        held_sources = model._variant_shape_source
    except (AttributeError, KeyError, IndexError, TypeError):
        logging.getLogger("warpcam").warning(
            "from_newton: body variants are drawn as they are now; others that are selected later are not seen"
        )
        return plain
    options = np.stack((rows.astype(np.uint64), held_kinds.astype(np.uint64), held_pointers), axis=1)
    _, first = np.unique(options, axis=0, return_index=True)
    others = np.setdiff1d(shapes, rows)
    all_shapes = np.concatenate((others, rows[first])).astype(np.int32)
    order = np.argsort(all_shapes, kind="stable")
    sources = [*(model.shape_source[shape] for shape in others), *(held_sources[held[place]] for place in first)]
    return VariantEntries(
        shapes=all_shapes[order],
        types=np.concatenate((kinds[others], held_kinds[first]))[order].astype(np.int32),
        pointers=np.concatenate((pointers[others], held_pointers[first]))[order],
        sources=[sources[place] for place in order],
        chosen=np.concatenate((np.zeros(len(others), bool), np.ones(len(first), bool)))[order],
    )
