"""Isaac Gym's closed sets, and the structured numbers of its states and properties."""

from enum import IntEnum
from typing import Any

import numpy as np

from warpcam.compat.common.scalars import whole
from warpcam.compat.isaacgym.api.math_types import TRANSFORM, VEC3
from warpcam.core.errors import WarpcamError


def one_of(kind: type[IntEnum], value: Any, where: str) -> Any:
    """The member of a closed set that was meant."""
    try:
        number = whole(value)
        return kind(value if number is None else number)
    except ValueError:
        allowed = ", ".join(each.name for each in kind)
        raise WarpcamError(f"{where} {value!r} came; allowed are {allowed}") from None


def check_segment(value: Any, where: str) -> None:
    """Raise unless it may be what ``IMAGE_SEGMENTATION`` shows."""
    number = whole(value)
    if number is None or not 0 <= number < 2**32:
        raise WarpcamError(f"{where}: a whole number from 0 to 2^32 - 1 is needed, got {value!r}")


class ImageType(IntEnum):
    """Kind of image that a camera makes."""

    IMAGE_COLOR = 0
    IMAGE_DEPTH = 1
    IMAGE_SEGMENTATION = 2
    IMAGE_OPTICAL_FLOW = 3


class CameraFollowMode(IntEnum):
    """Motion of a camera that is attached to a body."""

    FOLLOW_POSITION = 0
    FOLLOW_TRANSFORM = 1


class MeshType(IntEnum):
    """Shapes of a body, by their use."""

    MESH_NONE = 0
    MESH_COLLISION = 1
    MESH_VISUAL = 2
    MESH_VISUAL_AND_COLLISION = 3


class UpAxis(IntEnum):
    """Axis that points up."""

    UP_AXIS_Y = 0
    UP_AXIS_Z = 1


class SimType(IntEnum):
    """Asked for by programs; here both are simulated alike."""

    SIM_PHYSX = 0
    SIM_FLEX = 1


class IndexDomain(IntEnum):
    """Range that an index counts in."""

    DOMAIN_ACTOR = 0
    DOMAIN_ENV = 1
    DOMAIN_SIM = 2


class DofDriveMode(IntEnum):
    """Drive of a degree of freedom."""

    DOF_MODE_NONE = 0
    DOF_MODE_POS = 1
    DOF_MODE_VEL = 2
    DOF_MODE_EFFORT = 3


class DofType(IntEnum):
    """Kinds of degrees of freedom."""

    DOF_INVALID = -1
    DOF_ROTATION = 0
    DOF_TRANSLATION = 1


class JointType(IntEnum):
    """Kinds of joints; of several hinges or slides together it is none of these."""

    JOINT_INVALID = -1
    JOINT_FIXED = 0
    JOINT_REVOLUTE = 1
    JOINT_PRISMATIC = 2
    JOINT_BALL = 3
    JOINT_PLANAR = 4
    JOINT_FLOATING = 5


class TensorDataType(IntEnum):
    """Type of a tensor's numbers."""

    DTYPE_FLOAT32 = 0
    DTYPE_UINT32 = 1
    DTYPE_UINT64 = 2
    DTYPE_UINT8 = 3
    DTYPE_INT16 = 4
    DTYPE_INT32 = 5


class MeshNormalMode(IntEnum):
    """Source of an asset's mesh normals. Held: they are those of the file."""

    FROM_ASSET = 0
    COMPUTE_PER_VERTEX = 1
    COMPUTE_PER_FACE = 2


class ContactCollection(IntEnum):
    """Substeps in which contacts are collected. Held."""

    CC_NEVER = 0
    CC_LAST_SUBSTEP = 1
    CC_ALL_SUBSTEPS = 2


class CoordinateSpace(IntEnum):
    """Frame in which a vector is given."""

    ENV_SPACE = 0
    LOCAL_SPACE = 1
    GLOBAL_SPACE = 2


INVALID_HANDLE = -1
STATE_NONE, STATE_POS, STATE_VEL, STATE_ALL = 0, 1, 2, 3

DOF_STATE = np.dtype([("pos", "f4"), ("vel", "f4")])
BODY_STATE = np.dtype([("pose", TRANSFORM), ("vel", [("linear", VEC3), ("angular", VEC3)])])
DOF_PROPERTIES = np.dtype(
    [
        ("hasLimits", "?"),
        ("lower", "f4"),
        ("upper", "f4"),
        ("driveMode", "i4"),
        ("velocity", "f4"),
        ("effort", "f4"),
        ("stiffness", "f4"),
        ("damping", "f4"),
        ("friction", "f4"),
        ("armature", "f4"),
    ]
)

RIGID_CONTACT = np.dtype(
    [
        ("env0", "i4"),
        ("env1", "i4"),
        ("body0", "i4"),
        ("body1", "i4"),
        ("localPos0", VEC3),
        ("localPos1", VEC3),
        ("minDist", "f4"),
        ("initialOverlap", "f4"),
        ("normal", VEC3),
        ("offset0", VEC3),
        ("offset1", VEC3),
        ("lambda", "f4"),
        ("lambdaFriction", [("x", "f4"), ("y", "f4")]),
        ("friction", "f4"),
        ("torsionFriction", "f4"),
        ("rollingFriction", "f4"),
    ]
)


class DofState:
    """Position [m or rad] and velocity of a degree of freedom."""

    dtype = DOF_STATE


class RigidBodyState:
    """Pose and velocity of a body."""

    dtype = BODY_STATE


class RigidContact:
    """Contact of two bodies, counted in their environments, -1 for the ground, and the forces on them [N].

    The normal points from the first to the second; a distance that is negative is an overlap.
    """

    dtype = RIGID_CONTACT


class DofProperties:
    """Drive and limits of a degree of freedom."""

    dtype = DOF_PROPERTIES
