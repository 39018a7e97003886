"""Meshes of which Newton's importers have left out the unit of a COLLADA file."""

import logging
import sys

import newton
import numpy as np

HUGE = 20.0  # [m], longer than the parts of robots


def tell_huge_meshes(model: newton.Model) -> None:
    """Warn of parts of bodies that are as large as houses, if a COLLADA file was read in this process.

    A mesh does not know its file: its size is the only trace. Newton 1.8 takes a file in centimetres to be in metres.
    """
    if "collada" not in sys.modules or not model.shape_count or not model.body_count:
        return
    scales, bodies = np.abs(model.shape_scale.numpy()), model.shape_body.numpy()
    sizes: dict[int, np.ndarray] = {}
    found = []
    for shape, source in enumerate(model.shape_source):
        if isinstance(source, newton.Mesh) and bodies[shape] >= 0 and len(source.vertices):
            if id(source) not in sizes:
                sizes[id(source)] = np.ptp(np.asarray(source.vertices, np.float64), axis=0)
            if (sizes[id(source)] * scales[shape]).max() > HUGE:
                found.append(model.shape_label[shape])
    if found:
        more = f" and {len(found) - 1} more" if len(found) > 1 else ""
        logging.getLogger("warpcam").warning(
            "from_newton: shape '%s'%s is more than %g m long. Newton's importers leave out the <unit> of COLLADA "
            "files; warpcam.add_urdf(builder, path) reads them in metres",
            found[0],
            more,
            HUGE,
        )
