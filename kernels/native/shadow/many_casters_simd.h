// Shadows in scenes of many shapes, on a CPU. Most of these stand in the way of nothing that a region shows, which is
// found of eight at once by the spheres around them; patches of the region pick theirs among the others.
#pragma once
#include "shadow/shadow_pass.h"
#include "traversal/sphere_cull_simd.h"

namespace warpcam {

constexpr int PATCH = 16;  // pixels along a side, at most

// Bit mask of the spheres that may shade something in a region.
inline unsigned spheres_before(const Spheres& s, const LightView& light, const Camera& camera, const TileBounds& region)
{
    const Float8 none = 0.0f, one = 1.0f;
    const Vec3x8 c = s.at - broadcast(camera.origin), from = light.distant ? c : c - broadcast(light.aim);
    const Vec3 aim = light.aim;
    const Float8 half = s.radius
                        + 1.0e-5f
                              * (abs(c.x) + abs(c.y) + abs(c.z) + 2.0f * s.radius
                                 + (light.distant ? 0.0f : abs(aim.x) + abs(aim.y) + abs(aim.z)));
    const Float8 u = dot(broadcast(light.u), from), v = dot(broadcast(light.v), from),
                 w = dot(broadcast(light.w), from);
    Float8 left = u - half, right = u + half, bottom = v - half, top = v + half, height = w + half;
    Int8 unknown = s.unknown;
    if (!light.distant) {  // as bounds_uv_of()
        const Int8 aside = ~(w - half > 1.0e-3f * half);
        const Float8 nearest = aside ? one : w - half, at_near = 1.0001f / nearest, at_far = 0.9999f / (w + half);
        unknown |= aside;
        left *= left < none ? at_near : at_far;
        right *= right > none ? at_near : at_far;
        bottom *= bottom < none ? at_near : at_far;
        top *= top > none ? at_near : at_far;
        height = -nearest;
    }
    const LightSpaceBounds& all = region.bounds_uv;
    const Int8 may =
        (left <= all.right) & (right >= all.left) & (bottom <= all.top) & (top >= all.bottom) & (height > region.floor);
    return movemask(may | unknown) & s.there;
}

// Fills the list with shapes from `begin` on that may shade something in the region, until it is full; returns where to
// go on. `spheres`: of the first shapes, as many as the list has room for.
template <class Types, class List, class Shapes, class Materials, class Meshes, class HeightFields>
inline int gather_near(List& list, CasterBounds8<List::CAPACITY>& bounds_uv, int begin, const Spheres* spheres,
                       const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                       const HeightFields& fields, const LightView& light, const Camera& camera,
                       const TileBounds& region, int world)
{
    const int total = shapes.drawn.shape[0];
    bounds_uv.count = 0;
    for (; begin < total && bounds_uv.count + SIMD_WIDTH <= List::CAPACITY; begin += SIMD_WIDTH) {
        unsigned some =
            spheres_before(begin < List::CAPACITY ? spheres[begin / SIMD_WIDTH] : load_spheres(shapes, world, begin),
                           light, camera, region);
        for (; some; some &= some - 1) {
            Caster caster;
            const int id = wp::index(shapes.drawn, begin + ctz(some)), slot = bounds_uv.count;
            if (!prepare_caster<Types>(load_shape(shapes, world, id), light, camera, meshes, fields, caster)
                || !may_occlude(caster.bounds_uv, caster.height, region.bounds_uv, region.floor)
                || transparent(shapes, materials, world, id))
                continue;
            list.records[slot] = caster.record;
            list.aims[slot] = caster.aim;
            mark_glass<Types>(list.aims[slot], caster.record, shapes, materials, world, id);
            list.bounds_uv[slot] = caster.bounds_uv;
            list.heights[slot] = caster.height;
            if (Types::has(MESH))
                list.boxes[slot] = caster.box;
            bounds_uv.add(caster.bounds_uv, caster.height);
        }
    }
    bounds_uv.close();
    list.count = bounds_uv.count;
    return min(begin, total);
}

// Bounds, of a list, that may shade something in a patch.
template <int CAPACITY> struct PickedWindows : CasterBounds8<CAPACITY> {
    short slots[CAPACITY];

    void pick(const CasterBounds8<CAPACITY>& all, const TileBounds& patch)
    {
        this->count = 0;
        for (int packet = 0; packet < (all.count + SIMD_WIDTH - 1) / SIMD_WIDTH; ++packet)
            for (unsigned some = all.may_occlude(packet, patch); some; some &= some - 1) {
                const int k = ctz(some);
                slots[this->count] = static_cast<short>(packet * SIMD_WIDTH + k);
                this->add({ all.left[packet][k], all.right[packet][k], all.bottom[packet][k], all.top[packet][k] },
                          all.height[packet][k]);
            }
        this->close();
    }

    int slot_of(int number) const { return slots[number]; }
};

// Shadows in one region of one view, as cast() has them.
template <class Types, int LENS, int CAPACITY, int WIDTH, int HEIGHT, class Shapes, class Materials, class Meshes,
          class HeightFields, class Lights, class Views, class Target>
inline void cast_many(const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                      const HeightFields& fields, const Lights& lights, const Views& views, const Target& target,
                      int index)
{
    constexpr int ACROSS = WIDTH / TILE_WIDTH, DOWN = HEIGHT / TILE_HEIGHT;
    constexpr int PATCH_ACROSS = min(PATCH, WIDTH) / TILE_WIDTH, PATCH_DOWN = min(PATCH, HEIGHT) / TILE_HEIGHT;
    static_assert(ACROSS % PATCH_ACROSS == 0 && DOWN % PATCH_DOWN == 0);
    constexpr int PATCHES_ACROSS = ACROSS / PATCH_ACROSS, PATCHES = PATCHES_ACROSS * (DOWN / PATCH_DOWN);
    CasterList<CAPACITY, Types::has(MESH)> list;
    CasterBounds8<CAPACITY> bounds_uv;
    PickedWindows<CAPACITY> picked;
    Spheres spheres[CAPACITY / SIMD_WIDTH];  // for all lights
    Points cached_points[ACROSS * DOWN];
    int world;
    const Region region = region_of<WIDTH, HEIGHT>(target, index, world);
    if (!wp::index(target.mask, world))
        return;
    const Camera camera = load_camera(wp::index(views, world));
    const size_t corner = (size_t(world) * target.height + region.top) * target.width + region.left;
    const int total = shapes.drawn.shape[0], num_lights = lights.types.shape[1];
    ActiveLights active = active_lights(lights);
    bool fresh = true;
    for (int number = 0; number < num_lights; ++number) {
        const int place = active.next(lights, world, number);
        if (place < 0 || !casts(lights, world, number))
            continue;
        const ReceiverView<LENS> view = light_view<Types, LENS>(lights, camera, world, number);
        const unsigned bit = 1u << place;
        const auto load = [&](Points& points, int tile_column, int tile_row, bool clear) {
            const int column = tile_column * TILE_WIDTH, row = tile_row * TILE_HEIGHT;
            return points.load<Types>(view, target, corner + size_t(row) * target.width + column, region.left + column,
                                      region.top + row, bit, clear);
        };
        PointsAround patches[PATCHES], all;
        bool asks[ACROSS * DOWN];
        for (int row = 0; row < DOWN; ++row)
            for (int column = 0; column < ACROSS; ++column) {
                const int tile = row * ACROSS + column;
                asks[tile] = load(cached_points[tile], column, row, fresh);
                if (asks[tile])
                    patches[row / PATCH_DOWN * PATCHES_ACROSS + column / PATCH_ACROSS].add(cached_points[tile]);
            }
        if (fresh)
            for (int first = 0; first < min(total, CAPACITY); first += SIMD_WIDTH)
                spheres[first / SIMD_WIDTH] = load_spheres(shapes, world, first);
        fresh = false;
        for (const PointsAround& patch : patches)
            all.add(patch);
        const TileBounds everything = all.bounds_uv();
        int begin = everything.floor < MISS ? 0 : total;  // no point asks
        while (begin < total) {
            begin = gather_near<Types>(list, bounds_uv, begin, spheres, shapes, materials, meshes, fields, view.light,
                                       camera, everything, world);
            for (int patch = 0; patch < PATCHES; ++patch) {
                const TileBounds its = patches[patch].bounds_uv();
                if (!(its.floor < MISS))
                    continue;
                picked.pick(bounds_uv, its);
                if (picked.count == 0)
                    continue;
                for (int tile = 0; tile < PATCH_ACROSS * PATCH_DOWN; ++tile) {
                    const int column = patch % PATCHES_ACROSS * PATCH_ACROSS + tile % PATCH_ACROSS;
                    const int row = patch / PATCHES_ACROSS * PATCH_DOWN + tile / PATCH_ACROSS;
                    if (!asks[row * ACROSS + column])
                        continue;
                    Points& points = cached_points[row * ACROSS + column];
                    shade_tile<Types>(list, picked, view, world, shapes, meshes, fields, points);
                    points.mark(target, corner + size_t(row) * TILE_HEIGHT * target.width + column * TILE_WIDTH, bit);
                }
            }
        }
    }
    if (fresh)  // nothing casts a shadow
        clear_shadows<WIDTH, HEIGHT>(target, region, world, 0);
}

}  // namespace warpcam
