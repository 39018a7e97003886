// Which lights reach what a view sees. Each pixel's hit point looks back at each light; the shapes that may stand
// between a tile's points and the light are picked once for the whole tile.
#pragma once
#include "visibility.h"

namespace warpcam {

// The ray from a point of the scene along a direction, both in the world frame. Records for such rays hold the shape's
// position in `origin` and take world directions to the shape's frame.
struct WorldRay {
    Vec point, direction;

    WARPCAM_FN static Vec turned(const Record& record, Vec v)
    {
        const Row ax = record.axis_x, ay = record.axis_y, az = record.axis_z;
        return { ax.x * v.x + ax.y * v.y + ax.z * v.z, ay.x * v.x + ay.y * v.y + ay.z * v.z,
                 az.x * v.x + az.y * v.y + az.z * v.z };
    }

    WARPCAM_FN Ray local(const Record& record) const
    {
        const Row o = record.origin;
        return { turned(record, { point.x - o.x, point.y - o.y, point.z - o.z }), turned(record, direction) };
    }

    WARPCAM_FN RayFrame frame(const Record& record) const
    {
        const Vec d = direction;
        const float scale = 1.0f / dot(d, d);
        // any vector that is not along d, made perpendicular to it
        const bool steep = magnitude(d.z) > magnitude(d.x);
        const Vec across = steep ? Vec { 0.0f, d.z, -d.y } : Vec { d.y, -d.x, 0.0f };
        const Vec up { across.y * d.z - across.z * d.y, across.z * d.x - across.x * d.z,
                       across.x * d.y - across.y * d.x };
        return { local(record).origin, turned(record, across), turned(record, up),
                 turned(record, { d.x * scale, d.y * scale, d.z * scale }) };
    }
};

struct Sphere {
    Vec center;
    float radius;
};

template <int CAPACITY> struct CasterList {
    Record records[CAPACITY];
    Sphere spheres[CAPACITY];
    unsigned char order[CAPACITY];  // each its own slot: shadows need no sorting
    int count;
    int next_tile;
};

// The record of a shape for world rays, and the sphere around it. False if the shape casts no shadow.
template <int TYPES, class Meshes, class HeightFields>
WARPCAM_FN bool prepare_caster(const Shape& shape, const Meshes& meshes, const HeightFields& fields, Record& record,
                               Sphere& sphere)
{
    Extent extent {};
    Vec scale;
    record.size = { 0.0f, 0.0f, 0.0f, 0 };
    if (!describe<TYPES>(shape, meshes, fields, extent, scale, record))
        return false;
    const Matrix& r = shape.rotation;
    const Vec p = shape.position, c = extent.center;
    record.axis_x = { r.at[0][0] * scale.x, r.at[1][0] * scale.x, r.at[2][0] * scale.x, shape.type };
    record.axis_y = { r.at[0][1] * scale.y, r.at[1][1] * scale.y, r.at[2][1] * scale.y, shape.id };
    record.axis_z = { r.at[0][2] * scale.z, r.at[1][2] * scale.z, r.at[2][2] * scale.z, shape.asset };
    record.origin = { p.x, p.y, p.z, 0 };
    sphere.center = { p.x + r.at[0][0] * c.x + r.at[0][1] * c.y + r.at[0][2] * c.z,
                      p.y + r.at[1][0] * c.x + r.at[1][1] * c.y + r.at[1][2] * c.z,
                      p.z + r.at[2][0] * c.x + r.at[2][1] * c.y + r.at[2][2] * c.z };
    sphere.radius = extent.half.x < 0.0f ? FAR_AWAY : root(dot(extent.half, extent.half)) * 1.0001f;
    return true;
}

// A light as shadow rays see it: where to look, and how far.
struct Beam {
    Vec aim;       // directional: towards the light; else its position
    bool distant;  // directional

    WARPCAM_FN Vec from(Vec p) const
    {
        return distant ? aim : Vec { aim.x - p.x, aim.y - p.y, aim.z - p.z };
    }
};

// May the shape stand between the light and any point of the tile's sphere?
WARPCAM_FN bool may_shade(const Sphere& shape, const Sphere& tile, const Beam& beam)
{
    const Vec d = beam.from(tile.center);
    const Vec v { shape.center.x - tile.center.x, shape.center.y - tile.center.y, shape.center.z - tile.center.z };
    float s = dot(v, d) / upper(dot(d, d), 1.0e-30f);
    s = upper(s, 0.0f);
    if (!beam.distant)
        s = lower(s, 1.0f);
    const Vec gap { v.x - s * d.x, v.y - s * d.y, v.z - s * d.z };
    const float reach = shape.radius + tile.radius;
    return dot(gap, gap) <= reach * reach * 1.0001f;
}

template <class Lights> WARPCAM_FN bool casts(const Lights& lights, int world, int light)
{
    return shared_row(lights.active, world, light) && shared_row(lights.casts_shadow, world, light);
}

template <class Lights> WARPCAM_FN Beam beam_of(const Lights& lights, int world, int light)
{
    const bool distant = shared_row(lights.types, world, light) == 1;  // types.py, LIGHT_DIRECTIONAL
    const auto v = distant ? wp::index(lights.directions, world, light) : wp::index(lights.positions, world, light);
    return distant ? Beam { { -v[0], -v[1], -v[2] }, true } : Beam { { v[0], v[1], v[2] }, false };
}

template <int TYPES, int CAPACITY, class Meshes, class HeightFields>
WARPCAM_FN bool blocked(const CasterList<CAPACITY>& list, int slot, const WorldRay& ray, float near, float reach,
                        const HeightFields& fields)
{
    const Record& record = list.records[slot];
    if ((TYPES >> HEIGHT_FIELD & 1) && record.axis_x.w == HEIGHT_FIELD) {
        Hit hit { reach, -1, -1 };
        walk_height_field(fields, record, ray, near, hit);
        return hit.shape >= 0;
    }
    const float t = enter_any<analytic_types(TYPES)>(record, ray.local(record));
    return t > near && t < reach;
}

// Where a ray starts to count: past the rounding of its own starting point, in units of its length.
WARPCAM_FN float clearance(Vec p, Vec d, float depth)
{
    const float rounding = 2.0e-6f * (magnitude(p.x) + magnitude(p.y) + magnitude(p.z) + depth);
    return rounding / root(upper(dot(d, d), 1.0e-30f));
}

// Does a caster stand between the point and the light?
template <int TYPES, int CAPACITY, class Meshes, class HeightFields>
WARPCAM_FN bool in_shadow(const CasterList<CAPACITY>& list, const unsigned* words, const unsigned* mesh_words, Vec point,
                          float depth, const Beam& beam, const Meshes& meshes, const HeightFields& fields)
{
    const WorldRay ray { point, beam.from(point) };
    const float near = clearance(point, ray.direction, depth);
    const float reach = beam.distant ? FAR_AWAY : 1.0f - near;
    const int count = (list.count + 31) / 32;
    for (int word = 0; word < count; ++word)
        for (unsigned left = words[word]; left; left &= left - 1)
            if (blocked<TYPES, CAPACITY, Meshes>(list, word * 32 + lowest_bit(left), ray, near, reach, fields))
                return true;
    if (TYPES >> MESH & 1) {
        Hit hit { reach, -1, -1 };
        walk_meshes<true>(meshes, list.records, list.order, mesh_words, count, 1, ray, near, hit);
        return hit.shape >= 0;
    }
    return false;
}

// The tile's casters for one light as bits by slot, meshes apart.
template <int TYPES, int CAPACITY>
WARPCAM_FN void pick(const CasterList<CAPACITY>& list, const Sphere& tile, const Beam& beam, unsigned* words,
                     unsigned* mesh_words)
{
    const int count = (list.count + 31) / 32;
#if defined(__CUDA_ARCH__)
    const int lane = threadIdx.x % LANES;
    __syncwarp();
    for (int word = 0; word < count; ++word) {
        const int slot = word * 32 + lane;
        const bool mine = slot < list.count && may_shade(list.spheres[slot], tile, beam);
        const bool mesh = mine && (TYPES >> MESH & 1) && list.records[slot].axis_x.w == MESH;
        const unsigned bits = __ballot_sync(0xffffffffu, mine && !mesh);
        const unsigned mesh_bits = __ballot_sync(0xffffffffu, mesh);
        if (lane == 0) {
            words[word] = bits;
            mesh_words[word] = mesh_bits;
        }
    }
    __syncwarp();
#else
    for (int word = 0; word < count; ++word)
        words[word] = mesh_words[word] = 0;
    for (int slot = 0; slot < list.count; ++slot)
        if (may_shade(list.spheres[slot], tile, beam))
            ((TYPES >> MESH & 1) && list.records[slot].axis_x.w == MESH ? mesh_words : words)[slot / 32]
                |= 1u << slot % 32;
#endif
}

// Smallest and largest of a value over the lanes of a warp.
#if defined(__CUDA_ARCH__)
WARPCAM_FN void warp_range(float low, float high, float& center, float& half)
{
    for (int step = 16; step > 0; step /= 2) {
        low = lower(low, __shfl_xor_sync(0xffffffffu, low, step));
        high = upper(high, __shfl_xor_sync(0xffffffffu, high, step));
    }
    center = 0.5f * (low + high);
    half = upper(0.5f * (high - low), 0.0f);
}
#endif

WARPCAM_FN Vec hit_point(const Camera& camera, int lens, float x, float y, float depth)
{
    const float reach = lens == ORTHOGRAPHIC ? 1.0f : depth;
    const Matrix& r = camera.rotation;
    const float a = x * reach, b = y * reach;
    return { camera.origin.x + r.at[0][0] * a + r.at[0][1] * b - r.at[0][2] * depth,
             camera.origin.y + r.at[1][0] * a + r.at[1][1] * b - r.at[1][2] * depth,
             camera.origin.z + r.at[2][0] * a + r.at[2][1] * b - r.at[2][2] * depth };
}

// Shadows in one region of one view; the index runs as in draw(). The list is filled and used as often as the scene's
// shapes need.
template <int TYPES, int LENS, int CAPACITY, int WIDTH, int HEIGHT, class Shapes, class Materials, class Meshes,
          class HeightFields, class Lights, class Views, class Target>
WARPCAM_FN void cast(const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                     const HeightFields& fields, const Lights& lights, const Views& views, const Target& target,
                     int index)
{
    WARPCAM_SHARED CasterList<CAPACITY> list;
    constexpr int WORDS = (CAPACITY + 31) / 32;
    WARPCAM_SHARED unsigned words[THREADS / LANES + 1][WORDS];
    WARPCAM_SHARED unsigned mesh_words[THREADS / LANES + 1][WORDS];
    const int thread = index % THREADS, block = index / THREADS;
    const int columns = (target.width + WIDTH - 1) / WIDTH, rows = (target.height + HEIGHT - 1) / HEIGHT;
    const int world = block / (columns * rows), part = block % (columns * rows);
    if (!wp::index(target.mask, world))
        return;
    const Region region { part % columns * WIDTH, part / columns * HEIGHT, WIDTH, HEIGHT };
    const Camera camera = load_camera(wp::index(views, world));
    const int across = WIDTH / TILE_WIDTH, tiles = across * (HEIGHT / TILE_HEIGHT);
    const int total = shapes.drawn.shape[0], num_lights = lights.positions.shape[1];

    for (int begin = 0; begin == 0 || begin < total; begin += CAPACITY) {
        if (thread == 0) {
            list.count = 0;
            list.next_tile = 0;
        }
        block_barrier();
        const int end = lower_int(begin + CAPACITY, total);
        for (int i = begin + thread; i < end; i += THREADS) {
            Record record;
            Sphere sphere;
            const int id = wp::index(shapes.drawn, i);
            if (transparent(shapes, materials, world, id)
                || !prepare_caster<TYPES>(load_shape(shapes, world, id), meshes, fields, record, sphere))
                continue;
#if defined(__CUDA_ARCH__)
            const int slot = atomicAdd(&list.count, 1);
#else
            const int slot = list.count++;
#endif
            list.records[slot] = record;
            list.spheres[slot] = sphere;
            list.order[slot] = static_cast<unsigned char>(slot);
        }
        block_barrier();
#if defined(__CUDA_ARCH__)
        const int lane = thread % LANES, warp = thread / LANES;
        while (true) {
            int tile = 0;
            if (lane == 0)
                tile = atomicAdd(&list.next_tile, 1);
            tile = __shfl_sync(0xffffffffu, tile, 0);
            if (tile >= tiles)
                break;
            const int i = region.left + tile % across * TILE_WIDTH + lane % TILE_WIDTH;
            const int j = region.top + tile / across * TILE_HEIGHT + lane / TILE_WIDTH;
            const size_t at = (size_t(world) * target.height + j) * target.width + i;
            const bool inside = i < target.width && j < target.height;
            const bool hit = inside && target.shape.data[at] >= 0;
            unsigned shaded = begin > 0 && inside ? target.shadow.data[at] : 0;
            if (__any_sync(0xffffffffu, hit)) {
                const float depth = hit ? target.depth.data[at] : 0.0f;
                const Vec p = hit_point(camera, LENS, image_x(camera, float(i)), image_y(camera, float(j)), depth);
                Sphere around;
                Vec half;
                warp_range(hit ? p.x : FAR_AWAY, hit ? p.x : -FAR_AWAY, around.center.x, half.x);
                warp_range(hit ? p.y : FAR_AWAY, hit ? p.y : -FAR_AWAY, around.center.y, half.y);
                warp_range(hit ? p.z : FAR_AWAY, hit ? p.z : -FAR_AWAY, around.center.z, half.z);
                around.radius = root(dot(half, half));
                for (int light = 0; light < num_lights; ++light) {
                    if (!casts(lights, world, light))
                        continue;
                    const Beam beam = beam_of(lights, world, light);
                    pick<TYPES>(list, around, beam, words[warp], mesh_words[warp]);
                    if (hit && !(shaded >> light & 1)
                        && in_shadow<TYPES>(list, words[warp], mesh_words[warp], p, depth, beam, meshes, fields))
                        shaded |= 1u << light;
                }
            }
            if (inside)
                target.shadow.data[at] = static_cast<int>(shaded);
        }
#else
        for (int tile = 0; tile < tiles; ++tile) {
            Vec points[LANES], low { FAR_AWAY, FAR_AWAY, FAR_AWAY }, high { -FAR_AWAY, -FAR_AWAY, -FAR_AWAY };
            float depths[LANES];
            unsigned shaded[LANES];
            size_t at[LANES];
            bool hit[LANES], any = false;
            const int left = region.left + tile % across * TILE_WIDTH, top = region.top + tile / across * TILE_HEIGHT;
            for (int lane = 0; lane < LANES; ++lane) {
                const int i = left + lane % TILE_WIDTH, j = top + lane / TILE_WIDTH;
                const bool inside = i < target.width && j < target.height;
                at[lane] = inside ? (size_t(world) * target.height + j) * target.width + i : ~size_t(0);
                hit[lane] = inside && target.shape.data[at[lane]] >= 0;
                shaded[lane] = begin > 0 && inside ? target.shadow.data[at[lane]] : 0;
                if (!hit[lane])
                    continue;
                any = true;
                depths[lane] = target.depth.data[at[lane]];
                const Vec p = hit_point(camera, LENS, image_x(camera, float(i)), image_y(camera, float(j)),
                                        depths[lane]);
                points[lane] = p;
                low = { lower(low.x, p.x), lower(low.y, p.y), lower(low.z, p.z) };
                high = { upper(high.x, p.x), upper(high.y, p.y), upper(high.z, p.z) };
            }
            const Vec half { 0.5f * (high.x - low.x), 0.5f * (high.y - low.y), 0.5f * (high.z - low.z) };
            const Sphere around { { low.x + half.x, low.y + half.y, low.z + half.z }, root(dot(half, half)) };
            for (int light = 0; any && light < num_lights; ++light) {
                if (!casts(lights, world, light))
                    continue;
                const Beam beam = beam_of(lights, world, light);
                pick<TYPES>(list, around, beam, words[0], mesh_words[0]);
                for (int lane = 0; lane < LANES; ++lane)
                    if (hit[lane] && !(shaded[lane] >> light & 1)
                        && in_shadow<TYPES>(list, words[0], mesh_words[0], points[lane], depths[lane], beam, meshes,
                                            fields))
                        shaded[lane] |= 1u << light;
            }
            for (int lane = 0; lane < LANES; ++lane)
                if (at[lane] != ~size_t(0))
                    target.shadow.data[at[lane]] = static_cast<int>(shaded[lane]);
        }
#endif
        block_barrier();
    }
}

}  // namespace warpcam
