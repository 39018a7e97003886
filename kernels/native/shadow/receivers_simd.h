// The points of one tile, and what they cover as a light sees them, on a CPU: eight at once.
#pragma once
#include "camera/view_rays_simd.h"
#include "shadow/shadow_span.h"
#include "lights/shadow_extent.h"

namespace warpcam {

// Eight rays of a row: where they are in the image, or from a table.
struct RowPart {
    Float8 i, j;
};
template <bool TABLE> struct RaysOfRow {
    using type = OffsetRay8;
};
template <> struct RaysOfRow<false> {
    using type = RowPart;
};
template <int LENS> using RowRays = typename RaysOfRow<has_table(LENS)>::type;

template <int LENS> inline void row_rays(const PointReconstructor<LENS>& s, int left, int row, RowRays<LENS>& rays)
{
    if constexpr (has_table(LENS))
        offset_rays_from<LENS>(s.camera, left, row, rays);
    else
        rays = { float(left) + Float8 { 0, 1, 2, 3, 4, 5, 6, 7 }, (Float8) float(row) };
}

inline Vec3x8 points_of(const PointReconstructor<PINHOLE>& s, const RowPart& at, Float8 depth)
{
    return { depth * (s.start.x + at.i * s.across.x + at.j * s.down.x) + s.along.x,
             depth * (s.start.y + at.i * s.across.y + at.j * s.down.y) + s.along.y,
             depth * (s.start.z + at.i * s.across.z + at.j * s.down.z) + s.along.z };
}

inline Vec3x8 points_of(const PointReconstructor<ORTHOGRAPHIC>& s, const RowPart& at, Float8 depth)
{
    return { s.start.x + at.i * s.across.x + at.j * s.down.x + depth * s.along.x,
             s.start.y + at.i * s.across.y + at.j * s.down.y + depth * s.along.y,
             s.start.z + at.i * s.across.z + at.j * s.down.z + depth * s.along.z };
}

template <int LENS>
inline Vec3x8 points_of(const PointReconstructor<LENS>& s, const OffsetRay8& offset_rays, Float8 depth)
{
    const Vec3x8 v = places_on<LENS>(offset_rays, depth);
    return broadcast(s.along) + (v.x * broadcast(s.right) + v.y * broadcast(s.up) + v.z * broadcast(s.back));
}

inline Vec3x8 rays_to(const LightView& light, Vec3x8 p)
{
    const Vec3x8 aim = broadcast(light.aim);
    return light.distant ? aim : aim - p;
}

// The points of a tile that ask, row by row.
struct Points {
    static constexpr int ROWS = WARP_SIZE / SIMD_WIDTH;
    Vec3x8 at[ROWS];
    Float8 u[ROWS], v[ROWS], height[ROWS];  // as in Place
    Int8 beside[ROWS];
    Float8 near[ROWS], reach[ROWS];
    Int8 asked[ROWS], open[ROWS];  // true: asks; and is not shaded yet
    int ids[WARP_SIZE], faces[WARP_SIZE];
    int left, top;  // the tile's first pixel

    // Loads the points of a tile, whose first pixel is `first`; false if none asks. With `fresh` their masks are
    // cleared.
    template <class Types, int LENS, class Target> bool load(const ReceiverView<LENS>& view, const Target& target,
                                                             size_t first, int left, int top, unsigned bit, bool fresh)
    {
        constexpr bool FACES = Types::has(MESH), IDS = FACES || Types::has(HEIGHT_FIELD);
        static_assert(TILE_WIDTH == SIMD_WIDTH && TILE_HEIGHT == ROWS);
        this->left = left;
        this->top = top;
        for (int row = 0; row < ROWS; ++row) {
            const size_t start = first + size_t(row) * target.width;
            const int width = top + row < target.height ? target.width - left : 0;
            Float8 depth = 0.0f;
            Int8 asks = 0;
            if (width >= SIMD_WIDTH) {
                const Int8 shown = load8(target.shape.data + start);
                asks = shown >= 0;
                if (fresh)
                    __builtin_memset(target.shadow.data + start, 0, SIMD_WIDTH * sizeof *target.shadow.data);
                else
                    asks &= (load8(target.shadow.data + start) & int(bit)) == 0;
                __builtin_memcpy(&depth, target.depth.data + start, sizeof depth);
                depth = asks ? depth : (Float8)0.0f;
                if (IDS)
                    __builtin_memcpy(ids + row * SIMD_WIDTH, &shown, sizeof shown);
                if (FACES) {
                    const Int8 met = load8(target.face.data + start);
                    __builtin_memcpy(faces + row * SIMD_WIDTH, &met, sizeof met);
                }
            } else {
                for (int k = 0; k < width; ++k) {
                    const int lane = row * SIMD_WIDTH + k;
                    if (fresh)
                        target.shadow.data[start + k] = 0;
                    ids[lane] = target.shape.data[start + k];
                    if (ids[lane] < 0 || (target.shadow.data[start + k] & bit))
                        continue;
                    asks[k] = -1;
                    depth[k] = target.depth.data[start + k];
                    if (FACES)
                        faces[lane] = target.face.data[start + k];
                }
            }
            open[row] = asks;
            if (any(asks)) {
                RowRays<LENS> rays;
                row_rays(view.reconstructor, left, top + row, rays);
                put(row, view.light, view.origin, points_of(view.reconstructor, rays, depth),
                    points_of(view.lit, rays, depth), depth);
            }
            asked[row] = open[row];
        }
        return any_open();
    }

    // Adds the light's bit to the masks of those that are shaded.
    template <class Target> void mark(const Target& target, size_t first, unsigned bit) const
    {
        for (int row = 0; row < ROWS; ++row)
            for (unsigned left = movemask(asked[row] & ~open[row]); left; left &= left - 1)
                target.shadow.data[first + size_t(row) * target.width + ctz(left)] |= static_cast<int>(bit);
    }

    // `p` in the world's axes, `lit` along the light's.
    void put(int row, const LightView& light, Vec3 origin, Vec3x8 p, Vec3x8 lit, Float8 depth)
    {
        at[row] = p;
        const Float8 none = 0.0f, one = 1.0f;
        if (light.distant) {
            u[row] = lit.x;
            v[row] = lit.y;
            height[row] = lit.z;
            beside[row] = 0;
        } else {
            const Int8 aside = ~(lit.z > 1.0e-4f * (abs(lit.x) + abs(lit.y)));
            const Float8 scale = rcp(aside ? one : lit.z);
            u[row] = lit.x * scale;
            v[row] = lit.y * scale;
            height[row] = aside ? (Float8)-MISS : -lit.z;
            beside[row] = aside;
        }
        const Vec3x8 d = rays_to(light, p);
        const Float8 rounding = 2.0e-6f * (abs(origin.x + p.x) + abs(origin.y + p.y) + abs(origin.z + p.z) + depth);
        near[row] = rounding * rcp(sqrt(max(dot(d, d), (Float8)1.0e-30f)));
        Float8 far = light.distant ? (Float8)MAX_RAY_T : one - near[row];
        const ShadowMap& map = light.map;
        if (map.bounded) {
            Float8 along;
            const Int8 inside = has_place(map, light.distant, p, along);
            far = light.distant ? along - map.near : min(far, one - map.near * rcp(along));
            far = inside ? far : none;
        }
        reach[row] = far;
        open[row] &= near[row] < far;
    }

    Vec3 point(int lane) const { return get_lane(at[lane / SIMD_WIDTH], lane % SIMD_WIDTH); }
    Span span(int lane) const
    {
        return { near[lane / SIMD_WIDTH][lane % SIMD_WIDTH], reach[lane / SIMD_WIDTH][lane % SIMD_WIDTH] };
    }

    Int8 may_be_shaded(int row, const LightSpaceBounds& w, float top) const
    {
        const Int8 within = (w.left <= u[row]) & (w.right >= u[row]) & (w.bottom <= v[row]) & (w.top >= v[row]);
        return open[row] & (within | beside[row]) & (top > height[row]);
    }

    bool any_open() const
    {
        Int8 open_lanes = open[0];
        for (int row = 1; row < ROWS; ++row)
            open_lanes |= open[row];
        return any(open_lanes);
    }
};

// Bounds of points in the light's view: everything if some lie behind a light that shines forwards.
struct PointsAround {
    Float8 left = MISS, right = -MISS, bottom = MISS, top = -MISS, floor = MISS;

    // Adds a tile's points that are not shaded yet.
    void add(const Points& points)
    {
        const Float8 far = MISS;
        for (int row = 0; row < Points::ROWS; ++row) {
            const Int8 open = points.open[row], beside = points.beside[row];
            left = min(left, open ? (beside ? -far : points.u[row]) : far);
            right = max(right, open ? (beside ? far : points.u[row]) : -far);
            bottom = min(bottom, open ? (beside ? -far : points.v[row]) : far);
            top = max(top, open ? (beside ? far : points.v[row]) : -far);
            floor = min(floor, open ? points.height[row] : far);
        }
    }

    void add(const PointsAround& other)
    {
        left = min(left, other.left);
        right = max(right, other.right);
        bottom = min(bottom, other.bottom);
        top = max(top, other.top);
        floor = min(floor, other.floor);
    }

    TileBounds bounds_uv() const
    {
        return { { reduce_min(left), -reduce_min(-right), reduce_min(bottom), -reduce_min(-top) }, reduce_min(floor) };
    }
};

// The bounds of so many casters at most, part by part.
template <int CAPACITY> struct CasterBounds8 {
    static constexpr int PACKETS = (CAPACITY + SIMD_WIDTH - 1) / SIMD_WIDTH;
    Float8 left[PACKETS], right[PACKETS], bottom[PACKETS], top[PACKETS], height[PACKETS];
    int count = 0;

    CasterBounds8() = default;
    template <class List> explicit CasterBounds8(const List& list)
    {
        for (int slot = 0; slot < list.count; ++slot)
            add(list.bounds_uv[slot], list.heights[slot]);
        close();
    }

    void add(const LightSpaceBounds& bounds_uv, float its_height)
    {
        const int packet = count / SIMD_WIDTH, k = count % SIMD_WIDTH;
        left[packet][k] = bounds_uv.left;
        right[packet][k] = bounds_uv.right;
        bottom[packet][k] = bounds_uv.bottom;
        top[packet][k] = bounds_uv.top;
        height[packet][k] = its_height;
        ++count;
    }

    // After the last: what is left of its eight shades nothing.
    void close()
    {
        for (int slot = count; slot % SIMD_WIDTH != 0; ++slot)
            height[slot / SIMD_WIDTH][slot % SIMD_WIDTH] = -MISS;
    }

    // Bit mask of the casters, of eight, that may shade a point of a tile.
    unsigned may_occlude(int packet, const TileBounds& tile) const
    {
        const LightSpaceBounds& w = tile.bounds_uv;
        const Int8 may = (left[packet] <= w.right) & (right[packet] >= w.left) & (bottom[packet] <= w.top)
                         & (top[packet] >= w.bottom) & (height[packet] > tile.floor);
        return movemask(may);
    }

    int slot_of(int number) const { return number; }  // in the list
};

}  // namespace warpcam
