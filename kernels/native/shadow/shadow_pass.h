// Shadow pass: finds the lights that reach each visible point. Each pixel's hit point looks back at each light; the
// shapes that may stand between a tile's points and the light are selected once for the whole tile.
#pragma once
#include "core/conditional.h"
#include "shadow/plane_receiver_cull.h"
#include "lights/active_lights.h"
#include "shadow/mesh_any_hit.h"
#include "shadow/near_casters.h"
#include "shadow/shadow_strips.h"
#include "shadow/occluder_boxes.h"

namespace warpcam {

constexpr int FEW_CASTERS = 2;
constexpr int FULL_LIST = 160;  // the largest list; in scenes of more casters it has those that a region needs

// True if an active light casts shadows. A light without colour has none to take away.
template <class Lights> WARPCAM_DEVICE bool casts(const Lights& lights, int world, int light)
{
    const Vec3 sum = as_vec3(per_world(lights.ambient, world, light)) + as_vec3(per_world(lights.diffuse, world, light))
                     + as_vec3(per_world(lights.specular, world, light));
    return per_world(lights.casts_shadow, world, light) && dot(sum, sum) > 0.0f;
}

template <class Types, int LENS, class Lights>
WARPCAM_NOINLINE_CPU WARPCAM_DEVICE ReceiverView<LENS> light_view(const Lights& lights, const Camera& camera, int world,
                                                                  int light)
{
    const bool distant = per_world(lights.types, world, light) == LIGHT_DIRECTIONAL;
    const auto p = wp::index(lights.positions, world, light), d = wp::index(lights.directions, world, light);
    const LightView made = make_light(distant, { p[0], p[1], p[2] }, { d[0], d[1], d[2] }, camera,
                                      map_size(lights, distant, per_world(lights.cutoff, world, light)));
    const PointReconstructor<LENS> reconstructor = reconstructor_of<LENS>(camera);
    bool dims = false;
    if constexpr ((Types::has(MESH) && Types::has(SHADING_BACKS)) || leaves_out_backs<Types>()) {
        const Vec3 ambient = as_vec3(per_world(lights.ambient, world, light));
        dims = dot(ambient, ambient) > 0.0f;
    }
    return { made, reconstructor, lit_reconstructor(made, reconstructor), camera.origin, dims };
}

// Work for one light in one region. CUDA keeps it in shared memory: in registers it would crowd out what mesh
// traversals need.
template <int LENS> struct LightPass {
    ReceiverView<LENS> view;
    Region region;
    size_t corner;  // the region's first pixel
    int world;
    unsigned bit;  // of the light
    bool fresh;    // masks are to be cleared first
};

// Number of lights whose lists are built together: where a warp builds a list by itself, two lists are built at once,
// and their shadows are cast without a barrier between them.
template <class Types, int CAPACITY> constexpr int lights_per_batch()
{
#if defined(__CUDA_ARCH__)
    return (Types::has(MESH)) && CAPACITY <= 16 ? 2 : 1;
#else
    return 1;
#endif
}

#if defined(__CUDA_ARCH__)

// A mesh of those that are `met`, bits by slot, of which there are some: that of the shape itself, if it is one of
// them.
template <class List> WARPCAM_DEVICE int slot_to_try(const List& list, const unsigned (&met)[List::WORDS], int id)
{
    int slot = -1;
    for (int word = 0; word < (list.count + 31) / 32; ++word) {
        for (unsigned left = met[word]; left; left &= left - 1) {
            const int its = word * 32 + ctz(left);
            if (list.records[its].axis_y.w == id)
                return its;
            slot = slot < 0 ? its : slot;
        }
    }
    return slot;
}

// Leaves one of them out; false if none are left.
template <class List> WARPCAM_DEVICE bool others_met(const List& list, unsigned (&met)[List::WORDS], int slot)
{
    bool any = false;
    for (int word = 0; word < (list.count + 31) / 32; ++word) {
        met[word] &= ~(word == slot / 32 ? 1u << slot % 32 : 0u);
        any |= met[word] != 0;
    }
    return any;
}

#endif

// Casts the shadows of one light, as far as they come from the list's shapes, in one region: adds its bit to the masks
// of the pixels that lie in shadow.
template <class Types, int LENS, int WIDTH, int HEIGHT, class List, class Asking_, class Shapes, class Meshes,
          class HeightFields, class Target>
WARPCAM_DEVICE void cast_light(List& list, Asking_& asking_tiles, const LightPass<LENS>& task, const Shapes& shapes,
                               const Meshes& meshes, const HeightFields& fields, const Target& target,
                               const Floor& floor, unsigned floors)
{
    constexpr bool HAS_MESH = Types::has(MESH);
    const ReceiverView<LENS>& view = task.view;
#if defined(__CUDA_ARCH__)
    constexpr bool BESIDE = lights_per_batch<Types, List::CAPACITY>() > 1;
    constexpr int WORDS = List::WORDS;
    using Strips = Strip<WIDTH, HEIGHT>;
    constexpr bool SURVEYED = Asking_::COUNT > 0;  // it is known which points ask
    WARPCAM_SHARED ShadowRays<HAS_MESH ? WORDS : 1, NodeRay<by_child<Types>()>>
        rays[HAS_MESH ? THREADS / WARP_SIZE : 1];
    const int lane = threadIdx.x % WARP_SIZE, warp = HAS_MESH ? threadIdx.x / WARP_SIZE : 0;
    constexpr bool ON_FLOOR = uses_plane_cull<Types, LENS, WIDTH, HEIGHT>();
    if constexpr (
        ON_FLOOR) {  // a warp finds out which of its strips are to be looked through; then all warps share them
        const unsigned own = Strips::of_warp(threadIdx.x / WARP_SIZE, lane / 4);
        const unsigned missed =
            plane_receiver_cull(view, floor, list.bounds, task.region, lane)
                .missed(float(task.region.left + Strips::column(own)), float(task.region.top + Strips::row(own)));
        const unsigned todo = Strips::ALL_OF_WARP & ~(floors & missed);
        if (lane == 0 && todo)
            atomicOr(&list.strips, todo << threadIdx.x / WARP_SIZE);
        __syncwarp();
    }
    unsigned strip = 0, asking = 0;  // lanes that have found pixels in a strip's tiles, as far as these are to be done
    const auto next_tile = [&](int& found) {
        while (!asking) {
            if constexpr (SURVEYED) {
                strip = __shfl_sync(FULL_WARP, lane == 0 ? draw_next(list.next_tile) : 0, 0);
                if (strip >= unsigned(Asking_::COUNT))
                    return false;
                asking = asking_tiles.of[strip];
                continue;
            }
            if constexpr (ON_FLOOR) {
                if (!take_strip(list.strips, strip, lane))
                    return false;
            } else {
                strip = __shfl_sync(FULL_WARP, lane == 0 ? draw_next(list.next_tile) : 0, 0);
                if (strip >= Strips::COUNT)
                    return false;
            }
            const int column = Strips::column(strip) + Strips::lane_column(lane);
            const int row = Strips::row(strip) + Strips::lane_row(lane);
            const int i = task.region.left + column, j = task.region.top + row;
            const size_t at = task.corner + unsigned(row * target.width + column);
            const int inside = j < target.height ? target.width - i : 0;
            asking = __ballot_sync(
                FULL_WARP, find_asking<Strips::TILES>(target, at, inside, float(i), float(j), list, view, task.fresh));
            __syncwarp();  // masks that one lane clears another may write
        }
        const int first_lane = ctz(asking);
        const bool may_ask = !SURVEYED || (asking >> lane & 1);
        asking = SURVEYED ? 0 : asking & ~Strips::lanes_of(first_lane);
        const int column = (SURVEYED ? Asking_::column(strip) : Strips::column(strip) + Strips::tile_column(first_lane))
                           + lane % TILE_WIDTH;
        const int row = (SURVEYED ? Asking_::row(strip) : Strips::row(strip)) + lane / TILE_WIDTH;
        const size_t at = task.corner + unsigned(row * target.width + column);
        const int column_in_view = task.region.left + column, row_in_view = task.region.top + row;
        const bool inside = (column_in_view < target.width) & (row_in_view < target.height);
        const int id = inside ? target.shape.data[at] : -1;
        const float depth = inside ? target.depth.data[at] : 0.0f;
        const float i = float(column_in_view), j = float(row_in_view);
        const LightSpacePoint place = place_of(view.light.distant, view.lit.point(i, j, depth));
        const bool asks = may_ask && id >= 0 && may_be_shaded(list, place);
        bool open = asks;
        // with a mesh or two each pixel's own place tells as soon
        const TileBounds around = HAS_MESH && list.count <= FEW_CASTERS ? whole_tile() : bounds_uv_around(place, asks);
        if (!HAS_MESH && !may_occlude(list, around))
            return true;
        const Vec3 p = view.reconstructor.point(i, j, depth);
        const Span span = span_of(view.light, view.origin, p, depth);
        unsigned met[WORDS] {};
        const bool met_any = shade_tile<Types>(list, view, p, id, span, place, around, open, fields, met);
        if (HAS_MESH) {
            bool keep = open && met_any, tries = keep;
            const int slot = keep ? slot_to_try(list, met, id) : 0;
            const ShapeRecord& record = list.records[slot];
            const Ray ray = look_back(record, list.aims[slot], p, view.light.distant);
            if (keep && record.axis_y.w == id) {
                const Vec3 view_direction = transform_rows(record, view.reconstructor.along_of(p, i, j));
                const Facing facing =
                    face_light<Types>(meshes, record.axis_z.w, target.face.data[at], view.light.distant,
                                      { as_vec3(list.aims[slot]), ray.direction, view_direction });
                keep = (facing.front || view.dims) && (!facing.clear || others_met(list, met, slot));
                tries = keep && !facing.clear;
            }
            if constexpr (uses_occluder_boxes<Types>()) {
                if (blocked_by_boxes(meshes, slot, record.axis_z.w, ray, thin_span(view.light, span), tries)) {
                    mark_shadow<BESIDE>(target, at, task.bit);
                    keep = false;
                }
            }
            const unsigned kept = __ballot_sync(FULL_WARP, keep);
            rays[warp].put(kept, met, (list.count + 31) / 32, row * 64 + column, p, thin_span(view.light, span));
            __syncwarp();
            found = __popc(kept);
        }
        if (asks && !open)
            mark_shadow<BESIDE>(target, at, task.bit);
        if constexpr (SURVEYED)
            asking_tiles.leave_out(strip, asks && !open, lane);
        return true;
    };
    if (HAS_MESH) {
        const auto shade = [&](int pixel) {
            const size_t at = task.corner + unsigned(pixel / 64 * target.width + pixel % 64);
            mark_shadow<BESIDE>(target, at, task.bit);
        };
        cast_rays<Types>(rays[warp], list, view.light, meshes, next_tile, shade);
    } else {
        int none;
        while (next_tile(none)) {
        }
    }
#else
    const Region region = task.region;
    const size_t corner = task.corner;
    const int world = task.world;
    const unsigned bit = task.bit;
    const bool fresh = task.fresh;
    const CasterBounds8<List::CAPACITY> bounds_uv(list);
    Points points;
    constexpr int across = WIDTH / TILE_WIDTH, tiles = across * (HEIGHT / TILE_HEIGHT);
    for (int tile = 0; tile < tiles; ++tile) {
        const int column = tile % across * TILE_WIDTH, left = region.left + column;
        const int row = tile / across * TILE_HEIGHT;
        const size_t first = corner + size_t(row) * target.width + column;
        if (!points.template load<Types>(view, target, first, left, region.top + row, bit, fresh))
            continue;
        shade_tile<Types>(list, bounds_uv, view, world, shapes, meshes, fields, points);
        points.mark(target, first, bit);
    }
#endif
}

// Shadows in one region of one view; the index runs as in draw(). The list is filled and used once for each light, and
// again as often as the scene's shapes need.
template <class Types, int LENS, int CAPACITY, int WIDTH, int HEIGHT, class Shapes, class Materials, class Meshes,
          class HeightFields, class Lights, class Views, class Target>
WARPCAM_DEVICE void cast(const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                         const HeightFields& fields, const Lights& lights, const Views& views, const Target& target,
                         int index)
{
    constexpr int BESIDE = lights_per_batch<Types, CAPACITY>();
    WARPCAM_SHARED CasterList<CAPACITY, Types::has(MESH), BESIDE == 2 && uses_occluder_boxes<Types>()> lists[BESIDE];
    WARPCAM_SHARED LightPass<LENS> tasks[BESIDE];
    const int thread = index % THREADS, block = index / THREADS;
    const int columns = (target.width + WIDTH - 1) / WIDTH, rows = (target.height + HEIGHT - 1) / HEIGHT;
    WARPCAM_SHARED Floor floor;
    int world;
    const int part = part_of<Types::has(MIDDLE_FIRST)>(block, columns, rows, world);
    if (!wp::index(target.mask, world))
        return;
    const Region region { part % columns * WIDTH, part / columns * HEIGHT, WIDTH, HEIGHT };
    const int total = shapes.drawn.shape[0], num_lights = lights.types.shape[1];

#if defined(__CUDA_ARCH__)
    if constexpr (uses_plane_cull<Types, LENS, WIDTH, HEIGHT>())
        if (thread == THREADS - 1)
            floor = load_floor(shapes, load_camera(wp::index(views, world)), world, target.plane);
#endif
#if defined(__CUDA_ARCH__)
    constexpr bool FULL = Types::has(MESH) && CAPACITY >= FULL_LIST;
    WARPCAM_SHARED ReceiverBounds covers[FULL ? THREADS / WARP_SIZE : 1];
    WARPCAM_SHARED optional_t<FULL, NearPlaces> near_places;
    WARPCAM_SHARED AskingTiles<FULL ? WIDTH : 0, FULL ? HEIGHT : 0> asking_tiles;
    if constexpr (FULL)
        clear_shadows<WIDTH, HEIGHT>(target, region, world, thread);
#else
    constexpr bool FULL = false;
    AskingTiles<0, 0> asking_tiles;
#endif
    ActiveLights active = active_lights(lights);
    const size_t corner = (size_t(world) * target.height + region.top) * target.width + region.left;
    bool fresh = !FULL;  // masks are still to be cleared
    unsigned floors = 0;
#if defined(__CUDA_ARCH__)
    if constexpr (uses_plane_cull<Types, LENS, WIDTH, HEIGHT>()) {
        if (target.width % 4 == 0 && region.left + WIDTH <= target.width && region.top + HEIGHT <= target.height) {
            floors = find_floors<WIDTH, HEIGHT>(target, corner, target.plane);
            fresh = false;
        }
    }
#endif
#if defined(__CUDA_ARCH__)
    if constexpr (BESIDE > 1) {
        if (fresh)
            clear_shadows<WIDTH, HEIGHT>(target, region, world, thread);
        const int warp = thread / WARP_SIZE;
        unsigned casting = 0;  // of 32 lights those that do
        int first = 0, place = -1;
        while (casting || first < num_lights) {
            if (!casting) {
                place = active.next_of_lanes(lights, world, first + thread % WARP_SIZE, num_lights);
                casting = __ballot_sync(FULL_WARP, place >= 0 && casts(lights, world, first + thread % WARP_SIZE));
                first += WARP_SIZE;
                continue;
            }
            int found = 0, own = 0;
            for (; casting && found < BESIDE; casting &= casting - 1, ++found)
                own = found == warp ? ctz(casting) : own;
            const int own_place = __shfl_sync(FULL_WARP, place, own);
            own += first - WARP_SIZE;
            block_sync();  // the lists may still be in use, masks not yet cleared
            if (warp < found) {
                auto& list = lists[warp];
                const int lane = thread % WARP_SIZE;
                if (lane == 0)
                    list.count = list.next_tile = list.strips = 0;
                const Camera camera = load_camera(wp::index(views, world));
                const ReceiverView<LENS> view = light_view<Types, LENS>(lights, camera, world, own);
                if (lane == 0)
                    tasks[warp] = { view, region, corner, world, 1u << own_place, false };
                warp_sync();
                collect_casters<Types, WARP_SIZE>(list, 0, AllCasters {}, shapes, materials, meshes, fields, view.light,
                                                  camera, world, lane);
                warp_sync();
                if constexpr (uses_occluder_boxes<Types>()) {
                    for (int slot = 0; slot < list.count; ++slot)
                        if (list.records[slot].axis_x.w == MESH)
                            outline_caster(list, slot, view.light, meshes);
                    warp_sync();
                }
                find_bounds(list);
            }
            block_sync();
#pragma unroll 1
            for (int k = 0; k < found; ++k) {
                if (lists[k].count == 0)
                    continue;
                cast_light<Types, LENS, WIDTH, HEIGHT>(lists[k], asking_tiles, tasks[k], shapes, meshes, fields, target,
                                                       floor, floors);
            }
        }
        return;
    }
#endif
    auto& list = lists[0];
    auto& task = tasks[0];
    int begin = 0, listed = 0;  // the first shape that was not asked for; places near the region that were listed
    const auto gather = [&](const LightView& light, const Camera& camera) {  // true if there are more
#if defined(__CUDA_ARCH__)
        if constexpr (FULL) {
            if (begin == 0) {
                survey_region<Types>(task, shapes, target, covers, asking_tiles, thread);
                if (thread == 0)
                    near_places.count = 0;
                listed = 0;
                block_sync();
            }
            const NearCasters wanted { covers[0] };
            if (!wanted.cover.any)
                return false;
            if (listed >= near_places.count) {
                begin =
                    find_near<Types>(near_places, begin, wanted, shapes, meshes, fields, light, camera, world, thread);
                listed = 0;
            }
            gather_near<Types>(list, near_places, listed, wanted, shapes, materials, meshes, fields, light, camera,
                               world, thread);
            listed += CAPACITY;
            return begin < total || listed < near_places.count;
        }
#endif
        begin = gather_casters<Types>(list, begin, AllCasters {}, shapes, materials, meshes, fields, light, camera,
                                      world, thread);
        return begin < total;
    };
    for (int number = 0; number < num_lights; ++number) {
        const int place = active.next(lights, world, number);
        if (place < 0 || !casts(lights, world, number))
            continue;
        begin = 0;
        bool more = true;
        while (more) {
            block_sync();  // the list may still be in use
            if (thread == 0)
                list.count = list.next_tile = list.strips = 0;
            {
                const Camera camera = load_camera(wp::index(views, world));
                const ReceiverView<LENS> own = light_view<Types, LENS>(lights, camera, world, number);
                if (thread == 0)
                    task = { own, region, corner, world, 1u << place, fresh };
                block_sync();
                more = gather(own.light, camera);
            }
            if (list.count > 0)
                cast_light<Types, LENS, WIDTH, HEIGHT>(list, asking_tiles, task, shapes, meshes, fields, target, floor,
                                                       floors);
            fresh = fresh && list.count == 0;
        }
    }
    if (fresh)  // nothing casts a shadow
        clear_shadows<WIDTH, HEIGHT>(target, region, world, thread);
}

}  // namespace warpcam
