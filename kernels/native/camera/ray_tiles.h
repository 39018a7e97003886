// The tiles of a region that may show a shape, for lenses that are tables of rays.
#pragma once
#include "camera/region.h"
#if !defined(__CUDA_ARCH__)
#include "core/simd8.h"
#endif

namespace warpcam {

// Tiles of a region, found one after another in its rows: what holds them all.
struct TileRange {
    int left, right, top, bottom;  // empty while left > right

    WARPCAM_DEVICE void add(int row, int column)
    {
        left = min(left, column);
        right = column > right ? column : right;
        top = min(top, row);
        bottom = row;
    }

    WARPCAM_DEVICE TileRect box() const
    {
        return { static_cast<signed char>(left), static_cast<signed char>(top), static_cast<signed char>(right),
                 static_cast<signed char>(bottom) };
    }
};

WARPCAM_DEVICE Vec3 axis_of(const Float3Int& cone) { return { cone.x, cone.y, cone.z }; }

// The cosine of the widest angle to a tile's cone under which what lies within another cone around a direction, whose
// half angle has this cosine and sine, may be seen.
WARPCAM_DEVICE float least_along(const Float3Int& cone, float cosine, float sine)
{
    const float wide = as_float(cone.w), narrow = sqrt(max(1.0f - wide * wide, 0.0f));
    return wide <= -cosine ? -2.0f : wide * cosine - narrow * sine - 5.0e-5f;
}

#if !defined(__CUDA_ARCH__)

// least_along() of eight cones.
inline Float8 least_along(Float8 wide, Float8 cosine, Float8 sine)
{
    const Float8 narrow = sqrt(max(1.0f - wide * wide, (Float8)0.0f));
    return wide <= -cosine ? (Float8)-2.0f : wide * cosine - narrow * sine - 5.0e-5f;
}

// Bit mask of the cones of a row of tiles, at most eight, that may meet another cone: its axis, and the cosine and sine
// of its half angle.
inline unsigned cones_that_meet(const Float3Int* cones, int count, Vec3 axis, float cosine, float sine)
{
    Vec3x8 axes;
    Float8 wide;
    for (int k = 0; k < SIMD_WIDTH; ++k) {
        const Float3Int& cone = cones[min(k, count - 1)];
        set_lane(axes, k, axis_of(cone));
        wide[k] = as_float(cone.w);
    }
    return movemask(dot(broadcast(axis), axes) >= least_along(wide, (Float8)cosine, (Float8)sine))
           & ((1u << count) - 1);
}

// A cone about all rays of a region, in the camera's frame; of lenses that are no tables it is not used.
struct RegionCone {
    Vec3 axis;
    float cosine;  // of its half angle; -1: it is open all around
};

template <int LENS> inline RegionCone region_cone(const Camera& camera, const Region& region)
{
    if constexpr (LENS != RAYS)
        return { { 0.0f, 0.0f, 0.0f }, -1.0f };
    const int across = region.width / TILE_WIDTH, down = region.height / TILE_HEIGHT;
    const Float3Int* const first = tile_cones(camera, region.left / TILE_WIDTH, region.top / TILE_HEIGHT);
    const auto for_each = [&](const auto& look) {
        for (int row = 0; row < down; ++row)
            for (int column = 0; column < across; ++column)
                look(first[row * tiles_across(camera) + column]);
    };
    Vec3 sum { 0.0f, 0.0f, 0.0f };
    for_each([&](const Float3Int& cone) { sum = sum + axis_of(cone); });
    const float length = sqrt(dot(sum, sum));
    RegionCone found { (1.0f / max(length, 1.0e-30f)) * sum, length > 1.0e-3f ? 1.0f : -1.0f };
    for_each([&](const Float3Int& cone) {
        const float wide = as_float(cone.w), along = dot(found.axis, axis_of(cone));
        const float aside = sqrt(max(1.0f - along * along, 0.0f)), narrow = sqrt(max(1.0f - wide * wide, 0.0f));
        found.cosine = along <= -wide ? -1.0f : min(found.cosine, along * wide - aside * narrow);
    });
    return found;
}

#endif

// The tiles of a region whose cones may meet a box: its middle in the camera's frame, the rotation from there to its
// own frame, its half widths. Empty (left > right) if there are none.
WARPCAM_DEVICE TileRect ray_tiles(const Camera& camera, const Region& region, Vec3 center, const Mat3& m, Vec3 half)
{
    const int across = region.width / TILE_WIDTH, down = region.height / TILE_HEIGHT;
    const TileRect all { 0, 0, static_cast<signed char>(across - 1), static_cast<signed char>(down - 1) };
    const float length = sqrt(dot(center, center)), rate = 1.0f / max(length, 1.0e-30f);
    const Vec3 axis { rate * center.x, rate * center.y, rate * center.z };
    float cosine = 1.0f;  // of the angle between the box's middle and its corners, as seen from the camera
#pragma unroll 1
    for (int k = 0; k < 8; ++k) {
        const Vec3 corner { k & 1 ? half.x : -half.x, k & 2 ? half.y : -half.y, k & 4 ? half.z : -half.z };
        const Vec3 turned = transform_transposed(m, corner);
        const Vec3 at { center.x + turned.x, center.y + turned.y, center.z + turned.z };
        const float far = sqrt(dot(at, at)), along = dot(axis, at);
        if (!(along > 1.0e-3f * far))  // the box is not on one side of the camera
            return all;
        cosine = min(cosine, along / far);
    }
    const float sine = sqrt(max(1.0f - cosine * cosine, 0.0f));
    TileRange tiles { across, -1, down, -1 };
    const Float3Int* cones = tile_cones(camera, region.left / TILE_WIDTH, region.top / TILE_HEIGHT);
#if defined(__CUDA_ARCH__)
#pragma unroll 1
    for (int row = 0; row < down; ++row, cones += tiles_across(camera))
#pragma unroll 1
        for (int column = 0; column < across; ++column) {
            if (dot(axis, axis_of(cones[column])) >= least_along(cones[column], cosine, sine))
                tiles.add(row, column);
        }
#else
    for (int row = 0; row < down; ++row, cones += tiles_across(camera))
        if (const unsigned met = cones_that_meet(cones, across, axis, cosine, sine); met != 0) {
            tiles.add(row, ctz(met));
            tiles.add(row, 31 - __builtin_clz(met));
        }
#endif
    return tiles.box();
}

// Tile rectangle of a ball for rays with own origins.
WARPCAM_DEVICE TileRect spread_tiles(const Camera& camera, const Region& region, Vec3 center, float radius)
{
    const int across = region.width / TILE_WIDTH, down = region.height / TILE_HEIGHT;
    TileRange tiles { across, -1, down, -1 };
#pragma unroll 1
    for (int row = 0; row < down; ++row)
#pragma unroll 1
        for (int column = 0; column < across; ++column) {
            const Float3Int* tile =
                tile_starts(camera, region.left / TILE_WIDTH + column, region.top / TILE_HEIGHT + row);
            const Float3Int cone = load(tile, 0), starts = load(tile, 1);
            const Vec3 offset { center.x - starts.x, center.y - starts.y, center.z - starts.z };
            const float length = sqrt(dot(offset, offset)),
                        reach = radius + as_float(starts.w) + 1.0e-5f * (length + radius);
            if (length > reach) {  // no ray begins within
                const float sine = reach / length, cosine = sqrt(1.0f - sine * sine);
                if (dot(offset, axis_of(cone)) < least_along(cone, cosine, sine) * length)
                    continue;
            }
            tiles.add(row, column);
        }
    return tiles.box();
}

}  // namespace warpcam
