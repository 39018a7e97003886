// The trace of images whose shapes have been listed.
#pragma once
#include "traversal/view_shape_list.h"
#include "traversal/visibility.h"

namespace warpcam {

#if defined(__CUDA_ARCH__)

// Shared memory of a block.
template <class List, int LINES, class Places_> struct ListedRoom {
    List list;
    Places_ places;
    alignas(8) float lines[LINES];  // see TraceTarget
};

// Draws as draw() does, a whole image by one or several blocks.
template <class Types, int LENS, int CAPACITY, bool MULTIPASS, int WIDTH, int HEIGHT, int OUTPUTS, class Shapes,
          class Materials, class Meshes, class HeightFields, class Views, class Target>
WARPCAM_DEVICE void draw_listed(const Shapes& shapes, const Materials&, const Meshes& meshes,
                                const HeightFields& fields, const Views&, const Target& target, int index)
{
    static_assert(!MULTIPASS && (OUTPUTS & FLOW_WHOLE));
    constexpr bool FLOWING = (OUTPUTS & FLOWS) != 0;
    using List = ViewShapeList<CAPACITY, names_slots(OUTPUTS)>;
    using Near = typename Places<OUTPUTS, WIDTH, HEIGHT, (OUTPUTS & FLOW_LISTED) ? CAPACITY : 0,
                                 looks_at_floors<Types>(LENS, OUTPUTS, CAPACITY, WIDTH, HEIGHT)>::type;
    using TraceTarget_ =
        TraceTarget<Types, LENS, OUTPUTS, List, tiles_at_once<Types>(WIDTH, HEIGHT), Target, Shapes, Near>;
    using Room = ListedRoom<List, TraceTarget_::LINED ? WIDTH + HEIGHT : 1, Near>;
    WARPCAM_SHARED Room shared;
    Room& room = keep_shared_address(shared);
    constexpr int PARTS = parts_of(OUTPUTS, WIDTH, HEIGHT);
    static_assert(WIDTH % (TraceTarget_::TILE_COLUMNS_PER_WARP * TILE_WIDTH) == 0);
    const int thread = unsigned(index) % THREADS, block = warp_uniform(unsigned(index) / THREADS);
    const int world = unsigned(block) / PARTS, part = unsigned(block) % PARTS;
    __builtin_assume(world >= 0);
    const auto from = PackedShapeList<CAPACITY, names_slots(OUTPUTS)>::of(target.lists, world);
    from.fetch(room.list, shapes.drawn.shape[0], thread);
    if constexpr (FLOWING)
        room.places.fetch_motions(target.history, world, thread);
    const unsigned char wanted = wp::index(target.mask, world);  // all is on its way before the first is waited for
    if constexpr (TraceTarget_::LINED) {
        constexpr int STACK = TraceTarget_::TILES_PER_WARP * TILE_HEIGHT,
                      ROWS = (HEIGHT / STACK + PARTS - 1) / PARTS * STACK;  // of a part
        const Camera& camera = from.head().camera;
        const int top = PARTS > 1 ? part * ROWS : 0;
#pragma unroll
        for (int k = 0; k < (WIDTH + THREADS - 1) / THREADS; ++k)
            if (const int n = k * THREADS + thread; n < WIDTH)
                room.lines[n] = image_x(camera, float(n));
#pragma unroll
        for (int k = 0; k < (ROWS + THREADS - 1) / THREADS; ++k)
            if (const int n = k * THREADS + (THREADS - 1 - thread);
                n < ROWS && (PARTS * ROWS == HEIGHT || top + n < HEIGHT))
                room.lines[WIDTH + top + n] = image_y(camera, float(top + n));
    }
    if (!wanted) {
        await_rows();
        return;
    }
    const bool finds = thread >= WARP_SIZE && thread < THREADS - WARP_SIZE;
    if constexpr ((OUTPUTS & FLOW_VALID) != 0)
        if (finds || !Near::LOOKS_AT_FLOORS) {
            room.places.locate(target.history, world);  // all write the same
            room.places.fetch(shapes, target.history, thread);
        }
    const TraceTarget_ trace_target {
        target, shapes,      room.list,         room.list.camera, { 0, 0, WIDTH, HEIGHT },
        world,  room.places, room.list.facings, room.lines,       room.lines + (TraceTarget_::LINED ? WIDTH : 0),
        part,   PARTS
    };
    if (finds)
        trace_target.find_floor(thread - WARP_SIZE);
    else if (thread >= THREADS - WARP_SIZE)
        trace_target.follow_floor(from.head().camera);
    await_rows();
    block_sync();
    trace_target.template look_at_floor<THREADS>(thread);
    draw_tiles<Types, LENS>(room.list, trace_target, meshes, fields, true);
}

#endif

}  // namespace warpcam
