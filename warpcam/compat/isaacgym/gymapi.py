"""Isaac Gym's ``gymapi``, for programs that read cameras: Newton simulates, warpcam draws.

    from warpcam.compat.isaacgym import gymapi, gymtorch

    gym = gymapi.acquire_gym()

Calls have that system's names, arguments and conventions. Whatever cannot be given raises ``warpcam.WarpcamError``
where it is asked for; nothing returns None for an image.
"""

from typing import NoReturn

from warpcam.compat.isaacgym.api.appearance import AppearanceCalls
from warpcam.compat.isaacgym.api.cameras import CameraCalls
from warpcam.compat.isaacgym.api.enums import (
    INVALID_HANDLE,
    STATE_ALL,
    STATE_NONE,
    STATE_POS,
    STATE_VEL,
    CameraFollowMode,
    ContactCollection,
    CoordinateSpace,
    DofDriveMode,
    DofProperties,
    DofState,
    DofType,
    ImageType,
    IndexDomain,
    JointType,
    MeshNormalMode,
    MeshType,
    RigidBodyState,
    RigidContact,
    SimType,
    TensorDataType,
    UpAxis,
)
from warpcam.compat.isaacgym.api.env_lists import EnvListCalls
from warpcam.compat.isaacgym.api.forces import ForceCalls
from warpcam.compat.isaacgym.api.math_types import DofFrame, Mat33, Mat44, Quat, Transform, Vec2, Vec3, Velocity
from warpcam.compat.isaacgym.api.params import (
    AssetOptions,
    CameraProperties,
    FlexParams,
    HeightFieldParams,
    PhysXParams,
    PlaneParams,
    SimParams,
    TriangleMeshParams,
    Version,
    VhacdParams,
)
from warpcam.compat.isaacgym.api.properties import PropertyCalls
from warpcam.compat.isaacgym.api.property_types import (
    RIGID_BODY_DISABLE_GRAVITY,
    RIGID_BODY_DISABLE_SIMULATION,
    RIGID_BODY_ENABLE_GYROSCOPIC_FORCES,
    RIGID_BODY_NONE,
    ActuatorProperties,
    ForceSensorProperties,
    IndexRange,
    RigidBodyProperties,
    RigidShapeProperties,
    TendonProperties,
)
from warpcam.compat.isaacgym.api.sim import SimCalls
from warpcam.compat.isaacgym.api.tensors import Tensor
from warpcam.compat.isaacgym.api.unsupported import UnsupportedCalls, why_missing
from warpcam.compat.isaacgym.assets.asset import Asset
from warpcam.compat.isaacgym.physics.environments import Env
from warpcam.compat.isaacgym.physics.simulation import Sim

IMAGE_COLOR, IMAGE_DEPTH, IMAGE_SEGMENTATION, IMAGE_OPTICAL_FLOW = ImageType
FOLLOW_POSITION, FOLLOW_TRANSFORM = CameraFollowMode
MESH_NONE, MESH_COLLISION, MESH_VISUAL, MESH_VISUAL_AND_COLLISION = MeshType
UP_AXIS_Y, UP_AXIS_Z = UpAxis
SIM_PHYSX, SIM_FLEX = SimType
DOMAIN_ACTOR, DOMAIN_ENV, DOMAIN_SIM = IndexDomain
DOF_MODE_NONE, DOF_MODE_POS, DOF_MODE_VEL, DOF_MODE_EFFORT = DofDriveMode
DOF_INVALID, DOF_ROTATION, DOF_TRANSLATION = DofType
JOINT_INVALID, JOINT_FIXED, JOINT_REVOLUTE, JOINT_PRISMATIC, JOINT_BALL, JOINT_PLANAR, JOINT_FLOATING = JointType
DTYPE_FLOAT32, DTYPE_UINT32, DTYPE_UINT64, DTYPE_UINT8, DTYPE_INT16, DTYPE_INT32 = TensorDataType
FROM_ASSET, COMPUTE_PER_VERTEX, COMPUTE_PER_FACE = MeshNormalMode
CC_NEVER, CC_LAST_SUBSTEP, CC_ALL_SUBSTEPS = ContactCollection
ENV_SPACE, LOCAL_SPACE, GLOBAL_SPACE = CoordinateSpace

__all__ = [
    "CC_ALL_SUBSTEPS",
    "CC_LAST_SUBSTEP",
    "CC_NEVER",
    "COMPUTE_PER_FACE",
    "COMPUTE_PER_VERTEX",
    "DOF_INVALID",
    "DOF_MODE_EFFORT",
    "DOF_MODE_NONE",
    "DOF_MODE_POS",
    "DOF_MODE_VEL",
    "DOF_ROTATION",
    "DOF_TRANSLATION",
    "DOMAIN_ACTOR",
    "DOMAIN_ENV",
    "DOMAIN_SIM",
    "DTYPE_FLOAT32",
    "DTYPE_INT16",
    "DTYPE_INT32",
    "DTYPE_UINT8",
    "DTYPE_UINT32",
    "DTYPE_UINT64",
    "ENV_SPACE",
    "FOLLOW_POSITION",
    "FOLLOW_TRANSFORM",
    "FROM_ASSET",
    "GLOBAL_SPACE",
    "IMAGE_COLOR",
    "IMAGE_DEPTH",
    "IMAGE_OPTICAL_FLOW",
    "IMAGE_SEGMENTATION",
    "INVALID_HANDLE",
    "JOINT_BALL",
    "JOINT_FIXED",
    "JOINT_FLOATING",
    "JOINT_INVALID",
    "JOINT_PLANAR",
    "JOINT_PRISMATIC",
    "JOINT_REVOLUTE",
    "LOCAL_SPACE",
    "MESH_COLLISION",
    "MESH_NONE",
    "MESH_VISUAL",
    "MESH_VISUAL_AND_COLLISION",
    "RIGID_BODY_DISABLE_GRAVITY",
    "RIGID_BODY_DISABLE_SIMULATION",
    "RIGID_BODY_ENABLE_GYROSCOPIC_FORCES",
    "RIGID_BODY_NONE",
    "SIM_FLEX",
    "SIM_PHYSX",
    "STATE_ALL",
    "STATE_NONE",
    "STATE_POS",
    "STATE_VEL",
    "UP_AXIS_Y",
    "UP_AXIS_Z",
    "ActuatorProperties",
    "Asset",
    "AssetOptions",
    "CameraFollowMode",
    "CameraProperties",
    "ContactCollection",
    "CoordinateSpace",
    "DofDriveMode",
    "DofFrame",
    "DofProperties",
    "DofState",
    "DofType",
    "Env",
    "FlexParams",
    "ForceSensorProperties",
    "Gym",
    "HeightFieldParams",
    "ImageType",
    "IndexDomain",
    "IndexRange",
    "JointType",
    "Mat33",
    "Mat44",
    "MeshNormalMode",
    "MeshType",
    "PhysXParams",
    "PlaneParams",
    "Quat",
    "RigidBodyProperties",
    "RigidBodyState",
    "RigidContact",
    "RigidShapeProperties",
    "Sim",
    "SimParams",
    "SimType",
    "TendonProperties",
    "Tensor",
    "TensorDataType",
    "Transform",
    "TriangleMeshParams",
    "UpAxis",
    "Vec2",
    "Vec3",
    "Velocity",
    "Version",
    "VhacdParams",
    "acquire_gym",
]  # fmt: skip


class Gym(SimCalls, EnvListCalls, PropertyCalls, ForceCalls, AppearanceCalls, CameraCalls, UnsupportedCalls):
    """All calls. Those of Isaac Gym that are not here say so when they are called."""


_GYM = Gym()


def acquire_gym() -> Gym:
    """The one that all calls go to."""
    return _GYM


def __getattr__(name: str) -> NoReturn:
    raise AttributeError(why_missing(name))
