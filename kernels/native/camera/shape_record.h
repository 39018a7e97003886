// A shape as one view sees it: the record every ray of the view is tested against.
#pragma once
#include "core/mat3.h"
#include "shapes/analytic_shapes.h"

namespace warpcam {

// Features of a scene, as bits those of SceneFlag in flags.py.
enum SceneFeature {
    PER_SHAPE_SCALE,
    TWO_SIDED,
    ALPHA_TESTED,
    SHADING_BACKS,
    DEFORMING_MESHES,
    TRANSPARENT_CASTERS,
    TEXTURE_FROM_ABOVE,
    TEXTURELESS_SHAPES,
    MIDDLE_FIRST,
    HAS_OCCLUDER_BOXES,
    PROJECTED,
    TRIPLANAR,
    TEXTURE_ALPHA,
    LIT_NORMALS,
    COINCIDENT,
    PLANES_FROM_BEHIND,
    BACKS_UNLIT
};

// Shape types and features that a kernel is compiled for.
template <int GEOMETRY_, int FEATURES_> struct SceneTypes {
    static constexpr int GEOMETRY = GEOMETRY_, FEATURES = FEATURES_;
    static constexpr int ANALYTIC = GEOMETRY & ~(1 << MESH | 1 << HEIGHT_FIELD);  // types that rays do not walk through

    static constexpr bool has(ShapeType type) { return GEOMETRY >> type & 1; }
    static constexpr bool has(SceneFeature feature) { return FEATURES >> feature & 1; }
    template <class... Types> static constexpr bool has_any(Types... types) { return (has(types) || ...); }
};

// RAYS: from a table, see camera/ray_table.h; RAY_TABLE_WITH_ORIGINS: likewise, and each begins at a place of its own,
// see camera/offset_rays.h.
enum Lens { PINHOLE, ORTHOGRAPHIC, RAYS, RAY_TABLE_WITH_ORIGINS };

// Rays that have unit directions, and distances along them in place of planar depths.
constexpr bool has_table(int lens) { return lens == RAYS || lens == RAY_TABLE_WITH_ORIGINS; }

// Rays that all begin where the camera is.
constexpr bool has_centre(int lens) { return lens == PINHOLE || lens == RAYS; }

// The rows take camera coordinates to the shape's own, in which spheres and ellipsoids are the unit sphere, boxes
// the cube of half width 1, cylinders and cones have radius and half length 1, capsules radius 1, barrels end radius 1;
// meshes and height fields have their own coordinates; the rest is unscaled.
// A ray of the view is then origin + t * row . (x, y, -1), and its t is planar depth. Rays of a table have unit
// directions instead, and t is the distance along them: then it stands for depth in all that follows.
struct ShapeRecord {
    Float3Int axis_x;  // w: shape type
    Float3Int axis_y;  // w: shape id
    Float3Int axis_z;  // w: asset, the index of a mesh or height field
    Float3Int origin;  // the camera's centre in the shape's frame; w: see shadow/casters.h, else unused
    // plane: half widths, 0 infinite; capsule: x = half length / radius; barrel: x = half length, y = radius of
    // its side's arc, both / end radius; height field: half widths, base depth; mesh: x = greatest
    // magnitude of its box, y, z = bits of Meshes.node_start and Meshes.face_start. w: bits of `nearest`,
    // a lower bound of the planar depth of every point of the shape
    Float3Int size;
};

// True if a face is visible from behind, by its second row: see Meshes.faces.
template <class Types> WARPCAM_DEVICE bool has_back(int mark) { return (Types::has(TWO_SIDED)) && mark != 0; }

// True if the corners of a face have the face's own normal, by its second and third row.
template <class Types> WARPCAM_DEVICE bool is_flat(int back, int mark) { return has_back<Types>(back) && mark != 0; }

template <class Types> WARPCAM_DEVICE bool is_mesh(const ShapeRecord& record)
{
    return (Types::has(MESH)) && record.axis_x.w == MESH;
}

struct Ray {
    Vec3 origin, direction;  // in the shape's frame
};

// The ray's own view of space: coordinates in which it runs from the origin along depth alone.
struct RayFrame {
    Vec3 origin;
    Vec3 across, up, depth;  // rows; across x up points against the ray, depth . (t * direction) is t
};

// For a frame that may be scaled. It depends on the ray only, and is never mirrored.
WARPCAM_DEVICE RayFrame frame_along(const Ray& ray)
{
    const Vec3 d = ray.direction;
    const bool steep = abs(d.z) > abs(d.x);
    const Vec3 across = steep ? Vec3 { 0.0f, d.z, -d.y } : Vec3 { d.y, -d.x, 0.0f };
    const float rate = rcp(dot(d, d));
    return { ray.origin,
             across,
             { across.y * d.z - across.z * d.y, across.z * d.x - across.x * d.z, across.x * d.y - across.y * d.x },
             { rate * d.x, rate * d.y, rate * d.z } };
}

// The ray of a view through (x, y) of its image.
template <int LENS> struct CameraRay {
    float x, y;

    WARPCAM_DEVICE Vec3 direction() const  // in the camera's frame; of a table's ray: see camera/ray_table.h
    {
        if (LENS != RAYS)
            return { LENS == PINHOLE ? x : 0.0f, LENS == PINHOLE ? y : 0.0f, -1.0f };
        const float rate = 2.0f * rcp(1.0f + x * x + y * y);
        return { rate * x, rate * y, 1.0f - rate };
    }

    WARPCAM_DEVICE Ray local(const ShapeRecord& record) const
    {
        const Float3Int ax = record.axis_x, ay = record.axis_y, az = record.axis_z, o = record.origin;
        if constexpr (LENS == RAYS) {
            return { { o.x, o.y, o.z }, transform_rows(record, direction()) };
        }
        if (LENS == ORTHOGRAPHIC)
            return { { o.x + ax.x * x + ax.y * y, o.y + ay.x * x + ay.y * y, o.z + az.x * x + az.y * y },
                     { -ax.z, -ay.z, -az.z } };
        return { { o.x, o.y, o.z },
                 { (ax.x * x - ax.z) + ax.y * y, (ay.x * x - ay.z) + ay.y * y, (az.x * x - az.z) + az.y * y } };
    }

    template <class Types> WARPCAM_DEVICE RayFrame frame(const ShapeRecord& record) const
    {
        if constexpr (Types::has(PER_SHAPE_SCALE) || LENS == RAYS)
            return frame_along(local(record));
        const Float3Int ax = record.axis_x, ay = record.axis_y, az = record.axis_z;
        const Vec3 origin = local(record).origin;
        const Vec3 depth { -ax.z, -ay.z, -az.z };
        if (LENS == ORTHOGRAPHIC)
            return { origin, { ax.x, ay.x, az.x }, { ax.y, ay.y, az.y }, depth };
        return { origin,
                 { fma(x, ax.z, ax.x), fma(x, ay.z, ay.x), fma(x, az.z, az.x) },
                 { fma(y, ax.z, ax.y), fma(y, ay.z, ay.y), fma(y, az.z, az.y) },
                 depth };
    }
};

// Camera ray that starts at `near`, its own planar depth.
template <int LENS> struct ClippedRay : CameraRay<LENS> {
    float near;
};

// From where on a ray sees, in a view that sees from `near` on.
template <int LENS> WARPCAM_DEVICE float near_of(const CameraRay<LENS>&, float near) { return near; }
template <int LENS> WARPCAM_DEVICE float near_of(const ClippedRay<LENS>& ray, float) { return ray.near; }

}  // namespace warpcam
