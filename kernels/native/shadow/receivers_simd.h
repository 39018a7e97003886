// The points of one tile, and what they cover as a light sees them, on a CPU: eight at once.
#pragma once
#include "camera/view_rays_simd.h"
#include "shadow/shadow_tile.h"
#include "lights/shadow_extent.h"

namespace warpcam {

// Eight rays of a row: where they are in the image, or from a table.
struct RowPart {
    Floats i, j;
};
template <bool TABLE> struct RaysOfRow {
    using type = Beams;
};
template <> struct RaysOfRow<false> {
    using type = RowPart;
};
template <int LENS> using RowRays = typename RaysOfRow<has_table(LENS)>::type;

template <int LENS> inline void row_rays(const Sight<LENS>& s, int left, int row, RowRays<LENS>& rays)
{
    if constexpr (has_table(LENS))
        beams_from<LENS>(s.camera, left, row, rays);
    else
        rays = { float(left) + Floats { 0, 1, 2, 3, 4, 5, 6, 7 }, (Floats)float(row) };
}

inline Vecs points_of(const Sight<PINHOLE>& s, const RowPart& at, Floats depth)
{
    return { depth * (s.start.x + at.i * s.across.x + at.j * s.down.x) + s.along.x,
             depth * (s.start.y + at.i * s.across.y + at.j * s.down.y) + s.along.y,
             depth * (s.start.z + at.i * s.across.z + at.j * s.down.z) + s.along.z };
}

inline Vecs points_of(const Sight<ORTHOGRAPHIC>& s, const RowPart& at, Floats depth)
{
    return { s.start.x + at.i * s.across.x + at.j * s.down.x + depth * s.along.x,
             s.start.y + at.i * s.across.y + at.j * s.down.y + depth * s.along.y,
             s.start.z + at.i * s.across.z + at.j * s.down.z + depth * s.along.z };
}

template <int LENS> inline Vecs points_of(const Sight<LENS>& s, const Beams& beams, Floats depth)
{
    const Vecs v = places_on<LENS>(beams, depth);
    return eight_of(s.along) + (v.x * eight_of(s.right) + v.y * eight_of(s.up) + v.z * eight_of(s.back));
}

inline Vecs rays_to(const LightView& light, Vecs p)
{
    const Vecs aim = eight_of(light.aim);
    return light.distant ? aim : aim - p;
}

// The points of a tile that ask, row by row.
struct Points {
    static constexpr int ROWS = LANES / PACKET;
    Vecs at[ROWS];
    Floats u[ROWS], v[ROWS], height[ROWS];  // as in Place
    Ints beside[ROWS];
    Floats near[ROWS], reach[ROWS];
    Ints asked[ROWS], open[ROWS];  // true: asks; and is not shaded yet
    int ids[LANES], faces[LANES];
    int left, top;  // the tile's first pixel

    // Loads the points of a tile, whose first pixel is `first`; false if none asks. With `fresh` their masks are
    // cleared.
    template <int TYPES, int LENS, class Target> bool load(const LitView<LENS>& view, const Target& target,
                                                           size_t first, int left, int top, unsigned bit, bool fresh)
    {
        constexpr bool FACES = TYPES >> MESH & 1, IDS = FACES || (TYPES >> HEIGHT_FIELD & 1);
        static_assert(TILE_WIDTH == PACKET && TILE_HEIGHT == ROWS);
        this->left = left;
        this->top = top;
        for (int row = 0; row < ROWS; ++row) {
            const size_t start = first + size_t(row) * target.width;
            const int width = top + row < target.height ? target.width - left : 0;
            Floats depth = 0.0f;
            Ints asks = 0;
            if (width >= PACKET) {
                const Ints shown = load_eight(target.shape.data + start);
                asks = shown >= 0;
                if (fresh)
                    __builtin_memset(target.shadow.data + start, 0, PACKET * sizeof *target.shadow.data);
                else
                    asks &= (load_eight(target.shadow.data + start) & int(bit)) == 0;
                __builtin_memcpy(&depth, target.depth.data + start, sizeof depth);
                depth = asks ? depth : (Floats)0.0f;
                if (IDS)
                    __builtin_memcpy(ids + row * PACKET, &shown, sizeof shown);
                if (FACES) {
                    const Ints met = load_eight(target.face.data + start);
                    __builtin_memcpy(faces + row * PACKET, &met, sizeof met);
                }
            } else {
                for (int k = 0; k < width; ++k) {
                    const int lane = row * PACKET + k;
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
            if (any_of(asks)) {
                RowRays<LENS> rays;
                row_rays(view.sight, left, top + row, rays);
                put(row, view.light, view.origin, points_of(view.sight, rays, depth), points_of(view.lit, rays, depth),
                    depth);
            }
            asked[row] = open[row];
        }
        return any_open();
    }

    // Adds the light's bit to the masks of those that are shaded.
    template <class Target> void mark(const Target& target, size_t first, unsigned bit) const
    {
        for (int row = 0; row < ROWS; ++row)
            for (unsigned left = bits_of(asked[row] & ~open[row]); left; left &= left - 1)
                target.shadow.data[first + size_t(row) * target.width + lowest_bit(left)] |= static_cast<int>(bit);
    }

    // `p` in the world's axes, `lit` along the light's.
    void put(int row, const LightView& light, Vec origin, Vecs p, Vecs lit, Floats depth)
    {
        at[row] = p;
        const Floats none = 0.0f, one = 1.0f;
        if (light.distant) {
            u[row] = lit.x;
            v[row] = lit.y;
            height[row] = lit.z;
            beside[row] = 0;
        } else {
            const Ints aside = ~(lit.z > 1.0e-4f * (magnitude(lit.x) + magnitude(lit.y)));
            const Floats scale = reciprocal(aside ? one : lit.z);
            u[row] = lit.x * scale;
            v[row] = lit.y * scale;
            height[row] = aside ? (Floats)-FAR_AWAY : -lit.z;
            beside[row] = aside;
        }
        const Vecs d = rays_to(light, p);
        const Floats rounding = 2.0e-6f
            * (magnitude(origin.x + p.x) + magnitude(origin.y + p.y) + magnitude(origin.z + p.z) + depth);
        near[row] = rounding * reciprocal(root(upper(dot(d, d), (Floats)1.0e-30f)));
        Floats far = light.distant ? (Floats)ENDLESS : one - near[row];
        const ShadowMap& map = light.map;
        if (map.bounded) {
            Floats along;
            const Ints inside = has_place(map, light.distant, p, along);
            far = light.distant ? along - map.near : lower(far, one - map.near * reciprocal(along));
            far = inside ? far : none;
        }
        reach[row] = far;
        open[row] &= near[row] < far;
    }

    Vec point(int lane) const { return one_of(at[lane / PACKET], lane % PACKET); }
    Span span(int lane) const { return { near[lane / PACKET][lane % PACKET], reach[lane / PACKET][lane % PACKET] }; }

    Ints may_be_shaded(int row, const Window& w, float top) const
    {
        const Ints within = (w.left <= u[row]) & (w.right >= u[row]) & (w.bottom <= v[row]) & (w.top >= v[row]);
        return open[row] & (within | beside[row]) & (top > height[row]);
    }

    bool any_open() const
    {
        Ints any = open[0];
        for (int row = 1; row < ROWS; ++row)
            any |= open[row];
        return any_of(any);
    }
};

// What points cover as the light sees them: everything if some lie behind a light that shines forwards.
struct PointsAround {
    Floats left = FAR_AWAY, right = -FAR_AWAY, bottom = FAR_AWAY, top = -FAR_AWAY, floor = FAR_AWAY;

    // Those of a tile that are not shaded yet.
    void add(const Points& points)
    {
        const Floats far = FAR_AWAY;
        for (int row = 0; row < Points::ROWS; ++row) {
            const Ints open = points.open[row], beside = points.beside[row];
            left = lower(left, open ? (beside ? -far : points.u[row]) : far);
            right = upper(right, open ? (beside ? far : points.u[row]) : -far);
            bottom = lower(bottom, open ? (beside ? -far : points.v[row]) : far);
            top = upper(top, open ? (beside ? far : points.v[row]) : -far);
            floor = lower(floor, open ? points.height[row] : far);
        }
    }

    void add(const PointsAround& other)
    {
        left = lower(left, other.left);
        right = upper(right, other.right);
        bottom = lower(bottom, other.bottom);
        top = upper(top, other.top);
        floor = lower(floor, other.floor);
    }

    TileWindow window() const
    {
        return { { least_of(left), -least_of(-right), least_of(bottom), -least_of(-top) }, least_of(floor) };
    }
};

// The windows of so many casters at most, part by part.
template <int CAPACITY> struct Windows {
    static constexpr int PACKETS = (CAPACITY + PACKET - 1) / PACKET;
    Floats left[PACKETS], right[PACKETS], bottom[PACKETS], top[PACKETS], height[PACKETS];
    int count = 0;

    Windows() = default;
    template <class List> explicit Windows(const List& list)
    {
        for (int slot = 0; slot < list.count; ++slot)
            add(list.windows[slot], list.heights[slot]);
        close();
    }

    void add(const Window& window, float its_height)
    {
        const int packet = count / PACKET, k = count % PACKET;
        left[packet][k] = window.left;
        right[packet][k] = window.right;
        bottom[packet][k] = window.bottom;
        top[packet][k] = window.top;
        height[packet][k] = its_height;
        ++count;
    }

    // After the last: what is left of its eight shades nothing.
    void close()
    {
        for (int slot = count; slot % PACKET != 0; ++slot)
            height[slot / PACKET][slot % PACKET] = -FAR_AWAY;
    }

    // Those of eight that may shade a point of a tile, a bit each.
    unsigned may_shade(int packet, const TileWindow& tile) const
    {
        const Window& w = tile.window;
        const Ints may = (left[packet] <= w.right) & (right[packet] >= w.left) & (bottom[packet] <= w.top)
            & (top[packet] >= w.bottom) & (height[packet] > tile.floor);
        return bits_of(may);
    }

    int slot_of(int number) const { return number; }  // in the list
};

}  // namespace warpcam
