// The shapes of a world that hide light, for rays in any direction: a list for each world, made once a frame.
#pragma once
#include "path/path_shapes.h"

namespace warpcam {

// Lists those that cast shadows. `counts`: (world,) how many there are; none where the camera is not finite.
template <class Types, class Frame_, class Casters, class Materials, class Meshes, class HeightFields>
WARPCAM_DEVICE void list_occluders(const Frame_& frame, const Casters& casters, const Materials& materials,
                                   const Meshes& meshes, const HeightFields& fields, int world)
{
    if (!wp::index(frame.mask, world))
        return;
    const Camera camera = load_camera(wp::index(frame.views, world));
    Float3Int* const rows = reinterpret_cast<Float3Int*>(wp::address(frame.rows, world, 0));
    const bool finite = abs(camera.origin.x + camera.origin.y + camera.origin.z) < MISS;
    int count = 0;
    for (int place = 0; finite && place < casters.drawn.shape[0]; ++place) {
        const int id = wp::index(casters.drawn, place);
        Float3Int ball;
        ShapeRecord record;
        const Shape shape = load_shape(casters, world, id);
        if (!transparent(casters, materials, world, id)
            && path_shape<Types>(shape, camera, meshes, fields, ball, record) == SEEN)
            put_path_shape(rows + PATH_SHAPE_ROWS * count++, ball, record, 0);
    }
    wp::index(frame.counts, world) = count;
}

}  // namespace warpcam
