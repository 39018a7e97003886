// Visibility in mirrors: traces a view from behind the mirror, for the pixels that show it.
//
// The mirrored view has left and right exchanged; images are written in the orientation of the view itself.
#pragma once
#include "camera/mirror_plane.h"
#include "traversal/visibility.h"

namespace warpcam {

constexpr float ON_MIRROR = 1.0e-3f;  // of a depth: a box shows other sides beside the one that reflects

// Pixel (i, j) is column i of the mirrored view, counted from the other side in the images.
template <class Types, int LENS, bool FACES, class Target> struct MirrorTarget {
    static constexpr int VECTOR_OUTPUTS = 0, TILES_PER_WARP = 1, part = 0, parts = 1;
    static constexpr bool FROM_VIEW = false, PROJECTS = false;

    const Target& target;
    const Camera& camera;
    Region region;
    int world;
    MirrorPlane plane;
    int mirror;  // its shape

    WARPCAM_DEVICE bool inside(int i, int j) const { return i < target.width && j < target.height; }

    WARPCAM_DEVICE unsigned at(int i, int j) const
    {
        return (unsigned(world) * target.height + j) * target.width + (target.width - 1 - i);
    }

    WARPCAM_DEVICE ClippedRay<LENS> ray(int i, int j) const
    {
        const CameraRay<LENS> seen = view_ray<LENS>(camera, i, j);
        return { seen, plane.depth(seen) };
    }

    // True if the mirror is visible at a pixel.
    WARPCAM_DEVICE bool shows(int i, int j) const
    {
        if (!inside(i, j) || target.seen_shape.data[at(i, j)] != mirror)
            return false;
        const float depth = plane.depth(ray(i, j));
        return abs(target.seen_depth.data[at(i, j)] - depth) <= ON_MIRROR * depth;
    }

    WARPCAM_DEVICE Hit start(int i, int j, bool first_pass) const
    {
        Hit hit { shows(i, j) ? camera.far : -1.0f, -1, -1 };
        if (!first_pass && hit.depth > 0.0f && target.shape.data[at(i, j)] >= 0)
            hit.depth = next_float(target.depth.data[at(i, j)]);
        return hit;
    }

    WARPCAM_DEVICE void write_hit(int i, int j, const Hit& hit, bool first_pass) const
    {
        if (!inside(i, j) || !(first_pass || hit.shape >= 0))
            return;
        target.shape.data[at(i, j)] = hit.shape >= 0 ? hit.shape : hit.depth > 0.0f ? -2 : -1;
        target.depth.data[at(i, j)] = hit.depth;
        if (FACES)
            target.face.data[at(i, j)] = hit.face;
    }

    static constexpr bool WHOLE = false, STORES_MUCH = true, APART = false, BARE_FLOORS = false, PUTS_BARE = false;
    static constexpr int TILE_COLUMNS_PER_WARP = 1;
    WARPCAM_DEVICE void begin(int) const {}
    WARPCAM_DEVICE void face(int, int) const {}
    WARPCAM_DEVICE void ready() const {}
    template <class List> WARPCAM_DEVICE void note(List&, int, int) const {}

    WARPCAM_DEVICE bool write_seen_plane(int, int, const Hit (&)[1], int) const { return false; }
    WARPCAM_DEVICE void put_tiles(int i, int j, const ClippedRay<LENS> (&)[1], const Hit (&hits)[1], bool first_pass,
                                  float*) const
    {
        write_hit(i, j, hits[0], first_pass);
    }
};

// True if the shape is a plane with its back to `eye`. MuJoCo's renderer draws such a plane transparent, in mirrors
// too: it counts as a transparent shape.
template <class Types, class Shapes> WARPCAM_DEVICE bool turned_away(const Shapes& shapes, Vec3 eye, int world, int id)
{
    if constexpr (Types::has(PLANE))
        if (wp::index(shapes.types, id) == PLANE) {
            const auto r = wp::index(shapes.rotations, world, id);
            const Vec3 away = eye - as_vec3(wp::index(shapes.positions, world, id));
            return r.data[0][2] * away.x + r.data[1][2] * away.y + r.data[2][2] * away.z < 0.0f;
        }
    return false;
}

// The index runs as in draw().
template <class Types, int LENS, int CAPACITY, bool MULTIPASS, int WIDTH, int HEIGHT, bool FACES, class Shapes,
          class Materials, class Meshes, class HeightFields, class Views, class Target>
WARPCAM_DEVICE void draw_mirrored(const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                                  const HeightFields& fields, const Views& views, const Target& target, int index)
{
    WARPCAM_SHARED ShapeList<CAPACITY> list;
    alignas(16) WARPCAM_SHARED Camera camera;
    const int thread = index % THREADS;
    int world;
    const Region region = region_of<WIDTH, HEIGHT>(target, index / THREADS, world);
    if (!wp::index(target.mask, world))
        return;
    const auto mirror = wp::index(target.mirrors, world);
    if (mirror.shape < 0)
        return;
    if (thread == 0) {
        camera = load_camera(wp::index(views, world));
        begin_list(list);
    }
    block_sync();
    const MirrorTarget<Types, LENS, FACES, Target> trace_target { target, camera,           region,
                                                                  world,  plane_of(mirror), mirror.shape };
    const int itself = mirror.shape;
    const Vec3 eye = as_vec3(mirror.eye);
    const auto hidden = [&](int id, bool formless) {
        return formless || id == itself || !solid(shapes, materials, target.transparent_index, world, id)
               || turned_away<Types>(shapes, eye, world, id);
    };
    draw_region<Types, LENS, false, MULTIPASS>(
        list, trace_target, shapes, meshes, fields, hidden, [] {}, world, thread);
}

}  // namespace warpcam
