"""Vectors, quaternions and transforms as Isaac Gym has them: quaternions are x y z w."""

import math
from collections.abc import Iterator
from typing import Any, Self

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.core.rotations import rotation_matrices, rotation_quaternions

VEC2 = np.dtype([("x", "f4"), ("y", "f4")])
VEC3 = np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4")])
QUAT = np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4"), ("w", "f4")])
TRANSFORM = np.dtype([("p", VEC3), ("r", QUAT)])
VELOCITY = np.dtype([("linear", VEC3), ("angular", VEC3)])
DOF_FRAME = np.dtype([("origin", VEC3), ("axis", VEC3)])


def numbers_in(buffer: Any, kind: type) -> list[float]:
    """Read numbers from a row of an array of the type's ``dtype``, from bytes, or from as many numbers."""
    row = np.frombuffer(buffer, np.uint8) if isinstance(buffer, bytes | bytearray | memoryview) else np.asarray(buffer)
    packed = row.dtype.names is not None or row.dtype == np.uint8
    count = kind.dtype.itemsize // 4  # type: ignore[attr-defined]
    try:
        found = np.frombuffer(row.tobytes(), np.float32) if packed else row.astype(np.float32).ravel()
    except (TypeError, ValueError):
        found = np.zeros(0, np.float32)
    if len(found) != count:
        raise WarpcamError(f"{kind.__name__}.from_buffer: {count} numbers of float32 are needed, got {buffer!r}")
    return [float(value) for value in found]


class Numbered:
    """Type made of numbers alone: Python's, or single ones of numpy and torch."""

    dtype: np.dtype

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in (self.dtype.names or ()):
            raise WarpcamError(f"{type(self).__name__} has no {name!r}; it has {', '.join(self.dtype.names or ())}")
        super().__setattr__(name, float(value.item() if hasattr(value, "item") else value))

    @classmethod
    def from_buffer(cls, buffer: Any) -> Self:
        """Read from a row of an array of its ``dtype``, or from its bytes."""
        return cls(*numbers_in(buffer, cls))


class Vec3(Numbered):
    """A vector, or red, green and blue."""

    dtype = VEC3
    x: float
    y: float
    z: float

    def __init__(self, x: float = 0.0, y: float = 0.0, z: float = 0.0):
        self.x, self.y, self.z = x, y, z

    def __iter__(self) -> Iterator[float]:
        yield from (self.x, self.y, self.z)

    def __repr__(self) -> str:
        return f"Vec3({self.x}, {self.y}, {self.z})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Vec3) and tuple(self) == tuple(other)

    __hash__ = None  # type: ignore[assignment] # it may be written

    def __add__(self, other: "Vec3") -> "Vec3":
        return Vec3(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: "Vec3") -> "Vec3":
        return Vec3(self.x - other.x, self.y - other.y, self.z - other.z)

    def __neg__(self) -> "Vec3":
        return Vec3(-self.x, -self.y, -self.z)

    def __mul__(self, factor: float) -> "Vec3":
        return Vec3(self.x * factor, self.y * factor, self.z * factor)

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> "Vec3":
        return self * (1.0 / divisor)

    def dot(self, other: "Vec3") -> float:
        return self.x * other.x + self.y * other.y + self.z * other.z

    def cross(self, other: "Vec3") -> "Vec3":
        return Vec3(
            self.y * other.z - self.z * other.y,
            self.z * other.x - self.x * other.z,
            self.x * other.y - self.y * other.x,
        )

    def length(self) -> float:
        return math.sqrt(self.dot(self))

    def length_sq(self) -> float:
        return self.dot(self)

    def normalize(self) -> "Vec3":
        length = self.length()
        return self / length if length > 0.0 else Vec3()


class Vec2(Numbered):
    """A vector of two numbers."""

    dtype = VEC2
    x: float
    y: float

    def __init__(self, x: float = 0.0, y: float = 0.0):
        self.x, self.y = x, y

    def __iter__(self) -> Iterator[float]:
        yield from (self.x, self.y)

    def __repr__(self) -> str:
        return f"Vec2({self.x}, {self.y})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Vec2) and tuple(self) == tuple(other)

    __hash__ = None  # type: ignore[assignment] # it may be written

    def __add__(self, other: "Vec2") -> "Vec2":
        return Vec2(self.x + other.x, self.y + other.y)

    def __sub__(self, other: "Vec2") -> "Vec2":
        return Vec2(self.x - other.x, self.y - other.y)

    def __neg__(self) -> "Vec2":
        return Vec2(-self.x, -self.y)

    def __mul__(self, factor: float) -> "Vec2":
        return Vec2(self.x * factor, self.y * factor)

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> "Vec2":
        return self * (1.0 / divisor)


class Quat(Numbered):
    """A rotation."""

    dtype = QUAT
    x: float
    y: float
    z: float
    w: float

    def __init__(self, x: float = 0.0, y: float = 0.0, z: float = 0.0, w: float = 1.0):
        self.x, self.y, self.z, self.w = x, y, z, w

    @staticmethod
    def from_axis_angle(axis: Vec3, angle: float) -> "Quat":
        """About an axis of any length but 0 [rad]."""
        along = axis.normalize() * math.sin(0.5 * angle)
        return Quat(along.x, along.y, along.z, math.cos(0.5 * angle))

    @staticmethod
    def from_euler_zyx(x: float, y: float, z: float) -> "Quat":
        """About x first, then y, then z, all axes fixed [rad]."""
        axes = Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1)
        about = [Quat.from_axis_angle(axis, angle) for axis, angle in zip(axes, (x, y, z), strict=True)]
        return about[2] * about[1] * about[0]

    def to_euler_zyx(self) -> tuple[float, float, float]:
        """The angles that ``from_euler_zyx`` takes [rad]."""
        x, y, z, w = self.normalize()
        return (
            math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x)))),
            math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        )

    def __iter__(self) -> Iterator[float]:
        yield from (self.x, self.y, self.z, self.w)

    def __repr__(self) -> str:
        return f"Quat({self.x}, {self.y}, {self.z}, {self.w})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Quat) and tuple(self) == tuple(other)

    __hash__ = None  # type: ignore[assignment] # it may be written

    def __mul__(self, other: "Quat") -> "Quat":
        ax, ay, az, aw = self
        bx, by, bz, bw = other
        return Quat(
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        )

    def normalize(self) -> "Quat":
        length = math.sqrt(sum(value * value for value in self))
        return Quat(*(value / length for value in self)) if length > 0.0 else Quat()

    def inverse(self) -> "Quat":
        return Quat(-self.x, -self.y, -self.z, self.w)

    def rotate(self, vector: Vec3) -> Vec3:
        """The vector, turned; the quaternion is of length 1."""
        axis = Vec3(self.x, self.y, self.z)
        turn = axis.cross(vector) * 2.0
        return vector + turn * self.w + axis.cross(turn)


class Transform:
    """A pose: position ``p`` and rotation ``r``."""

    dtype = TRANSFORM

    def __init__(self, p: Any = None, r: Any = None):
        self.p = Vec3() if p is None else Vec3(*p)
        self.r = Quat() if r is None else Quat(*r)

    @classmethod
    def from_buffer(cls, buffer: Any) -> "Transform":
        """Read from a row of an array of its ``dtype``, as states have poses, or from its bytes."""
        numbers = numbers_in(buffer, cls)
        return cls(numbers[:3], numbers[3:])

    def __repr__(self) -> str:
        return f"Transform(p={self.p}, r={self.r})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Transform) and self.p == other.p and self.r == other.r

    __hash__ = None  # type: ignore[assignment] # it may be written

    def __mul__(self, other: "Transform") -> "Transform":
        return Transform(self.transform_point(other.p), self.r * other.r)

    def inverse(self) -> "Transform":
        back = self.r.inverse()
        return Transform(back.rotate(-self.p), back)

    def transform_point(self, point: Vec3) -> Vec3:
        return self.r.rotate(point) + self.p

    def transform_vector(self, vector: Vec3) -> Vec3:
        return self.r.rotate(vector)

    def transform_points(self, points: np.ndarray) -> np.ndarray:
        """Points, an array of ``Vec3.dtype`` of any shape."""
        return _moved(points, self.r, self.p)

    def transform_vectors(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors, likewise."""
        return _moved(vectors, self.r, Vec3())

    def numbers(self) -> tuple[float, ...]:
        """Position [m] and unit quaternion x y z w, 7 numbers."""
        return (*self.p, *self.r.normalize())


class Velocity:
    """Velocity of a body: ``linear`` [m/s] and ``angular`` [rad/s]."""

    dtype = VELOCITY

    def __init__(self, p: Any = None, q: Any = None):
        self.linear, self.angular = (Vec3() if part is None else Vec3(*part) for part in (p, q))

    @classmethod
    def from_buffer(cls, buffer: Any) -> "Velocity":
        """Read from a row of an array of its ``dtype``, as states have velocities, or from its bytes."""
        numbers = numbers_in(buffer, cls)
        return cls(numbers[:3], numbers[3:])

    def __repr__(self) -> str:
        return f"Velocity({self.linear}, {self.angular})"


class DofFrame:
    """Frame of a degree of freedom: its ``origin`` [m], and the ``axis`` along or about which it moves."""

    dtype = DOF_FRAME

    def __init__(self, origin: Any = None, axis: Any = None):
        self.origin, self.axis = (Vec3() if part is None else Vec3(*part) for part in (origin, axis))

    @classmethod
    def from_buffer(cls, buffer: Any) -> "DofFrame":
        """Read from a row of an array of its ``dtype``, or from its bytes."""
        numbers = numbers_in(buffer, cls)
        return cls(numbers[:3], numbers[3:])

    def __repr__(self) -> str:
        return f"DofFrame({self.origin}, {self.axis})"


class Mat33:
    """A matrix by its rows."""

    def __init__(self, x: Any = None, y: Any = None, z: Any = None):
        self.x, self.y, self.z = (Vec3() if row is None else Vec3(*row) for row in (x, y, z))

    @staticmethod
    def of(matrix: np.ndarray) -> "Mat33":
        return Mat33(*matrix.tolist())

    def numbers(self) -> np.ndarray:
        """(3, 3) float64."""
        return np.array([tuple(self.x), tuple(self.y), tuple(self.z)])

    def __repr__(self) -> str:
        return f"Mat33({self.x}, {self.y}, {self.z})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Mat33) and self.x == other.x and self.y == other.y and self.z == other.z

    __hash__ = None  # type: ignore[assignment] # it may be written


class Mat44:
    """A matrix by its rows, each of four numbers."""

    def __init__(self, x: Any = None, y: Any = None, z: Any = None, w: Any = None):
        rows = (x, y, z, w)
        self.x, self.y, self.z, self.w = (Quat(0, 0, 0, 0) if row is None else Quat(*row) for row in rows)

    def __repr__(self) -> str:
        return f"Mat44({self.x}, {self.y}, {self.z}, {self.w})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Mat44) and all(getattr(self, row) == getattr(other, row) for row in "xyzw")

    __hash__ = None  # type: ignore[assignment] # it may be written


def _moved(vectors: np.ndarray, turn: Quat, shift: Vec3) -> np.ndarray:
    numbers = np.stack([vectors[name] for name in "xyz"], axis=-1) @ matrix_of(turn).T + tuple(shift)
    return np.ascontiguousarray(numbers, np.float32).view(VEC3)[..., 0]


def matrix_of(rotation: Quat) -> np.ndarray:
    """(3, 3) float64, from the turned frame to the other."""
    x, y, z, w = rotation
    return rotation_matrices(np.array([(w, x, y, z)], np.float64))[0]


def quat_of(matrix: np.ndarray) -> Quat:
    """Convert a (3, 3) rotation matrix to a quaternion."""
    w, x, y, z = rotation_quaternions(np.asarray(matrix, np.float64)[None])[0].tolist()
    return Quat(x, y, z, w).normalize()


def looking(position: Vec3, target: Vec3, up: Vec3, along_x: bool) -> Quat:
    """Rotation of a camera that looks at a target.

    Args:
        position: Where it is.
        target: Elsewhere.
        up: Of the world.
        along_x: Whether a camera looks along its x with z up, as where z is up; else along -z with y up.
    """
    forward = np.array(tuple(target - position))
    length = np.linalg.norm(forward)
    forward = forward / length if length > 0.0 else np.array((1.0, 0.0, 0.0))
    upward = np.array(tuple(up))
    side = np.cross(forward, upward)
    if np.linalg.norm(side) < 1e-6:  # straight up or down: whichever way
        side = np.cross(forward, np.array((1.0, 0.0, 0.0)) if abs(forward[0]) < 0.9 else np.array((0.0, 1.0, 0.0)))
    right = side / np.linalg.norm(side)
    above = np.cross(right, forward)
    columns = (forward, -right, above) if along_x else (right, above, -forward)
    return quat_of(np.stack(columns, axis=1))
