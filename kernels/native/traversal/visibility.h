// The trace: for every pixel of a view the nearest shape, its face and depth, and what follows from these alone.
#pragma once
#include "traversal/trace_target.h"
#include "traversal/enclosing_mesh_cull.h"
#include "traversal/mesh_closest_hit.h"
#include "traversal/list_shapes.h"
#include "traversal/projected_faces.h"
#include "traversal/tile_marks.h"
#if !defined(__CUDA_ARCH__)
#include "traversal/trace_target_simd.h"
#endif

namespace warpcam {

#if defined(__CUDA_ARCH__)

// Draws the tiles of a region against the list, a warp TILES_PER_WARP of them at once, one below the other.
template <class Types, int LENS, class List, class TraceTarget_, class Meshes, class HeightFields>
WARPCAM_DEVICE void draw_tiles(List& list, const TraceTarget_& trace_target, const Meshes& meshes,
                               const HeightFields& fields, bool first_pass)
{
    constexpr int TILES_PER_WARP = TraceTarget_::TILES_PER_WARP;
    constexpr bool HAS_MESH = Types::has(MESH), HAS_VECTORS = TraceTarget_::VECTOR_OUTPUTS != 0;
    WARPCAM_SHARED typename MeshRaysOf<HAS_MESH ? List::SIZE : 1>::type rays[HAS_MESH ? THREADS / WARP_SIZE : 1];
    constexpr bool MARKED = HAS_MESH && TraceTarget_::FROM_VIEW;
    using Marks = TileMarks<MARKED ? List::SIZE : WARP_SIZE>;
    WARPCAM_SHARED optional_t<MARKED, Marks> marks;
    constexpr bool PROJECTS = TraceTarget_::PROJECTS;  // faces of small enough meshes
    WARPCAM_SHARED optional_t<PROJECTS, ProjectedFaces> projected;
    WARPCAM_SHARED float4 lanes[HAS_VECTORS ? THREADS / WARP_SIZE : 1][TILES_PER_WARP * 3 * WARP_SIZE / 4];
    int lane = threadIdx.x % WARP_SIZE;
    const int warp = threadIdx.x / WARP_SIZE;
    asm("" : "+r"(lane));  // a register for that, none for the thread's number
    float* row_of_lanes = reinterpret_cast<float*>(lanes[HAS_VECTORS ? warp : 0]);
    const Region region = trace_target.region;
    const float near = trace_target.camera.near;
    constexpr int TILE_COLUMNS_PER_WARP =
        TraceTarget_::TILE_COLUMNS_PER_WARP;  // stacks beside each other that are looked at together
    const int across = region.width / (TILE_COLUMNS_PER_WARP * TILE_WIDTH),
              levels = (region.height / TILE_HEIGHT + TILES_PER_WARP - 1) / TILES_PER_WARP;
    // A part has so many levels of units, the last one perhaps fewer.
    const int of_part = across * ((levels + trace_target.parts - 1) / trace_target.parts),
              begin = trace_target.part * of_part;
    const int units = trace_target.parts == 1 ? of_part : min(begin + of_part, across * levels);
    const unsigned per_level = unsigned(65536.0f * rcp(float(across))) + 1u;  // of 65536; exact below 8192 units
    // Gives each warp tiles of its own where tiles take about as long as each other: one of four, and of the next four
    // the next. Not where much is stored: warps drift apart then, and memory receives partial lines.
    constexpr int WARPS = THREADS / WARP_SIZE;
    constexpr bool OWN = TILES_PER_WARP > 1 && !TraceTarget_::STORES_MUCH;
    int own = warp;
    bool alone = TraceTarget_::APART && warp != WARPS - 1;  // the motions are not there yet
    const auto trace_meshes = [&] {
        if constexpr (TraceTarget_::APART)
            if (alone)
                named_barrier_sync<MOTIONS_THERE, THREADS>();
        alone = false;
    };
    if constexpr (MARKED) {
        marks.template mark<Types>(list, across, threadIdx.x);
        block_sync();
    }
    const auto ray_of = [&](int place) { return trace_target.ray(region.left + place % 64, region.top + place / 64); };
    if constexpr (PROJECTS)
        projected.template find<Types>(list, meshes, trace_target.camera, region, ray_of);
    const auto draw_stack = [&](int unit, int column, int row, int& found) {
        if constexpr (MARKED)
            if (!first_pass && !marks.touches(unit)) {
                found = 0;
                return;
            }
        const int i = region.left + column * TILE_WIDTH + int(unsigned(lane) % TILE_WIDTH);
        const int j = region.top + row * TILE_HEIGHT + int(unsigned(lane) / TILE_WIDTH);
        decltype(trace_target.ray(i, j)) ray[TILES_PER_WARP];
        Hit hit[TILES_PER_WARP];
        for (int k = 0; k < TILES_PER_WARP; ++k) {
            ray[k] = trace_target.ray(i, j + k * TILE_HEIGHT);
            hit[k] = trace_target.start(i, j + k * TILE_HEIGHT, first_pass);
        }
        const unsigned steps = PackedTileRect::steps(column, row, 1, TILES_PER_WARP);
        const auto shapes_of = [&](int begin) {
            if constexpr (MARKED)
                return marks.touching(unit, begin / WARP_SIZE) & ~marks.meshes[begin / WARP_SIZE];
            else
                return touching<Types>(list, begin, steps);
        };
        unsigned mask = shapes_of(0);
        if constexpr (TraceTarget_::BARE_FLOORS)
            if (first_pass && (mask & list.floor.bit) && list.floor.test(ray, hit)) {
                mask ^= list.floor.bit;
                if (TraceTarget_::PUTS_BARE && mask == 0u && !touching_more<Types>(list, steps)) {
                    trace_target.write_plane_tile(i, j, ray, hit, row_of_lanes);
                    return;
                }
            }
        trace_tiles<Types>(list, mask, shapes_of, ray, near, fields, hit);
        trace_meshes();
        if constexpr (PROJECTS)
            projected.take(list, (j - region.top) * 64 + i - region.left, hit[0]);
        if (!trace_target.write_seen_plane(i, j, hit, lane))
            trace_target.put_tiles(i, j, ray, hit, first_pass, row_of_lanes);
        if constexpr (HAS_MESH)
            found = find_rays<Types>(rays[HAS_MESH ? warp : 0], list, column, row, ray[0], near_of(ray[0], near),
                                     meshes, hit[0].depth, [&](int word) {
                                         unsigned apart = 0;
                                         if constexpr (PROJECTS)
                                             apart = projected.ranks[word];
                                         if constexpr (MARKED)
                                             return marks.touching(unit, word) & marks.meshes[word] & ~apart;
                                         else
                                             return touching_meshes<Types>(list, word * WARP_SIZE, steps) & ~apart;
                                     });
    };
    const auto next_tile = [&](int& found) {
        const int unit = begin + (OWN ? own : __shfl_sync(FULL_WARP, lane == 0 ? draw_next(list.next_tile) : 0, 0));
        own = (((own + 1) & (WARPS - 1)) | (own & ~(WARPS - 1))) + WARPS;
        if (unit >= units)
            return false;
        const int level = TraceTarget_::WHOLE ? unsigned(unit) / unsigned(across) : unsigned(unit) * per_level >> 16;
        const int column = TILE_COLUMNS_PER_WARP * (unit - level * across), row = TILES_PER_WARP * level;
        if constexpr (TILE_COLUMNS_PER_WARP > 1) {
            const unsigned bare = list.floor.bit;
            if (bare != 0u
                && touching<Types>(list, 0, PackedTileRect::steps(column, row, TILE_COLUMNS_PER_WARP, TILES_PER_WARP))
                       == bare
                && trace_target.write_plane_rows(column * TILE_WIDTH, row * TILE_HEIGHT, lane))
                return true;
        }
#pragma unroll 1
        for (int k = 0; k < TILE_COLUMNS_PER_WARP; ++k)
            draw_stack(unit + k, column + k, row, found);
        return true;
    };
    if constexpr (HAS_MESH) {
        const auto store = [&](int pixel, const Hit& hit) {
            trace_target.write_hit(region.left + pixel % 64, region.top + pixel / 64, hit, false);
        };
        trace_rays<Types>(rays[HAS_MESH ? warp : 0], list, meshes, near, next_tile, ray_of, store);
    } else {
        int none;
        while (next_tile(none)) {
        }
    }
    trace_meshes();
}

// Draws a region of few shapes, whose motions the last warp composes meanwhile: the first warp lists and sorts shapes,
// the others start to draw when it has, and wait for the motions before they write the first flow.
template <class Types, int LENS, bool HITS_NAME_SLOTS, int CAPACITY, class TraceTarget_, class Shapes, class Meshes,
          class HeightFields, class Hidden>
WARPCAM_DEVICE void draw_apart(ShapeList<CAPACITY>& list, const TraceTarget_& trace_target, const Shapes& shapes,
                               const Meshes& meshes, const HeightFields& fields, const Hidden& hidden, int world,
                               int thread, bool not_drawn)
{
    static_assert(CAPACITY <= WARP_SIZE && !Types::has(MESH));
    if (thread >= THREADS - WARP_SIZE) {
        trace_target.begin(thread);
        trace_target.ready();
        named_barrier_arrive<MOTIONS_THERE, THREADS>();
        trace_target.follow_floor(trace_target.camera);
        named_barrier_sync<SHAPES_SORTED, THREADS>();
        trace_target.template look_at_floor<WARP_SIZE>(thread % WARP_SIZE);
    } else {
        if (thread < WARP_SIZE) {
            if (!not_drawn)
                build_shape_list<Types, LENS, HITS_NAME_SLOTS, true>(
                    list, 0, shapes, meshes, fields, hidden, trace_target.camera, trace_target.region, world, thread);
            if (thread == 0 && list.broken) {  // nothing of this world can be trusted
                list.count = 0;
                trace_target.target.faults.data[world] = 1;
            }
            warp_sync();
            sort_by_depth(list, thread, [&](int slot, int rank) { trace_target.note(list, slot, rank); });
            trace_target.face(thread, WARP_SIZE);
        } else {
            trace_target.find_floor(thread - WARP_SIZE);
        }
        trace_target.ready();
        named_barrier_sync<FIRST_WARPS, THREADS - WARP_SIZE>();
        named_barrier_arrive<SHAPES_SORTED, THREADS>();
    }
    draw_tiles<Types, LENS>(list, trace_target, meshes, fields, true);
}

#else

// Draws the tiles of a region against the list.
template <class Types, int LENS, int CAPACITY, class TraceTarget_, class Meshes, class HeightFields>
inline void draw_tiles(ShapeList<CAPACITY>& list, const TraceTarget_& trace_target, const Meshes& meshes,
                       const HeightFields& fields, bool first_pass)
{
    const Region region = trace_target.region;
    TileRow<CAPACITY> picked;
    for (int row = 0; row < region.height / TILE_HEIGHT; ++row) {
        pick_row(list, row, picked);
        for (int column = 0; column < region.width / TILE_WIDTH; ++column) {
            const int left = region.left + column * TILE_WIDTH, top = region.top + row * TILE_HEIGHT;
            Rays rays;
            NearOf<decltype(trace_target.ray(0, 0))> near { trace_target.camera.near };
            start_tile(trace_target, left, top, first_pass, near, rays);
            trace_tile<Types, LENS>(list, picked, column, near, meshes, fields, rays);
            put_tile(trace_target, left, top, first_pass, rays);
        }
    }
}

#endif

// For one thread, before the block meets for the first time.
template <int CAPACITY> WARPCAM_DEVICE void begin_list(ShapeList<CAPACITY>& list)
{
    list.broken = 0;
    list.count = 0;
    list.next_tile = 0;
#if defined(__CUDA_ARCH__)
    list.floor.begin();
#endif
}

// Draws the shapes that are not hidden into the trace target's region; the list has begun. MULTIPASS: the scene may
// have more shapes than the list holds; then the region is drawn in several passes, each going on from the depth of the
// last. late(): what may wait until shapes are listed, and needs no other threads.
template <class Types, int LENS, bool HITS_NAME_SLOTS, bool MULTIPASS, int CAPACITY, class TraceTarget_, class Shapes,
          class Meshes, class HeightFields, class Hidden, class Late>
WARPCAM_DEVICE void draw_region(ShapeList<CAPACITY>& list, const TraceTarget_& trace_target, const Shapes& shapes,
                                const Meshes& meshes, const HeightFields& fields, const Hidden& hidden,
                                const Late& late, int world, int thread)
{
    const bool not_drawn = !(abs(trace_target.camera.origin.x) < MISS);
#if defined(__CUDA_ARCH__)
    if constexpr (TraceTarget_::APART)
        return draw_apart<Types, LENS, HITS_NAME_SLOTS>(list, trace_target, shapes, meshes, fields, hidden, world,
                                                        thread, not_drawn);
#endif
    constexpr bool FROM_VIEW = TraceTarget_::FROM_VIEW;
    int total = not_drawn ? 0 : shapes.drawn.shape[0];
    int begin = 0;
    bool first = true;
#if defined(__CUDA_ARCH__)
    [[maybe_unused]] const auto in_view = [&] {
        if constexpr (FROM_VIEW)
            return ListInView::of(trace_target.target.lists, trace_target.world);
        else
            return 0;
    }();
    [[maybe_unused]] float farthest = MISS;
    if constexpr (FROM_VIEW)
        total = in_view.count();
#endif
    do {
        if (MULTIPASS && !first) {
            if (thread == 0) {
                list.count = 0;
                list.next_tile = 0;
            }
            block_sync();
        }
        trace_target.begin(thread);
#if defined(__CUDA_ARCH__)
        if constexpr (FROM_VIEW)
            begin = choose_in_view<Types, LENS, HITS_NAME_SLOTS>(
                list, begin, in_view, farthest,
                Cells::of(trace_target.region, trace_target.target.width, trace_target.target.height), shapes, meshes,
                fields, hidden, trace_target.camera, trace_target.region, world, thread);
#endif
        if (!FROM_VIEW && !not_drawn)
            begin = build_shape_list<Types, LENS, HITS_NAME_SLOTS, false>(
                list, begin, shapes, meshes, fields, hidden, trace_target.camera, trace_target.region, world, thread);
        if (list.broken) {  // nothing of this world can be trusted
            block_sync();
            if (thread == 0) {
                list.count = 0;
                trace_target.target.faults.data[world] = 1;
            }
            begin = total;
            first = true;
            block_sync();
        }
        if constexpr (Types::has(MESH) && LENS == PINHOLE)
            cull_enclosing_meshes<Types>(list, meshes, rays_of_region(trace_target.camera, trace_target.region), thread,
                                         [&](const ShapeRecord& record) {
                                             return TraceTarget_::PROJECTS
                                                    && projects_mesh(record, meshes, trace_target.region);
                                         });
        trace_target.ready();
        sort_by_depth(list, thread, [&](int slot, int rank) { trace_target.note(list, slot, rank); });
        trace_target.face(thread, THREADS);
        block_sync();
        late();
        draw_tiles<Types, LENS>(list, trace_target, meshes, fields, !MULTIPASS || first);
        first = false;
        block_sync();
#if defined(__CUDA_ARCH__)
        if constexpr (FROM_VIEW)
            if (begin < total)
                farthest = deepest(trace_target, list.ids, thread);
#endif
    } while (MULTIPASS && begin < total);
}

// Shared memory of a block. LINES: columns and rows of pixels.
template <int CAPACITY, int LINES, class Places_, class Facings_> struct TraceShared {
    ShapeList<CAPACITY> list;
    alignas(16) Camera camera;  // kept in registers it would be spilled
    Places_ places;
    Facings_ facings;
    float lines[LINES];  // see TraceTarget
};

// Draws one region of one view; `index` counts worlds, then regions, then (CUDA) threads of the block.
// MULTIPASS: depth and shape are always written. With OPAQUE outputs shapes that are transparent are left out.
// Near: Places, or what else the block keeps for its images.
template <class Types, int LENS, int CAPACITY, bool MULTIPASS, int WIDTH, int HEIGHT, int OUTPUTS, class Near,
          class Shapes, class Materials, class Meshes, class HeightFields, class Views, class Target>
WARPCAM_DEVICE void draw_with(const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                              const HeightFields& fields, const Views& views, const Target& target, int index)
{
    static_assert(!names_slots(OUTPUTS)
                  || (Types::ANALYTIC == Types::GEOMETRY && (Types::FEATURES & ~(1 << PLANES_FROM_BEHIND)) == 0));
    constexpr bool FLOWING = (OUTPUTS & FLOWS) != 0;
    using TraceTarget_ = TraceTarget<Types, LENS, OUTPUTS, ShapeList<CAPACITY>, tiles_at_once<Types>(WIDTH, HEIGHT),
                                     Target, Shapes, Near>;
    using Room = TraceShared<CAPACITY, TraceTarget_::LINED ? WIDTH + HEIGHT : 1, Near, typename TraceTarget_::Facings_>;
    WARPCAM_SHARED Room shared;
    Room& room = keep_shared_address(shared);
    ShapeList<CAPACITY>& list = room.list;
    Camera& camera = room.camera;
    Near& places = room.places;
    const int thread = index % THREADS;
    int world = warp_uniform(index / THREADS);
    Region region { 0, 0, WIDTH, HEIGHT };
    if constexpr (!(OUTPUTS & FLOW_WHOLE)) {
        region = region_of<WIDTH, HEIGHT, Types::has(MIDDLE_FIRST)>(target, world, world);
        world = warp_uniform(world);
        region = { warp_uniform(region.left), warp_uniform(region.top), warp_uniform(region.width),
                   warp_uniform(region.height) };
    }
    const bool wanted = wp::index(target.mask, world);  // the view is on its way meanwhile
    if (thread == 0) {
        camera = load_camera(wp::index(views, world));
        begin_list(list);
        if constexpr (FLOWING)
            places.locate(target.history, world);
    }
    if constexpr (FLOWING && (OUTPUTS & FLOW_LISTED))
        if (thread == THREADS / 2)
            places.previous = load_camera(wp::index(target.history.views_before, world));
    if (!wanted)
        return;
    block_sync();
    if constexpr (FLOWING)
        places.fetch(shapes, target.history, thread);
    if constexpr (TraceTarget_::LINED)
        for (int n = thread; thread < THREADS - WARP_SIZE && n < WIDTH + HEIGHT;
             n += THREADS - WARP_SIZE)  // see draw_apart()
            room.lines[n] =
                n < WIDTH ? image_x(camera, float(region.left + n)) : image_y(camera, float(region.top + n - WIDTH));
    const TraceTarget_ trace_target {
        target, shapes, list,         camera,     region,
        world,  places, room.facings, room.lines, room.lines + (TraceTarget_::LINED ? WIDTH : 0)
    };
    const auto hidden = [&](int id, bool formless) {
        if constexpr ((OUTPUTS & OPAQUE) != 0)
            if (!formless)
                return !solid<Types::has(ALPHA_TESTED)>(shapes, materials, target.transparent_index, world, id);
        const bool unseen = transparent(shapes, materials, world, id);
        if (formless && !unseen)
            target.faults.data[world] = 1;
        return unseen || formless;
    };
    const auto draw = [&](const auto& late) {
        draw_region<Types, LENS, names_slots(OUTPUTS), MULTIPASS>(list, trace_target, shapes, meshes, fields, hidden,
                                                                  late, world, thread);
    };
    if constexpr (Near::WRITES_ALBEDO) {
        const auto scene = places.scene_of(shapes, meshes, fields, materials, target.textures);
        places.begin(scene, camera, region, target.plane, world, thread);
        draw([&] { places.load_looks(scene, camera, world, thread); });
        places.finish(scene, target, camera, region, world, thread);
    } else {
        draw([] {});
    }
}

template <class Types, int LENS, int CAPACITY, bool MULTIPASS, int WIDTH, int HEIGHT, int OUTPUTS, class Shapes,
          class Materials, class Meshes, class HeightFields, class Views, class Target>
WARPCAM_DEVICE void draw(const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                         const HeightFields& fields, const Views& views, const Target& target, int index)
{
    using Near = typename Places<OUTPUTS, WIDTH, HEIGHT, (OUTPUTS & FLOW_LISTED) ? CAPACITY : 0,
                                 looks_at_floors<Types>(LENS, OUTPUTS, CAPACITY, WIDTH, HEIGHT)>::type;
    draw_with<Types, LENS, CAPACITY, MULTIPASS, WIDTH, HEIGHT, OUTPUTS, Near>(shapes, materials, meshes, fields, views,
                                                                              target, index);
}

}  // namespace warpcam
