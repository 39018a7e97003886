// How high what a mesh has around one of its faces rises over the face's plane, all around: light from higher up
// reaches all of the face, as far as the mesh itself is concerned. Kept with faces (see Meshes.faces), found by
// build/horizon_builder.h.
#pragma once
#include "camera/shape_record.h"
#include "core/vec3.h"

namespace warpcam {

// Of 45 degrees each, about the face's normal. Each has four bits, its clearance: 0 where nothing is known to be clear,
// else rays are that rise more than 16 - clearance sixteenths of their length.
constexpr int SECTORS = 8;

// Whether faces have horizons: the words that these stand in are used otherwise where faces have backs.
constexpr bool has_horizons(int types) { return !(types >> TWO_SIDED & 1) && !(types >> DEFORMING_MESHES & 1); }

// A face's own axes: its first edge, what is across it, and its normal.
struct FaceAxes {
    Vec3 along, across, normal;
    bool known;  // not so for needles, whose axes rounding turns

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
    axes.known = area > 1.0e-6f * ff * dot(other, other) && area > 100.0f * MIN_NORMAL;
    return axes;
}

// Number of the sector that a direction points to: not in the order of their angles.
WARPCAM_DEVICE int sector_of(float along, float across)
{
    return (along < 0.0f ? 1 : 0) + (across < 0.0f ? 2 : 0) + (abs(along) < abs(across) ? 4 : 0);
}

// Does a ray from anywhere on the face in this direction, of any length, meet no other face of its mesh?
WARPCAM_DEVICE bool is_clear(unsigned horizon, const FaceAxes& axes, Vec3 direction)
{
    const Vec3 d = axes.of(direction);
    const unsigned clearance = horizon >> 4 * sector_of(d.x, d.y) & 15u;
    const float height = 16.01f - float(clearance);
    return axes.known & (d.z > 0.0f) & (256.0f * d.z * d.z > height * height * dot(d, d));
}

}  // namespace warpcam
