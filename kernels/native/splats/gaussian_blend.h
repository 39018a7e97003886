// Clouds of Gaussians over the finished images of one view: each pixel's ray blends those in front of its surface,
// nearest first.
//
// A Gaussian is seen at the point of the ray where its response is greatest: with o and d, origin and direction in the
// frame in which it is the standard normal, at t = -o.d / d.d, where the response is exp(-|o x d|^2 / (2 d.d))
// (Moenne-Loccoz et al., "3D Gaussian Ray Tracing", SIGGRAPH Asia 2024, sections 4.3 and 4.4). Rows are scaled so that
// the ellipsoid where a Gaussian ends is the unit sphere.
//
// The ray keeps the MAX_ORDERED_HITS nearest that it has not blended yet, by t, and walks the clouds' trees again for
// the next ones until nothing is left or little light comes through. t is the same in all frames, for which planar
// depth is taken.
#pragma once
#include "splats/gaussian_cloud.h"
#include "splats/harmonics.h"
#include "core/srgb.h"

namespace warpcam {

// Output flags, in the order of OUTPUTS in splats.py; BY_WORLD: ids by world; HAS_EXPOSURE: the camera has an exposure;
// SOLID: see solid_surface.
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
    SPLAT_EXPOSED = 16384,
    SPLAT_SOLID = 32768,
    SPLAT_OPAQUE = 65536,  // see kernels/flags.py
    SPLAT_HARMONICS = 131072
};
constexpr int SPLAT_COLORS = SPLAT_RGB | SPLAT_RGBA | SPLAT_HDR | SPLAT_ALBEDO;

constexpr int SPLAT_REGION = 16;  // side of what a block draws [pixels]
constexpr float LEAST_LIGHT = 0.001f;  // with less of it coming through a ray ends: a quarter of a step of 255
constexpr float HALF_LIGHT = 0.5f;  // where no more comes through is the surface: depth, ids and the rest
constexpr float OPAQUE_LIGHT = 0.005f;  // likewise of SPLAT_OPAQUE, where a ray ends, too

// Accumulated colour of a ray.
struct AlphaComposite {
    Vec3 color;
    float light;  // that comes through
    Key median;  // the hit after which no more than half of it does, or another share
};

template <int WANTED, class Splats, int LENS>
WARPCAM_DEVICE void blend(const Splats& splats, const Cloud& cloud, const CameraRay<LENS>& seen, Key key,
                          unsigned index, float half, AlphaComposite& blend)
{
    const unsigned row = 4u * (unsigned(cloud.axis_z.w) + index);
    const void* rows = splats.gaussians.data;
    const GaussianSpaceRay w = whiten(load(rows, row), load(rows, row + 1), load(rows, row + 2), cloud.local(seen));
    const Float3Int look = load(rows, row + 3);
    const Vec3 off = cross(w.origin, w.direction);
    const float far = dot(off, off) / dot(w.direction, w.direction), opacity = as_float(look.w);
    // in binary logarithms: the response ends where the cloud has it end, or at an alpha of 1 / 255 or 1 / 100
    constexpr float ALPHAS = (WANTED & SPLAT_OPAQUE) != 0 ? 100.0f : 255.0f;
    const float end = max(-0.72134752f * cloud.reach, -log2(ALPHAS * opacity));
    const float alpha = min(opacity * pow(2.0f, end * far), 1.0f) * as_float(cloud.origin.w);
    Vec3 color = as_vec3(look);
    if constexpr ((WANTED & SPLAT_HARMONICS) != 0)
        color =
            harmonic_color(splats, unsigned(cloud.axis_z.w) + index, color, normalized(cloud.local(seen).direction));
    blend.color = blend.color + blend.light * alpha * color;
    blend.light *= 1.0f - alpha;
    if (blend.median == NO_KEY && blend.light <= half)
        blend.median = key;
}

// Normal of the median Gaussian, camera frame: that of its ellipsoid where a ray of this direction through its centre
// enters it.
template <class Splats, int LENS>
WARPCAM_DEVICE Vec3 splat_normal(const Splats& splats, const Cloud& cloud, const CameraRay<LENS>& seen, unsigned index)
{
    const unsigned row = 4u * (unsigned(cloud.axis_z.w) + index);
    const void* rows = splats.gaussians.data;
    const Float3Int a = load(rows, row), b = load(rows, row + 1), c = load(rows, row + 2);
    const Vec3 d = whiten(a, b, c, cloud.local(seen)).direction;
    const Vec3 local = -(d.x * as_vec3(a) + d.y * as_vec3(b) + d.z * as_vec3(c));
    return local.x * as_vec3(cloud.axis_x) + local.y * as_vec3(cloud.axis_y) + local.z * as_vec3(cloud.axis_z);
}

template <class Array> WARPCAM_DEVICE void blend_bytes(const Array& image, size_t at, const AlphaComposite& found)
{
    unsigned char* bytes = reinterpret_cast<unsigned char*>(image.data) + at;
    for (int k = 0; k < 3; ++k)
        bytes[k] =
            static_cast<unsigned char>(to_byte(component(found.color, k) + found.light * (bytes[k] * (1.0f / 255.0f))));
}

// Applies the camera's exposure to the mean colour that a ray has blended. The background is exposed already.
template <class Frame_> WARPCAM_DEVICE void expose(const Frame_& frame, int world, AlphaComposite& found)
{
    const Vec3 factor = pow(2.0f, wp::index(frame.exposures, world)) * as_vec3(wp::index(frame.gains, world));
    const float part = 1.0f - found.light;
    found.color = part * encoded_beyond(mul(factor, srgb_to_linear(rcp(part) * found.color)));
}

template <int WANTED, class Frame_, class Images>
WARPCAM_DEVICE void put_colors(const Frame_& frame, const Images& images, int world, unsigned at, AlphaComposite found)
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
        const Vec3 behind { channels[0], channels[1], channels[2] };
        if (WANTED & SPLAT_LINEAR)
            put_three(images.hdr.data, at, srgb_to_linear(found.color + found.light * linear_to_srgb(behind)));
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

// Blends all clouds along a ray.
template <int WANTED, int LENS, class Scene>
WARPCAM_DEVICE AlphaComposite blend_all(const Scene& scene, const Cloud* clouds, int num_clouds, const Camera& camera,
                                        const CameraRay<LENS>& seen, float far, unsigned mask, Key* keys, int step)
{
    constexpr float SURFACE = (WANTED & SPLAT_OPAQUE) != 0 ? OPAQUE_LIGHT : HALF_LIGHT;
    constexpr float LEAST = (WANTED & SPLAT_OPAQUE) == 0 && (WANTED & SPLAT_COLORS) != 0 ? LEAST_LIGHT : SURFACE;
    AlphaComposite found { { 0.0f, 0.0f, 0.0f }, 1.0f, NO_KEY };
    Nearest nearest { keys, step, 0, key_of(camera.near, ~0u), key_of(far, 0u) };
    for (;;) {
        for (int place = 0; place < num_clouds; ++place)
            if (clouds[place].axis_x.w >= 0)
                walk(scene.splats, clouds[place], clouds[place].local(seen),
                     scene.splats.bits < 32 ? unsigned(place) << scene.splats.bits : 0u, nearest);
        Key key = 0;
        for (int i = 0; i < nearest.count && found.light > LEAST; ++i) {
            key = keys[i * step];
            const unsigned name = unsigned(key);
            blend<WANTED>(scene.splats, clouds[scene.splats.bits < 32 ? name >> scene.splats.bits : 0], seen, key,
                          name & mask, SURFACE, found);
        }
        if (nearest.count < MAX_ORDERED_HITS || found.light <= LEAST)
            break;
        nearest.after = key;
        nearest.count = 0;
    }
    return found;
}

// Finds the nearest solid cloud along a ray: clouds are solid where little enough light passes, and absent elsewhere,
// as in Newton's camera. Each cloud counts by itself, in the mean colour of its Gaussians that the ray blends.
template <int WANTED, int LENS, class Scene>
WARPCAM_DEVICE AlphaComposite solid_surface(const Scene& scene, const Cloud* clouds, int num_clouds,
                                            const Camera& camera, const CameraRay<LENS>& seen, float far, unsigned mask,
                                            Key* keys, int step)
{
    const auto limits = wp::index(scene.frame.limits, 0);
    AlphaComposite surface { { 0.0f, 0.0f, 0.0f }, 1.0f, NO_KEY };
    for (int place = 0; place < num_clouds; ++place) {
        const Cloud& cloud = clouds[place];
        if (cloud.axis_x.w < 0)
            continue;
        const unsigned prefix = scene.splats.bits < 32 ? unsigned(place) << scene.splats.bits : 0u;
        AlphaComposite found { { 0.0f, 0.0f, 0.0f }, 1.0f, NO_KEY };
        Nearest nearest { keys, step, 0, key_of(camera.near, ~0u), key_of(far, 0u) };
        float left = limits[1];
        const auto goes_on = [&] { return left > 0.0f && (found.light > LEAST_LIGHT || found.median == NO_KEY); };
        for (;;) {
            walk(scene.splats, cloud, cloud.local(seen), prefix, nearest);
            Key key = 0;
            for (int i = 0; i < nearest.count && goes_on(); ++i) {
                key = keys[i * step];
                blend<WANTED>(scene.splats, cloud, seen, key, unsigned(key) & mask, limits[0], found);
                left -= 1.0f;
            }
            if (nearest.count < MAX_ORDERED_HITS || !goes_on())
                break;
            nearest.after = key;
            nearest.count = 0;
        }
        if (found.median < surface.median)
            surface = { rcp(1.0f - found.light) * found.color, 0.0f, found.median };
    }
    return surface;
}

template <int LENS, int WANTED, class Scene>
WARPCAM_DEVICE void draw_splat_pixel(const Scene& scene, const Cloud* clouds, int num_clouds, const Camera& camera,
                                     int world, int column, int row, unsigned at, Key* keys, int step)
{
    const int behind = scene.frame.shape.data[at];
    const float far = behind < 0 ? camera.far : scene.frame.depth.data[at];
    const CameraRay<LENS> seen = view_ray<LENS>(camera, column, row);
    const unsigned mask = scene.splats.bits < 32 ? (1u << scene.splats.bits) - 1u : ~0u;
    AlphaComposite found;
    if constexpr ((WANTED & SPLAT_SOLID) != 0)
        found = solid_surface<WANTED>(scene, clouds, num_clouds, camera, seen, far, mask, keys, step);
    else
        found = blend_all<WANTED>(scene, clouds, num_clouds, camera, seen, far, mask, keys, step);
    if (found.light == 1.0f)
        return;
    put_colors<WANTED>(scene.frame, scene.images, world, at, found);
    if ((WANTED & ~(SPLAT_COLORS | SPLAT_BY_WORLD | SPLAT_LINEAR | SPLAT_EXPOSED | SPLAT_OPAQUE | SPLAT_HARMONICS)) == 0
        || found.median == NO_KEY)
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
        put_three(images.normals.data, at,
                  transform(camera.rotation, normalized(splat_normal(scene.splats, cloud, seen, name & mask))));
    if (WANTED & SPLAT_SHAPE)
        images.segmentation.data[at] = (WANTED & SPLAT_BY_WORLD) ? id_of(scene.shapes, world, hit.shape) : hit.shape;
    if (WANTED & SPLAT_BODIES)
        images.bodies.data[at] = body_of<(WANTED & SPLAT_BY_WORLD) != 0>(scene.shapes, world, hit.shape);
    if (WANTED & SPLAT_INSTANCES)
        images.instances.data[at] = per_world(images.instance_of, world, hit.shape);
    if (WANTED & SPLAT_SEMANTICS)
        images.semantics.data[at] = per_world(images.semantic_of, world, hit.shape);
    if constexpr ((WANTED & FLOWS) != 0) {
        VisibilityHistory<WANTED> places;
        places.locate(scene.frame.history, world);
        put_flow<SceneTypes<0, 0>, LENS, WANTED>(scene.frame.history, places, scene.shapes, camera, seen, hit, world,
                                                 column, row, 0, at);
    }
}

// Draws one region of one view; `index` counts worlds, then regions, then (CUDA) threads of the block. CAPACITY:
// clouds.
template <int LENS, int CAPACITY, int WANTED, class Scene>
WARPCAM_DEVICE void draw_splats(const Scene& scene, int index)
{
    WARPCAM_SHARED Cloud clouds[CAPACITY];
    const auto& frame = scene.frame;
    const int thread = index % THREADS, block = index / THREADS;
    const int columns = (frame.width + SPLAT_REGION - 1) / SPLAT_REGION,
              rows = (frame.height + SPLAT_REGION - 1) / SPLAT_REGION;
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
    block_sync();
#if defined(__CUDA_ARCH__)
    WARPCAM_SHARED Key keys[MAX_ORDERED_HITS * THREADS];
    const int lane = thread % WARP_SIZE;
    for (int tile = thread / WARP_SIZE; tile < SPLAT_REGION / TILE_WIDTH * (SPLAT_REGION / TILE_HEIGHT);
         tile += THREADS / WARP_SIZE) {
        const int column = left + tile % (SPLAT_REGION / TILE_WIDTH) * TILE_WIDTH + lane % TILE_WIDTH;
        const int row = top + tile / (SPLAT_REGION / TILE_WIDTH) * TILE_HEIGHT + lane / TILE_WIDTH;
        if (column < frame.width && row < frame.height)
            draw_splat_pixel<LENS, WANTED>(scene, clouds, num_clouds, camera, world, column, row,
                                           first + row * frame.width + column, keys + thread, THREADS);
        __syncwarp();
    }
#else
    Key keys[MAX_ORDERED_HITS];
    for (int row = top; row < min(top + SPLAT_REGION, frame.height); ++row)
        for (int column = left; column < min(left + SPLAT_REGION, frame.width); ++column)
            draw_splat_pixel<LENS, WANTED>(scene, clouds, num_clouds, camera, world, column, row,
                                           first + row * frame.width + column, keys, 1);
#endif
}

}  // namespace warpcam
