// Clouds of Gaussians over the finished images of one view: each pixel's ray blends those in front of its surface, nearest first.
//
// A Gaussian is seen at the point of the ray where its response is greatest: with o and d, origin and direction in the frame in which it is
// the standard normal, at t = -o.d / d.d, where the response is exp(-|o x d|^2 / (2 d.d)) (Moenne-Loccoz et al., "3D Gaussian Ray
// Tracing", SIGGRAPH Asia 2024, sections 4.3 and 4.4). Rows are scaled so that the ellipsoid where a Gaussian ends is the unit sphere.
//
// The ray keeps the KEPT nearest that it has not blended yet, by t, and walks the clouds' trees again for the next ones until nothing is
// left or little light comes through. t is the same in all frames, for which planar depth is taken.
#pragma once
#include "flow.h"
#include "srgb.h"

namespace warpcam {

// What is wanted, in the order of OUTPUTS in splats.py; BY_WORLD: ids by world; EXPOSED: the camera has an exposure.
enum SplatOutput {
    SPLAT_RGB = 1,
    SPLAT_RGBA = 2,
    SPLAT_HDR = 4,
    SPLAT_ALBEDO = 8,
    SPLAT_DEPTH = 16,
    SPLAT_DISTANCE = 32,
    SPLAT_POINTS = 64,
    SPLAT_NORMALS = 128,
    SPLAT_SHAPE = 256,
    SPLAT_BODIES = 512,
    SPLAT_INSTANCES = 1024,
    SPLAT_SEMANTICS = 2048,
    SPLAT_BY_WORLD = 4096,
    SPLAT_LINEAR = 8192,  // hdr is light; else display values
    SPLAT_EXPOSED = 16384
};
constexpr int SPLAT_COLORS = SPLAT_RGB | SPLAT_RGBA | SPLAT_HDR | SPLAT_ALBEDO;

constexpr int KEPT = 32;  // hits that a ray orders at once: more cost shared memory, fewer cost walks
constexpr int SPLAT_REGION = 16;  // side of what a block draws [pixels]
constexpr float LEAST_LIGHT = 0.001f;  // with less of it coming through a ray ends: a quarter of a step of 255
constexpr float HALF_LIGHT = 0.5f;  // where no more comes through is the surface: depth, ids and the rest

// A hit, ordered by t: bits of t, which is not negative, above those of the Gaussian's name.
using Key = unsigned long long;
constexpr Key NO_KEY = ~0ull;
WARPCAM_FN Key key_of(float t, unsigned name) { return Key(unsigned(as_int(t))) << 32 | name; }
WARPCAM_FN float time_of(Key key) { return as_float(int(key >> 32)); }

// A cloud as one view sees it; rows take camera coordinates to its own, as Record's do.
struct Cloud {
    Row axis_x;  // w: shape, or -1 where nothing is seen
    Row axis_y;  // w: first node
    Row axis_z;  // w: first Gaussian
    Row origin;  // w: bits of the shape's opacity
    float extent, reach;  // see types.py, Splats.clouds

    template <int LENS> WARPCAM_FN Ray local(const ViewRay<LENS>& ray) const
    {
        return ray.local({ axis_x, axis_y, axis_z, origin, {} });
    }
};

template <class Shapes, class Splats>
WARPCAM_FN void load_cloud(Cloud& cloud, const Shapes& shapes, const Splats& splats, const Camera& camera, int world, int place)
{
    const int shape = wp::index(splats.columns, place);
    const auto color = row_of(shapes.colors, world, shape);
    const int asset = row_of(shapes.assets, world, shape);
    const Vec size = to_vec(row_of(shapes.sizes, world, shape));
    cloud.axis_x.w = -1;
    if (!(color[3] > 0.0f) || asset < 0 || size.x == 0.0f || size.y == 0.0f || size.z == 0.0f)
        return;
    const auto position = *wp::address(shapes.positions, world, shape);
    const auto rotation = *wp::address(shapes.rotations, world, shape);
    Matrix r;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            r.at[i][j] = rotation.data[i][j];
    const Vec scale { 1.0f / size.x, 1.0f / size.y, 1.0f / size.z };
    const Vec o = times(scale, turned_back(r, camera.origin - to_vec(position)));
    Row* rows[3] = { &cloud.axis_x, &cloud.axis_y, &cloud.axis_z };
    for (int i = 0; i < 3; ++i) {
        Vec v;
        v.x = r.at[0][i] * camera.rotation.at[0][0] + r.at[1][i] * camera.rotation.at[1][0] + r.at[2][i] * camera.rotation.at[2][0];
        v.y = r.at[0][i] * camera.rotation.at[0][1] + r.at[1][i] * camera.rotation.at[1][1] + r.at[2][i] * camera.rotation.at[2][1];
        v.z = r.at[0][i] * camera.rotation.at[0][2] + r.at[1][i] * camera.rotation.at[1][2] + r.at[2][i] * camera.rotation.at[2][2];
        v = component(scale, i) * v;
        rows[i]->x = v.x;
        rows[i]->y = v.y;
        rows[i]->z = v.z;
    }
    const Row head = load(splats.clouds.data, asset);
    cloud.axis_x.w = shape;
    cloud.axis_y.w = as_int(head.x);
    cloud.axis_z.w = as_int(head.y);
    cloud.origin = { o.x, o.y, o.z, as_int(lower(color[3], 1.0f)) };
    cloud.extent = head.z;
    cloud.reach = as_float(head.w);
}

// The ray in the frame in which a Gaussian's ellipsoid is the unit sphere.
struct Whitened {
    Vec origin, direction;
};

WARPCAM_FN Whitened whiten(const Row& a, const Row& b, const Row& c, const Ray& ray)
{
    const Vec off = ray.origin - Vec { as_float(a.w), as_float(b.w), as_float(c.w) };
    return { { dot(to_vec(a), off), dot(to_vec(b), off), dot(to_vec(c), off) },
             { dot(to_vec(a), ray.direction), dot(to_vec(b), ray.direction), dot(to_vec(c), ray.direction) } };
}

// The nearest hits of a ray after `after` and before `end`.
struct Nearest {
    Key* keys;  // ascending, every `step`-th
    int step, count;
    Key after, end;

    WARPCAM_FN Key bound() const { return count < KEPT ? end : keys[(KEPT - 1) * step]; }

    WARPCAM_FN void add(Key key)  // below bound()
    {
        int i = count < KEPT ? count++ : KEPT - 1;
        for (; i > 0 && keys[(i - 1) * step] > key; --i)
            keys[i * step] = keys[(i - 1) * step];
        keys[i * step] = key;
    }
};

WARPCAM_FN void order(Key& a, Key& b)
{
    const Key low = a < b ? a : b;
    b = a < b ? b : a;
    a = low;
}

WARPCAM_FN void meet_leaf(const void* gaussians, const Cloud& cloud, const Ray& ray, int code, unsigned name, Nearest& nearest)
{
    const int first = code >> 4, end = first + (code & 15);
    Key bound = nearest.bound();
    for (int i = first; i < end; ++i) {
        const unsigned row = 4u * (unsigned(cloud.axis_z.w) + i);
        const Whitened w = whiten(load(gaussians, row), load(gaussians, row + 1), load(gaussians, row + 2), ray);
        const Vec off = cross(w.origin, w.direction);
        const float dd = dot(w.direction, w.direction), t = -dot(w.origin, w.direction) * reciprocal(dd);
        if (dot(off, off) < dd && t > 0.0f) {
            const Key key = key_of(t, name | unsigned(i));
            if (key > nearest.after && key < bound) {
                nearest.add(key);
                bound = nearest.bound();
            }
        }
    }
}

// Gathers the hits of one cloud; `name` are the upper bits of their names.
template <class Splats> WARPCAM_FN void walk(const Splats& splats, const Cloud& cloud, const Ray& ray, unsigned name, Nearest& nearest)
{
    const Slabs s = slabs(ray.origin, ray.direction, cloud.extent);
    const float from = time_of(nearest.after);
    Key stack[STACK];  // where the ray enters a child's box, and the child
    int top = 0, child = 0;
    for (;;) {
        Key next = NO_KEY;
        if (child >= 0) {
            const unsigned row = 8u * (unsigned(cloud.axis_y.w) + child);
            const float until = time_of(nearest.bound());
            Key found[4];
#pragma unroll
            for (int k = 0; k < 4; ++k) {
                const Row lo = load(splats.nodes.data, row + 2 * k), hi = load(splats.nodes.data, row + 2 * k + 1);
                const float x0 = lo.x * s.scale.x + s.down.x, x1 = hi.x * s.scale.x + s.up.x;
                const float y0 = lo.y * s.scale.y + s.down.y, y1 = hi.y * s.scale.y + s.up.y;
                const float z0 = lo.z * s.scale.z + s.down.z, z1 = hi.z * s.scale.z + s.up.z;
                const float enter = upper(upper(lower(x0, x1), lower(y0, y1)), upper(lower(z0, z1), from));
                const float leave = lower(lower(upper(x0, x1), upper(y0, y1)), lower(upper(z0, z1), until));
                found[k] = enter <= leave ? key_of(enter, unsigned(lo.w)) : NO_KEY;
            }
            order(found[0], found[1]);
            order(found[2], found[3]);
            order(found[0], found[2]);
            order(found[1], found[3]);
            order(found[1], found[2]);
#pragma unroll
            for (int k = 3; k > 0; --k)
                if (found[k] != NO_KEY)
                    stack[top++] = found[k];
            next = found[0];
        } else {
            meet_leaf(splats.gaussians.data, cloud, ray, -(child + 1), name, nearest);
        }
        const unsigned until = unsigned(nearest.bound() >> 32);
        while (next == NO_KEY && top > 0) {
            next = stack[--top];
            if (unsigned(next >> 32) > until)
                next = NO_KEY;
        }
        if (next == NO_KEY)
            return;
        child = int(unsigned(next));
    }
}

// What a ray has blended.
struct Blend {
    Vec color;
    float light;  // that comes through
    Key median;  // the hit after which no more than half of it does
};

template <class Splats, int LENS>
WARPCAM_FN void blend(const Splats& splats, const Cloud& cloud, const ViewRay<LENS>& seen, Key key, unsigned index, Blend& blend)
{
    const unsigned row = 4u * (unsigned(cloud.axis_z.w) + index);
    const void* rows = splats.gaussians.data;
    const Whitened w = whiten(load(rows, row), load(rows, row + 1), load(rows, row + 2), cloud.local(seen));
    const Row look = load(rows, row + 3);
    const Vec off = cross(w.origin, w.direction);
    const float far = dot(off, off) / dot(w.direction, w.direction), opacity = as_float(look.w);
    // in binary logarithms: the response ends where the cloud has it end, or at an alpha of 1 / 255
    const float end = upper(-0.72134752f * cloud.reach, -logarithm2(255.0f * opacity));
    const float alpha = lower(opacity * power(2.0f, end * far), 1.0f) * as_float(cloud.origin.w);
    blend.color = blend.color + blend.light * alpha * to_vec(look);
    blend.light *= 1.0f - alpha;
    if (blend.median == NO_KEY && blend.light <= HALF_LIGHT)
        blend.median = key;
}

// Normal of the median Gaussian, camera frame: that of its ellipsoid where a ray of this direction through its centre enters it.
template <class Splats, int LENS>
WARPCAM_FN Vec splat_normal(const Splats& splats, const Cloud& cloud, const ViewRay<LENS>& seen, unsigned index)
{
    const unsigned row = 4u * (unsigned(cloud.axis_z.w) + index);
    const void* rows = splats.gaussians.data;
    const Row a = load(rows, row), b = load(rows, row + 1), c = load(rows, row + 2);
    const Vec d = whiten(a, b, c, cloud.local(seen)).direction;
    const Vec local = -(d.x * to_vec(a) + d.y * to_vec(b) + d.z * to_vec(c));
    return local.x * to_vec(cloud.axis_x) + local.y * to_vec(cloud.axis_y) + local.z * to_vec(cloud.axis_z);
}

template <class Array> WARPCAM_FN void blend_bytes(const Array& image, size_t at, const Blend& found)
{
    unsigned char* bytes = reinterpret_cast<unsigned char*>(image.data) + at;
    for (int k = 0; k < 3; ++k)
        bytes[k] = static_cast<unsigned char>(to_byte(component(found.color, k) + found.light * (bytes[k] * (1.0f / 255.0f))));
}

// What the camera makes of the light that a ray has blended: of its mean colour. What is behind is exposed already.
template <class Frame_> WARPCAM_FN void expose(const Frame_& frame, int world, Blend& found)
{
    const Vec factor = power(2.0f, wp::index(frame.exposures, world)) * to_vec(wp::index(frame.gains, world));
    const float part = 1.0f - found.light;
    found.color = part * encoded_beyond(times(factor, decoded(reciprocal(part) * found.color)));
}

template <int WANTED, class Frame_, class Images>
WARPCAM_FN void put_colors(const Frame_& frame, const Images& images, int world, unsigned at, Blend found)
{
    if (WANTED & SPLAT_ALBEDO)
        blend_bytes(images.albedo, 3 * size_t(at), found);
    if constexpr ((WANTED & SPLAT_EXPOSED) != 0)
        expose(frame, world, found);
    if (WANTED & SPLAT_RGB)
        blend_bytes(images.rgb, 3 * size_t(at), found);
    if (WANTED & SPLAT_RGBA) {
        blend_bytes(images.rgba, 4 * size_t(at), found);
        unsigned char& alpha = reinterpret_cast<unsigned char*>(images.rgba.data)[4 * size_t(at) + 3];
        alpha = static_cast<unsigned char>(to_byte(1.0f - found.light + found.light * (alpha * (1.0f / 255.0f))));
    }
    if (WANTED & SPLAT_HDR) {
        float* channels = images.hdr.data + 3 * size_t(at);
        const Vec behind { channels[0], channels[1], channels[2] };
        if (WANTED & SPLAT_LINEAR)
            put_three(images.hdr.data, at, decoded(found.color + found.light * encoded(behind)));
        else
            put_three(images.hdr.data, at, found.color + found.light * behind);
    }
}

// The kernel's arguments.
template <class Frame_, class Images_, class Shapes_, class Splats_> struct SplatScene {
    const Frame_& frame;
    const Images_& images;
    const Shapes_& shapes;
    const Splats_& splats;
};
template <class... Structs> SplatScene(const Structs&...) -> SplatScene<Structs...>;

template <int LENS, int WANTED, class Scene>
WARPCAM_FN void draw_splat_pixel(const Scene& scene, const Cloud* clouds, int num_clouds, const Camera& camera, int world, int column,
                                 int row, unsigned at, Key* keys, int step)
{
    const int behind = scene.frame.shape.data[at];
    const float far = behind < 0 ? camera.far : scene.frame.depth.data[at];
    const ViewRay<LENS> seen = view_ray<LENS>(camera, column, row);
    const unsigned mask = scene.splats.bits < 32 ? (1u << scene.splats.bits) - 1u : ~0u;
    constexpr float LEAST = (WANTED & SPLAT_COLORS) != 0 ? LEAST_LIGHT : HALF_LIGHT;
    Blend found { { 0.0f, 0.0f, 0.0f }, 1.0f, NO_KEY };
    Nearest nearest { keys, step, 0, key_of(camera.near, ~0u), key_of(far, 0u) };
    for (;;) {
        for (int place = 0; place < num_clouds; ++place)
            if (clouds[place].axis_x.w >= 0)
                walk(scene.splats, clouds[place], clouds[place].local(seen), scene.splats.bits < 32 ? unsigned(place) << scene.splats.bits : 0u, nearest);
        Key key = 0;
        for (int i = 0; i < nearest.count && found.light > LEAST; ++i) {
            key = keys[i * step];
            const unsigned name = unsigned(key);
            blend(scene.splats, clouds[scene.splats.bits < 32 ? name >> scene.splats.bits : 0], seen, key, name & mask, found);
        }
        if (nearest.count < KEPT || found.light <= LEAST)
            break;
        nearest.after = key;
        nearest.count = 0;
    }
    if (found.light == 1.0f)
        return;
    put_colors<WANTED>(scene.frame, scene.images, world, at, found);
    if ((WANTED & ~(SPLAT_COLORS | SPLAT_BY_WORLD | SPLAT_LINEAR | SPLAT_EXPOSED)) == 0 || found.median == NO_KEY)
        return;
    const unsigned name = unsigned(found.median);
    const Cloud& cloud = clouds[scene.splats.bits < 32 ? name >> scene.splats.bits : 0];
    const Hit hit { time_of(found.median), cloud.axis_x.w, 0 };
    const auto& images = scene.images;
    if (WANTED & SPLAT_DEPTH)
        images.depth.data[at] = hit.depth;
    if (WANTED & SPLAT_DISTANCE)
        images.distance.data[at] = distance_of(hit, seen);
    if (WANTED & SPLAT_POINTS)
        put_three(images.points.data, at, point_of(hit, camera, seen));
    if (WANTED & SPLAT_NORMALS)
        put_three(images.normals.data, at, turned(camera.rotation, normalized(splat_normal(scene.splats, cloud, seen, name & mask))));
    if (WANTED & SPLAT_SHAPE)
        images.segmentation.data[at] = (WANTED & SPLAT_BY_WORLD) ? id_of(scene.shapes, world, hit.shape) : hit.shape;
    if (WANTED & SPLAT_BODIES)
        images.bodies.data[at] = body_of<(WANTED & SPLAT_BY_WORLD) != 0>(scene.shapes, world, hit.shape);
    if (WANTED & SPLAT_INSTANCES)
        images.instances.data[at] = row_of(images.instance_of, world, hit.shape);
    if (WANTED & SPLAT_SEMANTICS)
        images.semantics.data[at] = row_of(images.semantic_of, world, hit.shape);
    if constexpr ((WANTED & FLOWS) != 0) {
        FlowPlaces<WANTED> places;
        places.locate(scene.frame.trail, world);
        put_flow<0, LENS, WANTED>(scene.frame.trail, places, scene.shapes, camera, seen, hit, world, column, row, 0, at);
    }
}

// Draws one region of one view; `index` counts worlds, then regions, then (CUDA) threads of the block. CAPACITY: clouds.
template <int LENS, int CAPACITY, int WANTED, class Scene> WARPCAM_FN void draw_splats(const Scene& scene, int index)
{
    WARPCAM_SHARED Cloud clouds[CAPACITY];
    const auto& frame = scene.frame;
    const int thread = index % THREADS, block = index / THREADS;
    const int columns = (frame.width + SPLAT_REGION - 1) / SPLAT_REGION, rows = (frame.height + SPLAT_REGION - 1) / SPLAT_REGION;
    const int world = block / (columns * rows), part = block % (columns * rows);
    if (!wp::index(frame.mask, world))
        return;
    const Camera camera = load_camera(wp::index(frame.views, world));
    if (camera.origin.x != camera.origin.x)
        return;  // broken: see types.py, View
    const int left = part % columns * SPLAT_REGION, top = part / columns * SPLAT_REGION;
    const unsigned first = unsigned(world) * frame.width * frame.height;
    const int num_clouds = scene.splats.columns.shape[0];
    for (int i = thread; i < num_clouds; i += THREADS)
        load_cloud(clouds[i], scene.shapes, scene.splats, camera, world, i);
    block_barrier();
#if defined(__CUDA_ARCH__)
    WARPCAM_SHARED Key keys[KEPT * THREADS];
    const int lane = thread % LANES;
    for (int tile = thread / LANES; tile < SPLAT_REGION / TILE_WIDTH * (SPLAT_REGION / TILE_HEIGHT); tile += THREADS / LANES) {
        const int column = left + tile % (SPLAT_REGION / TILE_WIDTH) * TILE_WIDTH + lane % TILE_WIDTH;
        const int row = top + tile / (SPLAT_REGION / TILE_WIDTH) * TILE_HEIGHT + lane / TILE_WIDTH;
        if (column < frame.width && row < frame.height)
            draw_splat_pixel<LENS, WANTED>(scene, clouds, num_clouds, camera, world, column, row, first + row * frame.width + column,
                                           keys + thread, THREADS);
        __syncwarp();
    }
#else
    Key keys[KEPT];
    for (int row = top; row < lower_int(top + SPLAT_REGION, frame.height); ++row)
        for (int column = left; column < lower_int(left + SPLAT_REGION, frame.width); ++column)
            draw_splat_pixel<LENS, WANTED>(scene, clouds, num_clouds, camera, world, column, row, first + row * frame.width + column, keys, 1);
#endif
}

}  // namespace warpcam
