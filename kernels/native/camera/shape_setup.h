// From a shape's live pose to its record in one view, and the tiles of a region it may touch.
#pragma once
#include "camera/region.h"
#include "camera/projected_extent.h"
#include "camera/ray_tiles.h"

namespace warpcam {

template <class View> WARPCAM_DEVICE Camera load_camera(const View& view)
{
    Camera c;
    c.origin = { view.origin[0], view.origin[1], view.origin[2] };
    c.rotation = as_mat3(view.rotation);
    c.scale_x = view.scale[0];
    c.scale_y = view.scale[1];
    c.center_x = view.center[0];
    c.center_y = view.center[1];
    c.near = view.near;
    c.far = min(view.far, MAX_RAY_T);
    c.miss = view.miss;
    return c;
}

// The box of a shape in its own frame: center and half widths.
struct LocalBounds {
    Vec3 center, half;
};

// BROKEN: a pose or size is not finite. FORMLESS: its rotation is 0, or nothing of its size is above 0.
enum Visible { HIDDEN, SEEN, BROKEN, FORMLESS };

struct Shape {
    int type, id, asset;
    Vec3 position, size;
    Mat3 rotation;
};

WARPCAM_DEVICE LocalBounds stretched_by(const LocalBounds& e, Vec3 s)
{
    return { { e.center.x * s.x, e.center.y * s.y, e.center.z * s.z },
             { e.half.x * abs(s.x), e.half.y * abs(s.y), e.half.z * abs(s.z) } };
}

// Type-specific part: box, scale and size row. False if the shape draws nothing, as those with sizes that are not
// positive.
template <class Types, class Meshes, class HeightFields>
WARPCAM_DEVICE bool shape_bounds(const Shape& shape, const Meshes& meshes, const HeightFields& fields,
                                 LocalBounds& extent, Vec3& scale, ShapeRecord& record)
{
    scale = { 1.0f, 1.0f, 1.0f };
    const int asset = shape.asset;
    const bool stretched = Types::has(PER_SHAPE_SCALE) && (shape.type == MESH || shape.type == HEIGHT_FIELD);
    Vec3 stretch { 1.0f, 1.0f, 1.0f };
    if (stretched) {
        stretch = shape.size;
        if (stretch.x == 0.0f || stretch.y == 0.0f || stretch.z == 0.0f)
            return false;
        scale = { 1.0f / stretch.x, 1.0f / stretch.y, 1.0f / stretch.z };
    }
    if (Types::has(MESH) && shape.type == MESH) {
        if (asset < 0)
            return false;
        const auto lo = wp::index(meshes.bounds_min, asset), hi = wp::index(meshes.bounds_max, asset);
        extent.center = { 0.5f * (lo[0] + hi[0]), 0.5f * (lo[1] + hi[1]), 0.5f * (lo[2] + hi[2]) };
        extent.half = { 0.5f * (hi[0] - lo[0]), 0.5f * (hi[1] - lo[1]), 0.5f * (hi[2] - lo[2]) };
        record.size.x = max(max(abs(lo[0]), abs(hi[0])), max(max(abs(lo[1]), abs(hi[1])), max(abs(lo[2]), abs(hi[2]))));
        record.size.y = as_float(wp::index(meshes.node_start, asset));
        record.size.z = as_float(wp::index(meshes.face_start, asset));
        if (stretched)
            extent = stretched_by(extent, stretch);
        return hi[0] >= lo[0];
    }
    if (Types::has(HEIGHT_FIELD) && shape.type == HEIGHT_FIELD) {
        if (asset < 0)
            return false;
        const auto size = wp::index(fields.size, asset);
        const float top = wp::index(fields.grids, 2 * asset)[2];
        extent.center = { 0.0f, 0.0f, 0.5f * (top - size[3]) };
        extent.half = { size[0], size[1], 0.5f * (top + size[3]) };
        record.size.x = size[0];
        record.size.y = size[1];
        record.size.z = size[3];
        if (stretched)
            extent = stretched_by(extent, stretch);
        return true;
    }
    bool valid = false;
    visit_shape<Types::GEOMETRY>(shape.type, [&](auto traits) {
        extent = { { 0.0f, 0.0f, 0.0f }, traits.half_extents(shape.size) };
        valid = traits.is_valid(shape.size, extent.half);
        scale = traits.unit_scale(shape.size, extent.half);
        const Vec3 size = traits.unit_size(shape.size, scale);
        record.size.x = size.x;
        record.size.y = size.y;
    });
    return valid;
}

// First and last tile along one axis whose pixel centres lie between two image coordinates.
WARPCAM_DEVICE void tile_span(float lo, float hi, int start, int length, int tile, signed char& first,
                              signed char& last)
{
    const float margin = 0.01f;  // pixels; covers the rounding of the projection
    const float a = max(lo - margin - float(start), 0.0f), b = min(hi + margin - float(start), float(length - 1));
    first = 1;
    last = 0;
    if (!(a <= b))
        return;
    const int from = int(a) + (float(int(a)) < a ? 1 : 0);
    if (float(from) > b)
        return;
    first = static_cast<signed char>(from / tile);
    last = static_cast<signed char>(int(b) / tile);
}

// Bounds of what lies before the camera of a box beside it, part of which may lie behind it: its middle in the camera's
// frame, the camera's axes in its own, its half widths, how far from the camera's plane it reaches.
WARPCAM_DEVICE ViewSpan span_beside(const Mat3& m, Vec3 center, Vec3 half, float farthest)
{
    const auto width_along = [&](int axis) {
        return (1.0f + 1.0e-5f)
               * (abs(m.at[0][axis]) * half.x + abs(m.at[1][axis]) * half.y + abs(m.at[2][axis]) * half.z);
    };
    // what is to the right of the camera by at least x, and at most `farthest` away, is seen right of x / farthest
    const float rate = 0.9999f / farthest, wide = width_along(0), tall = width_along(1);
    const float left = center.x - wide, right = center.x + wide, low = center.y - tall, high = center.y + tall;
    return { left > 0.0f ? left * rate : -MISS, right < 0.0f ? right * rate : MISS, low > 0.0f ? low * rate : -MISS,
             high < 0.0f ? high * rate : MISS };
}

// Between which distances from the camera, `offset` before its centre, a box lies. Its frame may be any.
WARPCAM_DEVICE void distances(Vec3 offset, Vec3 half, float& nearest, float& farthest)
{
    const Vec3 a { abs(offset.x), abs(offset.y), abs(offset.z) };
    const Vec3 near { max(a.x - half.x, 0.0f), max(a.y - half.y, 0.0f), max(a.z - half.z, 0.0f) };
    const Vec3 far { a.x + half.x, a.y + half.y, a.z + half.z };
    farthest = (1.0f + 1.0e-5f) * sqrt(dot(far, far));
    nearest = max(sqrt(dot(near, near)) - 1.0e-5f * farthest, 0.0f);
}

// A shape's box and the scale that makes it a unit shape.
struct BoundsAndScale {
    LocalBounds extent;
    Vec3 scale;
};

// Per-shape data that depends on no camera; also the size row of the shape's record.
template <class Types, class Meshes, class HeightFields>
WARPCAM_DEVICE Visible find_form(const Shape& shape, const Meshes& meshes, const HeightFields& fields,
                                 BoundsAndScale& form, ShapeRecord& record)
{
    float sum = shape.position.x + shape.position.y + shape.position.z;
    for (int i = 0; i < 3; ++i)
        sum += shape.rotation.at[i][0] + shape.rotation.at[i][1] + shape.rotation.at[i][2];
    const float sizes = shape.size.x + shape.size.y + shape.size.z;
    if (!(abs(sum) < MISS) || sizes != sizes || (shape.type != PLANE && !(abs(sizes) < MISS)))
        return BROKEN;
    form.extent = {};
    record.size = { 0.0f, 0.0f, 0.0f, 0 };
    if (shape_bounds<Types>(shape, meshes, fields, form.extent, form.scale, record)) {
        const auto& turn = shape.rotation.at;
        return abs(turn[0][0]) + abs(turn[1][0]) + abs(turn[2][0]) > 0.0f ? SEEN : FORMLESS;
    }
    const bool has_asset = shape.type == MESH || shape.type == HEIGHT_FIELD;
    const bool sized = !has_asset || (Types::has(PER_SHAPE_SCALE) && shape.asset >= 0);
    return sized && max(max(shape.size.x, shape.size.y), shape.size.z) <= 0.0f ? FORMLESS : HIDDEN;
}

// The rest of its record. Without BOXES it is left open which tiles the shape touches, if any. CORNERS: as many of four
// are worked out at once, of which each stands for two; with all of them the registers of a trace would be twice as
// many. Tiles may have another size, but for tables of rays.
template <class Types, int LENS, bool BOXES = true, int CORNERS = 1>
WARPCAM_DEVICE Visible place(const Shape& shape, const BoundsAndScale& form, const Camera& camera, const Region& region,
                             ShapeRecord& record, TileRect& tiles, int tile_width = TILE_WIDTH,
                             int tile_height = TILE_HEIGHT)
{
    const LocalBounds& extent = form.extent;
    const Vec3 scale = form.scale;
    const Vec3 away { camera.origin.x - shape.position.x, camera.origin.y - shape.position.y,
                      camera.origin.z - shape.position.z };
    Vec3 o = transform_transposed(shape.rotation, away);
    Mat3 m = transposed_times(shape.rotation, camera.rotation);  // camera to shape
    if constexpr (Types::has(PLANES_FROM_BEHIND)) {
        // turned about its x axis, such a plane faces the camera
        if (shape.type == PLANE && (LENS == ORTHOGRAPHIC ? m.at[2][2] : o.z) < 0.0f) {
            o = { o.x, -o.y, -o.z };
            for (int j = 0; j < 3; ++j) {
                m.at[1][j] = -m.at[1][j];
                m.at[2][j] = -m.at[2][j];
            }
        }
    }

    const int across = (region.width - 1) / tile_width, down = (region.height - 1) / tile_height;
    tiles = { 0, 0, static_cast<signed char>(across), static_cast<signed char>(down) };
    float nearest = 0.0f;
    if (extent.half.x >= 0.0f) {  // not an endless plane
        const Vec3 offset { extent.center.x - o.x, extent.center.y - o.y, extent.center.z - o.z };
        const Vec3 center = transform_transposed(m, offset);
        const Vec3 e = extent.half;
        const float depth = -center.z;
        const float reach = abs(m.at[0][2]) * e.x + abs(m.at[1][2]) * e.y + abs(m.at[2][2]) * e.z;
        const float slack = 1.0e-5f * (abs(depth) + reach);
        nearest = max(depth - reach - slack, 0.0f);
        float farthest = depth + reach + slack;
        if constexpr (LENS == RAYS)
            distances(offset, e, nearest, farthest);
        if constexpr (LENS == RAY_TABLE_WITH_ORIGINS) {
            const Float3Int s = all_starts(camera);
            distances(offset - transform(m, as_vec3(s)), e, nearest, farthest);
            nearest = max(nearest - as_float(s.w), 0.0f);
            farthest += as_float(s.w);
        }
        if (farthest < camera.near || nearest > camera.far)
            return HIDDEN;
        if constexpr (LENS == RAYS) {
            if (BOXES) {
                tiles = ray_tiles(camera, region, center, m, e);
                if (tiles.left > tiles.right)
                    return HIDDEN;
            }
        } else if constexpr (LENS == RAY_TABLE_WITH_ORIGINS) {
            if (BOXES) {
                tiles = spread_tiles(camera, region, center, sqrt(dot(e, e)));
                if (tiles.left > tiles.right)
                    return HIDDEN;
            }
        } else if (BOXES) {
            ViewSpan span { MISS, -MISS, MISS, -MISS };
            if (LENS == PINHOLE && !(nearest > 1.0e-3f * reach)) {
                span = span_beside(m, center, e, farthest);
            } else if ((Types::GEOMETRY & ROUND_TYPES) != 0 && (ROUND_TYPES >> shape.type & 1) != 0) {
                span_round<LENS>(shape.type, center, depth, m, e, span);
            } else {
                const Vec3 side { m.at[0][0] * e.x, m.at[0][1] * e.x, m.at[0][2] * e.x };
#pragma unroll CORNERS
                for (int k = 0; k < 4; ++k) {
                    const float b = k & 1 ? e.y : -e.y, c = k & 2 ? e.z : -e.z;
                    const Vec3 middle { center.x + m.at[1][0] * b + m.at[2][0] * c,
                                        center.y + m.at[1][1] * b + m.at[2][1] * c,
                                        depth - (m.at[1][2] * b + m.at[2][2] * c) };
                    const float w = LENS == ORTHOGRAPHIC ? 1.0f : rcp(middle.z - side.z);
                    const float v = LENS == ORTHOGRAPHIC ? 1.0f : rcp(middle.z + side.z);
                    span.take((middle.x + side.x) * w, (middle.x - side.x) * v, (middle.y + side.y) * w,
                              (middle.y - side.y) * v);
                }
            }
            const float px = rcp(camera.scale_x), py = rcp(camera.scale_y);
            tile_span(span.left * px + camera.center_x - 0.5f, span.right * px + camera.center_x - 0.5f, region.left,
                      region.width, tile_width, tiles.left, tiles.right);
            tile_span(camera.center_y - 0.5f - span.high * py, camera.center_y - 0.5f - span.low * py, region.top,
                      region.height, tile_height, tiles.top, tiles.bottom);
            if (tiles.left > tiles.right || tiles.top > tiles.bottom)
                return HIDDEN;
        }
    }
    if (has_centre(LENS) && shape.type == PLANE && !(o.z > 0.0f))
        return HIDDEN;  // seen from below

    record.axis_x = { m.at[0][0] * scale.x, m.at[0][1] * scale.x, m.at[0][2] * scale.x, shape.type };
    record.axis_y = { m.at[1][0] * scale.y, m.at[1][1] * scale.y, m.at[1][2] * scale.y, shape.id };
    record.axis_z = { m.at[2][0] * scale.z, m.at[2][1] * scale.z, m.at[2][2] * scale.z, shape.asset };
    record.origin = { o.x * scale.x, o.y * scale.y, o.z * scale.z, 0 };
    record.size.w = as_int(nearest);
    return SEEN;
}

// All of it.
template <class Types, int LENS, bool BOXES = true, class Meshes, class HeightFields>
WARPCAM_NOINLINE_CPU WARPCAM_DEVICE Visible setup_shape(const Shape& shape, const Camera& camera, const Region& region,
                                                        const Meshes& meshes, const HeightFields& fields,
                                                        ShapeRecord& record, TileRect& tiles,
                                                        int tile_width = TILE_WIDTH, int tile_height = TILE_HEIGHT)
{
    BoundsAndScale form;
    const Visible found = find_form<Types>(shape, meshes, fields, form, record);
    return found == SEEN
               ? place<Types, LENS, BOXES>(shape, form, camera, region, record, tiles, tile_width, tile_height)
               : found;
}

}  // namespace warpcam
