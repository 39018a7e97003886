// Mirrors and glass of the real-time look: a ray in the mirror direction of each smooth surface that a pixel shows, and
// one through each clear one, of the nearest shape that they meet. What they meet is lit as pixels are.
#pragma once
#include "occlusion/occlusion_rays.h"
#include "path/camera_path.h"
#include "path/dielectric.h"
#include "path/lit_surface.h"
#include "path/reflection.h"

namespace warpcam {

constexpr int MAX_SEEN_THROUGH = 8;  // partly transparent surfaces along a ray
constexpr int MAX_INTERNAL = 4;  // total reflections within a clear body
constexpr float FAINTEST = 1.0f / 512.0f;  // share of light that a ray is followed for

// A pixel's own light is multiplied by `kept`; to that is added `rest`, and `share` of what its rays have `seen`.
struct PixelMix {
    Vec3 seen, share, rest;
    float kept;
    Vec3 normal;
    float roughness;  // 0: a mirror, whose neighbours say nothing of it
};

// Facets of a rough surface, one for each pixel of a block: the lobe is what a block sees (Heitz, "Sampling the GGX
// Distribution of Visible Normals", 2018). Below MIRROR_ROUGHNESS lobes are no wider than pixels.
constexpr float MIRROR_ROUGHNESS = 0.1f;
// Of a pixel before its filter: the normal as put_normal() has it, then its roughness, of 255.
constexpr int ROUGHNESS_SHIFT = 8 * NORMAL_BYTES;

struct FacetPattern {
    Float2 at;

    WARPCAM_DEVICE FacetPattern(int column, int row)
    {
        RayPattern pattern(column, row);
        pattern.first /= OCCLUSION_RAYS;
        at = pattern.point(0);
    }

    // The normal of a facet; `to_eye` is on its side of the surface.
    WARPCAM_DEVICE Vec3 facet(Vec3 normal, Vec3 to_eye, float roughness, bool again = false) const
    {
        if (!(roughness > MIRROR_ROUGHNESS))
            return normal;
        const FrameAxes axes(normal);
        Vec3 eye = axes.local(to_eye);
        eye.z = max(eye.z, 1.0e-4f);
        return axes.world(visible_facet(eye, roughness * roughness, again ? at.y : at.x, again ? at.x : at.y));
    }
};

template <class Types, int FLAGS, class Scene_> struct ReflectionTracer : LitWorld<Types, FLAGS, Scene_> {
    using World_ = LitWorld<Types, FLAGS, Scene_>;
    using World_::scene, World_::hub, World_::world, World_::rows, World_::trace, World_::light_of,
        World_::sky_along_ray;
    FacetPattern pattern;

    WARPCAM_DEVICE static Vec3 lerp_to(float share, Vec3 a, Vec3 b) { return a + share * (b - a); }

    WARPCAM_DEVICE static Vec3 mirror_direction(Vec3 normal, Vec3 to_eye)
    {
        return normalized(2.0f * dot(normal, to_eye) * normal - to_eye);
    }

    WARPCAM_INLINED PathSurface surface_at_hit(const PathRay& ray, const PathHit& hit, bool inside) const
    {
        PathSurface surface;
        find_path_surface<Types, FLAGS>(scene, hub, world, ray, hit, rows, inside, surface);
        return surface;
    }

    WARPCAM_DEVICE bool is_thin(int shape) const { return wp::index(scene.shapes.types, shape) == PLANE; }

    WARPCAM_DEVICE float border_reflectance(float cosine, float index, bool thin) const
    {
        float through;
        const float once = fresnel_exact(cosine, 1.0f / index, through);
        return thin ? 2.0f * once / (1.0f + once) : once;
    }

    // The light along a ray; `beyond` comes from behind all shapes. Clear bodies are seen straight through.
    WARPCAM_INLINED Vec3 light_along(PathRay ray, PathQuery query, Vec3 beyond) const
    {
        Vec3 sum { 0.0f, 0.0f, 0.0f }, left { 1.0f, 1.0f, 1.0f };
        for (int layer = 0; layer < MAX_SEEN_THROUGH; ++layer) {
            const PathHit hit = trace(ray, query);
            if (hit.slot < 0)
                return sum + mul(left, beyond);
            const PathSurface surface = surface_at_hit(ray, hit, false);
            const SurfaceMaterial& material = surface.material;
            const Vec3 to_eye = -ray.direction;
            const float alpha = (FLAGS & HAS_TRANSPARENT) ? surface.alpha : 1.0f, clear = surface.transmission;
            Vec3 own { 0.0f, 0.0f, 0.0f };
            if (clear < 1.0f)
                own = light_of(pbr_inputs_of(material), surface, hit.shape, to_eye);
            Vec3 passed { 0.0f, 0.0f, 0.0f };
            if (clear > 0.0f) {
                const float reflected = border_reflectance(dot(surface.normal, to_eye),
                                                           refractive_index(material.reflectance), is_thin(hit.shape));
                const Vec3 sky = sky_along_ray(mirror_direction(surface.normal, to_eye), material.roughness);
                own = lerp_to(clear, own, reflected * sky + material.emission);
                passed = clear * (1.0f - reflected) * material.color;
            }
            sum = sum + alpha * mul(left, own);
            const float open = 1.0f - alpha;
            left = mul(left, Vec3 { open, open, open } + alpha * passed);
            if (!(max(left.x, max(left.y, left.z)) > FAINTEST))
                return sum;
            const float step = hit.t + surface.margin;
            ray.point = surface.point + surface.margin * ray.direction;
            query = query_from(scene.shapes, hit.shape, -1, query.backs);
            query.far -= step;
        }
        return sum;
    }

    // The light that comes through a clear body whose surface is met. `facet`: its normal there; `around`: from lights,
    // added to the sky.
    WARPCAM_INLINED Vec3 refracted_light(const PathSurface& entry, Vec3 facet, int shape, Vec3 to_eye,
                                         Vec3 around) const
    {
        const float index = refractive_index(entry.material.reflectance), roughness = entry.material.roughness;
        const bool backs = scene.frame.backs != 0;
        PathRay ray { entry.point - entry.margin * (entry.front ? entry.outward : -entry.outward), -to_eye };
        const Vec3 color = entry.material.color;
        if (is_thin(shape))
            return mul(color, light_along(ray, query_from(scene.shapes, shape, -1, backs),
                                          around + sky_along_ray(ray.direction, roughness)));
        float through;
        const float cosine = dot(facet, to_eye);
        fresnel_exact(cosine, 1.0f / index, through);
        ray.direction = normalized((cosine / index - through) * facet - 1.0f / index * to_eye);
        for (int bounce = 0;; ++bounce) {
            const PathHit hit = trace(ray, query_from(scene.shapes, shape, shape, backs));
            if (hit.slot < 0)
                return mul(color, around + sky_along_ray(ray.direction, roughness));
            const bool is_exit = hit.shape == shape;
            const PathSurface met = surface_at_hit(ray, hit, is_exit);
            if (!is_exit)
                return mul(color, light_of(pbr_inputs_of(met.material), met, hit.shape, -ray.direction));
            const Vec3 border = pattern.facet(met.normal, -ray.direction, roughness, true);
            const float out = dot(border, -ray.direction);
            const Vec3 facing = met.front ? met.outward : -met.outward;
            fresnel_exact(out, index, through);
            if (through > 0.0f) {  // what is reflected within leaves with the rest
                const Vec3 direction = normalized((index * out - through) * border + index * ray.direction);
                return mul(color, light_along({ met.point - met.margin * facing, direction },
                                              query_from(scene.shapes, shape, -1, backs),
                                              around + sky_along_ray(direction, roughness)));
            }
            const Vec3 direction = mirror_direction(border, -ray.direction);
            if (bounce == MAX_INTERNAL)
                return mul(color, around + sky_along_ray(direction, roughness));
            ray = { met.point + met.margin * facing, direction };
        }
    }

    // What the surface mirrors, in place of the sky, and what is seen through it.
    WARPCAM_INLINED PixelMix mix_at(const PathSurface& surface, int shape, Vec3 to_eye) const
    {
        const SurfaceMaterial& material = surface.material;
        const Vec3 facing = surface.front ? surface.outward : -surface.outward, none { 0.0f, 0.0f, 0.0f };
        const Vec3 facet = pattern.facet(surface.normal, to_eye, material.roughness);
        Vec3 direction = mirror_direction(facet, to_eye);
        if (material.roughness > MIRROR_ROUGHNESS && dot(direction, facing) < 0.0f)
            direction = direction - 2.0f * dot(direction, facing) * facing;
        const Vec3 lobe = lobe_direction(surface.normal, mirror_direction(surface.normal, to_eye), material.roughness);
        const Vec3 around = this->ambient_at(surface, shape), beyond = around + sky_along_ray(lobe, material.roughness);
        const float sharp = sharpness(material.roughness), clear = surface.transmission;
        Vec3 seen = beyond;
        if (sharp > 0.0f && dot(direction, facing) > 0.0f)
            seen = light_along({ surface.point + surface.margin * facing, direction },
                               query_from(scene.shapes, shape, -1, scene.frame.backs != 0), beyond);
        PbrInputs<Vec3> inputs = pbr_inputs_of(material);
        inputs.bsdf.matt = none;  // facets alone
        const float cosine = max(dot(surface.normal, to_eye), 1.0e-4f), part = (1.0f - clear) * inputs.open * sharp;
        const Vec3 replaced =
            environment_brdf(inputs.bsdf, cosine, around + this->sky_on_surface(surface.normal), beyond);
        // what facets reflect to each other comes from the mirror direction, too, so that a mirror keeps all light
        const Vec3 one { 1.0f, 1.0f, 1.0f }, share = part * environment_brdf(inputs.bsdf, cosine, one, one);
        const float blur = material.roughness > MIRROR_ROUGHNESS ? material.roughness : 0.0f;
        PixelMix mix { seen, share, -part * replaced, 1.0f - clear, surface.normal, blur };
        if (clear > 0.0f) {
            const float reflected = border_reflectance(cosine, refractive_index(material.reflectance), is_thin(shape));
            PbrInputs<Vec3> border { {}, material.emission, 0.0f };  // lights' highlights, and what it emits
            set_reflection(border, none, material.roughness, 0.0f, material.reflectance);
            const Vec3 mirrored = lerp_to(sharp, beyond, seen);
            mix.seen = mul(share, seen)
                       + clear * lerp_to(reflected, refracted_light(surface, facet, shape, to_eye, around), mirrored);
            mix.share = one;
            mix.rest = mix.rest + clear * light_of(border, surface, shape, to_eye);
        }
        return mix;
    }

    // True if a shape's material may mirror or refract.
    WARPCAM_DEVICE bool may_mirror(int shape) const
    {
        const int material = material_of(scene.shapes, scene.materials, world, shape);
        if (material < 0 || per_world(scene.physical.reflectance, world, material) < 0.0f)  // UNLIT
            return false;
        if (per_world(scene.physical.transmission, world, material) > 0.0f
            || per_world(scene.physical.roughness, world, material) < ROUGHEST_MIRROR)
            return true;
        return PathNeeds<FLAGS>::MAPPED && texture_of(scene.materials, world, material, ROLE_PACKED) >= 0;
    }

    // `shape`: the one that a pixel shows.
    template <int LENS> WARPCAM_INLINED PixelMix mix_of_pixel(int i, int j, int shape) const
    {
        const PixelMix nothing { {}, {}, {}, 1.0f, { 0.0f, 0.0f, 1.0f }, 0.0f };
        if (!may_mirror(shape) || this->head[FAULTY])
            return nothing;
        const CameraPath from = camera_path<LENS>(this->camera, i, j, 0.5f, 0.5f);
        for (int slot = 0; slot < this->head[NUM_SHAPES]; ++slot) {
            const Float3Int* const own = rows + PATH_SHAPE_ROWS * slot;
            if (load(own, 2).w != shape)
                continue;
            PathHit hit = trace_path<Types>(own, 1, scene.meshes, scene.fields, from.ray,
                                            { from.far, false, false, true, -1, -1 });
            if (hit.slot < 0)
                return nothing;
            hit.slot = slot;
            return mix_at(surface_at_hit(from.ray, hit, false), shape, -from.ray.direction);
        }
        return nothing;
    }
};

// Writes one pixel's mix, for occlusion/reflection_filter.h.
template <class Types, int LENS, int FLAGS, class Scene_, class Views>
WARPCAM_INLINED void trace_reflections(const Scene_& scene, const Views& views, int index)
{
    const auto& frame = scene.frame;
    const unsigned pixels = unsigned(frame.width * frame.height);
    const int world = int(unsigned(index) / pixels), pixel = int(unsigned(index) - unsigned(world) * pixels);
    if (!wp::index(frame.mask, world))
        return;
    const int shape = frame.shape.data[index], column = pixel % frame.width, row = pixel / frame.width;
    const Camera camera = load_camera(wp::index(views, world)), hub = upright(camera);
    PixelMix mix { {}, {}, {}, 1.0f, { 0.0f, 0.0f, 1.0f }, 0.0f };
    if (shape >= 0) {
        const ReflectionTracer<Types, FLAGS, Scene_> tracer {
            {
                scene,
                camera,
                hub,
                world,
                reinterpret_cast<const Float3Int*>(wp::address(frame.rows, world, 0)),
                wp::address(frame.heads, world, 0),
            },
            FacetPattern(column, row),
        };
        mix = tracer.template mix_of_pixel<LENS>(column, row, shape);
    }
    unsigned char normal[NORMAL_BYTES];
    put_normal(normal, transform_transposed(camera.rotation, mix.normal));
    const int surface = normal[0] | normal[1] << 8 | int(255.0f * saturate(mix.roughness) + 0.5f) << ROUGHNESS_SHIFT;
    reinterpret_cast<Float3Int*>(frame.glossy.data)[index] = make_float3_int(mix.seen, surface);
    reinterpret_cast<Float3Int*>(frame.glossy_share.data)[index] = make_float3_int(mix.share, as_int(mix.kept));
    reinterpret_cast<Float3Int*>(frame.reflections.data)[index] = make_float3_int(mix.rest, 0);
}

}  // namespace warpcam
