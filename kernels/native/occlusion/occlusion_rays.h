// The rays of a pixel: around its surface for light from all around, and to the surfaces of lights.
//
// A light's share is the light of the rays that nothing stops over that of all, so that what arrives without shadows stays
// as shading/area_lights.h has it (Heitz, Hill and McGuire, "Combining Analytic Direct Illumination and Stochastic
// Shadows", 2018).
#pragma once
#include "occlusion/ray_pattern.h"
#include "output/hit_attributes.h"
#include "path/lamps.h"
#include "path/trace_path.h"
#include "shading/appearance.h"
#include "shading/environment_map.h"
#include "shading/light_visibility.h"

namespace warpcam {

// Bytes of a pixel before they are filtered: its normal in the camera's frame, by an octahedral map; then share_byte() of
// AMBIENT_SHARES for the light from all around, if it is asked for, and of one for each light that is kept.
constexpr int NORMAL_BYTES = 2;

// 2 * 127 * share, and 1 more where it is that of a light without size, whose shadows are sharp.
WARPCAM_DEVICE unsigned char share_byte(float share, bool sharp)
{
    return static_cast<unsigned char>(2 * int(127.0f * saturate(share) + 0.5f) + (sharp ? 1 : 0));
}

WARPCAM_DEVICE unsigned char signed_byte(float v) { return static_cast<unsigned char>(int(127.0f * v + 127.5f)); }
WARPCAM_DEVICE float from_signed_byte(unsigned char v) { return (1.0f / 127.0f) * float(v) - 1.0f; }

WARPCAM_DEVICE void put_normal(unsigned char* bytes, Vec3 normal)
{
    const Float2 at = to_octahedron(normal);
    bytes[0] = signed_byte(at.x);
    bytes[1] = signed_byte(at.y);
}

WARPCAM_DEVICE Vec3 stored_normal(const unsigned char* bytes)
{
    return normalized(from_octahedron(from_signed_byte(bytes[0]), from_signed_byte(bytes[1])));
}

// The surface that a pixel shows; from the camera, along the world's axes.
struct OcclusionPoint {
    Vec3 point;  // moved off the surface by more than rounding [m]
    Vec3 facing, normal;  // unit, towards the camera's side: of the geometry, and smooth
};

// A ray of the pattern around the surface, cosine-weighted.
WARPCAM_DEVICE Vec3 ray_around(const OcclusionPoint& from, const RayPattern& pattern, int ray)
{
    const Float2 at = pattern.point(ray);
    const Vec3 direction = FrameAxes(from.normal).world(cosine_direction(at.x, at.y));
    const float side = dot(direction, from.facing);
    return side < 0.0f ? direction - 2.0f * side * from.facing : direction;
}

template <class Types, class Frame, class Meshes, class HeightFields> struct OcclusionRays {
    const Frame& frame;
    const Meshes& meshes;
    const HeightFields& fields;
    OcclusionPoint from;
    RayPattern pattern;
    int world;
    int convex;  // the analytic shape that they leave, or -1

    WARPCAM_DEVICE bool is_open(Vec3 direction, float far) const
    {
        const Float3Int* const rows = reinterpret_cast<const Float3Int*>(wp::address(frame.rows, world, 0));
        const PathQuery query { far, true, frame.backs != 0, false, convex, -1 };
        return trace_path<Types>(rows, wp::index(frame.counts, world), meshes, fields, { from.point, direction }, query)
                   .slot
               < 0;
    }

    // Of light from all around, what nothing within the radius hides, and how what is hidden rises along the surface: the
    // square of a direction's part along an axis there is 1/4 in the mean.
    WARPCAM_DEVICE void put_ambient(unsigned char* bytes) const
    {
        int open = 0;
        Vec3 hidden { 0.0f, 0.0f, 0.0f };
#pragma unroll 1
        for (int ray = 0; ray < OCCLUSION_RAYS; ++ray) {
            const Vec3 direction = ray_around(from, pattern, ray);
            if (is_open(direction, min(frame.radius, MAX_RAY_T)))
                ++open;
            else
                hidden = hidden + direction;
        }
        const Vec3 rise = (4.0f / OCCLUSION_RAYS) * (hidden - dot(hidden, from.normal) * from.normal);
        const auto level_of = [](float v) {
            return share_byte((1.0f / 127.0f) * (float(LEVEL_BEFORE) + RISE_BEFORE * clamp(v, -1.0f, 1.0f)), false);
        };
        bytes[0] = share_byte(float(open) * (1.0f / OCCLUSION_RAYS), false);
        bytes[1] = level_of(rise.x);
        bytes[2] = level_of(rise.y);
        bytes[3] = level_of(rise.z);
    }

    // Of a light, along the world's axes.
    WARPCAM_DEVICE unsigned char share_of(const AreaLight& lamp) const
    {
        const float smallest = is_distant(lamp) ? SMALLEST_SUN : 0.0f;
        const bool sharp = !(lamp.size.x > smallest);
        float all = 0.0f, arriving = 0.0f;
#pragma unroll 1
        for (int ray = 0; ray < (sharp ? 1 : OCCLUSION_RAYS); ++ray) {
            const Float2 at = pattern.point(ray);
            const LampSample sample = draw_lamp(lamp, from.point, at.x, at.y);
            const float light = sample.weight * dot(from.normal, sample.direction);
            if (!(light > 0.0f && dot(from.facing, sample.direction) > 0.0f))
                continue;
            all += light;
            arriving += is_open(sample.direction, sample.distance) ? light : 0.0f;
        }
        return share_byte(all > 0.0f ? arriving / all : 0.0f, sharp);
    }
};

template <class Types, int LENS, class Frame, class Shapes, class Meshes, class HeightFields>
WARPCAM_DEVICE OcclusionPoint occlusion_point(const Frame& frame, const Shapes& shapes, const Meshes& meshes,
                                              const HeightFields& fields, const Camera& camera, int world, int index,
                                              const CameraRay<LENS>& seen)
{
    const int shape = frame.shape.data[index];
    const ShapeFromCamera pose = load_pose<Types>(shapes, meshes, camera, world, shape);
    int face = -1;
    if constexpr (Types::has_any(MESH, HEIGHT_FIELD))
        face = stored_face<Types>(frame.face.data[index]);
    Vec3 place, ray;
    const Vec3 local = locate_hit<LENS>(pose, seen.x, seen.y, frame.depth.data[index], place, ray);
    const SurfaceInteraction surface = surface_at<Types>(pose, meshes, fields, face, local, ray);
    const float side = dot(surface.normal, ray) > 0.0f ? -1.0f : 1.0f;
    const Vec3 p = transform(camera.rotation, place);
    OcclusionPoint found;
    found.facing = side * transform(camera.rotation, pose.seen(surface.normal));
    found.normal = side * transform(camera.rotation, pose.seen(smooth_normal<Types>(pose, meshes, surface)));
    const float sizes = abs(p.x) + abs(p.y) + abs(p.z) + abs(local.x) + abs(local.y) + abs(local.z);
    found.point = p + 4.0e-6f * sizes * found.facing;
    return found;
}

// Traces the rays of one pixel.
template <class Types, int LENS, bool AMBIENT, bool LIGHTS, class Frame, class Shapes, class Meshes, class HeightFields,
          class Physical>
WARPCAM_DEVICE void trace_occlusion(const Frame& frame, const Shapes& shapes, const Meshes& meshes,
                                    const HeightFields& fields, const Physical& physical, int index)
{
    const unsigned pixels = unsigned(frame.width * frame.height);
    const int world = int(unsigned(index) / pixels), pixel = int(unsigned(index) - unsigned(world) * pixels);
    if (!wp::index(frame.mask, world) || frame.shape.data[index] < 0)
        return;
    const int row = pixel / frame.width, column = pixel - row * frame.width;
    const Camera camera = load_camera(wp::index(frame.views, world));
    const int shape = frame.shape.data[index], type = wp::index(shapes.types, shape);
    const OcclusionPoint from = occlusion_point<Types, LENS>(frame, shapes, meshes, fields, camera, world, index,
                                                             view_ray<LENS>(camera, column, row));
    const OcclusionRays<Types, Frame, Meshes, HeightFields> rays {
        frame, meshes, fields, from, RayPattern(column, row), world, type == MESH || type == HEIGHT_FIELD ? -1 : shape
    };
    unsigned char* bytes = reinterpret_cast<unsigned char*>(frame.rays.data + index);
    put_normal(bytes, transform_transposed(camera.rotation, from.normal));
    bytes += NORMAL_BYTES;
    if constexpr (AMBIENT) {
        rays.put_ambient(bytes);
        bytes += AMBIENT_SHARES;
    }
    if constexpr (LIGHTS) {
        const auto& lights = physical.plain;
        const Camera hub = upright(camera);
        ActiveLights active = active_lights(lights);
        for (int light = 0; light < lights.types.shape[1]; ++light) {
            const int place = active.next(lights, world, light);
            if (place < 0)
                continue;
            const AreaLight lamp = load_area_light<true>(physical, hub, world, light, place);
            bytes[place] = lamp.diffuse.w & CASTS ? rays.share_of(lamp) : share_byte(1.0f, true);
        }
    }
}

}  // namespace warpcam
