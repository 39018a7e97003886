// The points of one tile against the casters that may stand between them and a light, on a CPU: eight at once.
#pragma once
#include "shadow/receivers_simd.h"
#include "geometry/intersect_exit.h"

namespace warpcam {

// Clears `open` of those points of a row that lie in the shadow of an analytic caster. INSIDE: by the side that points
// inside of the shape look out by.
template <int TYPE, bool INSIDE>
inline void shade_points(const Record& r, const Row& aim, const LightView& light, int row, Points& points)
{
    const Row o = r.origin;
    const Vec a { aim.x, aim.y, aim.z };
    const Vecs p = points.at[row];
    const Vecs origin { r.axis_x.x * p.x + r.axis_x.y * p.y + r.axis_x.z * p.z + o.x,
                        r.axis_y.x * p.x + r.axis_y.y * p.y + r.axis_y.z * p.z + o.y,
                        r.axis_z.x * p.x + r.axis_z.y * p.y + r.axis_z.z * p.z + o.z };
    const Vecs direction = light.distant ? eight_of(a) : eight_of(a) - origin;
    const Floats t = INSIDE ? leave<TYPE>(r, origin, direction) : enter<TYPE>(r, origin, direction);
    const Floats near = INSIDE ? points.near[row] + light.map.nearest : points.near[row];
    points.open[row] &= ~((t > near) & (t < points.reach[row]));
}

// As in_shade_of_field(), whose comments hold here.
template <class HeightFields> inline void shade_points_by_field(const HeightFields& fields, const Record& r,
                                                                const LightView& light, int row, Points& points)
{
    const Vecs p = points.at[row], to = rays_to(light, p);
    const Floats near = points.near[row] + light.map.nearest, far = points.reach[row];
    const auto turned = [](const Row& axis, Vecs v) { return axis.x * v.x + axis.y * v.y + axis.z * v.z; };
    const RayPacket rays { turned(r.axis_x, p) + r.origin.x,
                           turned(r.axis_y, p) + r.origin.y,
                           turned(r.axis_z, p) + r.origin.z,
                           turned(r.axis_x, to),
                           turned(r.axis_y, to),
                           turned(r.axis_z, to) };
    Ints ids;
    __builtin_memcpy(&ids, points.ids + row * PACKET, sizeof ids);
    const Floats height = rays.oz + near * rays.dz;
    const Ints low = (height <= load(fields.grids.data, 2 * r.axis_z.w).z) & (height >= -r.size.z);
    for (unsigned some = bits_of(points.open[row] & (ids != r.axis_y.w) & low); some; some &= some - 1) {
        const int k = lowest_bit(some);
        const Ray ray { { rays.ox[k], rays.oy[k], rays.oz[k] }, { rays.dx[k], rays.dy[k], rays.dz[k] } };
        if (comes_out(fields, r, ray, near[k], far[k]))
            points.open[row][k] = 0;
    }
    PacketHit hit { points.open[row] ? far : (Floats)-1.0f, (Ints)0, (Ints)0 };
    walk_packet(fields, r, rays, near, hit);
    points.open[row] &= ~hit.met;
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
    const LightView& light = view.light;
    const unsigned all = view.dims ? ~0u : 0u;
    unsigned facing = all, known = all;  // points on sides whose shadow matters, and those of which it is known
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
                const Floats near = points.near[row] + light.map.nearest;
                unsigned met = bits_of(asks & meet_box(record, list.aims[slot], list.boxes[slot], points.at[row], near,
                                                       points.reach[row], light.distant));
                for (unsigned asked = met & ~(known >> row * PACKET); asked; asked &= asked - 1) {
                    const int lane = row * PACKET + lowest_bit(asked);
                    const Vec point = points.point(lane);
                    const Vec sight = view.sight.along_of(point, float(points.left + lane % TILE_WIDTH),
                                                          float(points.top + lane / TILE_WIDTH));
                    const Facing one = face_light<TYPES>(shapes, meshes, world, points.ids[lane], points.faces[lane],
                                                         light, view.origin, sight, point);
                    facing |= unsigned(one.front) << lane;
                }
                known |= met << row * PACKET;
                met &= facing >> row * PACKET;
                if (!met)
                    continue;
                walks |= met << row * PACKET;
                put_rays<TYPES>(walk, row * PACKET, record, points.at[row], rays_to(light, points.at[row]), near,
                                points.reach[row]);
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

// Clears `open` of the points that lie in the shadow of a caster in the list, of those in `windows`.
template <int TYPES, int LENS, class List, class ListWindows, class Shapes, class Meshes, class HeightFields>
inline void shade_tile(const List& list, const ListWindows& windows, const LitView<LENS>& view, int world,
                       const Shapes& shapes, const Meshes& meshes, const HeightFields& fields, Points& points)
{
    constexpr bool HAS_MESH = TYPES >> MESH & 1;
    PointsAround around;
    around.add(points);
    const TileWindow tile = around.window();
    unsigned behind[List::WORDS] = {};  // meshes
    bool any = false;
    constexpr int TOGETHER = 64;  // casters that are looked through before one of them is tried
    for (int first = 0; first < windows.count; first += TOGETHER) {
        unsigned long long some = 0;
        for (int number = first; number < first + TOGETHER && number < windows.count; number += PACKET)
            some |= static_cast<unsigned long long>(windows.may_shade(number / PACKET, tile)) << (number - first);
        int tries[TOGETHER * Points::ROWS],
            count = 0;  // rows and casters, found without branches that cannot be foreseen
        for (; some; some &= some - 1) {
            const int slot = windows.slot_of(first + __builtin_ctzll(some));
            for (int row = 0; row < Points::ROWS; ++row) {
                tries[count] = slot * Points::ROWS + row;
                count += any_of(points.may_be_shaded(row, list.windows[slot], list.heights[slot]));
            }
        }
        for (int k = 0; k < count; ++k) {
            const int slot = tries[k] / Points::ROWS, row = tries[k] % Points::ROWS;
            const Record& record = list.records[slot];
            const Row& aim = list.aims[slot];
            switch (record.axis_x.w) {
#define WARPCAM_CASE(TYPE) \
    case TYPE: \
        if constexpr ((TYPES >> TYPE & 1) != 0) \
            shade_points<TYPE, false>(record, aim, view.light, row, points); \
        if constexpr ((TYPES >> TYPE & 1) && (TYPES >> GLASS & 1)) \
            if (aim.w) \
                shade_points<TYPE, true>(record, aim, view.light, row, points); \
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
                    shade_points_by_field(fields, record, view.light, row, points);
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
