// Lists of one world for its paths, made at the beginning of a frame: shapes, lights, shapes that shine.
#pragma once
#include "path/emitters.h"

namespace warpcam {

// Counts one world's paths: a `fresh` frame begins with `samples`, another has `more` added to what it has.
template <class Frame_, class Count>
WARPCAM_DEVICE void count_paths(const Frame_& frame, int samples, const Count& more, int fresh, int world)
{
    if (!wp::index(frame.mask, world))
        return;
    wp::index(frame.begun, world) = fresh ? 0 : wp::index(frame.begun, world) + wp::index(frame.wanted, world);
    wp::index(frame.wanted, world) = fresh ? samples : wp::index(more, 0);
}

// Lists one world's shapes and lights.
template <class Types, class Frame_, class Shapes, class Casters, class Materials, class Physical, class Meshes,
          class HeightFields, class Views>
WARPCAM_DEVICE void list_path_shapes(const Frame_& frame, const Shapes& shapes, const Casters& casters,
                                     const Materials& materials, const Physical& physical, const Meshes& meshes,
                                     const HeightFields& fields, const Views& views, int world)
{
    if (!wp::index(frame.mask, world))
        return;
    const Camera camera = load_camera(wp::index(views, world));
    int* const head = wp::address(frame.heads, world, 0);
    Float3Int* const rows = reinterpret_cast<Float3Int*>(wp::address(frame.rows, world, 0));
    int count = 0, faults = 0;
    const float seen_from = camera.origin.x + camera.origin.y + camera.origin.z;
    head[FAULTY] = !(abs(seen_from) < MISS);
    const auto add = [&](int id, int bits) {
        Float3Int ball;
        ShapeRecord record;
        const Visible found = path_shape<Types>(load_shape(shapes, world, id), camera, meshes, fields, ball, record);
        if (found == BROKEN)
            head[FAULTY] = 1;
        if (found == BROKEN || (found == FORMLESS && !transparent(shapes, materials, world, id)))
            faults = 1;
        if (found != SEEN || transparent(shapes, materials, world, id))
            return;
        put_path_shape(rows + PATH_SHAPE_ROWS * count++, ball, record, bits);
    };
    for (int place = 0; place < shapes.drawn.shape[0]; ++place)
        add(wp::index(shapes.drawn, place), 0);
    for (int place = 0; place < casters.drawn.shape[0]; ++place) {
        const int id = wp::index(casters.drawn, place);
        if (wp::index(shapes.places, id) < 0)
            add(id, UNSEEN_BY_CAMERA);
    }
    head[NUM_SHAPES] = count;
    const auto& lights = physical.plain;
    int lamps = 0;
    for (int light = 0; light < lights.types.shape[1]; ++light) {
        const int type = per_world(lights.types, world, light);
        if (per_world(lights.active, world, light) && (type == LIGHT_SPOT || type == LIGHT_DIRECTIONAL))
            head[FIRST_LAMP + lamps++] = light;
    }
    head[NUM_LAMPS] = lamps;
    int emitters = 0;
    for (int slot = 0; slot < count; ++slot) {
        const int id = rows[PATH_SHAPE_ROWS * slot + 2].w;
        if (is_emitter<Types>(frame, shapes, materials, physical, world, id))
            head[FIRST_LAMP + lamps + emitters++] = id;
    }
    head[NUM_EMITTERS] = emitters;
    if (faults)
        wp::index(frame.faults, world) = 1;
}

}  // namespace warpcam
