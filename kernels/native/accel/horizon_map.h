// Horizon maps: how far a mesh rises above the plane of each of its faces, by direction. Light from above the horizon
// reaches the whole face, as far as the mesh itself is concerned. Faces store their horizon (see Meshes.faces);
// build/horizon_builder.h computes it.
#pragma once
#include "camera/shape_record.h"
#include "core/vec3.h"

namespace warpcam {

// Sectors of 45 degrees about a face's normal. Each has four bits of clearance: 0 if no direction is known to be clear,
// else rays that rise by more than 16 - clearance sixteenths of their length are clear.
constexpr int SECTORS = 8;

// True if faces have horizons: two-sided faces and moving meshes use those words otherwise.
template <class Types> constexpr bool has_horizons() { return !Types::has(TWO_SIDED) && !Types::has(DEFORMING_MESHES); }

// A face's own axes: its first edge, what is across it, and its normal.
struct FaceAxes {
    Vec3 along, across, normal;
    bool reliable;  // not so for needles, whose axes rounding turns

    WARPCAM_DEVICE Vec3 of(Vec3 v) const { return { dot(along, v), dot(across, v), dot(normal, v) }; }
};

WARPCAM_DEVICE FaceAxes face_axes(Vec3 a, Vec3 b, Vec3 c)
{
    const Vec3 first = b - a, other = c - a, normal = cross(first, other);
    const float ff = dot(first, first), area = dot(normal, normal);
    FaceAxes axes;
    axes.along = rsqrt(max(ff, MIN_NORMAL)) * first;
    axes.normal = rsqrt(max(area, MIN_NORMAL)) * normal;
    axes.across = cross(axes.normal, axes.along);
    axes.reliable = area > 1.0e-6f * ff * dot(other, other) && area > 100.0f * MIN_NORMAL;
    return axes;
}

// Number of the sector that a direction points to: not in the order of their angles.
WARPCAM_DEVICE int sector_of(float along, float across)
{
    return (along < 0.0f ? 1 : 0) + (across < 0.0f ? 2 : 0) + (abs(along) < abs(across) ? 4 : 0);
}

// True if a ray of any length from any point of the face in this direction intersects no other face of the mesh.
WARPCAM_DEVICE bool is_clear(unsigned horizon, const FaceAxes& axes, Vec3 direction)
{
    const Vec3 d = axes.of(direction);
    const unsigned clearance = horizon >> 4 * sector_of(d.x, d.y) & 15u;
    const float height = 16.01f - float(clearance);
    return axes.reliable & (d.z > 0.0f) & (256.0f * d.z * d.z > height * height * dot(d, d));
}

}  // namespace warpcam
