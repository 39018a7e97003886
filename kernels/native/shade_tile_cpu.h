// The points of one tile against the casters that may stand between them and a light, on a CPU: eight at once.
#pragma once
#include "shade_tile.h"
#include "shapes_cpu.h"

namespace warpcam {

inline Vecs points_of(const Sight<PINHOLE>& s, Floats i, Floats j, Floats depth)
{
    return { depth * (s.start.x + i * s.across.x + j * s.down.x) + s.along.x,
             depth * (s.start.y + i * s.across.y + j * s.down.y) + s.along.y,
             depth * (s.start.z + i * s.across.z + j * s.down.z) + s.along.z };
}

inline Vecs points_of(const Sight<ORTHOGRAPHIC>& s, Floats i, Floats j, Floats depth)
{
    return { s.start.x + i * s.across.x + j * s.down.x + depth * s.along.x,
             s.start.y + i * s.across.y + j * s.down.y + depth * s.along.y,
             s.start.z + i * s.across.z + j * s.down.z + depth * s.along.z };
}

inline Vecs points_of(const Sight<RAYS>& s, Floats i, Floats j, Floats depth)
{
    Vecs points;
    for (int k = 0; k < PACKET; ++k)
        put_one(points, k, s.point(i[k], j[k], depth[k]));
    return points;
}

inline Vecs rays_to(const Light& light, Vecs p)
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

    // Loads the points of a tile, whose first pixel is `first`; false if none asks. With `fresh` their masks are cleared.
    template <bool FACES, int LENS, class Target>
    bool load(const LitView<LENS>& view, const Target& target, size_t first, int left, int top, unsigned bit, bool fresh)
    {
        static_assert(TILE_WIDTH == PACKET && TILE_HEIGHT == ROWS);
        const Floats i = float(left) + Floats { 0, 1, 2, 3, 4, 5, 6, 7 };
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
                if (FACES) {
                    const Ints met = load_eight(target.face.data + start);
                    __builtin_memcpy(ids + row * PACKET, &shown, sizeof shown);
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
                const Floats j = float(top + row);
                put(row, view.light, view.origin, points_of(view.sight, i, j, depth), points_of(view.lit, i, j, depth), depth);
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
    void put(int row, const Light& light, Vec origin, Vecs p, Vecs lit, Floats depth)
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
        near[row] = rounding * reciprocal(root(upper(dot(d, d), (Floats)1.0e-30f))) + light.map.nearest;
        Floats far = light.distant ? (Floats)ENDLESS : one - near[row];
        const ShadowMap& map = light.map;
        if (map.bounded) {
            const Vecs offset = p - eight_of(map.from);
            const Floats along = dot(eight_of(map.along), offset);
            const Floats side = upper(magnitude(dot(eight_of(map.right), offset)), magnitude(dot(eight_of(map.up), offset)));
            const Ints outside = ~(along > map.near) | (side > (light.distant ? one : along));
            far = light.distant ? along - map.near : lower(far, one - map.near * reciprocal(along));
            far = outside ? none : far;
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

// The windows of a list's casters, part by part.
template <int CAPACITY> struct Windows {
    static constexpr int PACKETS = (CAPACITY + PACKET - 1) / PACKET;
    Floats left[PACKETS], right[PACKETS], bottom[PACKETS], top[PACKETS], height[PACKETS];

    template <class List> explicit Windows(const List& list)
    {
        for (int first = 0; first < list.count; first += PACKET)
            for (int k = 0; k < PACKET; ++k) {
                const int packet = first / PACKET, slot = first + k;
                const bool there = slot < list.count;
                left[packet][k] = there ? list.windows[slot].left : FAR_AWAY;
                right[packet][k] = there ? list.windows[slot].right : -FAR_AWAY;
                bottom[packet][k] = there ? list.windows[slot].bottom : FAR_AWAY;
                top[packet][k] = there ? list.windows[slot].top : -FAR_AWAY;
                height[packet][k] = there ? list.heights[slot] : -FAR_AWAY;
            }
    }

    // Those of eight that may shade a point of a tile, a bit each.
    unsigned may_shade(int packet, const Window& tile, float floor) const
    {
        const Ints may = (left[packet] <= tile.right) & (right[packet] >= tile.left) & (bottom[packet] <= tile.top)
            & (top[packet] >= tile.bottom) & (height[packet] > floor);
        return bits_of(may);
    }
};

// INSIDE: by the side that points inside of the shape look out by.
template <int TYPE, bool INSIDE>
inline void shade_points(const Record& record, const Row& aim, const Window& window, float top, bool distant,
                         Points& points)
{
    const Record r = record;
    const Row o = r.origin;
    const Vec a { aim.x, aim.y, aim.z };
    for (int row = 0; row < Points::ROWS; ++row) {
        const Ints asks = points.may_be_shaded(row, window, top);
        if (!any_of(asks))
            continue;
        const Vecs p = points.at[row];
        const Vecs origin { r.axis_x.x * p.x + r.axis_x.y * p.y + r.axis_x.z * p.z + o.x,
                            r.axis_y.x * p.x + r.axis_y.y * p.y + r.axis_y.z * p.z + o.y,
                            r.axis_z.x * p.x + r.axis_z.y * p.y + r.axis_z.z * p.z + o.z };
        const Vecs direction = distant ? eight_of(a) : eight_of(a) - origin;
        Floats t;
        if constexpr (INSIDE)
            for (int k = 0; k < PACKET; ++k)
                t[k] = leave<TYPE>(r, { one_of(origin, k), one_of(direction, k) });
        else
            t = enter_eight<TYPE>(r, origin, direction);
        points.open[row] &= ~((t > points.near[row]) & (t < points.reach[row]));
    }
}

template <class HeightFields>
inline void shade_points_by_field(const HeightFields& fields, const Record& r, const Light& light, Points& points)
{
    for (int row = 0; row < Points::ROWS; ++row) {
        if (!any_of(points.open[row]))
            continue;
        const Vecs p = points.at[row], to = rays_to(light, p);
        const auto turned = [](const Row& axis, Vecs v) { return axis.x * v.x + axis.y * v.y + axis.z * v.z; };
        const RayPacket rays { turned(r.axis_x, p) + r.origin.x, turned(r.axis_y, p) + r.origin.y,
                               turned(r.axis_z, p) + r.origin.z, turned(r.axis_x, to),
                               turned(r.axis_y, to), turned(r.axis_z, to) };
        PacketHit hit { points.open[row] ? points.reach[row] : (Floats)-1.0f, (Ints)0, (Ints)0 };
        walk_packet(fields, r, rays, points.near[row], hit);
        points.open[row] &= ~hit.met;
    }
}

// As meets_box(), of eight points.
inline Ints meet_box(const Record& r, const Row& aim, const Box& box, Vecs p, Floats near, Floats reach, bool distant)
{
    const Vecs o { r.axis_x.x * p.x + r.axis_x.y * p.y + r.axis_x.z * p.z + r.origin.x,
                   r.axis_y.x * p.x + r.axis_y.y * p.y + r.axis_y.z * p.z + r.origin.y,
                   r.axis_z.x * p.x + r.axis_z.y * p.y + r.axis_z.z * p.z + r.origin.z };
    const Vecs a = eight_of({ aim.x, aim.y, aim.z }), d = distant ? a : a - o;
    const Vecs inverse { reciprocal(nonzero(d.x)), reciprocal(nonzero(d.y)), reciprocal(nonzero(d.z)) };
    const Floats pad = 2.0e-6f * (magnitude(o.x) + magnitude(o.y) + magnitude(o.z));
    const Vecs middle = times(eight_of(box.center) - o, inverse);
    const Vecs half { (box.half.x + pad) * magnitude(inverse.x), (box.half.y + pad) * magnitude(inverse.y),
                      (box.half.z + pad) * magnitude(inverse.z) };
    const Floats enter = upper(upper(middle.x - half.x, middle.y - half.y), upper(middle.z - half.z, near));
    const Floats leave = lower(lower(middle.x + half.x, middle.y + half.y), lower(middle.z + half.z, reach));
    return enter <= leave;
}

// Eight rays as WorldRay, whose comments hold here, at a mesh.
template <int TYPES>
inline void put_rays(MeshRays& rays, int first, const Record& r, Vecs p, Vecs to, Floats near, Floats reach)
{
    const auto turned = [&](Vecs v, Vec start) {
        return Vecs { r.axis_x.x * v.x + r.axis_x.y * v.y + r.axis_x.z * v.z + start.x,
                      r.axis_y.x * v.x + r.axis_y.y * v.y + r.axis_y.z * v.z + start.y,
                      r.axis_z.x * v.x + r.axis_z.y * v.y + r.axis_z.z * v.z + start.z };
    };
    const Vec none { 0.0f, 0.0f, 0.0f };
    const Vecs own = turned(to, none), d = TYPES >> SCALED & 1 ? own : to;
    const Floats zero = 0.0f;
    const Vecs across = chosen(magnitude(d.z) > magnitude(d.x), { zero, d.z, -d.y }, { d.y, -d.x, zero });
    const Vecs frame[3] = { across, cross(across, d), reciprocal(dot(d, d)) * d };
    const Vecs origin = turned(p, { r.origin.x, r.origin.y, r.origin.z });
    if constexpr (TYPES >> SCALED & 1)
        rays.put_eight(first, origin, own, r.size.x, frame, near, reach);
    else
        rays.put_eight(first, origin, own, r.size.x,
                       { turned(frame[0], none), turned(frame[1], none), turned(frame[2], none) }, near, reach);
}

// Clears `open` of the points that lie in the shadow of a mesh. `behind`: bits of the meshes that may shade any.
template <int TYPES, int LENS, class List, class Shapes, class Meshes>
inline void shade_points_by_meshes(const List& list, const LitView<LENS>& view, int world, const Shapes& shapes,
                                   const Meshes& meshes, const unsigned* behind, Points& points)
{
    const Light& light = view.light;
    unsigned facing = 0, known = 0;  // points on sides that see the light, and those of which it is known
    for (int word = 0; word < (list.count + 31) / 32; ++word)
        for (unsigned left = behind[word]; left; left &= left - 1) {
            const int slot = word * 32 + lowest_bit(left);
            const Record& record = list.records[slot];
            MeshRays walk(node_rows(meshes, record.axis_z.w), face_rows(meshes, record.axis_z.w));
            unsigned walks = 0;
            for (int row = 0; row < Points::ROWS; ++row) {
                const Ints asks = points.may_be_shaded(row, list.windows[slot], list.heights[slot]);
                if (!any_of(asks))
                    continue;
                unsigned met = bits_of(asks & meet_box(record, list.aims[slot], list.boxes[slot], points.at[row],
                                                       points.near[row], points.reach[row], light.distant));
                for (unsigned asked = met & ~(known >> row * PACKET); asked; asked &= asked - 1) {
                    const int lane = row * PACKET + lowest_bit(asked);
                    const Vec point = points.point(lane);
                    const Facing one = face_light<TYPES>(shapes, meshes, world, points.ids[lane], points.faces[lane], light,
                                                         view.origin, view.sight.along_of(point), point);
                    facing |= unsigned(one.front) << lane;
                }
                known |= met << row * PACKET;
                met &= facing >> row * PACKET;
                if (!met)
                    continue;
                walks |= met << row * PACKET;
                put_rays<TYPES>(walk, row * PACKET, record, points.at[row], rays_to(light, points.at[row]),
                                points.near[row], points.reach[row]);
            }
            for (unsigned some = walks; some; some &= some - 1)
                walk.start(lowest_bit(some));
            walk.template walk<SIDES_OF<TYPES, true>, true>([&](int lane, int face, float t) {
                const Vec p = points.point(lane);
                return is_there<TYPES>(meshes, record, WorldRay { p, ray_to(light, p) }.local(record), face, t);
            });
            for (unsigned some = walks; some; some &= some - 1) {
                const int lane = lowest_bit(some);
                if (walk.face[lane] >= 0)
                    points.open[lane / PACKET][lane % PACKET] = 0;
            }
        }
}

// Clears `open` of the points that lie in the shadow of a caster in the list.
template <int TYPES, int LENS, class List, int CAPACITY, class Shapes, class Meshes, class HeightFields>
inline void shade_tile(const List& list, const Windows<CAPACITY>& windows, const LitView<LENS>& view, int world,
                       const Shapes& shapes, const Meshes& meshes, const HeightFields& fields, Points& points)
{
    constexpr bool HAS_MESH = TYPES >> MESH & 1;
    Floats left = FAR_AWAY, right = -FAR_AWAY, bottom = FAR_AWAY, top = -FAR_AWAY, lowest = FAR_AWAY;
    const Floats far = FAR_AWAY;
    for (int row = 0; row < Points::ROWS; ++row) {
        const Ints open = points.open[row], beside = points.beside[row];
        left = lower(left, open ? (beside ? -far : points.u[row]) : far);
        right = upper(right, open ? (beside ? far : points.u[row]) : -far);
        bottom = lower(bottom, open ? (beside ? -far : points.v[row]) : far);
        top = upper(top, open ? (beside ? far : points.v[row]) : -far);
        lowest = lower(lowest, open ? points.height[row] : far);
    }
    const Window tile { least_of(left), -least_of(-right), least_of(bottom), -least_of(-top) };
    const float floor = least_of(lowest);
    const bool distant = view.light.distant;
    unsigned behind[List::WORDS] = {};  // meshes
    bool any = false;
    constexpr int TOGETHER = 64;  // casters that are looked through before one of them is tried
    for (int first = 0; first < list.count; first += TOGETHER) {
        unsigned long long some = 0;
        for (int slot = first; slot < first + TOGETHER && slot < list.count; slot += PACKET)
            some |= static_cast<unsigned long long>(windows.may_shade(slot / PACKET, tile, floor)) << (slot - first);
        for (; some; some &= some - 1) {
            const int slot = first + __builtin_ctzll(some);
            const Record& record = list.records[slot];
            const Row& aim = list.aims[slot];
            const Window& window = list.windows[slot];
            const float height = list.heights[slot];
            switch (record.axis_x.w) {
#define WARPCAM_CASE(TYPE) \
    case TYPE: \
        if constexpr ((TYPES >> TYPE & 1) != 0) \
            shade_points<TYPE, false>(record, aim, window, height, distant, points); \
        if constexpr ((TYPES >> TYPE & 1) && (TYPES >> GLASS & 1)) \
            if (aim.w) \
                shade_points<TYPE, true>(record, aim, window, height, distant, points); \
        break;
                WARPCAM_CASE(PLANE)
                WARPCAM_CASE(SPHERE)
                WARPCAM_CASE(CAPSULE)
                WARPCAM_CASE(ELLIPSOID)
                WARPCAM_CASE(CYLINDER)
                WARPCAM_CASE(BOX)
                WARPCAM_CASE(CONE)
                WARPCAM_CASE(BARREL)
#undef WARPCAM_CASE
            case HEIGHT_FIELD:
                if constexpr ((TYPES >> HEIGHT_FIELD & 1) != 0)
                    shade_points_by_field(fields, record, view.light, points);
                break;
            default:
                behind[slot / 32] |= 1u << slot % 32;
                any = true;
            }
        }
    }
    if constexpr (HAS_MESH)
        if (any)
            shade_points_by_meshes<TYPES>(list, view, world, shapes, meshes, behind, points);
}

}  // namespace warpcam
