// Reflection by a metallic-roughness surface that neither loses nor wins light.
//
// The material is the mixture of glTF 2.0, appendix B: a metal, and a matt base under a dielectric layer. Both reflect by
// microfacets of GGX with Smith's height-correlated masking, as shading/ggx.h has them. What facets reflect to each other
// is added as Kulla and Conty do ("Revisiting Physically Based Shading at Imageworks", 2017), and the base gets what the
// layer lets through on the way in and out, normed likewise (Kelemen and Szirmay-Kalos 2001). All parts are reciprocal.
#pragma once
#include "path/frame_axes.h"
#include "shading/ggx.h"

namespace warpcam {

// Share of light that facets reflect at once: `scale` times the reflectance at normal incidence plus `offset` times that
// at grazing incidence; by the root of the cosine and by roughness, with the means over all cosines as last row. See build/facet_albedo.py.
constexpr int ALBEDO_CELLS = 32;

struct DirectAlbedo {
    float scale, offset;

    WARPCAM_DEVICE float whole() const { return min(scale + offset, 1.0f); }
};

struct AlbedoTable {
    const float* values;  // (ALBEDO_CELLS + 1, ALBEDO_CELLS, 2): root, roughness

    WARPCAM_DEVICE DirectAlbedo at(float cosine, float roughness) const
    {
        const float row = sqrt(saturate(cosine)) * float(ALBEDO_CELLS - 1);
        const int first = min(int(row), ALBEDO_CELLS - 2);
        const DirectAlbedo low = of_row(first, roughness), high = of_row(first + 1, roughness);
        const float on = row - float(first);
        return { low.scale + on * (high.scale - low.scale), low.offset + on * (high.offset - low.offset) };
    }
    WARPCAM_DEVICE DirectAlbedo mean(float roughness) const { return of_row(ALBEDO_CELLS, roughness); }

private:
    WARPCAM_DEVICE DirectAlbedo of_row(int row, float roughness) const
    {
        const float column = saturate(roughness) * float(ALBEDO_CELLS - 1);
        const int first = min(int(column), ALBEDO_CELLS - 2);
        const float on = column - float(first);
        const float* const cell = values + 2 * (row * ALBEDO_CELLS + first);
        return { cell[0] + on * (cell[2] - cell[0]), cell[1] + on * (cell[3] - cell[1]) };
    }
};

// The normal of a facet, drawn as the eye sees them, about +z (Dupuy and Benyoub, "Sampling Visible GGX Normals with
// Spherical Caps", 2023).
WARPCAM_DEVICE Vec3 visible_facet(Vec3 eye, float alpha, float u, float v)
{
    const Vec3 bent = normalized(Vec3 { alpha * eye.x, alpha * eye.y, eye.z });
    const Float2 turn = on_circle(u);
    const float z = (1.0f - v) * (1.0f + bent.z) - bent.z, radius = wp::sqrt(clamp(1.0f - z * z, 0.0f, 1.0f));
    const Vec3 sum = Vec3 { radius * turn.x, radius * turn.y, z } + bent;
    return normalized(Vec3 { alpha * sum.x, alpha * sum.y, max(sum.z, 0.0f) });
}

// Reflected by the base, and by the facets.
struct ReflectedParts {
    Vec3 matt, gloss;
};

struct Reflector {
    Vec3 base;  // colour of the matt base, times its share of the mixture
    Bsdf<Vec3> facets;  // of the mixture: reflectances, roughness and squared alpha
    Vec3 bounced;  // what facets reflect among each other, of what they do not reflect at once
    float layer_straight, layer_grazing, layer_bounced;  // the same of the dielectric layer
    float mean_lost,
        layer_mean;  // of light from all around, what facets do not reflect at once, and what the layer does
    AlbedoTable table;

    // A color, its roughness and metalness in [0, 1], and the reflectance of what is no metal at normal incidence.
    WARPCAM_DEVICE Reflector(Vec3 color, float roughness, float metallic, float reflectance, AlbedoTable albedo)
        : table(albedo)
    {
        metallic = saturate(metallic);
        facets = make_bsdf(color, roughness, 0.0f, reflectance);
        base = (1.0f - metallic) * color;
        layer_straight = reflectance;
        layer_grazing = facets.grazing;
        const float metal_grazing = saturate(17.0f * (color.x + color.y + color.z));
        facets.straight = (1.0f - metallic) * facets.straight + metallic * color;
        facets.grazing += metallic * (metal_grazing - layer_grazing);
        const DirectAlbedo all = table.mean(facets.roughness);
        mean_lost = max(1.0f - all.whole(), 1.0e-6f);
        layer_bounced = bounces(layer_straight, layer_grazing);
        layer_mean = all.scale * layer_straight + all.offset * layer_grazing + layer_bounced * mean_lost;
        const float own = (1.0f - metallic) * layer_bounced;
        bounced = { own + metallic * bounces(color.x, metal_grazing), own + metallic * bounces(color.y, metal_grazing),
                    own + metallic * bounces(color.z, metal_grazing) };
    }

    // Light from `to_light` to `to_eye`, both over the surface, without the cosine [1/sr].
    WARPCAM_DEVICE ReflectedParts value(Vec3 normal, Vec3 to_eye, Vec3 to_light) const
    {
        const float eye = dot(normal, to_eye), light = dot(normal, to_light);
        if (!(eye > 0.0f && light > 0.0f))
            return { { 0.0f, 0.0f, 0.0f }, { 0.0f, 0.0f, 0.0f } };
        const Vec3 half = normalized(to_eye + to_light);
        const float once = ggx_ndf(normal, half, facets.square) * smith_visibility(light, eye, facets.square);
        const DirectAlbedo out = table.at(eye, facets.roughness), in = table.at(light, facets.roughness);
        const float again = (1.0f - out.whole()) * (1.0f - in.whole()) / (PI * mean_lost);
        const float through = (1.0f - layer(out)) * (1.0f - layer(in)) / (PI * max(1.0f - layer_mean, 1.0e-6f));
        return { through * base, once * fresnel(facets, dot(to_eye, half)) + again * bounced };
    }

    // Share of directions that are drawn from the facets, not from the cosine.
    WARPCAM_DEVICE float facet_share(float eye_cosine) const
    {
        const DirectAlbedo out = table.at(eye_cosine, facets.roughness);
        const float once = brightness(out.scale * facets.straight) + out.offset * facets.grazing;
        const float rest = brightness(bounced) * (1.0f - out.whole()) + brightness(base) * (1.0f - layer(out));
        return once > 0.0f ? max(once / (once + rest), 0.1f) : 0.0f;
    }

    // Density of sample() [1/sr].
    WARPCAM_DEVICE float density(Vec3 normal, Vec3 to_eye, Vec3 to_light, float share) const
    {
        const float eye = dot(normal, to_eye), light = dot(normal, to_light);
        if (!(eye > 0.0f && light > 0.0f))
            return 0.0f;
        const Vec3 half = normalized(to_eye + to_light);
        const float square = facets.square;
        const float visible =
            ggx_ndf(normal, half, square) * 0.5f / (eye + wp::sqrt(square + (1.0f - square) * eye * eye));
        return share * visible + (1.0f - share) * light * (1.0f / PI);
    }

    // Draws a direction to the light; below the surface where a facet reflects there.
    WARPCAM_DEVICE Vec3 sample(const FrameAxes& axes, Vec3 to_eye, float share, float choice, float u, float v) const
    {
        if (choice >= share)
            return axes.world(cosine_direction(u, v));
        const Vec3 eye = axes.local(to_eye), half = visible_facet(eye, wp::sqrt(facets.square), u, v);
        return axes.world(2.0f * dot(eye, half) * half - eye);
    }

private:
    WARPCAM_DEVICE static float brightness(Vec3 color) { return (color.x + color.y + color.z) * (1.0f / 3.0f); }

    // Of light that facets do not reflect at once, the share that they reflect in the end.
    WARPCAM_DEVICE float bounces(float straight, float grazing) const
    {
        const float mean = straight + (grazing - straight) * (1.0f / 21.0f);
        return mean * mean * (1.0f - mean_lost) / (1.0f - mean * mean_lost);
    }

    // Share of light that the dielectric layer reflects.
    WARPCAM_DEVICE float layer(const DirectAlbedo& albedo) const
    {
        return albedo.scale * layer_straight + albedo.offset * layer_grazing + layer_bounced * (1.0f - albedo.whole());
    }
};

}  // namespace warpcam
