// Pixels that points in the camera's frame come to: by formula, or by a search of the table of rays.
//
// The search finds the pixel whose ray passes a point at the smallest angle: tiles whose cone cannot have a nearer ray
// are passed over. Newton's steps lead from there to the place between pixels' centres, where rays are linear.
#pragma once
#include "camera/shape_setup.h"
#include "output/pixel_store.h"

namespace warpcam {

constexpr int PROJECTION_ROUNDS = 6;
constexpr float PROJECTION_TOLERANCE = 0.02f;  // pixels that a ray may pass a point aside

// Where a point comes to, column and row [pixels], and where its ray begins, in the camera's frame [m].
struct ProjectedPoint {
    float column, row;
    Vec3 start;
};

WARPCAM_DEVICE ProjectedPoint not_projected()
{
    const float nan = infinity() - infinity();
    return { nan, nan, { nan, nan, nan } };
}

// The ray of a pixel of a table.
template <int LENS> WARPCAM_DEVICE bool table_entry(const Camera& camera, int column, int row, OffsetRay& found)
{
    const CameraRay<LENS> ray = view_ray<LENS>(camera, column, row);
    if (sees_nothing(ray))
        return false;
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS)
        found = ray.offset_ray();
    else
        found = { { 0.0f, 0.0f, 0.0f }, ray.direction() };
    return true;
}

// Cone of a tile, and the ball in which its rays begin.
template <int LENS>
WARPCAM_DEVICE void tile_bounds(const Camera& camera, int column, int row, Float3Int& cone, Float3Int& starts)
{
    starts = { 0.0f, 0.0f, 0.0f, 0 };
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS) {
        const Float3Int* const tile = tile_starts(camera, column, row);
        cone = load(tile, 0);
        starts = load(tile, 1);
    } else {
        cone = load(tile_cones(camera, column, row), 0);
    }
}

// Upper bound of the cosine of the angle between a tile's rays and the way from where they begin to a point.
WARPCAM_DEVICE float closest_of_tile(const Float3Int& cone, const Float3Int& starts, Vec3 point)
{
    const Vec3 offset = point - as_vec3(starts);
    const float length = sqrt(dot(offset, offset)), reach = as_float(starts.w);
    if (!(length > reach))
        return 1.0f;
    const float sine = reach / length, cosine = sqrt(max(1.0f - sine * sine, 0.0f));
    const float wide = as_float(cone.w), narrow = sqrt(max(1.0f - wide * wide, 0.0f));
    const float whole = wide * cosine - narrow * sine, along = dot(offset, axis_of(cone)) / length;
    if (wide <= -cosine || along >= whole)
        return 1.0f;
    const float across = sqrt(max(1.0f - along * along, 0.0f));
    return along * whole + across * sqrt(max(1.0f - whole * whole, 0.0f)) + 1.0e-5f;
}

// The pixel whose ray passes a point at the smallest angle, as row * width + column; -1 if no pixel sees anything.
template <int LENS> WARPCAM_DEVICE int nearest_ray(const Camera& camera, Vec3 point)
{
    const int across = tiles_across(camera), tiles = across * tiles_down(camera);
    const int width = table_width(camera), height = table_height(camera);
    float best = -2.0f, guess = -2.0f;
    int nearest = -1, first = 0;
    Float3Int cone, starts;
    for (int tile = 0; tile < tiles; ++tile) {  // one whose axis is near: what it has rules others out
        tile_bounds<LENS>(camera, tile % across, tile / across, cone, starts);
        const Vec3 offset = point - as_vec3(starts);
        const float along = dot(offset, axis_of(cone)) / sqrt(max(dot(offset, offset), MIN_NORMAL));
        first = along > guess ? tile : first;
        guess = max(along, guess);
    }
#pragma unroll 1
    for (int k = -1; k < tiles; ++k) {
        const int tile = k < 0 ? first : k;
        tile_bounds<LENS>(camera, tile % across, tile / across, cone, starts);
        if (k == first || closest_of_tile(cone, starts, point) <= best)
            continue;
#pragma unroll 1
        for (int lane = 0; lane < TILE_WIDTH * TILE_HEIGHT; ++lane) {
            const int column = tile % across * TILE_WIDTH + lane % TILE_WIDTH;
            const int row = tile / across * TILE_HEIGHT + lane / TILE_WIDTH;
            OffsetRay ray;
            if (column >= width || row >= height || !table_entry<LENS>(camera, column, row, ray))
                continue;
            const Vec3 towards = point - ray.start;
            const float score = dot(ray.direction, towards) / sqrt(max(dot(towards, towards), MIN_NORMAL));
            if (score > best) {
                best = score;
                nearest = row * width + column;
            }
        }
    }
    return nearest;
}

// The first of two neighbours that a place lies between, and its share of the way to the second; beyond them at edges.
WARPCAM_DEVICE int neighbor_of(float place, int count, float& share)
{
    const int first = clamp(int(round_down(place - 0.5f)), 0, max(count - 2, 0));
    share = count > 1 ? place - 0.5f - float(first) : 0.0f;
    return first;
}

// How far the ray at a place passes a point, as a difference of directions, and how that changes across and down.
struct RayOffset {
    Vec3 off, across, down;
    Vec3 start;  // of the ray [m]
};

template <int LENS>
WARPCAM_DEVICE bool ray_offset(const Camera& camera, float column, float row, Vec3 point, RayOffset& found)
{
    const int width = table_width(camera), height = table_height(camera);
    float right, under;
    const int left = neighbor_of(column, width, right), top = neighbor_of(row, height, under);
    OffsetRay sum { {}, {} }, across { {}, {} }, down { {}, {} };
    for (int k = 0; k < 4; ++k) {
        const float x = k & 1 ? right : 1.0f - right, y = k & 2 ? under : 1.0f - under;
        const float by_x = width > 1 ? (k & 1 ? y : -y) : 0.0f, by_y = height > 1 ? (k & 2 ? x : -x) : 0.0f;
        OffsetRay ray;
        if (!table_entry<LENS>(camera, min(left + (k & 1), width - 1), min(top + (k >> 1), height - 1), ray)) {
            if (x * y != 0.0f)
                return false;
            continue;
        }
        sum = { sum.start + x * y * ray.start, sum.direction + x * y * ray.direction };
        across = { across.start + by_x * ray.start, across.direction + by_x * ray.direction };
        down = { down.start + by_y * ray.start, down.direction + by_y * ray.direction };
    }
    const Vec3 towards = point - sum.start;
    const float length = 1.0f / sqrt(max(dot(sum.direction, sum.direction), MIN_NORMAL)),
                rate = 1.0f / sqrt(max(dot(towards, towards), MIN_NORMAL));
    const Vec3 direction = length * sum.direction, aim = rate * towards;
    // of a unit vector changes across it alone count
    const auto slope = [&](const OffsetRay& change) {
        return length * (change.direction - dot(change.direction, direction) * direction)
               + rate * (change.start - dot(change.start, aim) * aim);
    };
    found.start = sum.start;
    found.off = direction - aim;
    found.across = slope(across);
    found.down = slope(down);
    return true;
}

template <int LENS> WARPCAM_DEVICE ProjectedPoint project_by_table(const Camera& camera, Vec3 point)
{
    const int width = table_width(camera), height = table_height(camera);
    const int nearest = abs(dot(point, point)) < MISS ? nearest_ray<LENS>(camera, point) : -1;
    if (nearest < 0)
        return not_projected();
    float column = float(nearest % width) + 0.5f, row = float(nearest / width) + 0.5f;
    const float least_column = max(column - 1.0f, 0.0f), least_row = max(row - 1.0f, 0.0f);
    const float most_column = min(column + 1.0f, float(width)), most_row = min(row + 1.0f, float(height));
    RayOffset ray;
    for (int round = 0; round <= PROJECTION_ROUNDS; ++round) {
        if (!ray_offset<LENS>(camera, column, row, point, ray))
            return not_projected();
        const float cc = dot(ray.across, ray.across), rr = dot(ray.down, ray.down), cr = dot(ray.across, ray.down);
        const float to_column = dot(ray.across, ray.off), to_row = dot(ray.down, ray.off), area = cc * rr - cr * cr;
        if (round == PROJECTION_ROUNDS) {
            const float pixel = sqrt(max(cc, rr));
            if (!(sqrt(dot(ray.off, ray.off)) <= PROJECTION_TOLERANCE * pixel))
                return not_projected();
        } else if (area > 1.0e-6f * cc * rr) {  // else rays are parallel along one side: no way to tell
            column = clamp(column - (rr * to_column - cr * to_row) / area, least_column, most_column);
            row = clamp(row - (cc * to_row - cr * to_column) / area, least_row, most_row);
        }
    }
    return { column, row, ray.start };
}

// NaN for a point that the lens does not see: behind the camera, or where no ray of a table leads.
template <int LENS> WARPCAM_DEVICE ProjectedPoint project_point(const Camera& camera, Vec3 point)
{
    if constexpr (has_table(LENS)) {
        return project_by_table<LENS>(camera, point);
    } else {
        const float depth = -point.z;
        if (!(LENS == PINHOLE ? depth > 0.0f : depth >= 0.0f))
            return not_projected();
        const float rate = LENS == PINHOLE ? 1.0f / depth : 1.0f;
        const Vec3 start { LENS == PINHOLE ? 0.0f : point.x, LENS == PINHOLE ? 0.0f : point.y, 0.0f };
        return { rate * point.x / camera.scale_x + camera.center_x, camera.center_y - rate * point.y / camera.scale_y,
                 start };
    }
}

// Projects one point of one world; `index` counts worlds, then points. `projection`: Projection of
// warpcam/labeling/kernels.py.
template <int LENS, class Views, class Projection>
WARPCAM_DEVICE void project_points(const Views& views, const Projection& projection, int index)
{
    const int count = projection.points.shape[1], number = index % count, world = index / count;
    if (!wp::index(projection.mask, world))
        return;
    const Camera camera = load_camera(wp::index(views, world));
    ProjectedPoint found = not_projected();
    if (abs(camera.origin.x) < MISS)
        found = project_point<LENS>(camera, as_vec3(wp::index(projection.points, world, number)));
    auto& pixel = *wp::address(projection.pixels, world, number);
    pixel[0] = found.column;
    pixel[1] = found.row;
    if (projection.starts.shape[0] > 0) {
        auto& start = *wp::address(projection.starts, world, number);
        for (int axis = 0; axis < 3; ++axis)
            start[axis] = component(found.start, axis);
    }
}

}  // namespace warpcam
