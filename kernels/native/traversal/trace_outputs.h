// Outputs of the trace, and the choices that follow from them.
#pragma once
#include "flow/visibility_history.h"

namespace warpcam {

// Output flags of the trace. WIDTH_MULTIPLE_OF_4: the image's width is a multiple of four pixels; NO_PARTIAL_TILES: no
// tile reaches over its edges. IDS: the ids that shapes have in each world; BY_WORLD: bodies have such ids, too.
// INSTANCES, SEMANTICS: labels. OPAQUE: transparent shapes are left out.
enum Output {
    DEPTH = 1,
    SHAPE = 2,
    FACE = 4,
    DISTANCE = 8,
    POINTS = 16,
    BODIES = 32,
    NORMAL = 64,
    WIDTH_MULTIPLE_OF_4 = 128,
    NO_PARTIAL_TILES = 256,
    LISTED_AHEAD = 512,  // the stage of views has listed the shapes: traversal/visibility_listed.h
    IDS = 1 << 16,
    BY_WORLD = 1 << 17,
    INSTANCES = 1 << 18,
    SEMANTICS = 1 << 19,
    OPAQUE = 1 << 20,
    TRACE_ALBEDO = 1 << 21,  // with albedo: shading_pass/visibility_albedo.h
    IN_VIEW = 1 << 22,  // the shapes in view have been listed: traversal/shapes_in_view.h
    PROJECTED_FACES = 1 << 23  // of moving meshes: traversal/projected_faces.h
};

// Tiles, one below the other, that a warp of a CUDA block draws at once: what a tile takes and what a shape takes of it
// besides the rays is then paid once. Small regions have too few of them. kernels/plan/trace.py has the same.
template <class Types> constexpr int tiles_at_once(int width, int height)
{
    const bool is_analytic = !Types::has_any(MESH, HEIGHT_FIELD);
    return is_analytic && width * height >= 32 * 32 ? 2 : 1;
}

// Number of blocks that share an image whose shapes have been listed. For 64x64 pixels: a launch that stores much ends
// sooner with short blocks; one that stores little starts them too often; for validity each block would test the whole
// plane. No block has less than a pixel a thread. Blocks of larger images have whole rows of stacks of tiles.
// kernels/plan/trace.py has the same rule.
constexpr int parts_of(int outputs, int width, int height)
{
    constexpr int PIXELS = 64 * 64, STACK = 2 * TILE_HEIGHT;
    const int more = outputs & (DISTANCE | BODIES | INSTANCES | SEMANTICS) && width * height <= PIXELS ? 2 : 1;
    const int vectors = (outputs & POINTS ? 1 : 0) + (outputs & NORMAL ? 1 : 0);
    const int wanted = outputs & FLOW_VALID ? 1 : vectors ? 4 * vectors : outputs & FLOW ? 2 : more;
    const int most = min(width * height / THREADS, height / TILE_HEIGHT), rows = PIXELS / (STACK * wanted * width);
    if (width * height <= PIXELS)
        return wanted < most ? wanted : most;
    return rows > 1 ? (height / STACK + rows - 1) / rows : height / STACK;
}

#if !defined(__CUDA_ARCH__)

// Images of the trace as a type.
template <int IMAGES> struct Images {
    static constexpr int SET = IMAGES;
};

// True if an image is written: CPU kernels are compiled for all of OUTPUTS and write those that are there.
template <int WHAT, class Target> inline bool is_written(const Target& target)
{
    if constexpr (WHAT == DEPTH)
        return target.depth.data != nullptr;
    else if constexpr (WHAT == SHAPE)
        return target.shape.data != nullptr;
    else if constexpr (WHAT == FACE)
        return target.face.data != nullptr;
    else if constexpr (WHAT == DISTANCE)
        return target.distance.data != nullptr;
    else if constexpr (WHAT == POINTS)
        return target.points.data != nullptr;
    else if constexpr (WHAT == BODIES)
        return target.bodies.data != nullptr;
    else if constexpr (WHAT == IDS)
        return target.ids.data != nullptr;
    else if constexpr (WHAT == INSTANCES)
        return target.labels.instances.data != nullptr;
    else if constexpr (WHAT == SEMANTICS)
        return target.labels.semantics.data != nullptr;
    else
        return WHAT != 0;
}

// Calls put(Images) for those of OUTPUTS that are written: several together where they share what they compute.
template <int OUTPUTS, class Target, class Put> inline void put_written(const Target& target, const Put& put)
{
    const auto put_if = [&](auto images, bool wanted) {
        if constexpr (decltype(images)::SET != 0)
            if (wanted)
                put(images);
    };
    const auto put_one = [&](auto image) { put_if(image, is_written<decltype(image)::SET>(target)); };
    const bool distances = is_written<OUTPUTS & DISTANCE>(target), points = is_written<OUTPUTS & POINTS>(target);
    put_one(Images<OUTPUTS & DEPTH>());
    put_one(Images<OUTPUTS & SHAPE>());
    put_one(Images<OUTPUTS & FACE>());
    put_if(Images<(OUTPUTS & POINTS ? OUTPUTS & (DISTANCE | POINTS) : 0)>(), points && distances);
    put_if(Images<OUTPUTS & DISTANCE>(), distances && !points);
    put_if(Images<OUTPUTS & POINTS>(), points && !distances);
    put_one(Images<OUTPUTS & BODIES>());
    put_one(Images<OUTPUTS & IDS>());
    put_one(Images<OUTPUTS & INSTANCES>());
    put_one(Images<OUTPUTS & SEMANTICS>());
    put_one(Images<OUTPUTS&(NORMAL | FLOWS | FLOW_MOVES)>());
}

#endif

// True if hits name the slot of their shape's record instead of the shape, for normals and albedo: see
// build_shape_list().
constexpr bool names_slots(int outputs) { return outputs & (NORMAL | TRACE_ALBEDO); }

// True if a block tests a plane as a whole against the previous image.
template <class Types> constexpr bool looks_at_floors(int lens, int outputs, int shapes, int width, int height)
{
    const int needs =
        FLOW_VALID | FLOW_COMPACT | FLOW_LISTED | NO_PARTIAL_TILES | (outputs & FLOW_WHOLE ? FLOW_NEAR : 0);
    const bool parts =
        width == FlowFloor::SIZE && height == FlowFloor::SIZE && tiles_at_once<Types>(width, height) == 2;
    return (outputs & needs) == needs && !names_slots(outputs) && parts && Types::has(PLANE) && !Types::has(MESH)
           && lens == PINHOLE && shapes <= WARP_SIZE;
}

// Selects the history of flow, if flow is wanted.
template <int OUTPUTS, int WIDTH, int HEIGHT, int SHAPES, bool FLOORED, bool WANTED = (OUTPUTS & FLOWS) != 0>
struct Places {
    static constexpr bool WHOLE = (OUTPUTS & FLOW_WHOLE) != 0, NEAR = (OUTPUTS & FLOW_NEAR) != 0;
    using type = VisibilityHistory<OUTPUTS, WHOLE ? WIDTH : 0, WHOLE ? HEIGHT : 0, SHAPES, NEAR, FLOORED>;
};
template <bool WHOLE_> struct NoPlaces {
    static constexpr bool WHOLE = WHOLE_, WRITES_ALBEDO = false, LOOKS_AT_FLOORS = false;
};
template <int OUTPUTS, int WIDTH, int HEIGHT, int SHAPES, bool FLOORED>
struct Places<OUTPUTS, WIDTH, HEIGHT, SHAPES, FLOORED, false> {
    using type = NoPlaces<(OUTPUTS & FLOW_WHOLE) != 0>;
};

}  // namespace warpcam
