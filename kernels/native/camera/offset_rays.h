// Rays of a table that each begin at a place of its own: two rows of it for each pixel, see camera/ray_table.h.
//
// A ray of another lens is two numbers, x and y, and they are all that is passed on of it. Those of an offset ray are
// the bits of its rows' address, whose lowest ones say which of the pixel's samples it is: wherever rays are met, what
// they are is read.
#pragma once
#include "camera/shape_record.h"
#include "camera/sample_offsets.h"
#include "core/vec3.h"

namespace warpcam {

// Bits of a pixel: which of those beside it its view goes on into, or that it sees nothing.
enum OffsetRayBit { LINKED_LEFT = 1, LINKED_RIGHT = 2, LINKED_UP = 4, LINKED_DOWN = 8, PIXEL_WITHOUT_RAY = 16 };
constexpr int OFFSET_RAY_ROWS = 2;  // start, with the bits; unit direction, with how many pixels a row of the image has

// A ray in the camera's frame, or how that changes from pixel to pixel.
struct OffsetRay {
    Vec3 start, direction;
};

WARPCAM_DEVICE Ray local_of(const OffsetRay& offset_ray, const ShapeRecord& record)
{
    return { as_vec3(record.origin) + transform_rows(record, offset_ray.start),
             transform_rows(record, offset_ray.direction) };
}

template <> struct CameraRay<RAY_TABLE_WITH_ORIGINS> {
    float x, y;

    // `sample` is -1 for the pixel's centre.
    WARPCAM_DEVICE static CameraRay of(const Float3Int* rows, int sample = -1)
    {
        const unsigned long long bits = reinterpret_cast<unsigned long long>(rows) + unsigned(sample + 1);
        return { as_float(int(unsigned(bits))), as_float(int(unsigned(bits >> 32))) };
    }

    WARPCAM_DEVICE OffsetRay offset_ray() const
    {
        const Float3Int *const rows = own_rows(), start = load(rows, 0), along = load(rows, 1);
        const int sample = (as_int(x) & LOWEST) - 1;
        if (sample < 0)
            return { as_vec3(start), as_vec3(along) };
        const Offset offset = sample_offset(sample);
        const OffsetRay right = across(), under = down();
        return { as_vec3(start) + offset.right * right.start + offset.down * under.start,
                 normalized(as_vec3(along) + offset.right * right.direction + offset.down * under.direction) };
    }
    WARPCAM_DEVICE Vec3 direction() const { return offset_ray().direction; }
    WARPCAM_DEVICE bool sees_nothing() const { return load(own_rows(), 0).w & PIXEL_WITHOUT_RAY; }

    // To the next pixel across, and down: over both sides that are linked.
    WARPCAM_DEVICE OffsetRay across() const { return step(1, LINKED_LEFT, LINKED_RIGHT); }
    WARPCAM_DEVICE OffsetRay down() const { return step(load(own_rows(), 1).w, LINKED_UP, LINKED_DOWN); }

    WARPCAM_DEVICE Ray local(const ShapeRecord& record) const { return local_of(offset_ray(), record); }

    template <class Types> WARPCAM_DEVICE RayFrame frame(const ShapeRecord& record) const
    {
        return frame_along(local(record));
    }

    WARPCAM_DEVICE const Float3Int* own_rows() const
    {
        const unsigned long long low = unsigned(as_int(x) & ~LOWEST), high = unsigned(as_int(y));
        return reinterpret_cast<const Float3Int*>(high << 32 | low);
    }

private:
    enum { LOWEST = 15 };  // bits of an address that are 0

    WARPCAM_DEVICE OffsetRay step(int pixels, int before, int after) const
    {
        const Float3Int* const rows = own_rows();
        const int links = load(rows, 0).w & (before | after), length = OFFSET_RAY_ROWS * pixels;
        const Float3Int *const from = links & before ? rows - length : rows, *const to =
                                                                                 links & after ? rows + length : rows;
        const float rate = links == (before | after) ? 0.5f : 1.0f;
        return { rate * (as_vec3(load(to, 0)) - as_vec3(load(from, 0))),
                 rate * (as_vec3(load(to, 1)) - as_vec3(load(from, 1))) };
    }
};

}  // namespace warpcam
