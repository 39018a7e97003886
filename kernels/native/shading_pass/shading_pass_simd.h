// From the visibility buffer to colours on a CPU: pixels of a few rows are sorted by the shape that they show, and
// those of one shape are drawn eight at once.
#pragma once
#include "shading_pass/sort_by_shape_simd.h"
#include "shading/appearance_cache.h"
#include "camera/view_rays_simd.h"
#include "shading/pbr_simd.h"
#include "shading/fixed_function_simd.h"

namespace warpcam {

// Colours of the pixels of a few rows. APART: as numbers, to be covered by other layers; else as bytes.
template <int SIZE, int IMAGES, bool APART> struct ShadedRows {
    static constexpr bool LINEAR = APART || (IMAGES & HDR), DISPLAY = APART;
    static constexpr bool WORDS = !APART && (IMAGES & (RGB | RGBA));
    Vec3 linear[LINEAR ? SIZE : 1], display[DISPLAY ? SIZE : 1], normal[IMAGES & NORMALS ? SIZE : 1];
    unsigned words[WORDS ? SIZE : 1];  // R, G, B, A
    unsigned albedo[IMAGES & ALBEDO ? SIZE : 1];

    void put_light(const short* pixels, int count, const Vec3x8& own_linear, const Vec3x8& own_display, unsigned alpha)
    {
        if constexpr (LINEAR)
            for (int k = 0; k < count; ++k)
                linear[pixels[k]] = get_lane(own_linear, k);
        if constexpr (DISPLAY)
            for (int k = 0; k < count; ++k)
                display[pixels[k]] = get_lane(own_display, k);
        if constexpr (WORDS) {
            const Int8 bytes = to_bytes(own_display) | int(alpha);
            if (count == SIMD_WIDTH && in_a_row(pixels))
                __builtin_memcpy(words + pixels[0], &bytes, sizeof bytes);
            else
                for (int k = 0; k < count; ++k)
                    words[pixels[k]] = unsigned(bytes[k]);
        }
    }

    void put_normals(const short* pixels, int count, const Vec3x8& normals)
    {
        for (int k = 0; k < count; ++k)
            normal[pixels[k]] = get_lane(normals, k);
    }

    void put_albedo(const short* pixels, int count, const Vec3x8& color)
    {
        const Int8 bytes = to_bytes(color);
        for (int k = 0; k < count; ++k)
            albedo[pixels[k]] = unsigned(bytes[k]);
    }

    ShadedPixel shown(int place) const
    {
        ShadedPixel shown;
        shown.linear = linear[LINEAR ? place : 0];
        shown.display = display[DISPLAY ? place : 0];
        if (IMAGES & NORMALS)
            shown.normal = normal[place];
        if (IMAGES & ALBEDO)
            shown.albedo = color_of(albedo[place]);
        return shown;
    }

    static Vec3 color_of(unsigned word)
    {
        return (1.0f / 255.0f) * Vec3 { float(word & 0xff), float(word >> 8 & 0xff), float(word >> 16 & 0xff) };
    }

    // Writes a row of pixels that begins at `at`.
    template <class Images, class Ids>
    void write(const Images& images, const Ids& ids, size_t at, int place, int width) const
    {
        if constexpr (WORDS && (IMAGES & RGB))
            put_colors(images.rgb.data + 3 * at, words + place, width);
        if constexpr (WORDS && (IMAGES & RGBA))
            __builtin_memcpy(images.rgba.data + 4 * at, words + place, 4 * size_t(width));
        if constexpr ((IMAGES & HDR) != 0)
            __builtin_memcpy(images.hdr.data + 3 * at, linear + place, sizeof(Vec3) * width);
        if constexpr ((IMAGES & (NORMALS | ALBEDO)) != 0)
            for (int k = 0; k < width; ++k) {
                const bool hit = ids.data[at + k] >= 0;
                if constexpr ((IMAGES & NORMALS) != 0)
                    put_three(images.normals.data, unsigned(at) + k,
                              hit ? normal[place + k] : Vec3 { 0.0f, 0.0f, 0.0f });
                if constexpr ((IMAGES & ALBEDO) != 0)
                    put_color(images.albedo.data + 3 * (at + k), hit ? albedo[place + k] : 0u);
            }
    }

    static void put_color(unsigned char* to, unsigned word)
    {
        for (int k = 0; k < 3; ++k)
            to[k] = static_cast<unsigned char>(word >> 8 * k);
    }

    static void put_colors(unsigned char* to, const unsigned* from, int count)
    {
        typedef unsigned char Bytes __attribute__((ext_vector_type(32)));
        int done = 0;
        for (; done + SIMD_WIDTH <= count; done += SIMD_WIDTH) {
            Bytes bytes;
            __builtin_memcpy(&bytes, from + done, sizeof bytes);
            bytes = __builtin_shufflevector(bytes, bytes, 0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, 16, 17, 18, 20, 21,
                                            22, 24, 25, 26, 28, 29, 30, -1, -1, -1, -1, -1, -1, -1, -1);
            __builtin_memcpy(to + 3 * done, &bytes, 3 * SIMD_WIDTH);
        }
        for (; done < count; ++done)
            put_color(to + 3 * done, from[done]);
    }
};

// Eight pixels of one shape.
struct EightHits {
    Float8 x, y, depth;
    Int8 shadow;
    int faces[SIMD_WIDTH];
    PixelShares<Vec3x8> shares;
    PixelLight<Vec3x8> indirect;
};

// World-frame normals of surfaces that face the camera.
template <class Types, class Appearances, class Scene_>
inline Vec3x8 facing_normals(const Appearances& look, const Scene_& scene, const SurfaceInteraction8& surface,
                             const Vec3x8& ray)
{
    const ShapeToWorldRotation& turn = look.turn;
    const Float3Int a = turn.axis_x, b = turn.axis_y, c = turn.axis_z;
    Vec3x8 normal = surface.normal;
    if constexpr (Types::has(LIT_NORMALS))
        normal = smooth_normal<Types>(look.pose, scene.meshes, surface);
    const Vec3x8 turned { a.x * normal.x + a.y * normal.y + a.z * normal.z,
                          b.x * normal.x + b.y * normal.y + b.z * normal.z,
                          c.x * normal.x + c.y * normal.y + c.z * normal.z };
    return select(dot(surface.normal, ray) > 0.0f, -turned, turned);
}

// The light on eight places of a shape, as MuJoCo's renderer has it, before its texture.
template <class Types, int LENS, int FLAGS, bool LINEAR, class Appearances, class List, class Scene_>
inline void light_eight(const Appearances& look, int id, const List& lights, const Scene_& scene, const Camera& camera,
                        const SurfaceInteraction8& surface, const OffsetRay8& offset_rays, const Vec3x8& place,
                        Int8 shadow, Lits& lit)
{
    constexpr bool SHADOWS = FLAGS & HAS_SHADOWS, BY_CORNERS = lit_by_corners<List>(SHADOWS);
    const ShapeFromCamera& pose = look.pose;
    if constexpr (SHADOWS && (Types::GEOMETRY & SHADES_ITSELF))
        if (lights.dims && (SHADES_ITSELF >> pose.type() & 1))
            shadow |= own_shadow(lights, camera, place, pose.seen(surface.normal));
    Int8 inside = 0;
    if constexpr (BY_CORNERS)
        if (id == lights.grid.shape) {
            const OnCornersOfEight on = on_corners(lights.grid, surface.local);
            lit.display = light_from_corners(lights.grid, on, shadow);
            inside = on.inside;
        }
    if (!any(~inside)) {
        lit.linear = lit.display;
        return;
    }
    GouraudTriangle8 gouraud;
    gouraud_at<Types>(look, scene.meshes, surface, place, gouraud);
    const bool at_corners = Types::has_any(PLANE, HEIGHT_FIELD, BOX, MESH) && lit_at_corners<Types>(look);
    Lits own;
    const auto light_corners = [&](const auto&... eye) {
        illuminate_eight<SHADOWS, LINEAR>(lights, gouraud, at_corners ? 3 : 1, look.material, shadow, own, eye...);
    };
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS)
        light_corners(offset_rays.start);
    else
        light_corners();
    lit = BY_CORNERS ? Lits { own.linear, select(inside, lit.display, own.display) } : own;
}

// Packets of a shape that are shaded together, step by step: the others fill the latency of each one's steps.
constexpr int TOGETHER = 4;

// Shades packets; of the last packet `rest` pixels count, of the others all.
template <class Types, int LENS, int IMAGES, int FLAGS, class Appearances, class List, class Scene_, class Rows,
          class ShadedRows_>
WARPCAM_NOINLINE_CPU inline void shade_packets(const Appearances& look, const Levels* levels, int id,
                                               const List& lights, const Scene_& scene, const Rows& rows, Vec3 gain,
                                               const EightHits* hits, const short* pixels, int packets, int rest,
                                               ShadedRows_& shaded)
{
    using Wants = ShadingNeeds<IMAGES, FLAGS>;
    constexpr bool SHADOWS = FLAGS & HAS_SHADOWS;
    const ShapeFromCamera& pose = look.pose;
    const Float8 one = 1.0f;
    Vec3x8 rays[TOGETHER], textures[TOGETHER];
    OffsetRay8 offset_rays[TOGETHER];
    SurfaceInteraction8 surfaces[TOGETHER];
    const auto count_of = [&](int packet) { return packet + 1 < packets ? SIMD_WIDTH : rest; };
    for (int n = 0; n < packets; ++n) {
        const EightHits& hit = hits[n];
        offset_rays_of<LENS>(hit.x, hit.y, offset_rays[n]);
        rays[n] = pose.local(offset_rays[n].direction);
        const Vec3x8 away =
            has_centre(LENS) ? hit.depth * rays[n] : pose.local(places_on<LENS>(offset_rays[n], hit.depth));
        surfaces[n].local = broadcast(pose.eye()) + away;
        find_surface<Types>(pose, scene.meshes, scene.fields, hit.faces, rays[n], surfaces[n]);
        textures[n] = { one, one, one };
    }
    const auto steps = [&](int n, Vec3x8& right, Vec3x8& down) {
        OffsetRay8 across, below;
        rows.steps(pixels + n * SIMD_WIDTH, count_of(n), hits[n].x, hits[n].y, across, below);
        right = pose.local(places_on<LENS>(across, hits[n].depth));
        down = pose.local(places_on<LENS>(below, hits[n].depth));
    };
    if constexpr (Wants::TEXTURED)
        if (levels) {
            texture_colors<Types>(look, *levels, scene.meshes, scene.textures, steps, surfaces, rays, packets,
                                  textures);
            for (int n = 0; Wants::PBR && n < packets; ++n)
                textures[n] = srgb_to_linear(textures[n]);
        }
    if constexpr ((IMAGES & NORMALS) != 0)
        for (int n = 0; n < packets; ++n)
            shaded.put_normals(pixels + n * SIMD_WIDTH, count_of(n),
                               facing_normals<Types>(look, scene, surfaces[n], rays[n]));
    if constexpr ((IMAGES & ALBEDO) != 0)
        for (int n = 0; n < packets; ++n) {
            const Vec3x8 albedo = mul(broadcast(clip(as_vec3(look.material.color))), textures[n]);
            shaded.put_albedo(pixels + n * SIMD_WIDTH, count_of(n), Wants::PBR ? linear_to_srgb(albedo) : albedo);
        }
    for (int n = 0; Wants::LIT && n < packets; ++n) {
        const Vec3x8 place = places_on<LENS>(offset_rays[n], hits[n].depth);
        const Int8 shadow = SHADOWS ? hits[n].shadow : (Int8)0;
        Lits lit;
        if constexpr (Wants::LIT && Wants::PBR) {
            const Vec3x8 to_eye =
                LENS == ORTHOGRAPHIC || LENS == RAY_TABLE_WITH_ORIGINS ? -offset_rays[n].direction : -normalized(place);
            const auto own_steps = [&](Vec3x8& right, Vec3x8& down) { steps(n, right, down); };
            shade_eight_physically<Types, FLAGS>(look, lights, scene, rows.camera.rotation, own_steps, surfaces[n],
                                                 place, to_eye, rays[n], textures[n], visibility8_of<FLAGS>(hits[n]),
                                                 lit.linear);
            if (FLAGS & HAS_EXPOSURE)
                lit.linear = mul(broadcast(gain), lit.linear);
            lit.display = display_color<FLAGS>(lit.linear);
        } else if constexpr (Wants::LIT) {
            light_eight<Types, LENS, FLAGS, ShadedRows_::LINEAR>(look, id, lights, scene, rows.camera, surfaces[n],
                                                                 offset_rays[n], place, shadow, lit);
            const Vec3x8 scaled = FLAGS & HAS_EXPOSURE ? mul(broadcast(gain), textures[n]) : textures[n];
            lit = { mul(lit.linear, scaled), mul(lit.display, scaled) };
        }
        shaded.put_light(pixels + n * SIMD_WIDTH, count_of(n), lit.linear, lit.display, 0xff000000u);
    }
}

// An environment along rays that `rows` finds.
template <int LENS, class Rows>
inline Vec3x8 environment_of(const Environment& environment, const Rows& rows, const short* pixels, int count)
{
    Float8 x, y;
    OffsetRay8 rays, right, down;
    rows.find(pixels, count, x, y);
    rows.steps(pixels, count, x, y, right, down);
    offset_rays_of<LENS>(x, y, rays);
    Vec3x8 light;
    for (int k = 0; k < SIMD_WIDTH; ++k) {
        const auto turned = [&](const Vec3x8& v) { return transform(rows.camera.rotation, get_lane(v, k)); };
        set_lane(
            light, k,
            environment_behind(environment, turned(rays.direction), turned(right.direction), turned(down.direction)));
    }
    return light;
}

// Writes the background.
template <int LENS, int IMAGES, int FLAGS, class List, class Scene_, class Rows, class ShadedRows_>
WARPCAM_NOINLINE_CPU inline void shade_background(const List& lights, const Scene_& scene, const Rows& rows, int world,
                                                  Vec3 gain, const short* pixels, int count, ShadedRows_& shaded)
{
    const auto& background = background_of<FLAGS>(scene, world);
    Vec3x8 color = broadcast(as_vec3(background.color));
    const Image image = FLAGS & HAS_SKYBOX ? load_image(scene.textures, background.skybox) : Image { 0, 0, 0, 0 };
    const Mat3& r = rows.camera.rotation;
    const auto axis = [&](int k) { return broadcast(Vec3 { r.at[0][k], r.at[2][k], -r.at[1][k] }); };
    const Vec3x8 x_axis = axis(0), y_axis = axis(1), z_axis = axis(2);
    const auto to_sky = [&](Vec3x8 v) { return v.x * x_axis + v.y * y_axis + v.z * z_axis; };
    const Levels levels(image, 6);
    for (int first = 0; first < count; first += SIMD_WIDTH) {
        const int some = min(SIMD_WIDTH, count - first);
        if ((FLAGS & HAS_SKYBOX) && image.levels > 0) {
            Float8 x, y;
            OffsetRay8 offset_rays, right, down;
            rows.find(pixels + first, some, x, y);
            rows.steps(pixels + first, some, x, y, right, down);
            offset_rays_of<LENS>(x, y, offset_rays);
            if (LENS == ORTHOGRAPHIC && scene.frame.horizon > 0.0f) {
                const auto upright = [&](Vec3x8 v) {
                    const Vec3x8 d = to_sky(v);
                    return Vec3x8 { d.x, -d.z, d.y };
                };
                const Vec3x8 place = place_on_sky(upright(offset_rays.start), upright(offset_rays.direction),
                                                  (Float8)(SKY_DISTANCE * scene.frame.horizon));
                sample_cubes(scene.textures.texels.data, levels, Vec3x8 { place.x, place.z, -place.y },
                             to_sky(right.start), to_sky(down.start), color);
            } else {
                sample_cubes(scene.textures.texels.data, levels, to_sky(offset_rays.direction), to_sky(right.direction),
                             to_sky(down.direction), color);
            }
        }
        Vec3x8 linear = color, display = color;
        if constexpr ((FLAGS & PHYSICAL) != 0) {
            linear = srgb_to_linear(color);
            if constexpr ((FLAGS & HAS_SKYBOX) != 0)
                linear = mul(broadcast(lights.sky.gain), linear);
        }
        if constexpr ((FLAGS & SHOWS_ENVIRONMENT) != 0)
            linear =
                environment_of<LENS>(load_environment(scene.physical.environments, world), rows, pixels + first, some);
        if (FLAGS & HAS_EXPOSURE)
            linear = display = mul(broadcast(gain), linear);
        if constexpr ((FLAGS & PHYSICAL) != 0
                      && (FLAGS & (HAS_SKYBOX | SHOWS_ENVIRONMENT | HAS_EXPOSURE | TONE_FLAGS)) != 0)
            display = display_color<FLAGS>(linear);
        shaded.put_light(pixels + first, some, linear, display, 0u);
    }
}

// Loads the hits of eight pixels, of which `count` are given; further lanes repeat the last.
template <class Types, int FLAGS, int WIDTH, class Frame, class Rows>
inline void load_hits(const Frame& frame, size_t first, const Rows& rows, const short* pixels, int count,
                      EightHits& hits)
{
    constexpr bool FACES = Types::has_any(MESH, HEIGHT_FIELD), SHADOWS = FLAGS & HAS_SHADOWS;
    rows.find(pixels, count, hits.x, hits.y);
    find_pixel_light<FLAGS, WIDTH>(frame, first, pixels, count, hits);
    if (in_one_row<WIDTH>(pixels, count)) {
        const size_t at = first + size_t(pixels[0] / WIDTH) * frame.width + pixels[0] % WIDTH;
        __builtin_memcpy(&hits.depth, frame.depth.data + at, sizeof hits.depth);
        if (FACES) {
            Int8 faces = load8(frame.face.data + at);
            if (Types::has(HEIGHT_FIELD) && sizeof *frame.face.data == 2)
                faces |= faces == 0xffff;  // see stored_face()
            store8(hits.faces, faces);
        }
        if (SHADOWS)
            hits.shadow = load8(frame.shadow.data + at);
        return;
    }
    float depth[SIMD_WIDTH];
    int shadow[SIMD_WIDTH];
    for (int k = 0; k < SIMD_WIDTH; ++k) {
        const int pixel = pixels[min(k, count - 1)];
        const size_t at = first + size_t(pixel / WIDTH) * frame.width + pixel % WIDTH;
        depth[k] = frame.depth.data[at];
        if (FACES)
            hits.faces[k] = stored_face<Types>(frame.face.data[at]);
        if (SHADOWS)
            shadow[k] = frame.shadow.data[at];
    }
    __builtin_memcpy(&hits.depth, depth, sizeof depth);
    if (SHADOWS)
        __builtin_memcpy(&hits.shadow, shadow, sizeof shadow);
}

// Shades the pixels of a few rows. `look_at(id)` gives a shape's look.
template <class Types, int LENS, int IMAGES, int FLAGS, int WIDTH, int SIZE, bool BEHIND, class List, class Scene_,
          class Rows, class LookAt, class ShadedRows_>
inline void shade_sorted(const Sorted<SIZE>& sorted, const List& lights, const Scene_& scene, const Rows& rows,
                         int world, size_t first, const LookAt& look_at, ShadedRows_& shaded)
{
    using Wants = ShadingNeeds<IMAGES, FLAGS>;
    const auto& frame = scene.frame;
    const Vec3 gain = exposed<FLAGS>(scene, world, { 1.0f, 1.0f, 1.0f });
    for (int group = 0, begin = 0; group < sorted.count; begin = sorted.ends[group++]) {
        const int id = sorted.shapes[group], total = sorted.ends[group] - begin;
        const short* const pixels = sorted.order + begin;
        if (id < 0) {
            if constexpr (BEHIND && Wants::LIT)
                shade_background<LENS, IMAGES, FLAGS>(lights, scene, rows, world, gain, pixels, total, shaded);
            continue;
        }
        const auto& look = look_at(id);
        bool textured = false;
        Image image { 0, 0, 0, 0 };
        int faces = 1;
        if constexpr (Wants::TEXTURED) {
            image = look.layout.image;
            textured = image.levels > 0;
            faces = look.layout.cube ? 6 : 1;
        }
        const Levels levels(image, faces);
        for (int done = 0; done < total; done += TOGETHER * SIMD_WIDTH) {
            EightHits hits[TOGETHER];
            const int packets = min(TOGETHER, (total - done + SIMD_WIDTH - 1) / SIMD_WIDTH);
            for (int n = 0; n < packets; ++n) {
                const int from = done + n * SIMD_WIDTH;
                load_hits<Types, Wants::LIT ? FLAGS : 0, WIDTH>(frame, first, rows, pixels + from,
                                                                min(SIMD_WIDTH, total - from), hits[n]);
            }
            shade_packets<Types, LENS, IMAGES, FLAGS>(
                look, textured ? &levels : nullptr, id, lights, scene, rows, gain, hits, pixels + done, packets,
                min(SIMD_WIDTH, total - done - (packets - 1) * SIMD_WIDTH), shaded);
        }
    }
}

}  // namespace warpcam
