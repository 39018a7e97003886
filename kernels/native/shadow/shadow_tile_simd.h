// The points of one tile against the casters that may stand between them and a light, on a CPU: eight at once.
#pragma once
#include "shadow/receivers_simd.h"
#include "geometry/intersect_exit.h"

namespace warpcam {

// Clears `open` of those points of a row that lie in the shadow of an analytic caster. INSIDE: by the side that points
// inside of the shape look out by.
template <bool INSIDE, class Shape> inline void shade_points(Shape shape, const ShapeRecord& r, const Float3Int& aim,
                                                             const LightView& light, int row, Points& points)
{
    const Vec3 a { aim.x, aim.y, aim.z };
    const Vec3x8 p = points.at[row];
    const Vec3x8 origin = transform_rows(r, p, r.origin);
    const Vec3x8 direction = light.distant ? broadcast(a) : broadcast(a) - origin;
    const Float8 t = INSIDE ? intersect_exit(shape, r, origin, direction) : shape.intersect(r.size, origin, direction);
    const Float8 near = INSIDE ? points.near[row] + light.map.nearest : points.near[row];
    points.open[row] &= ~((t > near) & (t < points.reach[row]));
}

// Tests a packet against a height field; comments in in_shade_of_field() apply.
template <class HeightFields> inline void shade_points_by_field(const HeightFields& fields, const ShapeRecord& r,
                                                                const LightView& light, int row, Points& points)
{
    const Vec3x8 p = points.at[row], to = rays_to(light, p);
    const Float8 near = points.near[row] + light.map.nearest, far = points.reach[row];
    const auto dot_axis = [](const Float3Int& axis, Vec3x8 v) { return axis.x * v.x + axis.y * v.y + axis.z * v.z; };
    const RayPacket rays { dot_axis(r.axis_x, p) + r.origin.x,
                           dot_axis(r.axis_y, p) + r.origin.y,
                           dot_axis(r.axis_z, p) + r.origin.z,
                           dot_axis(r.axis_x, to),
                           dot_axis(r.axis_y, to),
                           dot_axis(r.axis_z, to) };
    Int8 ids;
    __builtin_memcpy(&ids, points.ids + row * SIMD_WIDTH, sizeof ids);
    const Float8 height = rays.oz + near * rays.dz;
    const Int8 low = (height <= load(fields.grids.data, 2 * r.axis_z.w).z) & (height >= -r.size.z);
    for (unsigned some = movemask(points.open[row] & (ids != r.axis_y.w) & low); some; some &= some - 1) {
        const int k = ctz(some);
        const Ray ray { { rays.ox[k], rays.oy[k], rays.oz[k] }, { rays.dx[k], rays.dy[k], rays.dz[k] } };
        if (comes_out(fields, r, ray, near[k], far[k]))
            points.open[row][k] = 0;
    }
    PacketHit hit { points.open[row] ? far : (Float8)-1.0f, (Int8)0, (Int8)0 };
    walk_packet(fields, r, rays, near, hit);
    points.open[row] &= ~hit.met;
}

// Tests the segments of eight points against a mesh's box, as meets_box() does.
inline Int8 meet_box(const ShapeRecord& r, const Float3Int& aim, const Box& box, Vec3x8 p, Float8 near, Float8 reach,
                     bool distant)
{
    const Vec3x8 o = transform_rows(r, p, r.origin);
    const Vec3x8 a = broadcast({ aim.x, aim.y, aim.z }), d = distant ? a : a - o;
    const Vec3x8 inverse { rcp(avoid_zero(d.x)), rcp(avoid_zero(d.y)), rcp(avoid_zero(d.z)) };
    const Float8 pad = 2.0e-6f * (abs(o.x) + abs(o.y) + abs(o.z));
    const Vec3x8 middle = mul(broadcast(box.center) - o, inverse);
    const Vec3x8 half { (box.half.x + pad) * abs(inverse.x), (box.half.y + pad) * abs(inverse.y),
                        (box.half.z + pad) * abs(inverse.z) };
    const Float8 enter = max(max(middle.x - half.x, middle.y - half.y), max(middle.z - half.z, near));
    const Float8 t_far = min(min(middle.x + half.x, middle.y + half.y), min(middle.z + half.z, reach));
    return enter <= t_far;
}

// Eight rays as WorldRay, whose comments hold here, at a mesh.
template <class Types>
inline void put_rays(MeshRays& rays, int first, const ShapeRecord& r, Vec3x8 p, Vec3x8 to, Float8 near, Float8 reach)
{
    const Vec3x8 own = transform_rows(r, to), d = Types::has(PER_SHAPE_SCALE) ? own : to;
    const Float8 zero = 0.0f;
    const Vec3x8 across = select(abs(d.z) > abs(d.x), { zero, d.z, -d.y }, { d.y, -d.x, zero });
    const Vec3x8 frame[3] = { across, cross(across, d), rcp(dot(d, d)) * d };
    const Vec3x8 origin = transform_rows(r, p, r.origin);
    if constexpr (Types::has(PER_SHAPE_SCALE))
        rays.put_eight(first, origin, own, r.size.x, frame, near, reach);
    else
        rays.put_eight(first, origin, own, r.size.x,
                       { transform_rows(r, frame[0]), transform_rows(r, frame[1]), transform_rows(r, frame[2]) }, near,
                       reach);
}

// Clears `open` of the points that lie in the shadow of a mesh. `behind`: bits of the meshes that may shade any.
template <class Types, int LENS, class List, class Shapes, class Meshes>
inline void shade_points_by_meshes(const List& list, const ReceiverView<LENS>& view, int world, const Shapes& shapes,
                                   const Meshes& meshes, const unsigned* behind, Points& points)
{
    const LightView& light = view.light;
    const unsigned all = view.dims ? ~0u : 0u;
    unsigned facing = all, known = all;  // points on sides whose shadow matters, and those of which it is known
    for (int word = 0; word < (list.count + 31) / 32; ++word)
        for (unsigned left = behind[word]; left; left &= left - 1) {
            const int slot = word * 32 + ctz(left);
            const ShapeRecord& record = list.records[slot];
            MeshRays walk(node_rows(meshes, record.axis_z.w), face_rows(meshes, record.axis_z.w));
            unsigned walks = 0;
            for (int row = 0; row < Points::ROWS; ++row) {
                const Int8 asks = points.may_be_shaded(row, list.bounds_uv[slot], list.heights[slot]);
                if (!any(asks))
                    continue;
                const Float8 near = points.near[row] + light.map.nearest;
                unsigned met = movemask(asks
                                        & meet_box(record, list.aims[slot], list.boxes[slot], points.at[row], near,
                                                   points.reach[row], light.distant));
                for (unsigned asked = met & ~(known >> row * SIMD_WIDTH); asked; asked &= asked - 1) {
                    const int lane = row * SIMD_WIDTH + ctz(asked);
                    const Vec3 point = points.point(lane);
                    const Vec3 view_direction = view.reconstructor.along_of(
                        point, float(points.left + lane % TILE_WIDTH), float(points.top + lane / TILE_WIDTH));
                    const Facing one = face_light<Types>(shapes, meshes, world, points.ids[lane], points.faces[lane],
                                                         light, view.origin, view_direction, point);
                    facing |= unsigned(one.front) << lane;
                }
                known |= met << row * SIMD_WIDTH;
                met &= facing >> row * SIMD_WIDTH;
                if (!met)
                    continue;
                walks |= met << row * SIMD_WIDTH;
                put_rays<Types>(walk, row * SIMD_WIDTH, record, points.at[row], rays_to(light, points.at[row]), near,
                                points.reach[row]);
            }
            find_faces<SIDES_OF<Types, true>, true>(walk, walks, [&](int lane, int face, float t) {
                const Vec3 p = points.point(lane);
                return is_there<Types>(meshes, record, WorldRay { p, ray_to(light, p) }.local(record), face, t);
            });
            for (unsigned some = walks; some; some &= some - 1) {
                const int lane = ctz(some);
                if (walk.face[lane] >= 0)
                    points.open[lane / SIMD_WIDTH][lane % SIMD_WIDTH] = 0;
            }
        }
}

// Clears `open` of the points that lie in the shadow of a caster in the list, of those in `bounds_uv`.
template <class Types, int LENS, class List, class ListBounds, class Shapes, class Meshes, class HeightFields>
inline void shade_tile(const List& list, const ListBounds& bounds_uv, const ReceiverView<LENS>& view, int world,
                       const Shapes& shapes, const Meshes& meshes, const HeightFields& fields, Points& points)
{
    constexpr bool HAS_MESH = Types::has(MESH);
    PointsAround around;
    around.add(points);
    const TileBounds tile = around.bounds_uv();
    unsigned behind[List::WORDS] = {};  // meshes
    bool found = false;
    constexpr int TOGETHER = 64;  // casters that are looked through before one of them is tried
    for (int first = 0; first < bounds_uv.count; first += TOGETHER) {
        unsigned long long some = 0;
        for (int number = first; number < first + TOGETHER && number < bounds_uv.count; number += SIMD_WIDTH)
            some |= static_cast<unsigned long long>(bounds_uv.may_occlude(number / SIMD_WIDTH, tile))
                    << (number - first);
        int tries[TOGETHER * Points::ROWS],
            count = 0;  // rows and casters, found without branches that cannot be foreseen
        for (; some; some &= some - 1) {
            const int slot = bounds_uv.slot_of(first + __builtin_ctzll(some));
            for (int row = 0; row < Points::ROWS; ++row) {
                tries[count] = slot * Points::ROWS + row;
                count += any(points.may_be_shaded(row, list.bounds_uv[slot], list.heights[slot]));
            }
        }
        for (int k = 0; k < count; ++k) {
            const int slot = tries[k] / Points::ROWS, row = tries[k] % Points::ROWS;
            const ShapeRecord& record = list.records[slot];
            const Float3Int& aim = list.aims[slot];
            if (HAS_MESH && record.axis_x.w == MESH) {
                behind[slot / 32] |= 1u << slot % 32;
                found = true;
            } else if (Types::has(HEIGHT_FIELD) && record.axis_x.w == HEIGHT_FIELD) {
                shade_points_by_field(fields, record, view.light, row, points);
            } else {
                visit_shape<Types::ANALYTIC>(record.axis_x.w, [&](auto shape) {
                    shade_points<false>(shape, record, aim, view.light, row, points);
                    if constexpr (Types::has(TRANSPARENT_CASTERS))
                        if (aim.w)
                            shade_points<true>(shape, record, aim, view.light, row, points);
                });
            }
        }
    }
    if constexpr (HAS_MESH)
        if (found)
            shade_points_by_meshes<Types>(list, view, world, shapes, meshes, behind, points);
}

}  // namespace warpcam
