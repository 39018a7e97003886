// A camera in one world, and its rays: by a formula, or from a table for lenses that have none.
//
// A table has of each pixel's unit direction the point where the line from behind the camera, (0, 0, 1), through it
// meets the image at (0, 0, 0): two numbers of equal relative precision for every direction but straight back. Before
// them stands a cone for each tile of 8 x 4 pixels that holds the tile's rays: its axis and the cosine of its half
// angle.
//
// A table of offset rays has a ball in which all of them begin, its middle in the camera's frame and its radius; for
// each tile the cone and such a ball; and for each pixel two rows.
#pragma once
#include "camera/offset_rays.h"

namespace warpcam {

constexpr float NO_RAY = 1.0e18f;  // what is greater are the coordinates of a pixel that sees nothing
constexpr int TILE_WIDTH = 8, TILE_HEIGHT = 4;  // pixels; one warp

// One camera in one world (types.py, View). With a table scale_x has the bits of the image's width + 65536 * height,
// scale_y the angle between neighbouring rays, of offset ones and how far apart they begin, and center_x and center_y
// the bits of the table's address.
struct Camera {
    Vec3 origin;
    Mat3 rotation;
    float scale_x, scale_y, center_x, center_y, near, far, miss;
};

WARPCAM_DEVICE float image_x(const Camera& camera, float i) { return (i + 0.5f - camera.center_x) * camera.scale_x; }
WARPCAM_DEVICE float image_y(const Camera& camera, float j) { return (camera.center_y - j - 0.5f) * camera.scale_y; }

WARPCAM_DEVICE const char* table_of(const Camera& camera)
{
    const unsigned long long low = unsigned(as_int(camera.center_x)), high = unsigned(as_int(camera.center_y));
    return reinterpret_cast<const char*>(high << 32 | low);
}
WARPCAM_DEVICE int table_width(const Camera& camera) { return as_int(camera.scale_x) & 0xffff; }
WARPCAM_DEVICE int table_height(const Camera& camera) { return as_int(camera.scale_x) >> 16 & 0xffff; }
WARPCAM_DEVICE int tiles_across(const Camera& camera) { return (table_width(camera) + TILE_WIDTH - 1) / TILE_WIDTH; }
WARPCAM_DEVICE int tiles_down(const Camera& camera) { return (table_height(camera) + TILE_HEIGHT - 1) / TILE_HEIGHT; }

// The cone of a tile, counted from the image's corner. w: bits of the cosine of its half angle.
WARPCAM_DEVICE const Float3Int* tile_cones(const Camera& camera, int column, int row)
{
    return reinterpret_cast<const Float3Int*>(table_of(camera)) + row * tiles_across(camera) + column;
}

// Starts of a tile's rays with own origins, followed by the bounding ball. For the ball of the whole image:
// all_starts().
WARPCAM_DEVICE const Float3Int* tile_starts(const Camera& camera, int column, int row)
{
    return reinterpret_cast<const Float3Int*>(table_of(camera)) + 1 + 2 * (row * tiles_across(camera) + column);
}
WARPCAM_DEVICE Float3Int all_starts(const Camera& camera) { return load(table_of(camera), 0); }

// Ray of the image's nearest pixel.
WARPCAM_DEVICE CameraRay<RAY_TABLE_WITH_ORIGINS> spread_ray(const Camera& camera, int i, int j, int sample = -1)
{
    const int width = table_width(camera), height = table_height(camera);
    const int column = i < 0 ? 0 : min(i, width - 1), row = j < 0 ? 0 : min(j, height - 1);
    const Float3Int* const rays = tile_starts(camera, 0, tiles_down(camera));
    return CameraRay<RAY_TABLE_WITH_ORIGINS>::of(rays + OFFSET_RAY_ROWS * size_t(row * width + column), sample);
}

// Ray of the image's nearest pixel.
WARPCAM_DEVICE CameraRay<RAYS> table_ray(const Camera& camera, int i, int j)
{
    const int width = table_width(camera), height = table_height(camera);
    const int column = i < 0 ? 0 : min(i, width - 1), row = j < 0 ? 0 : min(j, height - 1);
    const char* rays = table_of(camera) + size_t(tiles_across(camera) * tiles_down(camera)) * sizeof(Float3Int);
    const Float2 at = reinterpret_cast<const Float2*>(rays)[row * width + column];
    return { at.x, at.y };
}

// Change of the ray from pixel (i, j) to the next, across and down: over both neighbours that see anything.
WARPCAM_DEVICE void table_slopes(const Camera& camera, int i, int j, Float2& across, Float2& down)
{
    const CameraRay<RAYS> here = table_ray(camera, i, j);
    const auto slope = [&](CameraRay<RAYS> from, bool has_from, CameraRay<RAYS> to, bool has_to) {
        has_from = has_from && from.x < NO_RAY;
        has_to = has_to && to.x < NO_RAY;
        from = has_from ? from : here;
        to = has_to ? to : here;
        const float rate = here.x >= NO_RAY ? 0.0f : has_from && has_to ? 0.5f : 1.0f;
        return Float2 { rate * (to.x - from.x), rate * (to.y - from.y) };
    };
    across = slope(table_ray(camera, i - 1, j), i > 0, table_ray(camera, i + 1, j), i + 1 < table_width(camera));
    down = slope(table_ray(camera, i, j - 1), j > 0, table_ray(camera, i, j + 1), j + 1 < table_height(camera));
}

// The ray of pixel (i, j).
template <int LENS> WARPCAM_DEVICE CameraRay<LENS> view_ray(const Camera& camera, int i, int j)
{
    if constexpr (LENS == RAYS)
        return table_ray(camera, i, j);
    else if constexpr (LENS == RAY_TABLE_WITH_ORIGINS)
        return spread_ray(camera, i, j);
    else
        return { image_x(camera, float(i)), image_y(camera, float(j)) };
}

// True if a pixel has no ray.
WARPCAM_DEVICE bool sees_nothing(const CameraRay<RAYS>& ray) { return ray.x >= NO_RAY; }
WARPCAM_DEVICE bool sees_nothing(const CameraRay<RAY_TABLE_WITH_ORIGINS>& ray) { return ray.sees_nothing(); }

// The ray of a sample of pixel (i, j).
template <int LENS> WARPCAM_DEVICE CameraRay<LENS> sample_ray(const Camera& camera, int i, int j, int sample)
{
    const Offset offset = sample_offset(sample);
    if constexpr (LENS == RAYS) {
        Float2 across, under;
        table_slopes(camera, i, j, across, under);
        const CameraRay<RAYS> ray = table_ray(camera, i, j);
        return { ray.x + offset.right * across.x + offset.down * under.x,
                 ray.y + offset.right * across.y + offset.down * under.y };
    } else if constexpr (LENS == RAY_TABLE_WITH_ORIGINS) {
        return spread_ray(camera, i, j, sample);
    } else {
        return { image_x(camera, float(i) + offset.right), image_y(camera, float(j) + offset.down) };
    }
}

// Width of a pixel [m], see widths_at().
template <int LENS> WARPCAM_DEVICE float pixel_width(const Camera& camera)
{
    if constexpr (has_table(LENS))
        return camera.scale_y;
    return camera.scale_x;
}

// Width of a pixel at a depth, in widths at depth 1. For rays with own origins an upper bound: they may diverge, and
// start apart.
template <int LENS, class Number> WARPCAM_DEVICE Number widths_at(Number depth)
{
    return LENS == RAY_TABLE_WITH_ORIGINS ? 1.0f + depth : LENS == ORTHOGRAPHIC ? Number(1.0f) : depth;
}

// A camera with a table as one of its pixels has it: its ray, and how that changes to the next pixel across, in scale_x
// and scale_y, and down, in center_x and center_y. Of an offset ray that is asked of the ray.
struct PixelCamera : Camera {
    float x, y;
};

template <int LENS> WARPCAM_DEVICE PixelCamera camera_at(const Camera& camera, int i, int j)
{
    PixelCamera own;
    static_cast<Camera&>(own) = camera;
    const CameraRay<LENS> ray = view_ray<LENS>(camera, i, j);
    own.x = ray.x;
    own.y = ray.y;
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS)
        return own;
    Float2 across, down;
    table_slopes(camera, i, j, across, down);
    own.scale_x = across.x;
    own.scale_y = across.y;
    own.center_x = down.x;
    own.center_y = down.y;
    return own;
}

// The ray of a pixel, of a camera that may be one of a pixel's own.
template <int LENS, class Camera_> WARPCAM_DEVICE float ray_x(const Camera_& camera, int i)
{
    if constexpr (has_table(LENS))
        return camera.x;
    else
        return image_x(camera, float(i));
}
template <int LENS, class Camera_> WARPCAM_DEVICE float ray_y(const Camera_& camera, int j)
{
    if constexpr (has_table(LENS))
        return camera.y;
    else
        return image_y(camera, float(j));
}

// Converts a change of a table's ray at (x, y) to a change of its unit direction.
WARPCAM_DEVICE Vec3 turn_of(float x, float y, float dx, float dy)
{
    const float rate = rcp(1.0f + x * x + y * y), along = 2.0f * rate * (x * dx + y * dy);
    return { 2.0f * rate * (dx - along * x), 2.0f * rate * (dy - along * y), 2.0f * rate * along };
}

// From what a pixel sees to what the next one does, across and down, on a surface that faces the camera; in its frame.
template <int LENS> WARPCAM_DEVICE Vec3 step_right(const Camera& camera, float x, float y, float depth)
{
    if constexpr (LENS == RAYS) {
        const Vec3 turn = turn_of(x, y, camera.scale_x, camera.scale_y);
        return { depth * turn.x, depth * turn.y, depth * turn.z };
    }
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS) {
        const OffsetRay step = CameraRay<LENS> { x, y }.across();
        return step.start + depth * step.direction;
    }
    const float stretch = LENS == PINHOLE ? depth : 1.0f;
    return { stretch * camera.scale_x, 0.0f, 0.0f };
}
template <int LENS> WARPCAM_DEVICE Vec3 step_down(const Camera& camera, float x, float y, float depth)
{
    if constexpr (LENS == RAYS) {
        const Vec3 turn = turn_of(x, y, camera.center_x, camera.center_y);
        return { depth * turn.x, depth * turn.y, depth * turn.z };
    }
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS) {
        const OffsetRay step = CameraRay<LENS> { x, y }.down();
        return step.start + depth * step.direction;
    }
    const float stretch = LENS == PINHOLE ? depth : 1.0f;
    return { 0.0f, -stretch * camera.scale_y, 0.0f };
}

}  // namespace warpcam
