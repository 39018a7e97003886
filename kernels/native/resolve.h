// From the visibility buffer to images: a block draws one region of one view.
#pragma once
#include "mapping.h"
#include "pixels.h"
#include "shade.h"
#include "texture.h"

namespace warpcam {

// The structs of types.py that a pixel needs.
template <class Frame_, class Images_, class Shapes_, class Meshes_, class Fields_, class Materials_, class Textures_,
          class Background_>
struct Scene {
    const Frame_& frame;
    const Images_& images;
    const Shapes_& shapes;
    const Meshes_& meshes;
    const Fields_& fields;
    const Materials_& materials;
    const Textures_& textures;
    const Background_& background;
};
template <class... Structs> Scene(const Structs&...) -> Scene<Structs...>;

// What the trace found at a pixel.
struct Found {
    int shape, face;
    float depth;
};

// Where a warp sees anything at all, its pixels that see nothing do as one of the others does, so that all its threads
// go the same way; what they find is not used.
WARPCAM_FN void follow(bool hit, Found& found)
{
#if defined(__CUDA_ARCH__)
    const int leader = lowest_bit(__ballot_sync(0xffffffffu, hit)) & 31;
    const int shape = __shfl_sync(0xffffffffu, found.shape, leader), face = __shfl_sync(0xffffffffu, found.face, leader);
    const float depth = __shfl_sync(0xffffffffu, found.depth, leader);
    if (!hit)
        found = { shape, face, depth };
#endif
}

WARPCAM_FN Vec turned(const Matrix& m, Vec v)
{
    return { m.at[0][0] * v.x + m.at[0][1] * v.y + m.at[0][2] * v.z,
             m.at[1][0] * v.x + m.at[1][1] * v.y + m.at[1][2] * v.z,
             m.at[2][0] * v.x + m.at[2][1] * v.y + m.at[2][2] * v.z };
}

// Colour where nothing is hit. The skybox lies on its side: its y axis is the world's z.
template <int LENS, int FACTS, class Textures, class Background>
WARPCAM_FN Vec background_color(const Textures& textures, const Background& background, const Camera& camera, float x,
                                float y)
{
    if ((FACTS & HAS_SKYBOX) && is_texture(textures, background.skybox)) {
        const bool pinhole = LENS == PINHOLE;
        const Vec ray = turned(camera.rotation, { pinhole ? x : 0.0f, pinhole ? y : 0.0f, -1.0f });
        const Vec right = turned(camera.rotation, { pinhole ? camera.scale_x : 0.0f, 0.0f, 0.0f });
        const Vec down = turned(camera.rotation, { 0.0f, pinhole ? -camera.scale_y : 0.0f, 0.0f });
        return sample_cube(textures, background.skybox, { ray.x, ray.z, -ray.y }, { right.x, right.z, -right.y },
                           { down.x, down.z, -down.y });
    }
    return to_vec(background.color);
}

// `step` carried along `ray` into the plane of `normal`: how far the hit moves from pixel to pixel.
WARPCAM_FN Vec slide(Vec step, Vec ray, Vec normal)
{
    const float slope = dot(normal, ray);
    if (slope * slope < 1.0e-24f * dot(ray, ray))
        return 1.0e6f * step;
    return step - dot(normal, step) * inverse(slope) * ray;
}

// The texture's colour at a hit; white where there is none.
template <int TYPES, int LENS, class Looks, class Meshes, class Textures>
WARPCAM_FN Vec texture_color(const Looks& look, const Meshes& meshes, const Textures& textures, const Camera& camera,
                             const Surface& surface, const Triangle& triangle, Vec ray, float depth)
{
    const int texture = look.finish.color.w;
    if (!is_texture(textures, texture))
        return { 1.0f, 1.0f, 1.0f };
    const Pose& pose = look.pose;
    const float stretch = LENS == PINHOLE ? depth : 1.0f;
    const Vec right = slide(pose.local({ stretch * camera.scale_x, 0.0f, 0.0f }), ray, surface.normal);
    const Vec down = slide(pose.local({ 0.0f, -stretch * camera.scale_y, 0.0f }), ray, surface.normal);
    if (wp::index(textures.kind, texture) == TEXTURE_2D) {
        const Mapping mapping = map_2d<TYPES>(pose, look.layout, meshes, surface, triangle);
        return sample_2d(textures, texture, mapping.u, mapping.v, { dot(mapping.du, right), dot(mapping.dv, right) },
                         { dot(mapping.du, down), dot(mapping.dv, down) });
    }
    if (look.layout.own)  // on such a mesh a cube texture does not show
        return { 1.0f, 1.0f, 1.0f };
    const CubeMapping mapping = map_cube<TYPES>(pose, look.layout, surface);
    return sample_cube(textures, texture, mapping.direction, times(mapping.scale, right), times(mapping.scale, down));
}

// The images that need only what the trace found.
template <int LENS, int IMAGES, int FACTS, class Images, class Shapes>
WARPCAM_FN void resolve_hit(const Images& images, const Shapes& shapes, const Camera& camera, const Pixel& pixel,
                            float x, float y, const Found& found)
{
    constexpr bool IN_QUADS = FACTS & QUADS;
    const bool hit = found.shape >= 0;
    if (IMAGES & DISTANCE) {
        const float length = LENS == PINHOLE ? root(x * x + y * y + 1.0f) : 1.0f;
        put_one(images.distance, pixel, hit ? found.depth * length : infinity());
    }
    if (IMAGES & BODIES)
        put_one(images.bodies, pixel, hit ? wp::index(shapes.bodies, found.shape) : -1);
    if (IMAGES & POINTS) {
        const float depth = hit ? found.depth : 0.0f, near = LENS == PINHOLE ? depth : 1.0f;
        const Vec place = camera.origin + turned(camera.rotation, { near * x, near * y, -depth });
        put_vec<IN_QUADS>(images.points, pixel, hit ? place : Vec { infinity(), infinity(), infinity() });
    }
}

template <int TYPES, int LENS, int IMAGES, int FACTS, class Looks, class Scene_>
WARPCAM_FN void resolve_surface(const Looks& look, const LightList& lights, const Scene_& scene, const Camera& camera,
                                const Pixel& pixel, float x, float y, bool hit, const Found& found)
{
    using Wants = Wanted<IMAGES, FACTS>;
    constexpr bool IN_QUADS = FACTS & QUADS;
    const auto& images = scene.images;
    const float depth = found.depth;
    Surface surface;
    Triangle triangle;
    Vec place, ray;  // in the camera's frame; in the shape's
    if constexpr (Wants::SURFACE) {
        const Pose& pose = look.pose;
        place = LENS == PINHOLE ? Vec { depth * x, depth * y, -depth } : Vec { x, y, -depth };
        ray = LENS == PINHOLE ? pose.local({ x, y, -1.0f }) : pose.local({ 0.0f, 0.0f, -1.0f });
        const Vec local = pose.eye() + (LENS == PINHOLE ? depth * ray : pose.local(place));
        surface = surface_at<TYPES>(pose, scene.meshes, scene.fields, found.face, local, ray, triangle);
    }
    if constexpr (Wants::TURNED) {
        Vec normal = look.turn.world(surface.normal);
        if (dot(surface.normal, ray) > 0.0f)
            normal = -normal;
        put_vec<IN_QUADS>(images.normals, pixel, hit ? normal : Vec { 0.0f, 0.0f, 0.0f });
    }
    if constexpr (Wants::COLORED) {
        const Finish& finish = look.finish;
        Vec texture { 1.0f, 1.0f, 1.0f };
        if constexpr (Wants::TEXTURED)
            texture = texture_color<TYPES, LENS>(look, scene.meshes, scene.textures, camera, surface, triangle, ray,
                                                 depth);
        if (IMAGES & ALBEDO)
            put_bytes<IN_QUADS>(images.albedo, pixel, hit ? to_bytes(times(clip(to_vec(finish.color)), texture)) : 0u);
        if constexpr (Wants::LIT) {
            constexpr bool SHADOWS = FACTS & HAS_SHADOWS;
            const int shadow = SHADOWS && hit ? scene.frame.shadow.data[pixel.at] : 0;
            Facet facet;
            facet_at<TYPES>(look, scene.meshes, scene.fields, surface, triangle, found.face, place, facet);
            const bool three = (TYPES & (1 << PLANE | 1 << HEIGHT_FIELD | 1 << BOX | 1 << MESH)) && any_lane(facet.three);
            const Lit lit = three ? illuminate<3, SHADOWS>(lights, facet, finish, shadow)
                                  : illuminate<1, SHADOWS>(lights, facet, finish, shadow);
            Vec linear = times(lit.linear, texture), display = times(lit.display, texture);
            if (!hit)
                linear = display = background_color<LENS, FACTS>(scene.textures, scene.background, camera, x, y);
            if (IMAGES & HDR)
                put_vec<IN_QUADS>(images.hdr, pixel, linear);
            const unsigned word = to_bytes(display);
            if (IMAGES & RGB)
                put_bytes<IN_QUADS>(images.rgb, pixel, word);
            if (IMAGES & RGBA)
                put_word(images.rgba, pixel, hit ? word | 0xff000000u : word);
        }
    }
}

// Where nothing is hit.
template <int LENS, int IMAGES, int FACTS, class Scene_>
WARPCAM_FN void resolve_nothing(const Scene_& scene, const Camera& camera, const Pixel& pixel, float x, float y)
{
    constexpr bool IN_QUADS = FACTS & QUADS;
    const auto& images = scene.images;
    if (IMAGES & NORMALS)
        put_vec<IN_QUADS>(images.normals, pixel, { 0.0f, 0.0f, 0.0f });
    if (IMAGES & ALBEDO)
        put_bytes<IN_QUADS>(images.albedo, pixel, 0u);
    if (Wanted<IMAGES, FACTS>::LIT) {
        const Vec color = background_color<LENS, FACTS>(scene.textures, scene.background, camera, x, y);
        const unsigned word = to_bytes(color);
        if (IMAGES & HDR)
            put_vec<IN_QUADS>(images.hdr, pixel, color);
        if (IMAGES & RGB)
            put_bytes<IN_QUADS>(images.rgb, pixel, word);
        if (IMAGES & RGBA)
            put_word(images.rgba, pixel, word);
    }
}

// CAPACITY: the looks a block keeps, more than any shape's id; 0 if they are made anew for each pixel.
template <int TYPES, int LENS, int CAPACITY, int IMAGES, int FACTS, class Looks, class Scene_>
WARPCAM_FN void resolve_pixel(const Looks* looks, const LightList& lights, const Scene_& scene, const Camera& camera,
                              int world, const Pixel& pixel)
{
    using Wants = Wanted<IMAGES, FACTS>;
    const auto& frame = scene.frame;
    Found found { -1, 0, 0.0f };
    if (pixel.inside) {
        found.shape = frame.shape.data[pixel.at];
        if (IMAGES & ~(BODIES | ALBEDO) || Wants::SURFACE)
            found.depth = frame.depth.data[pixel.at];
    }
    const float x = image_x(camera, float(pixel.column)), y = image_y(camera, float(pixel.row));
    const bool hit = found.shape >= 0;
    resolve_hit<LENS, IMAGES, FACTS>(scene.images, scene.shapes, camera, pixel, x, y, found);
    if (!Wants::SURFACE && !Wants::COLORED)
        return;
    if (!any_lane(hit)) {
        resolve_nothing<LENS, IMAGES, FACTS>(scene, camera, pixel, x, y);
        return;
    }
    if (Wants::SURFACE && (TYPES & (1 << MESH | 1 << HEIGHT_FIELD)) && hit)
        found.face = frame.face.data[pixel.at];
    follow(hit, found);
    if constexpr (CAPACITY > 0) {
        resolve_surface<TYPES, LENS, IMAGES, FACTS>(looks[found.shape], lights, scene, camera, pixel, x, y, hit, found);
    } else {
        const Looks look = load_look<TYPES, Wants>(scene.shapes, scene.materials, scene.meshes, scene.fields, camera,
                                                   frame.horizon, world, found.shape);
        resolve_surface<TYPES, LENS, IMAGES, FACTS>(look, lights, scene, camera, pixel, x, y, hit, found);
    }
}

// Draws one region of one view; `index` counts worlds, then regions, then (CUDA) threads of the block.
template <int TYPES, int LENS, int CAPACITY, int WIDTH, int HEIGHT, int IMAGES, int FACTS, class Scene_, class Lights>
WARPCAM_FN void resolve(const Scene_& scene, const Lights& lights, int index)
{
    using Wants = Wanted<IMAGES, FACTS>;
    using Looks = Look<TYPES, Wants>;
    constexpr int KEPT = CAPACITY * int(sizeof(Looks)) <= 40960 && (Wants::SURFACE || Wants::COLORED) ? CAPACITY : 0;
    WARPCAM_SHARED Looks looks[KEPT > 0 ? KEPT : 1];
    WARPCAM_SHARED LightList list;
    const auto& frame = scene.frame;
    const int thread = index % THREADS, block = index / THREADS;
    const int columns = (frame.width + WIDTH - 1) / WIDTH, rows = (frame.height + HEIGHT - 1) / HEIGHT;
    const int world = block / (columns * rows), part = block % (columns * rows);
    if (!wp::index(frame.mask, world))
        return;
    const int left = part % columns * WIDTH, top = part / columns * HEIGHT;
    const Camera camera = load_camera(wp::index(frame.views, world));
    const size_t first = size_t(world) * frame.width * frame.height;
    if (KEPT > 0)
        for (int i = thread; i < scene.shapes.drawn.shape[0]; i += THREADS) {
            const int id = wp::index(scene.shapes.drawn, i);
            looks[id] = load_look<TYPES, Wants>(scene.shapes, scene.materials, scene.meshes, scene.fields, camera,
                                                frame.horizon, world, id);
        }
    if (Wants::LIT)
        gather_lights<(FACTS & HAS_SHADOWS) != 0>(lights, camera, world, thread, list);
    else
        block_barrier();
    Pixel pixel;
#if defined(__CUDA_ARCH__)
    WARPCAM_SHARED float4 lanes[THREADS / LANES][3 * LANES / 4];
    const int lane = thread % LANES, warp = thread / LANES;
    pixel.lane = lane;
    pixel.row_of_lanes = reinterpret_cast<float*>(lanes[warp]);
#pragma unroll 1
    for (int tile = warp; tile < WIDTH / TILE_WIDTH * (HEIGHT / TILE_HEIGHT); tile += THREADS / LANES) {
        const int tile_left = left + tile % (WIDTH / TILE_WIDTH) * TILE_WIDTH;
        const int tile_top = top + tile / (WIDTH / TILE_WIDTH) * TILE_HEIGHT;
        if (tile_left >= frame.width || tile_top >= frame.height)
            continue;
        pixel.left = frame.width - tile_left;
        pixel.column = tile_left + lane % TILE_WIDTH;
        pixel.row = tile_top + lane / TILE_WIDTH;
        pixel.at = first + (pixel.row * frame.width + pixel.column);
        pixel.inside = pixel.column < frame.width && pixel.row < frame.height;
        resolve_pixel<TYPES, LENS, KEPT, IMAGES, FACTS>(looks, list, scene, camera, world, pixel);
    }
#else
    pixel.inside = true;
    for (pixel.row = top; pixel.row < lower_int(top + HEIGHT, frame.height); ++pixel.row)
        for (pixel.column = left; pixel.column < lower_int(left + WIDTH, frame.width); ++pixel.column) {
            pixel.at = first + (pixel.row * frame.width + pixel.column);
            resolve_pixel<TYPES, LENS, KEPT, IMAGES, FACTS>(looks, list, scene, camera, world, pixel);
        }
#endif
}

}  // namespace warpcam
