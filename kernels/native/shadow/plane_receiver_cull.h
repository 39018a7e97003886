// Selects the parts of a plane that a light's casters may shade, from pixel coordinates alone.
#pragma once
#include "shadow/casters.h"

namespace warpcam {

// A plane by its unit normal, in the world's axes, and how far along that it is from the camera.
struct Floor {
    Vec3 normal;
    float away;
    int shape;  // id, or -1
};

#if defined(__CUDA_ARCH__)

template <class Shapes> WARPCAM_DEVICE Floor load_floor(const Shapes& shapes, const Camera& camera, int world, int id)
{
    if (id < 0)
        return { { 0.0f, 0.0f, 1.0f }, 0.0f, -1 };
    const Shape shape = load_shape(shapes, world, id);
    const Mat3& r = shape.rotation;
    const Vec3 normal { r.at[0][2], r.at[1][2], r.at[2][2] };
    return { normal,
             dot(normal, { shape.position.x - camera.origin.x, shape.position.y - camera.origin.y,
                           shape.position.z - camera.origin.z }),
             id };
}

// True if all four are the same number.
template <int BYTES> WARPCAM_DEVICE bool all_are(const AlignedArray<unsigned, BYTES>& words, int number)
{
    const unsigned wanted = BYTES == 1   ? (unsigned(number) & 0xffu) * 0x01010101u
                            : BYTES == 2 ? (unsigned(number) & 0xffffu) * 0x00010001u
                                         : unsigned(number);
    bool all = true;
#pragma unroll
    for (int k = 0; k < BYTES; ++k)
        all &= words.at[k] == wanted;
    return all;
}

// Strips of 32x4 pixels that a warp looks through, four bits each of which the lowest counts.
constexpr unsigned EACH_STRIP = 0x11111111u;

// The sides of bounds are straight lines in the image of a plane. A lane has one of the four: by how much the pixel
// of a strip that lies farthest inside of it does, times something positive; changes from column to column and from row
// to row, and of the strip at the image's first pixel.
struct PlaneReceiverCull {
    float across, down, start;
    bool valid;

    // Bit mask of the strips, of eight with four lanes each, in which no caster shades the plane. A lane's strip starts
    // at column i and row j.
    WARPCAM_DEVICE unsigned missed(float i, float j) const
    {
        unsigned outside = __ballot_sync(FULL_WARP, valid & (start + i * across + j * down < 0.0f));
        outside |= outside >> 1;
        return (outside | outside >> 2) & EACH_STRIP;
    }
};

// `bounds`: what all casters cover.
template <class View> WARPCAM_DEVICE PlaneReceiverCull plane_receiver_cull(const View& view, const Floor& floor,
                                                                           const LightSpaceBounds& bounds,
                                                                           const Region& region, int lane)
{
    const float side = floor.away < 0.0f ? -1.0f : 1.0f, away = side * floor.away;
    const auto& ray = view.reconstructor;
    const auto& lit = view.lit;
    // A ray's way to the plane is `away` over this; all is multiplied by it, as it is not negative where the plane is
    // seen.
    const Vec3 rate { side * dot(floor.normal, ray.across), side * dot(floor.normal, ray.down),
                      side * dot(floor.normal, ray.start) };
    const auto place = [&](float across, float down, float start, float along) {
        return Vec3 { away * across + along * rate.x, away * down + along * rate.y, away * start + along * rate.z };
    };
    const Vec3 u = place(lit.across.x, lit.down.x, lit.start.x, lit.along.x);
    const Vec3 v = place(lit.across.y, lit.down.y, lit.start.y, lit.along.y);
    const Vec3 w = place(lit.across.z, lit.down.z, lit.start.z, lit.along.z);
    const bool distant = view.light.distant;
    const Vec3 whole = distant ? rate : w;
    const Vec3 at = lane & 2 ? v : u;
    const float edge = lane & 2 ? (lane & 1 ? bounds.top : bounds.bottom) : lane & 1 ? bounds.right : bounds.left;
    // Nothing lies beyond an edge that is endless, or that has no place: shapes behind a light have such.
    const bool ends = abs(edge) < MAX_RAY_T;
    const Vec3 in = !ends ? Vec3 { 0.0f, 0.0f, 1.0f } : lane & 1 ? edge * whole - at : at - edge * whole;
    // Half a pixel more on each side than the strip has, which is more than all rounding.
    PlaneReceiverCull own { in.x, in.y, in.z + 15.5f * in.x + 16.0f * abs(in.x) + 1.5f * in.y + 2.0f * abs(in.y),
                            floor.shape >= 0 };
    // All of the region's plane must lie clearly before the light.
    const float i = float(lane & 1 ? region.left + region.width : region.left - 1);
    const float j = float(lane & 2 ? region.top + region.height : region.top - 1);
    const auto value = [&](const Vec3& of) { return of.z + i * of.x + j * of.y; };
    const bool before = distant || value(w) > 1.0e-3f * (abs(value(u)) + abs(value(v)));
    own.valid = __all_sync(FULL_WARP, own.valid & before);
    return own;
}

#endif

}  // namespace warpcam
